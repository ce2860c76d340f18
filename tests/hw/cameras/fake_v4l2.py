"""A V4L2 node without a kernel: buffers, queue, stamps, controls and faults as the kernel has them.

A picture of sequence number n has the brightness n % 200 everywhere.
"""

import errno
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NoReturn

import cv2
import numpy as np

from hw.cameras.v4l2_node import Filled, Layout, Mode, Range, Stamp, VideoNode

EXPOSURE_AUTO, EXPOSURE, PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
GAIN, AUTOGAIN, FOCUS, FOCUS_AUTO = 0x00980913, 0x00980912, 0x009A090A, 0x009A090C


@dataclass
class FakeCamera:
    """What is plugged in; `open` gives nodes as the driver wants them."""

    all_modes: list[Mode] = field(default_factory=lambda: [Mode("YUYV", 64, 48, 30.0)])
    ranges: Mapping[int, Range] = field(default_factory=dict)
    values: dict[int, int] = field(default_factory=dict)
    refused: Mapping[int, int] = field(default_factory=dict)  # errors of setting controls
    stamp: Stamp = Stamp.START
    padding: int = 0  # bytes at the end of each line
    sends: Callable[[bytes], bytes] = bytes  # instead of a picture
    plugged: bool = True
    busy: bool = False
    full_bus: bool = False
    wait_error: int = 0  # error of the next DQBUF
    node: "FakeNode | None" = None
    opened: int = 0
    sequence: int = 0

    def open(self, path: str) -> VideoNode:
        if not self.plugged:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
        self.opened += 1
        self.node = FakeNode(self)
        return self.node

    def shoot(self, *, damaged: bool = False, short: bool = False, t: float | None = None) -> None:
        """Expose a picture; lost if the driver has no empty buffer."""
        self.sequence += 1
        if self.node is not None:
            self.node.fill(damaged, short, time.monotonic() if t is None else t)

    def unplug(self) -> None:
        self.plugged = False
        if self.node is not None:
            self.node.wake()

    def break_off(self, number: int) -> None:
        """Let the next DQBUF fail."""
        self.wait_error = number
        assert self.node is not None
        self.node.wake()


class FakeNode(VideoNode):
    def __init__(self, camera: FakeCamera) -> None:
        self._camera = camera
        self.name = "Fake"
        self._empty: deque[int] = deque()
        self._filled: deque[Filled] = deque()
        self._data: dict[int, bytes] = {}
        self._layout = Layout("", 0, 0, 0)
        self._event = os.eventfd(0, os.EFD_NONBLOCK)
        self.is_closed = False
        self._lock = threading.Lock()  # pictures may be shot by another thread

    def fileno(self) -> int:
        return self._event

    def now(self) -> float:
        return time.monotonic()

    def modes(self) -> list[Mode]:
        return self._camera.all_modes

    def set_format(self, name: str, width: int, height: int) -> Layout:
        if self._camera.busy:
            fail(errno.EBUSY)
        modes = self._camera.all_modes
        exact = [m for m in modes if m[:3] == (name, width, height)]
        chosen = (exact or modes)[0]
        wide = 2 if chosen.format == "YUYV" else 1
        stride = wide * chosen.width + self._camera.padding
        self._layout = Layout(*chosen[:3], stride)
        return self._layout

    def set_rate(self, fps: float) -> float:
        fastest = max(m.fps for m in self._camera.all_modes if m[:3] == self._layout[:3])
        return min(fps, fastest)

    def range(self, control: int) -> Range | None:
        return self._camera.ranges.get(control)

    def set_control(self, control: int, value: int) -> int:
        if control in self._camera.refused:
            fail(self._camera.refused[control])
        limits = self._camera.ranges[control]
        if not limits.low <= value <= limits.high:
            fail(errno.ERANGE)
        if control == EXPOSURE_AUTO and value not in (1, 3):
            fail(errno.EINVAL)
        self._camera.values[control] = value
        return value

    def control(self, control: int) -> int:
        return self._camera.values.get(control, 0)

    def start(self, count: int) -> int:
        if self._camera.full_bus:
            fail(errno.ENOSPC)
        self._empty.extend(range(count))
        return count

    def dequeue(self) -> Filled | None:
        if not self._camera.plugged:
            fail(errno.ENODEV)
        if self._camera.wait_error:
            number, self._camera.wait_error = self._camera.wait_error, 0
            fail(number)
        with self._lock:
            if not self._filled:
                return None
            if len(self._filled) == 1:
                os.eventfd_read(self._event)
            return self._filled.popleft()

    def queue(self, index: int) -> None:
        if not self._camera.plugged:
            fail(errno.ENODEV)
        assert index not in self._empty
        self._empty.append(index)

    def copy(self, filled: Filled) -> bytes:
        assert filled.buffer not in self._empty, "the driver may be writing into it"
        return self._data[filled.buffer]

    def close(self) -> None:
        assert not self.is_closed
        self.is_closed = True
        os.close(self._event)
        self._camera.node = None

    # ---- the device's side ----

    def fill(self, damaged: bool, short: bool, t: float) -> None:
        if not self._empty:
            return
        index = self._empty.popleft()
        data = self._camera.sends(picture(self._layout, self._camera.sequence % 200))
        data = data[: len(data) // 2] if short else data
        self._data[index] = data
        camera = self._camera
        with self._lock:
            self._filled.append(Filled(index, len(data), camera.sequence, t, camera.stamp, damaged))
            self.wake()

    def wake(self) -> None:
        os.eventfd_write(self._event, 1)


def picture(layout: Layout, value: int) -> bytes:
    """Return a picture of one brightness as a camera sends it; what is not brightness is 255."""
    name, width, height, stride = layout
    if name == "MJPG":
        image = np.full((height, width), value, np.uint8)
        return cv2.imencode(".jpg", image)[1].tobytes() + b"\0\0"
    lines = np.full((height, stride), 255, np.uint8)
    lines[:, : 2 * width : 2 if name == "YUYV" else 1][:, :width] = value
    colour = np.full(stride * height // 2, 255, np.uint8).tobytes() if name == "NV12" else b""
    return lines.tobytes() + colour


def fail(number: int) -> NoReturn:
    raise OSError(number, os.strerror(number))
