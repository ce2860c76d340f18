"""The simulated camera: exposes, renders, and delivers late, on the event loop's clock."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hw.sim.options import SimCameraOptions
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, Snapshot
from landerd.geometry import add, sub
from landerd.messages import Frame
from landerd.ports import DeviceLost


@dataclass
class CameraFaults:
    """What is wrong with the camera; may be changed at any time."""

    drop: float = 0.0  # probability that a frame is lost
    frozen: bool = False  # the last picture is delivered again, with its old time
    wrong_size: bool = False
    wrong_type: bool = False  # pictures of 16 bits
    not_a_number: bool = False  # pictures of NaN
    time_ahead_s: float = 0.0  # time stamps lie in the future
    disconnected: bool = False
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


class SimCamera:
    """Implements landerd.ports.Camera; a frame not fetched in time is replaced by the next."""

    def __init__(
        self,
        renderer: Renderer,
        truth: Callable[[float], Snapshot],
        options: SimCameraOptions,
        delivered: Callable[[Frame, Snapshot], None] | None = None,
    ) -> None:
        """Make a camera.

        Args:
            renderer: draws its pictures.
            truth: the world at a time not long past, s on the loop's clock.
            options: rate, exposure, latency.
            delivered: told of every sound frame with the truth at its exposure.
        """
        self.faults = CameraFaults()
        self._renderer = renderer
        self._truth = truth
        self._options = options
        self._delivered = delivered
        self._seq = 0
        self._exposed_t = 0.0  # middle of the exposure of the newest frame
        self._last: Frame | None = None

    async def open(self) -> None:
        """Start the stream. Raises DeviceLost."""
        if self.faults.disconnected:
            raise DeviceLost("simulated camera is unplugged")
        self._exposed_t = asyncio.get_running_loop().time()

    async def newest(self) -> Frame:
        """Wait for the next frame; those that nobody waited for are skipped. Raises DeviceLost."""
        loop = asyncio.get_running_loop()
        period, latency = 1.0 / self._options.fps, self._options.latency_s
        while True:
            late = loop.time() - latency - self._exposed_t
            steps = max(1, int(late / period))
            self._exposed_t += steps * period
            self._seq += steps
            await asyncio.sleep(max(0.0, self._exposed_t + latency - loop.time()))
            if loop.time() - latency - self._exposed_t > period:
                continue  # the loop was late: there is a newer one by now
            faults = self.faults
            if faults.disconnected:
                raise DeviceLost("simulated camera is unplugged")
            if faults.drop > 0.0 and faults.random.random() < faults.drop:
                continue
            if faults.frozen and self._last is not None:
                return self._last
            return self._expose(self._exposed_t)

    async def close(self) -> None:
        """Stop the stream; safe to call twice."""

    def _expose(self, t: float) -> Frame:
        half = 0.5 * self._options.exposure_s
        start, middle, end = (self._truth(at) for at in (t - half, t, t + half))
        image = self._renderer.render(
            self._seq,
            _beside_pad(start, middle),
            _beside_pad(end, middle),
            middle.pad,
            middle.vehicle,
        )
        faults = self.faults
        stamp = t + self._options.clock_offset_s + faults.time_ahead_s
        if faults.wrong_size:
            return Frame(stamp, self._seq, image[::2, ::2])
        if faults.wrong_type:
            return Frame(stamp, self._seq, image.astype(np.uint16))
        if faults.not_a_number:
            return Frame(stamp, self._seq, np.full(image.shape, np.nan))
        self._last = Frame(stamp, self._seq, image)
        if self._delivered is not None and faults.time_ahead_s == 0.0:
            self._delivered(self._last, middle)
        return self._last


def _beside_pad(then: Snapshot, now: Snapshot) -> CameraPose:
    """Return the camera's pose at another time, carried along with the pad to where it is now.

    The renderer lets the pad stand still; a camera that keeps pace with a moving one sees it sharp.
    """
    way = sub(now.pad.position, then.pad.position)
    return CameraPose(add(then.camera.position, way), then.camera.R_local_camera)
