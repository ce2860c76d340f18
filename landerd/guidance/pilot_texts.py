"""Everything the core tells the pilot, word for word.

As STATUSTEXT, with "landerd: " before it, cut at 50 characters, each line once a second at most:

| when | severity | text |
|---|---|---|
| landerd does not fly, or without sight, or for a while without own data | WARNING | the reason |
| landerd may fly and does not begin, again after REMIND_S | WARNING | the reason |
| a phase of the landing begins | NOTICE | the phase, where there is room, and the reason |
| the landing has gone on for RESUMED_S, the pad in sight again | NOTICE | phase and reason |
| it is where the pilot asked to hold | NOTICE | HOLDING_OVER |
| a descent is broken off with the pad in sight | WARNING | the reason |
| the switch must be low first (RC_LATCHED), again after REMIND_S | WARNING | the reason |
| sight suffices still; again after REMIND_S | WARNING | MANY_REFUSED, LATE_PICTURES |
| own data are missing for moments, again after REMIND_S | WARNING | NOW_AND_THEN |
| its climb rate is wrong, again after REMIND_S | WARNING | WRONG_CLIMB_RATE |
| it comes neither nearer nor to descend, every REMIND_S | WARNING | the reason, or KEPT_OFF |
| velocities are not flown as ordered, every `state_flying.UNFOLLOWED_S` | WARNING | UNFOLLOWED |
| landerd hands back | CRITICAL | the reason, and HANDED_BACK |
| held up higher over the pad than the build allows | WARNING | TOUCHED_HIGH |
| it turns over on the ground | CRITICAL | the reason |
| on the pad, and the land detector is silent, every REMIND_UNCONFIRMED_S | CRITICAL | UNCONFIRMED |
| the same, and disarming is refused | CRITICAL | NOT_DISARMED |

A reason is also recorded with every change of phase. What hands back is in `states.HAND_BACKS`.
"""

from collections.abc import Mapping

from landerd.guidance.states import Event

PREFIX = "landerd: "
MAX_CHARACTERS = 50  # of a STATUSTEXT
REPEAT_S = 1.0  # the same line is not told more often: a bound for the link, chosen by hand
# That a landing goes on is told once more after this time, s: if the line of its phase were lost,
# the pilot would read "holding" for the whole of a descent.
RESUMED_S = 2.0
REMIND_S = 10.0  # what waits for the pilot's hand is told again: a line may be lost, or not be read
# No longer than guidance.touchdown_timeout_s may be: of one that touches anew it is told in time.
REMIND_UNCONFIRMED_S = 5.0

# ---- who flies (guidance.gate) -----------------------------------------------------------------
STARTING = "starting"
NO_HEARTBEAT = "no heartbeat from the autopilot"
NOT_ARMED = "not armed"
NOT_GUIDED = "mode is {mode}, not GUIDED"
FAILED = f"{PREFIX}failed: pilot, take over"
TOLD_TO_STOP = "told to stop: take over"
RC_STALE = "RC channels are stale"
RC_NO_SIGNAL = "RC {channel} has no signal"
RC_LOW = "RC {channel} is low"
RC_LATCHED = "move RC {channel} low, then high"
_SWITCH_WANTED = RC_LATCHED.partition("{")[0]
GRANTED = "granted"  # never told: a phase is instead
PRECISION_LANDING = "left to the autopilot's precision landing"

# ---- why an event led to another state ---------------------------------------------------------
# Of the others the gate, the phases or the search say why.
REASONS: Mapping[Event, str] = {
    Event.PAD_IN_SIGHT: "pad in sight",
    Event.DISARMED: "landed and disarmed",
    Event.DISARMED_OFF_PAD: "disarmed beside the pad",
    Event.DISARMED_TIPPED: "disarmed, tipped over",
    Event.PAD_MISSED: "pad missed",
    Event.HOLD_ASKED: "asked to hold",
    Event.PAD_NOT_FOUND: "pad not found",
    Event.NO_LANDING_POSSIBLE: "no landing possible",
    Event.HEADING_NOT_SEEN: "pad's heading not seen",
    Event.TOOK_TOO_LONG: "no landing in time",
    Event.TURNS_OVER: "turns over, disarm by hand",
}
HANDED_BACK = "{reason}: pilot, take over"

# ---- with the pad in sight (guidance.phases) ---------------------------------------------------
UNDER_WAY = "{distance:.1f} m away, {height:.1f} m up"
HOLDING_OVER = "holding over the marker, switch to land"
TURNING = "heading {error:.0f} degrees off"
UNSURE = "pad known to {known:.1f} m, descends with {radius:.1f}"
# In DESCENT: as far as it came since it last got lower.
KEPT_OFF = "up to {off:.1f} m off, descends within {radius:.1f} m"
NO_HEADING = "pad's heading not seen"
NO_HEADING_CLIMBING = "pad's heading not seen, climbing again"
LEANS = "leans too far: {lean:.0f} degrees"
OFF_CLIMBING = "off by {distance:.2f} m, climbing again"
# Below the commit height, and nearer than that: why it is not carried through.
MAY_MISS_CLIMBING = "may miss by {distance:.2f} m, climbing again"
SLIDES_CLIMBING = "{speed:.2f} m/s across, climbing again"
SINKS_CLIMBING = "sinks at {speed:.2f} m/s, climbing again"
OLD_SIGHT_CLIMBING = "pictures too old, climbing again"

# Before it matters: the words say where to look.
MANY_REFUSED = "many sightings refused: camera, gimbal?"
LATE_PICTURES = "pictures come late: camera, computer?"
WRONG_CLIMB_RATE = "climb rate wrong: EKF?"  # the height says otherwise
UNFOLLOWED = "flies {off:.1f} m/s off its orders: autopilot?"

# ---- out of sight ------------------------------------------------------------------------------
STALE: Mapping[str, str] = {  # by Estimator.stale
    "attitude": "attitude is stale",
    "position": "position is stale",
    "gimbal": "gimbal angles are stale",
}
NO_PICTURES = "no pictures from camera"
OLD_PICTURES = "pictures come too late"
NOT_IN_SIGHT = "pad not in sight"
OTHER_PAD = "another pad, tag {id}, seen"
NOT_BELIEVED = "pad seen but not believed"  # it would be elsewhere than where it was
UNPLACED = "pad seen, but no telemetry"  # nor any near enough to it
NOW_AND_THEN = "{why} now and then: link?"
BLIND = "{why}, {what}"  # one of those above, and what is done about it:
CLIMBING_AWAY = "climbing away"  # so too when it may not fly on, or the pad is missed
HOLDING, CLIMBING, SEARCHING = "holding", "climbing", "searching"
WITHOUT_SIGHT = (HOLDING, CLIMBING, SEARCHING, CLIMBING_AWAY)  # ends of such reasons

# ---- on the pad --------------------------------------------------------------------------------
STANDS = "stands on the pad"
MAY_STAND = "pad in sight, stands on it?"
HOLDS_IN_THE_AIR = "on the pad: holding begins in the air"
TOUCHED_HIGH = "touched {height:.2f} m up: gear, camera?"  # gear_height_m, camera_offset_m
UNCONFIRMED = "touch-down not confirmed, disarm by hand"
NOT_DISARMED = "autopilot does not disarm: disarm by hand"  # though it says that it has landed


def asks_for_switch(reason: str) -> bool:
    """Tell whether a reason asks the pilot to move the switch: nothing happens until he does."""
    return reason.startswith(_SWITCH_WANTED)
