"""What in the autopilot's parameters would fight landerd (docs/ardupilot.md)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from landerd.config.models import Config
from landerd.preflight.finding import Finding

# ArduCopter 4.7 has the second for the first: a mask of what is left out for one of what is done.
_SUCCESSORS = {"ARMING_CHECK": "ARMING_SKIPCHK"}


@dataclass(frozen=True)
class _Rule:
    good: Callable[[float], bool]
    level: Literal["warn", "fail"]
    why: str
    mend: str


def judged_parameters(config: Config) -> Mapping[str, _Rule]:
    """Return the autopilot's parameters that are judged, by name (docs/ardupilot.md)."""
    option = f"RC{config.rc.gate_channel}_OPTION"
    rules = {
        option: _Rule(
            lambda v: v == 0, "fail",
            "landerd's switch would do something else too", f"set {option} 0",
        ),
        "GUID_TIMEOUT": _Rule(
            lambda v: v <= 1.5, "warn",
            "the last velocity is flown on so many seconds when landerd dies",
            "set GUID_TIMEOUT 1",
        ),
        "WP_YAW_BEHAVIOR": _Rule(
            lambda v: v == 0, "warn",
            "the nose turns into the direction of travel, away from the pad's heading",
            "set WP_YAW_BEHAVIOR 0",
        ),
        "FS_THR_ENABLE": _Rule(
            lambda v: v != 0, "warn", "nothing happens when the transmitter is lost",
            "set FS_THR_ENABLE 1",
        ),
        "ARMING_CHECK": _Rule(
            lambda v: v != 0, "warn", "the autopilot arms whatever is wrong with it",
            "set ARMING_CHECK 1",
        ),
        "ARMING_SKIPCHK": _Rule(
            lambda v: v == 0, "warn", "the autopilot arms although something is wrong with it",
            "set ARMING_SKIPCHK 0",
        ),
    }  # fmt: skip
    if config.guidance.output == "landing_target":
        for name in ("PLND_ENABLED", "PLND_TYPE"):
            why = "ArduPilot does not use landerd's targets"
            rules[name] = _Rule(lambda v: v == 1, "fail", why, f"set {name} 1")
    return rules


def parameter_findings(config: Config, values: Mapping[str, float]) -> list[Finding]:
    """Return what is wrong with the autopilot's parameters."""
    found = []
    rules = judged_parameters(config)
    for name, rule in rules.items():
        if name in values and not rule.good(values[name]):
            what = f"{name} is {values[name]:g}: {rule.why}"
            found.append(Finding(rule.level, "parameters", what, rule.mend))
    told = {*values, *(old for old, new in _SUCCESSORS.items() if new in values)}
    told |= {new for old, new in _SUCCESSORS.items() if old in values}
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
