"""What in the autopilot's parameters would fight landerd (docs/ardupilot.md)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from landerd.config.models import Config
from landerd.preflight.finding import Finding

# ArduCopter 4.7 has the second for the first: a mask of what is left out for one of what is done.
SUCCESSORS = {"ARMING_CHECK": "ARMING_SKIPCHK"}


@dataclass(frozen=True)
class Rule:
    """What a parameter must be, what is said where it is not so, and the value to set."""

    good: Callable[[float], bool]
    level: Literal["warn", "fail"]
    why: str
    best: float


def judged_parameters(config: Config) -> Mapping[str, Rule]:
    """Return the autopilot's parameters that are judged, by name, those of 4.7 too."""
    rules = {
        f"RC{config.rc.gate_channel}_OPTION": Rule(
            lambda v: v == 0, "fail", "landerd's switch would do something else too", 0.0
        ),
        "GUID_TIMEOUT": Rule(
            lambda v: v <= 1.5, "warn",
            "the last velocity is flown on so many seconds when landerd dies", 1.0,
        ),
        "WP_YAW_BEHAVIOR": Rule(
            lambda v: v == 0, "warn",
            "the nose turns into the direction of travel, away from the pad's heading", 0.0,
        ),
        "FS_THR_ENABLE": Rule(
            lambda v: v != 0, "warn", "nothing happens when the transmitter is lost", 1.0
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


def parameter_findings(config: Config, values: Mapping[str, float]) -> list[Finding]:
    """Return what is wrong with the autopilot's parameters."""
    found = []
    rules = judged_parameters(config)
    for name, rule in rules.items():
        if name in values and not rule.good(values[name]):
            what = f"{name} is {values[name]:g}: {rule.why}"
            found.append(Finding(rule.level, "parameters", what, f"set {name} {rule.best:g}"))
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
