"""A view as plain values for the page's JSON; made in the server's threads."""

import base64
import math
import statistics
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from landerd.camera_model import CameraModel
from landerd.geometry import horizontal, norm, wrap
from landerd.guidance.phases import descent_radius
from landerd.guidance.states import State
from landerd.messages import Frame, Sightings
from landerd.pad import PadLayout
from landerd.vision.draw import plate_edge
from landerd.vision.pose import MIN_DEPTH_M
from landerd.web.live import View

_PICTURES_S = 1.0  # without pictures for longer it is said
WIDEST_PX = 640  # of the picture that is sent
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 60]


@dataclass(frozen=True)
class Fixed:
    """What does not change while the daemon runs."""

    camera: CameraModel
    layout: PadLayout


def shown(view: View, fixed: Fixed) -> dict[str, Any]:
    """Return all of a view but its picture; NaN and infinities are null."""
    relative = view.relative
    shows: dict[str, Any] = {
        "t": view.t,
        "state": view.state.value,
        "flies": view.state is not State.SILENT,
        "phase": view.phase.value,
        "reason": view.reason,
        "outcome": view.outcome,
        "aborts": view.aborts,
        "conditions": [
            {"name": name, "ok": ok, "is": text} for name, ok, text in _conditions(view)
        ],
        "pad": None,
        "vehicle": _vehicle(view),
        "rates": {name: _number(rate, 1) for name, rate in view.rates.items()},
        "latency_ms": _latency(view.latencies),
        "gaps": view.gaps,
        "longest_gap_ms": _number(1e3 * view.longest_gap_s, 0),
        "sensors": _sensors(view),
        "nis": None if view.health is None else _number(view.health.nis, 2),
        "refused": None if view.health is None else _number(view.health.refused, 3),
        "battery": _battery(view),
        "faults": view.faults,
        "lines": [{"ago": view.t - x.t, "text": x.text, "urgent": x.is_urgent} for x in view.lines],
        "plate": fixed.layout.plate.model_dump(),
    }
    if relative is not None:
        heading = relative.heading_error
        shows["pad"] = {
            "north": _number(relative.error[0], 3),
            "east": _number(relative.error[1], 3),
            "height": _number(relative.height, 3),
            "distance": _number(relative.distance, 3),
            "sigma": _number(relative.sigma_m, 3),
            "speed": _number(norm(relative.pad_velocity), 2),
            "heading_off_deg": None if heading is None else _number(math.degrees(heading), 1),
            "heading_deg": None
            if heading is None or view.attitude is None
            else _number(math.degrees(wrap(view.attitude.yaw + heading)), 1),
            "region": _number(descent_radius(view.config.guidance.descent, relative.height), 2),
        }
    return shows


def picture(frame: Frame, sightings: Sightings, fixed: Fixed) -> dict[str, Any] | None:
    """Return a frame as JPEG and what was seen in it, in pixels of what is sent."""
    height, width = frame.image.shape
    scale = min(1.0, WIDEST_PX / width)
    image = frame.image
    if scale < 1.0:
        size = (round(scale * width), round(scale * height))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    ok, data = cv2.imencode(".jpg", image, _JPEG)
    if not ok:
        return None

    def scaled(points: Any) -> list[list[float]]:
        return [[round(float(scale * x), 1), round(float(scale * y), 1)] for x, y in points]

    plate = point = None
    if sightings.pad:
        edge = plate_edge(sightings.pad[0], fixed.camera, fixed.layout)
        plate = None if edge is None else scaled(edge)
        if sightings.pad[0].position[2] > MIN_DEPTH_M:
            point = scaled(fixed.camera.pixels(np.array([sightings.pad[0].position])))[0]
    return {
        "seq": frame.seq,
        "width": image.shape[1],
        "height": image.shape[0],
        "jpeg": base64.b64encode(data.tobytes()).decode(),
        "markers": [
            {
                "name": m.kind if m.id is None else f"{m.kind} {m.id}",
                "outline": scaled(m.outline_px),
                "range": _number(norm(m.solutions[0].position), 2),
            }
            for m in sightings.markers
        ],
        "plate": plate,
        "point": point,
    }


def _conditions(view: View) -> list[tuple[str, bool, str]]:
    """Return what must hold before it lands: name, whether it does, how it stands."""
    limits, rc = view.config.freshness, view.config.rc
    beat = view.heartbeat
    age = view.ages.get

    def young(name: str, kind: str, limit_s: float) -> tuple[str, bool, str]:
        old = age(kind, math.inf)
        is_young = old < limit_s
        return name, is_young, "" if is_young else f"none {_ago(old)}"

    channels = view.rc.channels_us if view.rc is not None else ()
    pulse = channels[rc.gate_channel - 1] if len(channels) >= rc.gate_channel else 0
    armed = beat is not None and beat.armed
    is_done = not armed and view.state is State.SILENT and view.outcome is not None
    switch = f"RC {rc.gate_channel} at {pulse} us" if pulse else f"RC {rc.gate_channel}: no signal"
    is_fresh = age("RcChannels", math.inf) < limits.rc_s
    found = [
        young("autopilot", "Heartbeat", limits.heartbeat_s),
        ("armed", armed or is_done, "yes" if armed else "no longer" if is_done else "no"),
        ("mode", beat is not None and beat.guided, beat.mode if beat else "unknown"),
        ("switch", is_fresh and pulse > rc.gate_threshold_us, switch),
        young("attitude", "Attitude", limits.attitude_s),
        young("position", "LocalPosition", limits.position_s),
        young("gimbal", "GimbalState", limits.gimbal_s),
    ]
    is_seen = view.pad_age < view.config.guidance.lost.after_s
    pad = ("pad", is_seen, "in sight" if is_seen else f"not seen {_ago(view.pad_age)}")
    return [*found, young("pictures", "Sightings", _PICTURES_S), pad]


def _ago(seconds: float) -> str:
    if seconds == math.inf:
        return "yet"
    return f"for {seconds:.1f} s" if seconds < 100.0 else f"for {seconds / 60.0:.0f} min"


def _vehicle(view: View) -> dict[str, Any]:
    speed = None if view.position is None else horizontal(view.position.velocity)
    down = None if view.position is None else view.position.velocity[2]
    yaw = None if view.attitude is None else math.degrees(view.attitude.yaw)
    return {
        "speed": _number(speed, 2),
        "sink": _number(down, 2),
        "heading_deg": _number(yaw, 1),
        "mode": view.heartbeat.mode if view.heartbeat is not None else None,
        "armed": view.heartbeat.armed if view.heartbeat is not None else None,
    }


def _latency(latencies: tuple[float, ...]) -> dict[str, Any] | None:
    if not latencies:
        return None
    median = statistics.median(latencies)
    return {"median": _number(1e3 * median, 0), "most": _number(1e3 * max(latencies), 0)}


def _sensors(view: View) -> dict[str, Any]:
    s = view.sensors
    return {
        "clock_ms": [_number(1e3 * s.clock_s, 1), _number(1e3 * s.sigma_clock_s, 1)],
        "up_deg": [_number(math.degrees(s.up), 2), _number(math.degrees(s.sigma_up), 2)],
        "right_deg": [_number(math.degrees(s.right), 2), _number(math.degrees(s.sigma_right), 2)],
    }


def _battery(view: View) -> dict[str, Any] | None:
    if view.battery is None:
        return None
    used = view.battery.energy_consumed_j
    return {
        "volts": _number(view.battery.voltage_v, 2),
        "used_wh": None if used is None else _number(used / 3600.0, 2),
    }


def _number(value: float | None, digits: int) -> float | None:
    return round(value, digits) if value is not None and math.isfinite(value) else None
