"""Moves a gimbal while the camera sees a pad that lies still, and collects views and delays."""

import asyncio
import math
from bisect import bisect_right
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from landerd.calibration.bench import REST_S, REST_UNMEASURED_S, Bench, Refused
from landerd.calibration.gimbal_fit import View, turn_between
from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3, clamp, dot, rot_zyx, rotate, transpose
from landerd.messages import (
    Frame,
    GimbalCommand,
    GimbalState,
    PoseSolution,
    Reference,
    Sightings,
)
from landerd.runtime.daemon import Devices

AxisName = Literal["yaw", "pitch"]

_PICTURES_EACH = 2  # number of pictures in each direction
_SIGN_STEP = math.radians(6.0)  # turn that is ordered to find an axis's sign
FEWEST_VIEWS = 8  # least number of views for a calibration
_LEAST_FOLLOWED = 0.3  # least share of an ordered turn that counts as following it
_SEARCH_PITCHES = tuple(math.radians(a) for a in (0.0, -20.0, -40.0, -60.0, -80.0, 20.0))
_FROM_MIDDLE = 0.6  # distance to which the pad is brought from the middle; share of half a picture
_WIDEST_YAW = math.radians(35.0)  # limit of yaw orders, which straight down would be unlimited
_SURE_YAW = math.radians(1.0)  # largest sigma of the yaw of a pad that is used
_SWING = math.radians(5.0)  # amplitude of swings
_SWING_HZ, _SWING_S = 0.5, 3.0  # frequency and duration of swings
_SWING_PICTURES_S = 0.05  # interval of the pictures that are searched
_DELAYS_S = np.arange(-0.25, 0.6, 0.002)  # delays that are tried


@dataclass(frozen=True)
class Delays:
    """Delays of pictures of an axis in motion, by their times of exposure, s."""

    order: float  # behind the orders
    report: float  # behind what was reported, by its own times


@dataclass
class Measured:
    """Everything that was measured."""

    views: list[View] = field(default_factory=list)
    signs: dict[AxisName, int] = field(default_factory=dict)  # of axes that turn
    delays: dict[AxisName, Delays] = field(default_factory=dict)


class GimbalMotion:
    """Moves one gimbal, once."""

    def __init__(
        self,
        devices: Devices,
        camera: CameraModel,
        reach: Mapping[AxisName, tuple[float, float]],
        search: Callable[[Frame], Sightings],
        say: Callable[[str], None],
        *,
        is_measured: bool = True,
        with_autopilot: bool = True,
    ) -> None:
        """Prepare; the devices are opened by `run`.

        Args:
            devices: of the vehicle, still closed.
            camera: calibration of the pictures.
            reach: least and greatest angle of each axis, rad.
            search: finds the pad in a picture.
            say: shows the user a line.
            is_measured: whether the gimbal measures its angles.
            with_autopilot: whether the autopilot must be heard, and be disarmed; else the airframe
                must stand level.
        """
        self._devices, self._camera = devices, camera
        self._limits, self._search, self._say = reach, search, say
        self._rest_s = REST_S if is_measured else REST_UNMEASURED_S
        self._bench = Bench(devices, with_autopilot=with_autopilot)
        self.measured = Measured()

    async def run(self, places: int, ask: Callable[[int], Awaitable[None]]) -> Measured:
        """Take views of the pad in a number of places, and return them.

        Args:
            places: number of places in which the pad lies in turn, straight ahead and level.
            ask: waits until the pad lies in a place, given by its number from 0.

        Raises:
            DeviceLost: a device is gone.
            Refused: a device sends nothing, the pad is not seen, or the gimbal does not follow.
        """
        async with self._bench.opened():
            for place in range(places):
                await ask(place)
                await self._turn_around(place)
        return self.measured

    # ---- the trial -----------------------------------------------------------------------------

    async def _turn_around(self, place: int) -> None:
        """Take views of the pad at many angles; in the first place also find signs and delays."""
        yaw, pitch, pad = await self._find()
        self._say(f"the pad is seen {_metres(pad)} away; turning the camera around it")
        measured = self.measured
        if place == 0:
            for axis in ("yaw", "pitch"):
                sign = await self._sign(axis, yaw, pitch)
                if sign is not None:
                    measured.signs[axis] = sign
        grid = self._grid(yaw, pitch, pad)
        if len(grid) == 1:
            grid *= FEWEST_VIEWS  # the camera is bolted
        seen = 0
        for to_yaw, to_pitch in grid:
            found = await self._look(to_yaw, to_pitch, place)
            seen += bool(found)
            measured.views += found
        self._say(f"{seen} of {len(grid)} directions show the pad")
        if place == 0:
            middle = [0.5 * (min(angles) + max(angles)) for angles in zip(*grid, strict=True)]
            for axis in measured.signs:
                measured.delays[axis] = await self._delays_of(axis, middle[0], middle[1])

    async def _find(self) -> tuple[float, float, PoseSolution]:
        """Return yaw and pitch, rad, at which the pad is in the picture, and its pose there."""
        start = self._bench.states[-1]
        low, high = self._limits["yaw"]
        yaws = [clamp(yaw, low, high) for yaw in (0.0, -_WIDEST_YAW, _WIDEST_YAW)]
        tries = [(start.yaw, start.pitch)]
        for yaw in dict.fromkeys(yaws):
            tries += [(yaw, clamp(p, *self._limits["pitch"])) for p in _SEARCH_PITCHES]
        for yaw, pitch in dict.fromkeys(tries):
            views = await self._look(yaw, pitch, 0)
            if views:
                return yaw, pitch, views[0].pad
        raise Refused(
            "the pad is nowhere to be seen: is it lit, flat, whole in the picture, and the one "
            "that pad.layout names?"
        )

    async def _sign(self, axis: AxisName, yaw: float, pitch: float) -> int | None:
        """Return 1 if the camera turns as reported, -1 if the other way; None: it cannot turn."""
        low, high = self._limits[axis]
        at = yaw if axis == "yaw" else pitch
        if high - low < _SIGN_STEP:
            return None
        steps = [s for s in (_SIGN_STEP, -_SIGN_STEP) if low <= at + s <= high]
        before = await self._look(yaw, pitch, 0)
        why = f"{axis}: the pad leaves the picture when it turns by {_deg(_SIGN_STEP)}"
        for step in steps:
            turn = {"yaw": (yaw + step, pitch), "pitch": (yaw, pitch + step)}[axis]
            after = await self._look(*turn, 0)
            if not (before and after):
                continue
            told = getattr(after[0], axis) - getattr(before[0], axis)
            turned = turn_between(before[0].pad, after[0].pad)
            # The camera's x lies along the pitch axis; yaw turns about gravity, the pad's normal.
            came = turned[0] if axis == "pitch" else dot(turned, before[0].pad.normal)
            if abs(came) > _LEAST_FOLLOWED * abs(step):
                break
            why = (
                f"{axis} does not follow: {_deg(step)} were ordered, {_deg(came)} came. Are its "
                "motors on? Is its mode one that takes orders?"
            )
        else:
            raise Refused(why)
        if told * step < 0.0 or abs(told) < _LEAST_FOLLOWED * abs(step):
            raise Refused(
                f"{axis} reports {_deg(told)} for an order of {_deg(step)}: orders and reports do "
                "not belong together"
            )
        return 1 if came * told > 0.0 else -1

    def _grid(self, yaw: float, pitch: float, pad: PoseSolution) -> list[tuple[float, float]]:
        """Return orders (yaw, pitch), rad, that bring the pad to many places of the picture.

        They form a cross and its corners about the orders `yaw` and `pitch`, at which the pad was
        seen with the pose `pad`.
        """
        camera = self._camera
        x, y, z = pad.position
        across, down = math.atan2(x, z), math.atan2(y, z)
        most_across = _FROM_MIDDLE * math.atan(0.5 * camera.width / camera.fx)
        most_down = _FROM_MIDDLE * math.atan(0.5 * camera.height / camera.fy)
        # Cosine of the camera's pitch, by the pad, which lies level.
        flat = max(0.3, abs(pad.normal[1]))
        signs = self.measured.signs
        yaws = [
            clamp((across - a) / flat, -_WIDEST_YAW, _WIDEST_YAW) * signs.get("yaw", 0)
            for a in (-most_across, most_across)
        ]
        pitches = [(d - down) * signs.get("pitch", 0) for d in (-most_down, most_down)]
        ys = _spread(yaw, yaws, self._limits["yaw"])
        ps = _spread(pitch, pitches, self._limits["pitch"])
        cross = [(ys[2], p) for p in ps] + [(y, ps[2]) for y in ys]
        corners = [(y, p) for y in (ys[0], ys[4]) for p in (ps[0], ps[4])]
        return list(dict.fromkeys(cross + corners))

    async def _delays_of(self, axis: AxisName, yaw: float, pitch: float) -> Delays:
        """Swing an axis to and fro, and return the pictures' delays."""
        frames = await self._swing(axis, yaw, pitch)
        times, angles = [], []
        for frame in frames:
            pad = await self._pad_in(frame)
            if pad is not None:
                x, y, z = pad.position
                times.append(frame.t)
                angles.append(math.atan2(-x if axis == "yaw" else y, z))
        if len(times) < 0.5 * len(frames) or len(times) < 20:
            raise Refused(f"{axis}: the pad is not seen while it swings; more light, a larger pad")
        column = 1 if axis == "yaw" else 2
        orders = self._bench.orders
        order_t = [order[0] for order in orders]

        def ordered(t: float) -> float:
            # An order holds until the next one.
            return orders[max(0, bisect_right(order_t, t) - 1)][column]

        reports = np.array([(s.t, getattr(s, axis)) for s in self._bench.states])
        seen_t, seen = np.array(times), np.array(angles)
        return Delays(
            _delay(seen_t, seen, lambda t: np.array([ordered(float(x)) for x in t])),
            _delay(seen_t, seen, lambda t: np.interp(t, reports[:, 0], reports[:, 1])),
        )

    async def _swing(self, axis: AxisName, yaw: float, pitch: float) -> list[Frame]:
        """Swing an axis about these angles, as far as its limits allow; return the pictures."""
        low, high = self._limits[axis]
        at = yaw if axis == "yaw" else pitch
        has_room = high - low > 2.0 * _SWING
        at = clamp(at, low + _SWING, high - _SWING) if has_room else 0.5 * (low + high)
        size = min(_SWING, high - at, at - low)
        loop = asyncio.get_running_loop()
        start = loop.time() + REST_S

        def target(t: float) -> GimbalCommand:
            swung = at + size * math.sin(2.0 * math.pi * _SWING_HZ * max(0.0, t - start))
            return GimbalCommand(swung, pitch) if axis == "yaw" else GimbalCommand(yaw, swung)

        frames: list[Frame] = []
        async with self._bench.ordering(target):
            while loop.time() < start + _SWING_S:
                frame = await self._devices.camera.newest()
                if frame.t > (frames[-1].t + _SWING_PICTURES_S if frames else start):
                    frames.append(frame)
                self._bench.check()
        return frames

    # ---- orders and pictures -------------------------------------------------------------------

    async def _look(self, yaw: float, pitch: float, place: int) -> list[View]:
        """Order angles, rad, wait until the gimbal stands still, and return views of the pad."""
        views = []
        async with self._bench.ordering(lambda _: GimbalCommand(yaw, pitch)):
            await asyncio.sleep(self._rest_s)
            start = asyncio.get_running_loop().time()
            taken = 0
            while taken < _PICTURES_EACH:
                frame = await self._devices.camera.newest()
                self._bench.check()
                if frame.t < start:
                    continue
                taken += 1
                pad = await self._pad_in(frame)
                if pad is not None:
                    state = self._bench.states[-1]
                    down = self._down(state)
                    views.append(View(place, state.yaw, state.pitch, state.roll, pad, down))
        return views

    async def _pad_in(self, frame: Frame) -> PoseSolution | None:
        """Return the pad's pose in a picture; None: not found, or of an uncertain heading."""
        await asyncio.sleep(0.0)  # links are served between searches, which take long
        pads = [pad for pad in self._search(frame).pad if _tells_heading(pad)]
        return pads[0] if pads else None

    def _down(self, state: GimbalState) -> Vec3:
        """Return the unit vector of gravity in the frame that the gimbal's angles are against."""
        if state.reference is not Reference.BODY or self._bench.attitude is None:
            return (0.0, 0.0, 1.0)
        R_level_body = rot_zyx(0.0, self._bench.attitude.pitch, self._bench.attitude.roll)
        return rotate(transpose(R_level_body), (0.0, 0.0, 1.0))


def _tells_heading(pad: PoseSolution) -> bool:
    """Tell whether a pad's heading is known well; that of a partly hidden tag may not be."""
    return pad.sigma_yaw is not None and pad.sigma_yaw < _SURE_YAW


def _spread(at: float, ends: list[float], limits: tuple[float, float]) -> list[float]:
    """Return five angles over a range around an angle, within limits."""
    low, high = sorted(clamp(at + end, *limits) for end in ends)
    return [low + 0.25 * i * (high - low) for i in range(5)]


def _delay(t: F64, seen: F64, model: Callable[[F64], F64]) -> float:
    """Return the delay, s, with which the angles seen fit best to a linear function of a model.

    Args:
        t: times at which angles were seen, s, (n,).
        seen: angles seen, rad, (n,).
        model: returns orders or reports at times, rad.
    """
    best, least = 0.0, math.inf
    for delay in _DELAYS_S:
        A = np.column_stack([np.ones(len(t)), model(t - delay)])
        x, *_ = np.linalg.lstsq(A, seen, rcond=None)
        left = float(np.sum((A @ x - seen) ** 2))
        if left < least:
            best, least = float(delay), left
    return best


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):+.1f} degrees"


def _metres(pad: PoseSolution) -> str:
    return f"{math.hypot(*pad.position):.2f} m"
