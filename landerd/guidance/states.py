"""The states of a landing, its events, and which event leads to which state: read this first.

In each control step the gate says who flies, as an event. If the table below has a transition for
it, that is followed. Then the current state either makes its orders or returns an event of its own;
the state that this leads to has its turn in the same step.

What a state orders is in its class (`state_silent`, `state_flying`, `state_committed`,
`state_on_pad`, `state_leaving`), what the pilot is told in `pilot_texts`. The pilot and the log see
the thesis's phases (`phases`, messages.Phase): APPROACH to DESCENT while TRACKING, LANDED while
COMMITTED and ON_PAD, else NOT_LANDING.
"""

from collections.abc import Mapping
from enum import Enum


class State(Enum):
    """What landerd is doing; the comment beside each state says what it orders."""

    SILENT = "silent"  # nothing: the pilot or a ground station flies
    # Zero velocity for guidance.release_s: the autopilot would go on flying the last order.
    RELEASING = "releasing"
    # To the pad and down, by phase and guidance.method. While the pilot asks to hold: no lower than
    # guidance.hold.height_m over the pad.
    TRACKING = "tracking"
    SEARCHING = "searching"  # hover, then climb (guidance.lost), without turning or sinking
    COMMITTED = "committed"  # down onto the pad, no longer bound by descent region and heading
    WAVING_OFF = "waving off"  # up from the pad at the pad's velocity, for a moment
    # The same, when landerd may not fly on but a stop would tip the vehicle over.
    LEAVING = "leaving"
    # Down, at the pad's velocity; once the vehicle stands still, level without thrust; then disarm.
    ON_PAD = "on the pad"
    # Level without thrust for guidance.release_s, because landerd may not fly on.
    STANDING = "standing"


class Event(Enum):
    """What leads from one state to another; the value says when it happens."""

    # From the gate (guidance.gate) and what is known of vehicle and pad: one in every control step.
    GRANTED = "armed, GUIDED, switch high: landerd may fly"
    RELEASED = "switch low, RC or heartbeat stale, autopilot restarted, latched, about to end"
    RELEASED_LOW = "RELEASED just over a pad that moves, or touching it but not standing yet"
    RELEASED_TOUCHING = "RELEASED as the feet seem to touch a pad slow enough to stop on"
    TURNS_OVER = "not SILENCED, but the vehicle leans as none flies, just over the pad"
    SILENCED = "not armed or not GUIDED"
    DISARMED = "SILENCED because disarmed, all feet on the pad as last seen"
    DISARMED_OFF_PAD = "SILENCED because disarmed, a foot beside the pad as last seen"
    DISARMED_TIPPED = "SILENCED because disarmed, leaning more than any pad"
    # From the states:
    RELEASE_OVER = "stop orders were streamed for guidance.release_s"
    PAD_IN_SIGHT = "pad confirmed, last sighting and telemetry fresh"
    SIGHT_LOST = "last sighting or telemetry too old"
    SIGHT_LOST_LOW = "SIGHT_LOST just over a pad that moves, before commit"
    PAD_MISSED = "the feet would touch beside the pad, or slide across it"
    HOLD_ASKED = "the pilot asks to hold after commit, before the feet touch"
    CLEAR_OF_PAD = "climbed away from the pad"
    STANDS = "the vehicle stands still on the pad although told to climb"
    COMMITS = "just over the pad with a good touch-down ahead, or standing on it already"
    CONTACT = "feet on the pad, or ON_GROUND reported since commit"
    NO_CONTACT = "the contact was a false one: it is seen to rise, or sinks on out of sight"
    # Hand-backs: the pilot must put the switch low before landerd flies again.
    PAD_NOT_FOUND = "searched for guidance.lost.give_up_s"
    NO_LANDING_POSSIBLE = "too many descents were refused or broken off, or none may begin"
    HEADING_NOT_SEEN = "waited over the pad for its heading for guidance.lost.give_up_s"
    TOOK_TOO_LONG = "no commit within guidance.lost.total_s"


HAND_BACKS = (
    Event.PAD_NOT_FOUND,
    Event.NO_LANDING_POSSIBLE,
    Event.HEADING_NOT_SEEN,
    Event.TOOK_TOO_LONG,
)

LANDED = (Event.DISARMED, Event.DISARMED_OFF_PAD, Event.DISARMED_TIPPED)

# From every state that flies: once released the vehicle is stopped, where need be after it has left
# the pad; once silenced not even a stop may be sent (rule 1a).
_FLYING = {
    Event.RELEASED: State.RELEASING,
    Event.RELEASED_LOW: State.LEAVING,
    Event.SILENCED: State.SILENT,
    Event.TURNS_OVER: State.ON_PAD,  # with thrust it would be thrown about
}

# An event that is not in its state's row changes nothing.
TRANSITIONS: Mapping[State, Mapping[Event, State]] = {
    State.SILENT: {
        # Before the first accepted sighting, and after every landing (rule 1c).
        Event.PAD_IN_SIGHT: State.TRACKING,
    },
    State.RELEASING: {
        Event.RELEASE_OVER: State.SILENT,
        Event.SILENCED: State.SILENT,
        # RC was only stale, and the pad is in sight. Without sight of it stop orders go on while
        # landerd may fly: a moment of fresh RC is no reason to fall silent.
        Event.PAD_IN_SIGHT: State.TRACKING,
        # But for no longer than a search lasts: handed back, it is released for the last time.
        Event.PAD_NOT_FOUND: State.RELEASING,
        Event.NO_LANDING_POSSIBLE: State.RELEASING,
        # Released just over the pad, it came down on the pad while it was stopped.
        Event.RELEASED_TOUCHING: State.STANDING,
        Event.TURNS_OVER: State.STANDING,
    },
    State.TRACKING: {
        **_FLYING,
        Event.COMMITS: State.COMMITTED,
        # No sighting for guidance.lost.after_s, or position or attitude stale.
        Event.SIGHT_LOST: State.SEARCHING,
        Event.SIGHT_LOST_LOW: State.WAVING_OFF,  # a hover would touch the moving pad
        Event.NO_LANDING_POSSIBLE: State.RELEASING,
        Event.HEADING_NOT_SEEN: State.RELEASING,
        Event.TOOK_TOO_LONG: State.RELEASING,
    },
    State.SEARCHING: {
        **_FLYING,
        Event.PAD_IN_SIGHT: State.TRACKING,
        Event.PAD_NOT_FOUND: State.RELEASING,
        Event.NO_LANDING_POSSIBLE: State.RELEASING,
        Event.TOOK_TOO_LONG: State.RELEASING,
    },
    State.COMMITTED: {
        **_FLYING,
        # Before contact was certain: with zero velocity ordered it would stand there with thrust.
        Event.RELEASED_TOUCHING: State.STANDING,
        Event.CONTACT: State.ON_PAD,
        # No sighting for so long that contact would come too late (until then it descends to the
        # pad as last known), or position or attitude stale.
        Event.SIGHT_LOST: State.WAVING_OFF,
        # The pad stops, starts, jerks or is carried away under the vehicle.
        Event.PAD_MISSED: State.WAVING_OFF,
        Event.HOLD_ASKED: State.WAVING_OFF,
    },
    State.WAVING_OFF: {
        **_FLYING,
        # From SEARCHING on to TRACKING in the same step if the pad is in sight. Counts as a descent
        # broken off (guidance.lost.retries).
        Event.CLEAR_OF_PAD: State.SEARCHING,
        # It touched while its data were stale.
        Event.STANDS: State.ON_PAD,
    },
    State.LEAVING: {
        Event.CLEAR_OF_PAD: State.RELEASING,
        # Thrust had not come back for the climb.
        Event.STANDS: State.STANDING,
        Event.SILENCED: State.SILENT,
        Event.TURNS_OVER: State.STANDING,
    },
    State.ON_PAD: {
        **_FLYING,
        # Only before it stands still: then pictures are not searched any more.
        Event.NO_CONTACT: State.COMMITTED,
        Event.RELEASED: State.STANDING,
        Event.DISARMED: State.SILENT,
        Event.DISARMED_OFF_PAD: State.SILENT,
        Event.DISARMED_TIPPED: State.SILENT,
    },
    State.STANDING: {
        Event.RELEASE_OVER: State.SILENT,
        Event.SILENCED: State.SILENT,
        # RC was only stale.
        Event.GRANTED: State.ON_PAD,
    },
}

# The outcome that an event gives a landing. The first one is kept: what follows (the release after
# a hand-back) is its consequence. `touchdown_unconfirmed` (see OnPad) is not final: touch-down may
# still be confirmed.
OUTCOMES: Mapping[Event, str] = {
    Event.DISARMED: "landed",
    Event.DISARMED_OFF_PAD: "landed_off_pad",
    Event.DISARMED_TIPPED: "tipped_over",
    Event.SILENCED: "taken over",
    Event.RELEASED: "released",
    Event.RELEASED_LOW: "released",
    Event.RELEASED_TOUCHING: "released",
    **dict.fromkeys(HAND_BACKS, "handed_back"),
}
