"""What flights have found of camera and gimbal: kept from one to the next, and offered."""

import dataclasses
import json
import math
import os
from pathlib import Path

from landerd.config.models import Config
from landerd.estimation.pad_filter import SensorErrors
from landerd.preflight.finding import Finding

FILE = "sensors.json"  # in $STATE_DIRECTORY
_LEAST_CLOCK_S = 0.01  # smaller ones are estimated away in a second of flight
_LEAST_ANGLE = math.radians(1.0)
_SIGMAS = 3.0  # less sure errors are not offered


def sensors_file() -> Path | None:
    """Return where it is kept; None: nowhere, systemd sets STATE_DIRECTORY."""
    state = os.environ.get("STATE_DIRECTORY")
    return Path(state) / FILE if state else None


def write_sensors(path: Path, found: SensorErrors) -> None:
    """Keep what a flight has found. Raises OSError."""
    new = path.with_suffix(".new")
    new.write_text(json.dumps(dataclasses.asdict(found)), encoding="utf-8")
    new.replace(path)


def read_sensors(path: Path) -> SensorErrors | None:
    """Return what the last flight has found; None: nothing that can be read."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        found = SensorErrors(**values)
        numbers = dataclasses.astuple(found)
    except (OSError, ValueError, TypeError):
        return None
    return found if all(isinstance(x, float) and math.isfinite(x) for x in numbers) else None


def sensor_findings(config: Config, found: SensorErrors) -> list[Finding]:
    """Return what is worth setting; nothing is set by itself."""
    findings = []
    off_s = found.clock_s - config.camera.clock_offset_s
    if abs(off_s) > max(_LEAST_CLOCK_S, _SIGMAS * found.sigma_clock_s):
        way = "later" if off_s > 0.0 else "earlier"
        what = f"your pictures are stamped {abs(1e3 * off_s):.0f} ms {way} than they were taken"
        mend = f"set camera.clock_offset_s: {found.clock_s:.3f}"
        findings.append(Finding("warn", "camera clock", f"{what} (last flight)", mend))
    return findings + _lens_findings(config, found)


def _lens_findings(config: Config, found: SensorErrors) -> list[Finding]:
    """Return what to set where the lens looks elsewhere than the gimbal says."""
    roll, pitch, yaw = (math.radians(angle) for angle in config.gimbal.camera_rotation_deg)
    # Found about the picture's axes, set about the gimbal's: a camera may sit rolled on it.
    c, s = math.cos(roll), math.sin(roll)
    up, right = c * found.up - s * found.right, s * found.up + c * found.right
    sigma = max(found.sigma_up, found.sigma_right)
    findings = []
    for angle, ways, axis, new in (
        (up, ("higher", "lower"), "pitch", pitch + up),
        (right, ("farther right", "farther left"), "yaw", yaw + right / math.cos(pitch)),
    ):
        if abs(angle) > max(_LEAST_ANGLE, _SIGMAS * sigma):
            way = ways[0] if angle > 0.0 else ways[1]
            off = abs(math.degrees(angle))
            what = f"your lens looks {off:.1f} degrees {way} than your gimbal says (last flight)"
            mend = f"set {axis} of gimbal.camera_rotation_deg to {math.degrees(new):.1f}"
            findings.append(Finding("warn", "lens direction", what, mend))
    return findings
