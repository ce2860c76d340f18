"""The records of a flight log besides the core's messages, and the names of its topics.

| topic | what |
|---|---|
| `/in/TYPE` | a message as the core took it; its number counts the core's steps |
| `/out/TYPE` | a command, with the number of the step that gave it |
| `/core/state` | phase, outcome, pad relative to vehicle, errors of camera and gimbal, health |
| `/vision/searched` | a frame that was searched and what was expected in it |
| `/camera/image`, `/camera/calibration`, `/camera/markers`, `/tf`, `/events` | for Foxglove |
| `/log/dropped` | how much could not be recorded so far, by kind |
"""

import typing
from dataclasses import dataclass

from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.estimation.health import Health
from landerd.estimation.pad_filter import SensorErrors
from landerd.guidance.relative_state import RelativeState
from landerd.lander import Lander
from landerd.messages import Command, Input, Phase, Prior
from landerd.pad import PadLayout

IN, OUT = "/in/", "/out/"
STATE, SEARCHED, DROPPED = "/core/state", "/vision/searched", "/log/dropped"
IMAGE, CALIBRATION, MARKERS = "/camera/image", "/camera/calibration", "/camera/markers"
TRANSFORMS, EVENTS, SCENE = "/tf", "/events", "/scene"

INPUTS: dict[str, type] = {kind.__name__: kind for kind in typing.get_args(Input)}
COMMANDS: dict[str, type] = {kind.__name__: kind for kind in typing.get_args(Command)}

# Attachments that a replay needs.
CONFIG_JSON, PAD_JSON, CAMERA_JSON = "config.json", "pad.json", "camera.json"
VERSIONS = "versions"  # metadata; its keys besides those of software:
WALL_OFFSET, DRY = "wall_offset_s", "dry_run"


@dataclass(frozen=True)
class Head:
    """What stays the same during a flight: configuration, pad, calibration."""

    config: Config
    layout: PadLayout
    camera: CameraModel
    wall_offset_s: float = 0.0  # Unix time minus the event loop's, s; 0: simulated time
    is_dry: bool = False  # a dry run's: the vehicle moves as it was recorded, not as ordered


@dataclass(frozen=True, slots=True)
class Searched:
    """One frame given to vision."""

    t: float  # exposure, s
    seq: int
    prior: Prior
    anew: bool = False  # vision was replaced before it, as an earlier search had failed or hung


@dataclass(frozen=True, slots=True)
class State:
    """The core's view of the landing."""

    t: float
    phase: Phase
    reason: str
    outcome: str | None
    aborts: int
    relative: RelativeState | None  # None while pad or vehicle is unknown
    sensors: SensorErrors | None = None  # None: the log is of an older landerd
    health: Health | None = None  # lately; None: nothing was seen, or an older landerd


def state_of(lander: Lander, now: float) -> State:
    """Return the core's view of the landing now (loop time, s)."""
    return State(
        now,
        lander.phase,
        lander.reason,
        lander.outcome,
        lander.aborts,
        lander.relative_state(now),
        lander.sensor_errors,
        lander.health,
    )


@dataclass(frozen=True, slots=True)
class Dropped:
    """Numbers of records that could not be written since the log's beginning."""

    images: int
    detail: int  # states, transforms, annotations
    messages: int  # of the core: the log replays up to the first gap only
    errors: int  # records that could not be encoded as JSON


OWN: dict[str, type] = {STATE: State, SEARCHED: Searched, DROPPED: Dropped}
FOXGLOVE = {  # topics in Foxglove's schemas
    IMAGE: "foxglove.CompressedImage",
    CALIBRATION: "foxglove.CameraCalibration",
    MARKERS: "foxglove.ImageAnnotations",
    TRANSFORMS: "foxglove.FrameTransform",
    EVENTS: "foxglove.Log",
    SCENE: "foxglove.SceneUpdate",
}
