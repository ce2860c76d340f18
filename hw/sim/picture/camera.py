"""The simulated camera: exposes, renders, and delivers late, on the event loop's clock."""

import asyncio
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions
from hw.sim.physics.world import stream
from hw.sim.picture.exposure import SHORTEST_S, AutoExposure, Exposure
from hw.sim.picture.shutter import POSE_PERIOD_S, Readout, Vibration
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.geometry import IDENTITY, add, sub
from landerd.messages import ExposureOrder, Frame
from landerd.ports import DeviceLost

U8 = NDArray[np.uint8]

OLDEST_S = 0.45  # greatest age of a picture at its arrival; the world keeps its states longer
ORDER_FRAMES = 2  # number of pictures from an exposure order until it takes effect, as in sensors
FORGIVEN_S = 0.05  # a picture stamped no farther in the future may still be used
JITTER_MOST = 0.45  # largest jitter, share of the period, so that pictures keep their order
_NO_PAD = PadPose((0.0, 0.0, -1e5), IDENTITY)  # far above the camera, whose lower side is not drawn


@dataclass
class CameraFaults:
    """The faults of the camera; they may be changed at any time."""

    drop: float = 0.0  # probability that a frame is lost
    frozen: bool = False  # the last picture is delivered again, with its old time
    frozen_fresh: bool = False  # the last picture is delivered again, as if it were new
    wrong_size: bool = False
    wrong_type: bool = False  # pictures of 16 bits
    not_a_number: bool = False  # pictures of NaN
    time_ahead_s: float = 0.0  # added to time stamps
    time_jumps_s: float = 0.0  # largest random error of each time stamp, either way
    time_stands: bool = False  # new pictures have the last time
    late_s: float = 0.0  # additional delay of pictures, whose time stamps stay correct
    swap: float = 0.0  # probability that a picture arrives after the next one
    spoil: Callable[[U8], U8] | None = None  # changes every picture
    pad_covered: bool = False  # the pad is not visible
    hides_pad: bool = False  # the pad cannot be found in the pictures delivered
    raises: Exception | None = None  # unexpected exception of the driver, raised once
    disconnected: bool = False
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


class Renders(Protocol):
    """Draws pictures, as `hw.sim.picture.renderer.Renderer` does."""

    def render(
        self,
        frame_index: int,
        start: CameraPose,
        end: CameraPose,
        pad: PadPose,
        vehicle: VehiclePose | None,
        exposure: Exposure | None = None,
        readout: Readout | None = None,
    ) -> U8:
        """Return the picture (height, width) of an exposure from pose start to pose end."""
        ...

    def brightness(self, image: U8) -> float:
        """Return the mean of a picture, share of full scale."""
        ...


class SimCamera:
    """Implements landerd.ports.Camera; a frame not fetched in time is replaced by the next.

    Attributes:
        faults: faults of the camera.
    """

    def __init__(
        self,
        renderer: Renders,
        truth: Callable[[float], Snapshot],
        options: SimCameraOptions,
        delivered: Callable[[Frame, Snapshot], None] | None = None,
        seed: int = 0,
        *,
        realtime: bool = False,
    ) -> None:
        """Make a camera.

        Args:
            renderer: draws its pictures.
            truth: returns the world's state at a recent time, s on the loop's clock.
            options: rate, exposure, latency, and their jitter.
            delivered: called with every valid frame and the truth at its exposure.
            seed: seed of all jitter.
            realtime: pictures are drawn in a thread; in the event loop they would hold up all else.
        """
        self._realtime = realtime
        self.faults = CameraFaults()
        self._scenes = [renderer]
        self._truth = truth
        self._options = options
        self._delivered = delivered
        self._timing = _Timing(options, seed)
        self._fixed = Exposure(options.exposure_s)
        self._auto = AutoExposure(options) if options.exposure == "auto" else None
        self._orders: list[tuple[float, Exposure]] = []  # time from which on it holds (s), exposure
        self._vibration: Vibration | None = None
        if options.vibration.deg > 0.0:
            self._vibration = Vibration(options.vibration, stream(seed, "camera vibration"))
        self._seq = 0
        self._due_t = 0.0  # middle of the newest frame's exposure without jitter, s
        self._last: Frame | None = None
        self._line: deque[_Made] = deque()  # pictures under way
        self._overtaken: _Made | None = None  # picture that the next one overtakes
        self._behind: _Made | None = None  # overtaken picture, which arrives now

    @property
    def pictures(self) -> Renders:
        """The renderer of its pictures."""
        return self._scenes[-1]

    def show(self, scene: Renders) -> None:
        """Use another renderer from now on."""
        self._scenes.append(scene)

    def hide(self, scene: Renders) -> None:
        """Stop using a renderer given to `show`; the order of these calls does not matter."""
        self._scenes.remove(scene)

    async def open(self) -> None:
        """Start the stream. Raises DeviceLost."""
        if self.faults.disconnected:
            raise DeviceLost("simulated camera is unplugged")
        self._due_t = asyncio.get_running_loop().time()

    async def newest(self) -> Frame:
        """Wait for the next frame; those that nobody waited for are skipped. Raises DeviceLost."""
        loop = asyncio.get_running_loop()
        period, latency = 1.0 / self._options.fps, self._options.latency_s
        while True:
            late = loop.time() - latency - self._due_t
            steps = max(1, int(late / period))
            self._due_t += steps * period
            self._seq += steps
            exposed_t = self._due_t + self._timing.rate_jitter()
            late_s = self._timing.latency(exposed_t, self._read_s(exposed_t))
            await asyncio.sleep(max(0.0, exposed_t + late_s - loop.time()))
            if loop.time() - late_s - exposed_t > period:
                continue  # the loop was late, and there is a newer frame by now
            if self._misses():
                continue
            made = self._on_the_way(await self._made(exposed_t))
            if made is not None:
                return self._deliver(made)

    def _misses(self) -> bool:
        """Tell whether the next picture is lost. Raises the exceptions of a faulty driver."""
        faults = self.faults
        if faults.disconnected:
            raise DeviceLost("simulated camera is unplugged")
        if faults.raises is not None:
            raised, faults.raises = faults.raises, None
            raise raised
        if faults.drop > 0.0 and faults.random.random() < faults.drop:
            return True
        return self._timing.drops()

    async def _made(self, exposed_t: float) -> "_Made":
        faults, last = self.faults, self._last
        if faults.frozen and last is not None:
            return _Made(last, None)
        if faults.frozen_fresh and last is not None:
            return _Made(Frame(self._stamp(exposed_t), self._seq, last.image), None)
        return await self._expose(exposed_t)

    def _on_the_way(self, made: "_Made") -> "_Made | None":
        """Send a picture on its way; return the one that arrives now; None: none does."""
        faults, period = self.faults, 1.0 / self._options.fps
        self._line.append(made)
        waiting = round(faults.late_s / period)
        if len(self._line) <= waiting:
            return None
        while len(self._line) > waiting + 1:
            self._line.popleft()  # overdue, as the fault's delay has become shorter
        arriving = self._line.popleft()
        if self._behind is not None:
            arriving, self._behind = self._behind, None
        elif self._overtaken is not None:
            self._behind, self._overtaken = self._overtaken, None
        elif faults.swap > 0.0 and faults.random.random() < faults.swap:
            self._overtaken = arriving
            return None
        return arriving

    def _deliver(self, made: "_Made") -> Frame:
        if self._delivered is not None and made.truth is not None:
            self._delivered(made.frame, made.truth)
        return made.frame

    async def close(self) -> None:
        """Stop the stream; safe to call twice."""

    def expose(self, order: ExposureOrder) -> None:
        """Take an exposure order, effective some pictures later, if the option is `ordered`."""
        if self._options.exposure != "ordered":
            return
        at = asyncio.get_running_loop().time() + ORDER_FRAMES / self._options.fps
        time_s = min(max(order.time_s, SHORTEST_S), 0.9 / self._options.fps)
        gain = min(max(order.gain, 1.0), self._options.auto_exposure.gain_max)
        self._orders.append((at, Exposure(time_s, gain)))

    def _read_s(self, t: float) -> float:
        """Time from the middle of an exposure to the end of the last row's, s."""
        return 0.5 * (self._exposure(t).time_s + self._options.readout_s)

    def _exposure(self, t: float) -> Exposure:
        """Return the exposure of the picture at t, s; t must not decrease."""
        if self._auto is not None:
            return self._auto.exposure
        while self._orders and self._orders[0][0] <= t:
            self._fixed = self._orders.pop(0)[1]
        return self._fixed

    def _stamp(self, t: float) -> float:
        """Return the camera's time stamp for time t, s."""
        offset_s = self._options.clock_offset_s + self._timing.clock_jitter()
        faults = self.faults
        if faults.time_stands and self._last is not None:
            return self._last.t
        if faults.time_jumps_s > 0.0:
            offset_s += float(faults.random.uniform(-faults.time_jumps_s, faults.time_jumps_s))
        return t + offset_s + faults.time_ahead_s

    async def _expose(self, t: float) -> "_Made":
        exposure = self._exposure(t)
        half = 0.5 * exposure.time_s
        start, middle, end = (self._truth(at) for at in (t - half, t, t + half))
        if self.faults.pad_covered:
            middle = replace(middle, pad=_NO_PAD)
            start, end = replace(start, pad=_NO_PAD), replace(end, pad=_NO_PAD)
        render = partial(
            self.pictures.render,
            self._seq,
            _beside_pad(start, middle),
            _beside_pad(end, middle),
            middle.pad,
            middle.vehicle,
            exposure,
            self._readout(middle, exposure),
        )
        image = await asyncio.to_thread(render) if self._realtime else render()
        if self._auto is not None:
            self._auto.see(self.pictures.brightness(image), t)
        faults = self.faults
        stamp = self._stamp(t)
        if faults.wrong_size:
            return _Made(Frame(stamp, self._seq, image[::2, ::2]), None)
        if faults.wrong_type:
            return _Made(Frame(stamp, self._seq, image.astype(np.uint16)), None)
        if faults.not_a_number:
            return _Made(Frame(stamp, self._seq, np.full(image.shape, np.nan)), None)
        if faults.spoil is not None:
            image = faults.spoil(image)
        self._last = Frame(stamp, self._seq, image)
        is_sound = not faults.hides_pad and faults.time_ahead_s <= FORGIVEN_S
        return _Made(self._last, middle if is_sound else None)

    def _readout(self, middle: Snapshot, exposure: Exposure) -> Readout | None:
        """Return the poses during the rows' readout; None: all rows are exposed at once."""
        seconds = self._options.readout_s
        if seconds == 0.0:
            if self._vibration is None:
                return None
            snapshots = [middle]
        else:
            steps = math.ceil(seconds / POSE_PERIOD_S)
            shares = (k / steps - 0.5 for k in range(steps + 1))
            snapshots = [self._truth(middle.t + seconds * share) for share in shares]
            if self.faults.pad_covered:
                snapshots = [replace(s, pad=_NO_PAD) for s in snapshots]
        return Readout(middle.t, seconds, exposure.time_s, tuple(snapshots), self._vibration)


@dataclass(frozen=True, slots=True)
class _Made:
    """A picture, and the truth at its exposure if the pad can be found in it."""

    frame: Frame
    truth: Snapshot | None


class _Timing:
    """Jitter and losses of a camera's pictures; each kind has its own random numbers."""

    def __init__(self, options: SimCameraOptions, seed: int) -> None:
        self._options = options
        self._rate, self._latency, self._clock, self._drop = (
            stream(seed, f"camera {name}") for name in ("rate", "latency", "clock", "drop")
        )
        self._arrived_t = -math.inf  # arrival of the picture before, s

    def rate_jitter(self) -> float:
        """Return the deviation of the next picture's exposure from its due time, s."""
        o = self._options
        if o.fps_jitter == 0.0:
            return 0.0
        share = self._rate.gauss(0.0, o.fps_jitter)
        return min(max(share, -JITTER_MOST), JITTER_MOST) / o.fps

    def latency(self, exposed_t: float, least_s: float) -> float:
        """Return the delay from a picture's exposure to its arrival, s; none overtakes another."""
        o = self._options
        latency_s = o.latency_s
        if o.latency_jitter_s > 0.0:
            latency_s += self._latency.gauss(0.0, o.latency_jitter_s)
            latency_s = min(latency_s, max(o.latency_s, OLDEST_S))
        latency_s = max(latency_s, least_s, self._arrived_t - exposed_t)
        self._arrived_t = exposed_t + latency_s
        return latency_s

    def clock_jitter(self) -> float:
        """Return the error of one time stamp in addition to the offset, s."""
        jitter_s = self._options.clock_jitter_s
        return self._clock.gauss(0.0, jitter_s) if jitter_s > 0.0 else 0.0

    def drops(self) -> bool:
        """Tell whether the next picture is lost."""
        drop = self._options.drop
        return drop > 0.0 and self._drop.random() < drop


def _beside_pad(then: Snapshot, now: Snapshot) -> CameraPose:
    """Return the camera's pose at another time, carried along with the pad to where it is now.

    The renderer lets the pad stand still; a camera that keeps pace with a moving one sees it sharp.
    """
    way = sub(now.pad.position, then.pad.position)
    return CameraPose(add(then.camera.position, way), then.camera.R_local_camera)
