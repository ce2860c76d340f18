"""The states of a landing, and which event leads where: the table to read first.

Each control step the gate says who flies, and the state says what is ordered or which event has
happened; the table below says where that leads, and the new state has its turn in the same step.
What a state orders is in its class (`state_silent`, `state_flying`, `state_committed`,
`state_on_pad`, `state_leaving`), what the pilot is told in `pilot_texts`. The thesis's phases
(`phases`, messages.Phase) are what the pilot and the log see: APPROACH to DESCENT while TRACKING,
LANDED while COMMITTED and ON_PAD, else NOT_LANDING.
"""

from collections.abc import Mapping
from enum import Enum


class State(Enum):
    """What landerd is doing about the landing; beside each what it orders."""

    SILENT = "silent"  # nothing: the pilot or a ground station flies
    RELEASING = "releasing"  # zero velocity for guidance.release_s: its last order must not live on
    # to the pad and down, as phase and guidance.method say; while the pilot asks to hold, at
    # guidance.hold.height_m over it and not down
    TRACKING = "tracking"
    SEARCHING = "searching"  # hover, then climb (guidance.lost), without turning or sinking
    COMMITTED = "committed"  # down onto the pad, no longer bound by region and heading
    WAVING_OFF = "waving off"  # up from the pad at the pad's velocity, for a moment
    LEAVING = "leaving"  # the same when landerd may not fly on: a stop would tip the vehicle over
    ON_PAD = "on the pad"  # with the pad and down; once still, level without thrust; then disarm
    STANDING = "standing"  # level without thrust for guidance.release_s, as it may not fly on


class Event(Enum):
    """What leads from one state to another."""

    # From the gate (guidance.gate), in every control step one of these:
    GRANTED = "armed, GUIDED, switch high: landerd may fly"
    RELEASED = "switch low, RC or heartbeat stale, autopilot restarted, latched, about to end"
    RELEASED_LOW = "the same, just over a pad that moves, or touching it but not standing yet"
    RELEASED_TOUCHING = "the same, as feet seem to touch a slower one, or do while it is stopped"
    TURNS_OVER = "either, but it leans as no multicopter flies, just over the pad"
    SILENCED = "not armed or not GUIDED"
    DISARMED = "silenced because disarmed, all feet on the pad as last seen"
    DISARMED_OFF_PAD = "the same, a foot beside the pad as last seen"
    DISARMED_TIPPED = "the same, leaning more than any pad does"
    # From the states:
    RELEASE_OVER = "stop orders were streamed for long enough"
    PAD_IN_SIGHT = "pad confirmed, last sighting and telemetry young"
    SIGHT_LOST = "last sighting or telemetry too old"
    SIGHT_LOST_LOW = "the same, just over a pad that moves, not committed yet"
    PAD_MISSED = "would touch beside the pad, or slide across it"
    HOLD_ASKED = "the pilot asks to hold after all, not touching yet"
    CLEAR_OF_PAD = "climbed away from the pad"
    STANDS = "stands still on the pad, whatever was ordered"
    COMMITS = "just over the pad, and the touch-down will be good, or it stands there already"
    CONTACT = "feet on the pad, or ON_GROUND said since commit"
    NO_CONTACT = "seen to rise from the pad: what was taken for contact was none"
    # Hand-backs to the pilot, who must have the switch low before landerd flies again:
    PAD_NOT_FOUND = "searched for guidance.lost.give_up_s"
    NO_LANDING_POSSIBLE = "too many descents were refused or broken off, or none may begin"
    HEADING_NOT_SEEN = "waited over the pad for its heading for guidance.lost.give_up_s"
    TOOK_TOO_LONG = "did not come to commit within guidance.lost.total_s"


HAND_BACKS = (
    Event.PAD_NOT_FOUND,
    Event.NO_LANDING_POSSIBLE,
    Event.HEADING_NOT_SEEN,
    Event.TOOK_TOO_LONG,
)

LANDED = (Event.DISARMED, Event.DISARMED_OFF_PAD, Event.DISARMED_TIPPED)

# Whatever it flies: released, it stops first, where need be after leaving the pad; silenced, not
# even that may be sent (rule 1a).
_FLYING = {
    Event.RELEASED: State.RELEASING,
    Event.RELEASED_LOW: State.LEAVING,
    Event.SILENCED: State.SILENT,
    Event.TURNS_OVER: State.ON_PAD,  # thrust would throw it about
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
        # RC was only stale, and it sees the pad. Else it goes on stopping for as long as it may
        # fly: a moment of fresh RC is no reason to fall silent.
        Event.PAD_IN_SIGHT: State.TRACKING,
        # Nor for longer than a search lasts.
        Event.PAD_NOT_FOUND: State.RELEASING,
        Event.NO_LANDING_POSSIBLE: State.RELEASING,
        # Released just over the pad it came down on while it was stopped.
        Event.RELEASED_TOUCHING: State.STANDING,
        Event.TURNS_OVER: State.STANDING,
    },
    State.TRACKING: {
        **_FLYING,
        Event.COMMITS: State.COMMITTED,
        # No sighting for guidance.lost.after_s, or position or attitude stale.
        Event.SIGHT_LOST: State.SEARCHING,
        Event.SIGHT_LOST_LOW: State.WAVING_OFF,  # to hover would be to touch it, stopped
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
        # Before contact was sure: stopped there for good it would stand with thrust.
        Event.RELEASED_TOUCHING: State.STANDING,
        Event.CONTACT: State.ON_PAD,
        # No sighting for so long that contact would come too late (until then it sinks on with the
        # pad as last known), or position or attitude stale.
        Event.SIGHT_LOST: State.WAVING_OFF,
        # A pad that stops, starts, jerks or is carried away under it.
        Event.PAD_MISSED: State.WAVING_OFF,
        Event.HOLD_ASKED: State.WAVING_OFF,
    },
    State.WAVING_OFF: {
        **_FLYING,
        # From there on to TRACKING in the same step if it sees the pad. Counts as a descent broken
        # off (guidance.lost.retries).
        Event.CLEAR_OF_PAD: State.SEARCHING,
        # Its data were stale as it touched.
        Event.STANDS: State.ON_PAD,
    },
    State.LEAVING: {
        Event.CLEAR_OF_PAD: State.RELEASING,
        # Before its thrust came back to climb with.
        Event.STANDS: State.STANDING,
        Event.SILENCED: State.SILENT,
        Event.TURNS_OVER: State.STANDING,
    },
    State.ON_PAD: {
        **_FLYING,
        # Before it stands, which ends sight: no picture is even searched then.
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

# How a landing ends by an event. The first outcome of a landing is kept: what follows (after a
# hand-back the release) is its consequence. `touchdown_unconfirmed` is no end (see OnPad): it may
# be confirmed yet.
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
