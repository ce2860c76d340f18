"""docs/parameters.md, from the parameters."""

from landerd.config.parameters import parameters

_HEAD = """# Parameters over MAVLink

landerd answers ground stations as component 191 of the vehicle's system: in QGroundControl and
Mission Planner its parameters appear beside the autopilot's, in MAVProxy after
`set target_component 191`. A change is checked against the range, flown from the next control step
on, without a bump, and logged. What may not be changed while armed is refused and says so. Changes
are gone with the next start unless you save them while disarmed ("write to storage",
MAV_CMD_PREFLIGHT_STORAGE): they go to a file that is laid over the configuration, the service's to
`/var/lib/landerd/saved.yaml` (`landerd run --help`).

This table is made from the code: `make reference`.
"""


def markdown() -> str:
    """Return docs/parameters.md."""
    lines = [
        _HEAD,
        "| name | key of the configuration | range | default | unit | while armed |",
        "|---|---|---|---|---|---|",
    ]
    for p in parameters().values():
        kind = "whole number, " if p.whole else ""
        lines.append(
            f"| `{p.name}` | `{p.key}` | {kind}{p.range_in_words} | {p.default:g} | {p.unit} "
            f"| {'yes' if p.in_flight else 'no'} |"
        )
    return "\n".join(lines) + "\n"
