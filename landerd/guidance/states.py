"""The states of a landing, and which event leads where: the table to read first.

Each control step the gate says who flies, and the state says what is ordered or which event has
happened; the table below says where that leads, and the new state has its turn in the same step.
What a state orders is in its class (`state_silent`, `state_flying`, `state_pad`), what the pilot is
told in `pilot_texts`. The thesis's phases (`phases`, messages.Phase) are what the pilot and the log
see: APPROACH to DESCENT while TRACKING, LANDED while COMMITTED and ON_PAD, else NOT_LANDING.
"""

from collections.abc import Mapping
from enum import Enum


class State(Enum):
    """What landerd is doing about the landing; beside each what it orders."""

    SILENT = "silent"  # nothing: the pilot or a ground station flies
    RELEASING = "releasing"  # zero velocity for guidance.release_s: its last order must not live on
    TRACKING = "tracking"  # to the pad and down, as phase and guidance.method say
    SEARCHING = "searching"  # hover, then climb (guidance.lost), without turning or sinking
    COMMITTED = "committed"  # down onto the pad, no longer bound by region and heading
    ON_PAD = "on the pad"  # with the pad and down; once still, level without thrust; then disarm


class Event(Enum):
    """What leads from one state to another."""

    # From the gate (guidance.gate), in every control step one of these:
    GRANTED = "armed, GUIDED, switch high: landerd may fly"
    RELEASED = "in GUIDED, but switch low, RC stale, latched or landerd about to end"
    SILENCED = "not armed, not GUIDED or no heartbeat"
    DISARMED = "silenced because disarmed, on the pad"
    # From the states:
    RELEASE_OVER = "stop orders were streamed for long enough"
    PAD_IN_SIGHT = "pad confirmed, last sighting and telemetry young"
    SIGHT_LOST = "last sighting or telemetry too old"
    COMMITS = "just over the pad, and the touch-down will be good"
    CONTACT = "feet on the pad, or ON_GROUND said since commit"
    # Hand-backs to the pilot, who must have the switch low before landerd flies again:
    PAD_NOT_FOUND = "searched for guidance.lost.give_up_s, or too many descents were broken off"
    NO_LANDING_POSSIBLE = "too many descents were refused at commit"
    HEADING_NOT_SEEN = "waited over the pad for its heading for guidance.lost.give_up_s"


HAND_BACKS = (Event.PAD_NOT_FOUND, Event.NO_LANDING_POSSIBLE, Event.HEADING_NOT_SEEN)

# Whatever it flies: released, it stops first; silenced, not even that may be sent (rule 1a).
_FLYING = {Event.RELEASED: State.RELEASING, Event.SILENCED: State.SILENT}

# An event that is not in its state's row changes nothing.
TRANSITIONS: Mapping[State, Mapping[Event, State]] = {
    State.SILENT: {
        # Before the first accepted sighting, and after every landing (rule 1c).
        Event.PAD_IN_SIGHT: State.TRACKING,
    },
    State.RELEASING: {
        Event.RELEASE_OVER: State.SILENT,
        Event.SILENCED: State.SILENT,
        # RC was only stale. From SILENT it goes on to TRACKING in the same step if it sees the pad.
        Event.GRANTED: State.SILENT,
    },
    State.TRACKING: {
        **_FLYING,
        Event.COMMITS: State.COMMITTED,
        # No sighting for guidance.lost.after_s, or position or attitude stale.
        Event.SIGHT_LOST: State.SEARCHING,
        Event.NO_LANDING_POSSIBLE: State.RELEASING,
        Event.HEADING_NOT_SEEN: State.RELEASING,
    },
    State.SEARCHING: {
        **_FLYING,
        Event.PAD_IN_SIGHT: State.TRACKING,
        Event.PAD_NOT_FOUND: State.RELEASING,
    },
    State.COMMITTED: {
        **_FLYING,
        Event.CONTACT: State.ON_PAD,
        # No sighting for touchdown.MAX_BLIND_S (until then it sinks on with the pad as last known),
        # or position or attitude stale. It is low, so it climbs at once instead of holding first;
        # without a position it holds. Counts as a descent broken off (guidance.lost.retries).
        Event.SIGHT_LOST: State.SEARCHING,
    },
    State.ON_PAD: {
        **_FLYING,
        # Sight plays no part any more: no picture is even searched.
        Event.DISARMED: State.SILENT,
    },
}

# How a landing ends by an event. The first outcome of a landing is kept: what follows (after a
# hand-back the release) is its consequence. `touchdown_unconfirmed` is no end: see OnPad.
OUTCOMES: Mapping[Event, str] = {
    Event.DISARMED: "landed",
    Event.SILENCED: "taken over",
    Event.RELEASED: "released",
    **dict.fromkeys(HAND_BACKS, "handed_back"),
}
