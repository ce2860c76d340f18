"""The `sim.faults` block: the faults of a simulated flight, their onset, duration and severity.

`FAULTS` is the one table of all faults; `hw.sim.faults` makes them happen.
"""

from collections.abc import Mapping
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, model_validator

from landerd.section import NotNegative, Positive, Section

PHASES = ("APPROACH", "CLOSE_APPROACH", "YAW_CORRECTION", "DESCENT", "LANDED")  # in this order
PhaseName = Literal["APPROACH", "CLOSE_APPROACH", "YAW_CORRECTION", "DESCENT", "LANDED"]


class FaultKind(NamedTuple):
    """One kind of fault."""

    device: str
    does: str  # the fault, and its range from severity 0 to 1, for docs/faults.md
    ends: bool = True  # false: it is momentary, and `for_s` is ignored
    # Beginnings of the broken rules and findings that are excused, as no landerd could avoid them
    # during the fault and shortly after.
    excuses: tuple[str, ...] = ()
    lands: bool = True  # false: no landing is expected any more
    in_sitl: bool = True  # false: only flights with the simulated autopilot can have it
    stays: bool = False  # its effect lasts until the flight ends


# ---- what excuses broken rules ------------------------------------------------------------------

# A process that is blocked, is gone or cannot send sends no orders. The vehicle keeps descending
# until the autopilot's timeout stops it (just over the pad: onto the pad), without seeing the pad.
_SILENT = (
    "3: set-points less often",
    "1b: silent without stop orders",
    "motion on a set-point older",
    "2: contact too long after the last sighting",
    "4: no descent ordered after contact",
    "4: a climb ordered while standing",
)

# Once the vehicle stands, pictures are no longer searched; if the pad is pulled away from under its
# first foot, it stands on the ground.
_UNDER_ITS_FEET = (
    "6: said to have landed",
    "4: not going with",
    "4: level and without thrust while it slides",
    "descends below",
)
# Until sightings show that the pad rises, the vehicle descends at its earlier rate.
_COMES_UP = ("2: sinking faster than the autopilot",)
# On a pad that is carried away, going with it is as good as leaving it.
_CARRIED = (*_COMES_UP, "4: no descent", "4: not going with", "4: a climb ordered")
# Wrong gimbal angles shift the pad's apparent position by as much; if they drift, the pad seems to
# drive.
_SEEN_ASIDE = ("2: a downward set-point outside the descent region",)
# They also turn the pad's apparent heading: by the error of the yaw and, while the airframe leans,
# by a part of the error of the pitch.
_SEEN_TURNED = (*_SEEN_ASIDE, "2: a downward set-point with the heading off")
# No order arrives: the vehicle flies the last one until the autopilot's timeout stops it, even with
# its feet on a driving pad.
_UNHEARD = ("ground contact off the pad", "tipped over 30 degrees")
_CUT_OFF = (*_SILENT, *_UNHEARD)
# Another flight mode begins with a stop, which tips over a vehicle standing on a driving pad.
_LED_AWAY = ("tipped over in the hands of others",)
# With wrong velocities, orders meant to go with the pad move the vehicle across it.
_GOES_BY_WRONG_VELOCITIES = ("4: not going with",)
# landerd may not fly: the autopilot stops a vehicle that has come down on a driving pad.
_LEFT_THERE = ("tipped over",)
# Its successor is latched, and may not fly at once.
_KILLED = (*_SILENT, *_LEFT_THERE)
# A gust accelerates the airframe at once, whatever is ordered.
_BLOWN = ("accelerates more than the limits",)

FAULTS: Mapping[str, FaultKind] = {
    # -- pictures, on their way and as they are ----------------------------------------------------
    "pictures-lost": FaultKind("camera", "pictures are lost: 30 % to all"),
    "pictures-late": FaultKind("camera", "they arrive 0.1 to 1 s late, with their own times"),
    "pictures-repeated": FaultKind("camera", "the last one comes again with its old time"),
    "pictures-swapped": FaultKind("camera", "10 to 100 % come after the next one"),
    "pictures-frozen": FaultKind("camera", "the last one comes again with new times"),
    "pictures-black": FaultKind("camera", "all black"),
    "pictures-white": FaultKind("camera", "all white"),
    "pictures-half": FaultKind("camera", "the lower half is missing"),
    "pictures-mirrored": FaultKind("camera", "left and right are changed over"),
    "pictures-small": FaultKind("camera", "of another size"),
    "pictures-wide": FaultKind("camera", "of 16 bits"),
    "stamps-shifted": FaultKind("camera", "their times are 10 to 300 ms too early"),
    "stamps-ahead": FaultKind("camera", "their times are 10 ms to 3 s too late"),
    "stamps-jumping": FaultKind("camera", "their times jump by up to 10 to 200 ms"),
    "stamps-frozen": FaultKind("camera", "all have the same time"),
    "camera-lost": FaultKind("camera", "unplugged"),
    "camera-raises": FaultKind("camera", "its driver has an error nobody foresaw", ends=False),
    # -- what is to be seen ------------------------------------------------------------------------
    "pad-dirty": FaultKind("scene", "10 to 60 % of the plate is covered"),
    "pad-shaded": FaultKind("scene", "leaves take 20 to 90 % of the light by flecks"),
    "pad-gone": FaultKind("scene", "the pad cannot be seen any more: wholly covered"),
    "decoys": FaultKind("scene", "5 to 30 things like markers lie about"),
    "second-pad": FaultKind("scene", "another pad of the same ids lies 2 to 6 m beside it"),
    # -- the pad moves -----------------------------------------------------------------------------
    "pad-stops": FaultKind("pad", "it brakes to a stand at 1 to 8 m/s2", ends=False),
    "pad-starts": FaultKind("pad", "it speeds up by 0.5 to 3 m/s at 2 m/s2", ends=False),
    "pad-jerks": FaultKind("pad", "it jumps aside by 0.1 to 1 m in 0.2 s", False, _UNDER_ITS_FEET),
    "pad-turns": FaultKind("pad", "it turns about itself at 5 to 40 degrees/s"),
    "pad-lifted": FaultKind(
        "pad", "it rises by 0.1 to 1 m at 0.5 m/s", False, _COMES_UP, in_sitl=False
    ),
    "pad-carried-away": FaultKind(
        "pad", "it rises by 1 m and goes off at 1 to 5 m/s", False, _CARRIED, False, in_sitl=False
    ),
    # -- gimbal ------------------------------------------------------------------------------------
    "gimbal-silent": FaultKind("gimbal", "reports no angles"),
    "gimbal-frozen": FaultKind("gimbal", "reports the same angles for ever"),
    "gimbal-nan": FaultKind("gimbal", "reports angles that are no numbers"),
    "gimbal-lost": FaultKind("gimbal", "gone from the bus"),
    "gimbal-late": FaultKind("gimbal", "reports are 20 to 300 ms old and do not say so"),
    "gimbal-offset": FaultKind(
        "gimbal", "reports both angles 1 to 20 degrees too large", True, _SEEN_TURNED
    ),
    "gimbal-slipping": FaultKind(
        "gimbal", "reports drift off at 0.5 to 10 degrees/s", True, _SEEN_TURNED, stays=True
    ),
    "gimbal-stuck": FaultKind("gimbal", "the axes do not move"),
    "gimbal-reversed": FaultKind("gimbal", "it turns the other way than ordered"),
    "gimbal-raises": FaultKind("gimbal", "its driver has an error nobody foresaw"),
    # -- what the autopilot says -------------------------------------------------------------------
    "attitude-lost": FaultKind("telemetry", "no ATTITUDE"),
    "attitude-late": FaultKind("telemetry", "ATTITUDE comes 50 to 500 ms late"),
    "attitude-frozen": FaultKind("telemetry", "ATTITUDE repeats itself with new times"),
    "attitude-biased": FaultKind(
        "telemetry", "roll and pitch are 1 to 10 degrees too large", True, _SEEN_ASIDE
    ),
    "attitude-jumping": FaultKind("telemetry", "the heading jumps by up to 3 to 30 degrees"),
    "position-lost": FaultKind("telemetry", "no LOCAL_POSITION_NED"),
    "position-late": FaultKind("telemetry", "LOCAL_POSITION_NED comes 50 to 500 ms late"),
    "position-frozen": FaultKind("telemetry", "LOCAL_POSITION_NED repeats itself with new times"),
    "position-biased": FaultKind(
        "telemetry", "velocities are 0.2 to 2 m/s too large", True, _GOES_BY_WRONG_VELOCITIES
    ),
    "position-jumping": FaultKind("telemetry", "positions jump by up to 0.5 to 20 m"),
    "position-nan": FaultKind("telemetry", "positions are no numbers"),
    "position-reset": FaultKind(
        "telemetry", "the position is set anew, 0.4 to 10 m off, for good", ends=False
    ),
    "height-reset": FaultKind("telemetry", "the same of the height, 0.1 to 2 m", ends=False),
    "heading-reset": FaultKind(
        "telemetry", "the heading is set anew, 3 to 45 degrees off, for good", ends=False
    ),
    "velocity-spikes": FaultKind(
        "telemetry", "2 to 30 % of velocities are off by up to 20 m/s each way"
    ),
    "heartbeat-lost": FaultKind("telemetry", "no HEARTBEAT"),
    "heartbeat-late": FaultKind("telemetry", "HEARTBEAT comes 0.3 to 3 s late"),
    "heartbeat-disarmed": FaultKind(
        "telemetry", "HEARTBEAT says disarmed, and it is not so", True, _LEFT_THERE
    ),
    "heartbeat-wrong-mode": FaultKind(
        "telemetry", "HEARTBEAT says LOITER, and it is not so", True, _LEFT_THERE
    ),
    "rc-missing": FaultKind("telemetry", "no RC_CHANNELS"),
    "rc-late": FaultKind("telemetry", "RC_CHANNELS comes 0.1 to 1 s late"),
    "rc-frozen": FaultKind("telemetry", "RC_CHANNELS repeats itself with new times"),
    "rc-no-signal": FaultKind("telemetry", "all channels are 0 or 65535"),
    "landed-missing": FaultKind("telemetry", "no EXTENDED_SYS_STATE"),
    "landed-late": FaultKind("telemetry", "EXTENDED_SYS_STATE comes 0.2 to 2 s late"),
    "landed-false": FaultKind("telemetry", "EXTENDED_SYS_STATE says ON_GROUND"),
    "landed-never": FaultKind("telemetry", "EXTENDED_SYS_STATE says IN_AIR"),
    "landed-flickers": FaultKind("telemetry", "10 to 90 % of EXTENDED_SYS_STATE say ON_GROUND"),
    "clock-back": FaultKind(
        "telemetry", "the boot clock goes back by 0.1 to 20 s", False, in_sitl=False
    ),
    "clock-ahead": FaultKind(
        "telemetry", "the boot clock goes ahead by 0.1 to 20 s", False, in_sitl=False
    ),
    "clock-wrapped": FaultKind(
        "telemetry", "the boot clock's milliseconds wrap", False, in_sitl=False
    ),
    "clock-drifts": FaultKind(
        "telemetry", "the boot clock is 0.1 to 2 % fast or slow", in_sitl=False
    ),
    "clock-outliers": FaultKind("telemetry", "2 to 30 % of messages have any boot time"),
    "timesync-lost": FaultKind("telemetry", "no answer to TIMESYNC"),
    "timesync-jumping": FaultKind(
        "telemetry", "answers to TIMESYNC jump by up to 10 to 500 ms either way"
    ),
    "timesync-late": FaultKind("telemetry", "answers to TIMESYNC come 20 to 400 ms late"),
    # -- link --------------------------------------------------------------------------------------
    "link-cut": FaultKind("link", "the device is gone", True, _CUT_OFF),
    "link-dead-up": FaultKind("link", "nothing reaches the autopilot", True, _UNHEARD),
    "link-dead-down": FaultKind("link", "nothing comes from the autopilot"),
    "link-lossy": FaultKind("link", "2 to 50 % is lost, either way"),
    "link-corrupted": FaultKind("link", "0.1 to 2 % of the bytes are changed, either way"),
    "link-doubled": FaultKind("link", "10 to 100 % comes twice, either way"),
    "link-late": FaultKind("link", "20 to 400 ms late, either way"),
    # -- who else is on it -------------------------------------------------------------------------
    "stranger-noise": FaultKind("strangers", "bytes without sense, 20 a second"),
    "stranger-autopilot": FaultKind("strangers", "another autopilot's heartbeats and states"),
    "stranger-flood": FaultKind("strangers", "500 to 5000 messages without meaning a second"),
    "stranger-station": FaultKind("strangers", "a false ground station changes parameters"),
    # -- pilot, and the autopilot's own decisions --------------------------------------------------
    "switch-low": FaultKind("pilot", "the pilot has the switch low"),
    "switch-flapping": FaultKind("pilot", "the switch goes to and fro every 0.1 to 1 s"),
    "switch-stuck": FaultKind("pilot", "the switch stays as it is, whatever the pilot does"),
    "rc-lost": FaultKind(
        "pilot", "the transmitter is off: the autopilot goes home (RTL)", True, _LED_AWAY
    ),
    "mode-loiter": FaultKind("pilot", "LOITER, and then GUIDED again", True, _LED_AWAY),
    "mode-rtl": FaultKind("pilot", "RTL, and then GUIDED again", True, _LED_AWAY),
    "mode-land": FaultKind("pilot", "LAND, and then GUIDED again", True, _LED_AWAY, lands=False),
    "disarm-refused": FaultKind(
        "pilot", "the autopilot does not disarm when asked to", in_sitl=False
    ),
    "disarm-asked": FaultKind(
        "pilot", "a ground station asks the autopilot to disarm, again and again", in_sitl=False
    ),
    "autopilot-restarts": FaultKind(
        "pilot", "the autopilot restarts in flight", False, in_sitl=False
    ),
    # -- the computer ------------------------------------------------------------------------------
    "loop-stalls": FaultKind("computer", "the daemon stands still for 0.1 to 3 s", False, _CUT_OFF),
    "search-slow": FaultKind("computer", "searching a picture takes 0.1 to 3 s"),
    "search-raises": FaultKind("computer", "an error in the search nobody foresaw"),
    "core-raises": FaultKind("computer", "an error in the core nobody foresaw", ends=False),
    "sending-raises": FaultKind(
        "computer", "an error in the autopilot's driver nobody foresaw", True, _CUT_OFF
    ),
    "disk-full": FaultKind("computer", "nothing can be recorded"),
    "disk-slow": FaultKind(
        "computer", "each picture recorded holds up the loop 10 to 100 ms", True, _SILENT
    ),
    "sigterm": FaultKind("computer", "the service is told to stop", ends=False, lands=False),
    "sigint": FaultKind("computer", "Ctrl-C", ends=False, lands=False),
    "killed": FaultKind("computer", "kill -9; systemd starts it again", False, _KILLED),
    # -- air ---------------------------------------------------------------------------------------
    "gust": FaultKind("air", "3 to 12 m/s more wind from anywhere", True, _BLOWN, in_sitl=False),
    "ground-effect": FaultKind("air", "the ground adds 10 to 50 % to the thrust", in_sitl=False),
}


def _known(name: str) -> str:
    if name not in FAULTS:
        raise ValueError(f"found {name!r}, expected one of {', '.join(FAULTS)}")
    return name


class OnsetOptions(Section):
    """When a fault begins: one of the first three, and then a while after it."""

    time_s: NotNegative | None = None  # since the flight began
    # So high over the pad it is for the first time that landerd flies; 0: a foot touches.
    height_m: NotNegative | None = None
    phase: PhaseName | None = None  # of the landing is reached, or passed
    after_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [x for x in (self.time_s, self.height_m, self.phase) if x is not None]
        if len(given) != 1:
            raise ValueError("expected one of time_s, height_m, phase")
        return self


class FaultOptions(Section):
    """One fault in a flight."""

    fault: Annotated[str, AfterValidator(_known)]
    at: OnsetOptions
    for_s: Positive | None = None  # null: until the flight ends
    severity: Annotated[float, Field(ge=0, le=1)] = 0.5

    @property
    def lasts_s(self) -> float | None:
        """How long it lasts, s; 0: it is momentary, None: until the flight ends."""
        kind = FAULTS[self.fault]
        if kind.stays:
            return None
        return self.for_s if kind.ends else 0.0
