"""Errors of camera and gimbal that flights found, and how well they saw: kept for the check."""

import dataclasses
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path

from landerd.config.models import Config
from landerd.estimation.health import Health
from landerd.estimation.pad_filter import SensorErrors
from landerd.preflight.finding import Finding

FILE = "sensors.json"  # in $STATE_DIRECTORY
_LEAST_CLOCK_S = 0.01  # a smaller clock error is estimated within a second of flight
_LEAST_ANGLE = math.radians(1.0)
_SIGMAS = 3.0  # an error is offered as a setting if it exceeds this many standard deviations
# Of a whole flight. In 36 days of the field (seeds 401 to 440, modelled sight) at most 0.016 was
# refused while tracking, and pictures were at most 0.25 s old.
_MOST_REFUSED = 0.05
_OLDEST_PICTURES_S = 0.3


@dataclass(frozen=True)
class LastFlight:
    """What is stored of the last landing."""

    sensors: SensorErrors
    health: Health | None  # of the whole flight; None: nothing was seen


def sensors_file() -> Path | None:
    """Return the path of the file; None: systemd has not set STATE_DIRECTORY."""
    state = os.environ.get("STATE_DIRECTORY")
    return Path(state) / FILE if state else None


def write_sensors(path: Path, flight: LastFlight) -> None:
    """Store what a flight found. Raises OSError."""
    new = path.with_suffix(".new")
    new.write_text(json.dumps(dataclasses.asdict(flight)), encoding="utf-8")
    new.chmod(0o644)  # `landerd check` reads it as another user than the service
    new.replace(path)


def read_sensors(path: Path) -> LastFlight | None:
    """Return what the last flight found; None: no file, or its content is invalid.

    Raises:
        PermissionError: this user may not read it.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        health = values["health"] and Health(**values["health"])
        flight = LastFlight(SensorErrors(**values["sensors"]), health)
        parts: list[SensorErrors | Health] = [flight.sensors, *([health] if health else [])]
        numbers = [x for part in parts for x in dataclasses.astuple(part)]
    except PermissionError:
        raise
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return flight if all(isinstance(x, float | int) and math.isfinite(x) for x in numbers) else None


def last_flight_findings(config: Config, path: Path) -> list[Finding]:
    """Return findings on what to set or repair by the last flight."""
    try:
        flight = read_sensors(path)
    except PermissionError:
        what = f"what it found of camera and gimbal may not be read by this user: {path}"
        return [Finding("warn", "last flight", what, "sudo landerd check ...")]
    return sensor_findings(config, flight) if flight is not None else []


def sensor_findings(config: Config, flight: LastFlight) -> list[Finding]:
    """Return findings on what to set or repair; nothing is set automatically."""
    return [
        *_clock_findings(config, flight.sensors),
        *_lens_findings(config, flight.sensors),
        *(_health_findings(flight.health) if flight.health is not None else ()),
    ]


def _health_findings(health: Health) -> list[Finding]:
    findings = []
    if health.refused > _MOST_REFUSED:
        what = f"{100.0 * health.refused:.0f} % of the sightings were refused (last flight)"
        mend = "landerd bench-test gimbal, and the pad's measures; landerd report shows when"
        findings.append(Finding("warn", "sight", what, mend))
    if health.picture_age_s > _OLDEST_PICTURES_S:
        what = f"pictures were {health.picture_age_s:.2f} s old when flown on (last flight)"
        mend = "landerd check --budget; a camera without buffers (docs/cameras.md)"
        findings.append(Finding("warn", "picture age", what, mend))
    return findings


def _clock_findings(config: Config, found: SensorErrors) -> list[Finding]:
    findings = []
    off_s = found.clock_s - config.camera.clock_offset_s
    if abs(off_s) > max(_LEAST_CLOCK_S, _SIGMAS * found.sigma_clock_s):
        way = "later" if off_s > 0.0 else "earlier"
        what = f"your pictures are stamped {abs(1e3 * off_s):.0f} ms {way} than they were taken"
        mend = f"set camera.clock_offset_s: {found.clock_s:.3f}"
        findings.append(Finding("warn", "camera clock", f"{what} (last flight)", mend))
    return findings


def _lens_findings(config: Config, found: SensorErrors) -> list[Finding]:
    """Return findings on what to set if the lens points elsewhere than the gimbal reports."""
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
