"""Converts a flight's events to messages of the log's topics; derived classes write them."""

import json
import math
from abc import ABC, abstractmethod
from typing import Any

import cv2

from landerd import gimbal_frames
from landerd.flightlog import codec, contents, foxglove, foxglove_scene
from landerd.flightlog.contents import Dropped, Head, Searched, State
from landerd.geometry import (
    Mat3,
    Vec3,
    camera_mount,
    cross,
    matmul,
    rot_zyx,
    transpose,
)
from landerd.messages import (
    Attitude,
    Command,
    Frame,
    GimbalState,
    Input,
    LocalPosition,
    PhaseChange,
    PoseSolution,
    Severity,
    Sightings,
    StatusText,
)

TRANSFORM_S = 0.05  # interval of transforms, as short as an eye can use
_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 85]


class TopicWriter(ABC):
    """Writes a flight's steps, pictures, and data for viewers to topics."""

    def __init__(self, head: Head) -> None:
        """Open all topics at the beginning, so that none is lost with a damaged part."""
        self._head = head
        self._attitude: Attitude | None = None
        self._drawn: dict[str, float] = {}  # when each frame's transform was last written
        self._R_gimbal_camera = camera_mount(head.config.gimbal.camera_rotation_deg)
        for kind in (*contents.INPUTS.values(), *contents.COMMANDS.values()):
            prefix = contents.IN if kind.__name__ in contents.INPUTS else contents.OUT
            self._name(prefix + kind.__name__, codec.schema(kind))
        for topic, own in contents.OWN.items():
            self._name(topic, codec.schema(own))
        for topic, name in contents.FOXGLOVE.items():
            self._name(topic, foxglove.SCHEMAS[name])

    def _name(self, topic: str, schema: dict[str, Any]) -> None:
        self._open(topic, schema["title"], json.dumps(schema).encode())

    @abstractmethod
    def _open(self, topic: str, schema_name: str, schema: bytes) -> None:
        """Prepare for messages of this topic, JSON of this schema."""

    @abstractmethod
    def _put(self, topic: str, ns: int, data: bytes, measured_ns: int, number: int) -> None:
        """Write a message; times are Unix time, ns, as that of the core's step and the datum's."""

    def wants(self, topic: str) -> bool:
        """Tell whether a topic is read by anybody; if not, its messages need not be made."""
        return True

    # ---- what a replay needs -------------------------------------------------------------------

    def step(self, number: int, now: float, message: Input, commands: list[Command]) -> None:
        """Write one step of the core."""
        ns = self._ns(now)
        self._write(contents.IN, message, ns, self._ns(message.t), number)
        for command in commands:
            self._write(contents.OUT, command, ns, ns, number)

    def _write(self, prefix: str, message: Any, ns: int, measured_ns: int, number: int) -> None:
        topic = prefix + type(message).__name__
        if self.wants(topic):
            self._put(topic, ns, codec.encode(message), measured_ns, number)

    def searched(self, now: float, searched: Searched) -> None:
        """Write that vision searched a frame."""
        self._add(contents.SEARCHED, now, searched, searched.seq)

    def image(self, now: float, frame: Frame, mode: str) -> None:
        """Write a frame's picture, `jpeg` or `lossless`."""
        form, options = ("png", _PNG) if mode == "lossless" else ("jpeg", _JPEG)
        ok, data = cv2.imencode(f".{form}", frame.image, options)
        if ok:
            message = foxglove.image(self._ns(frame.t), data.tobytes(), form)
            self._add(contents.IMAGE, now, message, frame.seq)

    # ---- what people look at -------------------------------------------------------------------

    def state(self, state: State) -> None:
        """Write the core's view of the landing."""
        self._add(contents.STATE, state.t, state)

    def dropped(self, now: float, dropped: Dropped) -> None:
        """Write the numbers of records that could not be written."""
        self._add(contents.DROPPED, now, dropped)

    def calibration(self, now: float) -> None:
        """Write what viewers need once: calibration, the upward direction, pad and vehicle."""
        camera = foxglove.calibration(self._ns(now), self._head.camera)
        self._add(contents.CALIBRATION, now, camera)
        self._transform(now, now, "map", "local", (0.0, 0.0, 0.0), foxglove.NED_IN_MAP)
        vehicle = self._head.config.vehicle
        drawn = foxglove_scene.pad_and_vehicle(self._ns(now), self._head.layout, vehicle)
        self._add(contents.SCENE, now, drawn)

    def scene(self, now: float, message: Input) -> None:
        """Write where vehicle, camera and pad are, and the markers' outlines."""
        if isinstance(message, Attitude):
            self._attitude = message
        elif isinstance(message, LocalPosition) and self._attitude is not None:
            R = _R_local_body(self._attitude)
            self._transform(now, message.t, "local", "body", message.position, R)
        elif isinstance(message, GimbalState) and self._attitude is not None:
            a = self._attitude
            angles = (message.yaw, message.pitch, message.roll)
            R_local_body = _R_local_body(a)
            R_local_gimbal = gimbal_frames.rotation_local_gimbal(
                message.reference, R_local_body, a.yaw, angles
            )
            R_body_gimbal = matmul(transpose(R_local_body), R_local_gimbal)
            R = matmul(R_body_gimbal, self._R_gimbal_camera)
            offset = self._head.config.vehicle.camera_offset_m
            self._transform(now, message.t, "body", "camera", offset, R)
        elif isinstance(message, Sightings):
            marks = foxglove.annotations(self._ns(message.t), message.markers)
            self._add(contents.MARKERS, now, marks)
            if message.pad and message.pad[0].north is not None:
                pad = message.pad[0]
                self._transform(now, message.t, "camera", "pad", pad.position, _axes(pad))

    def events(self, now: float, commands: list[Command]) -> None:
        """Write texts for the pilot, and changes of phase."""
        for command in commands:
            if isinstance(command, StatusText):
                urgent = command.severity <= Severity.WARNING
                self._event(now, foxglove.WARNING if urgent else foxglove.INFO, command.text)
            elif isinstance(command, PhaseChange):
                self._event(now, foxglove.INFO, f"{command.phase.value}: {command.reason}")

    def _event(self, now: float, level: int, text: str) -> None:
        message = foxglove.event(self._ns(now), level, text)
        self._add(contents.EVENTS, now, message)

    def _transform(
        self, now: float, t: float, parent: str, child: str, origin: Vec3, R: Mat3
    ) -> None:
        if now - self._drawn.get(child, -math.inf) < TRANSFORM_S:
            return
        self._drawn[child] = now
        message = foxglove.transform(self._ns(t), parent, child, origin, R)
        self._add(contents.TRANSFORMS, now, message)

    def _add(self, topic: str, now: float, message: Any, number: int = 0) -> None:
        if self.wants(topic):
            ns = self._ns(now)
            self._put(topic, ns, codec.encode(message), ns, number)

    def _ns(self, t: float) -> int:
        return max(0, round(1e9 * (t + self._head.wall_offset_s)))


def _R_local_body(attitude: Attitude) -> Mat3:  # noqa: N802 - a rotation's name
    return rot_zyx(attitude.yaw, attitude.pitch, attitude.roll)


def _axes(pad: PoseSolution) -> Mat3:
    """Return R_camera_pad from the pad's north and normal."""
    assert pad.north is not None
    return transpose((pad.north, cross(pad.normal, pad.north), pad.normal))
