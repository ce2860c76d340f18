"""Checks the autopilot's parameters for values that would disturb landerd (docs/ardupilot.md)."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from landerd.config.models import Config
from landerd.guidance.limits import flyable_limits
from landerd.guidance.sink_rate import unstopped_height
from landerd.preflight.finding import Finding

# ArduCopter 4.7 has the second for the first: a mask of what is left out for one of what is done.
SUCCESSORS = {"ARMING_CHECK": "ARMING_SKIPCHK"}
# How the autopilot shapes velocities, by their names up to 4.6, in 4.7.0 and in what came after it;
# with what makes m/s^2 of them. Before 4.2 there was no such jerk.
_JERKS = ("PSC_JERK_XY", "PSC_JERK_NE", "PSC_NE_JERK")
_ACCELERATIONS = {"WPNAV_ACCEL": 0.01, "WP_ACC": 1.0}
LONGEST_TIMEOUT_S = 1.0  # longest timeout after which the autopilot stops without orders
# Acceleration over jerk, s: the delay of the answer to a velocity. In the simulator a landing on a
# pad of 5 m/s took 14 s at 0.5 s, 15 s at 0.8, 19 s at 1.3 and 28 s at 2.1.
LATEST_S = 0.8
# Time constant of the attitude, s: in SITL ArduCopter's own velocities overshot by 3 % with 0.15,
# by 9 with 0.3 and by 20 to 25 with 0.5, to and fro for ten seconds.
ATTITUDE, SLOWEST_ATTITUDE_S, GOOD_ATTITUDE_S = "ATC_INPUT_TC", 0.3, 0.2
# Of GUID_OPTIONS: velocity is not held. In SITL ArduCopter then drifted at 0.1 m/s whatever was
# ordered, and never came to the pad; with 16, position is not held, it landed as ever.
VELOCITY_NOT_HELD = 1 << 5
MODE_CHANNEL = "FLTMODE_CH"  # the RC channel by which the pilot selects flight modes


@dataclass(frozen=True)
class Rule:
    """The values that a parameter may have, the text if it has another, and the value to set."""

    good: Callable[[float], bool]
    level: Literal["warn", "fail"]
    why: str
    best: float


def judged_parameters(config: Config) -> Mapping[str, Rule]:
    """Return the rules of parameters that are judged one by one, by name, with those of 4.7."""
    rules = {
        f"RC{config.rc.gate_channel}_OPTION": Rule(
            lambda v: v == 0, "fail", "landerd's switch would do something else too", 0.0
        ),
        "GUID_TIMEOUT": Rule(
            lambda v: v <= LONGEST_TIMEOUT_S, "fail",
            "the last velocity is flown on so many seconds when landerd dies", LONGEST_TIMEOUT_S,
        ),
        "GUID_OPTIONS": Rule(
            lambda v: math.isfinite(v) and not int(v) & VELOCITY_NOT_HELD, "fail",
            "velocities that landerd orders are not held (bit 5)", 0.0,
        ),
        "WP_YAW_BEHAVIOR": Rule(
            lambda v: v == 0, "warn",
            "the nose turns into the direction of travel, away from the pad's heading", 0.0,
        ),
        # Without it ArduPilot keeps reporting the last pulses as if they were fresh.
        "FS_THR_ENABLE": Rule(
            lambda v: v != 0, "fail",
            "with the transmitter lost your switch stays high for landerd, which flies on", 1.0,
        ),
        "ARMING_CHECK": Rule(
            lambda v: v != 0, "warn", "the autopilot arms whatever is wrong with it", 1.0
        ),
        "ARMING_SKIPCHK": Rule(
            lambda v: v == 0, "warn", "the autopilot arms although something is wrong with it", 0.0
        ),
    }  # fmt: skip
    if config.guidance.output == "landing_target":
        for name in ("PLND_ENABLED", "PLND_TYPE"):
            why = "ArduPilot does not use landerd's targets"
            rules[name] = Rule(lambda v: v == 1, "fail", why, 1.0)
    return rules


def asked_parameters(config: Config) -> list[str]:
    """Return the names of all parameters that `parameter_findings` uses."""
    return [*judged_parameters(config), MODE_CHANNEL, *_ACCELERATIONS, *_JERKS, ATTITUDE]


def parameter_findings(config: Config, values: Mapping[str, float]) -> list[Finding]:
    """Return the findings on the autopilot's parameters."""
    found = []
    rules = judged_parameters(config)
    for name, rule in rules.items():
        if name in values and not rule.good(values[name]):
            what = f"{name} is {values[name]:g}: {rule.why}"
            if name == "GUID_TIMEOUT":
                what += _where_it_strikes(config, values[name])
            found.append(Finding(rule.level, "parameters", what, f"set {name} {rule.best:g}"))
    found += _mode_switch(config, values) + _shaping(config, values) + _attitude(values)
    told = {*values, *(old for old, new in SUCCESSORS.items() if new in values)}
    told |= {new for old, new in SUCCESSORS.items() if old in values}
    missing = [name for name in rules if name not in told]
    if missing:
        what = f"the autopilot did not tell {', '.join(missing)}"
        found.append(Finding("warn", "parameters", what, "compare them with docs/ardupilot.md"))
    return found or [
        Finding(
            "ok",
            "parameters",
            f"{len(rules.keys() & values.keys())} looked at, none fights landerd",
        )
    ]


def _where_it_strikes(config: Config, timeout_s: float) -> str:
    """Return a text on the height below which the vehicle reaches the ground within a timeout."""
    deceleration = flyable_limits(config).vertical_acceleration_mps2
    now, then = (unstopped_height(t, deceleration) for t in (timeout_s, LONGEST_TIMEOUT_S))
    return f", below {now:.1f} m to the ground (with {LONGEST_TIMEOUT_S:g} s below {then:.1f} m)"


def _mode_switch(config: Config, values: Mapping[str, float]) -> list[Finding]:
    """Return a finding if the switch is that of the flight modes: selecting one would be to land.

    It is channel 5 by ArduCopter's default, which is the first that rc.gate_channel may be.
    """
    channel = config.rc.gate_channel
    if values.get(MODE_CHANNEL) != channel:
        return []
    what = f"{MODE_CHANNEL} is {channel}: landerd's switch selects flight modes, and they open it"
    return [Finding("fail", "parameters", what, "set rc.gate_channel to a switch of its own")]


def _shaping(config: Config, values: Mapping[str, float]) -> list[Finding]:
    """Return the findings on the autopilot's limits of acceleration and jerk."""
    told = [unit * values[name] for name, unit in _ACCELERATIONS.items() if name in values]
    acceleration = next((a for a in told if a > 0.0), config.autopilot.acceleration_mps2)
    for name in _JERKS:
        jerk = values.get(name, 0.0)
        if jerk > 0.0 and (late_s := acceleration / jerk) > LATEST_S:
            what = f"{name} is {jerk:g}: velocities are answered {late_s:.1f} s late: slow landings"
            mend = f"set {name} {max(5, math.ceil(acceleration / LATEST_S))}"
            return [Finding("warn", "parameters", what, mend)]
    return []


def _attitude(values: Mapping[str, float]) -> list[Finding]:
    """Return the findings on the time constant of the autopilot's attitude control."""
    time_s = values.get(ATTITUDE, 0.0)
    if not time_s > SLOWEST_ATTITUDE_S:
        return []
    what = f"{ATTITUDE} is {time_s:g}: it leans so late that its velocities swing: slow landings"
    return [Finding("warn", "parameters", what, f"set {ATTITUDE} {GOOD_ATTITUDE_S:g}")]
