"""docs/faults.md, from the one table of what can go wrong in the simulator."""

from landerd.simulation.faults import fault_kinds

_HEAD = """# Faults of the simulator

What `sim.faults` can let happen; how it is asked for: [simulator](simulator.md). Where a fault goes
from one figure to another, severity 0 makes the first of it and 1 the last. What has no `for_s` is
done in a moment.

This page is made from the code: `make reference`.
"""
_ABOUT = {
    "camera": "Pictures and their times",
    "scene": "What is to be seen",
    "pad": "How the pad moves",
    "gimbal": "The gimbal (`gimbal.driver: sim`)",
    "telemetry": "What the autopilot says, and its clock",
    "link": "The link to the autopilot",
    "strangers": "Others on the wire",
    "pilot": "Pilot, radio, and the autopilot's own doing",
    "computer": "landerd's computer and process",
    "air": "The air",
}


def markdown() -> str:
    """Return docs/faults.md."""
    parts = [_HEAD]
    for device, about in _ABOUT.items():
        rows = [
            f"| `{name}` | {kind.does} | {'yes' if kind.ends else 'no'} |"
            for name, kind in fault_kinds().items()
            if kind.device == device
        ]
        head = [f"## {about}", "", "| fault | what it does | `for_s` |", "|---|---|---|"]
        parts.append("\n".join([*head, *rows, ""]))
    return "\n".join(parts)
