"""Bench tests before the first flight (thesis 4.2.3): the pad lies on marks on the floor.

The vehicle stands still and the core runs as in flight, but no orders are sent to the autopilot.
The pad's position as seen is compared to that of the marks, which was measured by hand.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from statistics import median
from typing import NoReturn

from landerd.calibration.bench import REST_S, REST_UNMEASURED_S, Bench, Refused
from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.estimation.camera_pose import PoseHistory
from landerd.geometry import Vec3, clamp, rot_z, rotate, sub, unit
from landerd.lander import Lander
from landerd.messages import (
    Attitude,
    Frame,
    GimbalCommand,
    GimbalState,
    LocalPosition,
    Prior,
    Sightings,
    Tick,
)
from landerd.pad import PadLayout
from landerd.runtime.daemon import Devices

Search = Callable[[Frame, Prior], Awaitable[Sightings]]

_TICK_S = 0.025  # period of control steps, as in flight
_FOUND_WITHIN_S = 25.0  # longest time to find the pad, sweeps of the gimbal included
_SWING_S = 2.5  # time for which the pad is watched after the core may move the gimbal again
_TURNING_S = 1.0  # the part of it in which the gimbal counts as turning
_OFF_MIDDLE = 0.6  # distance from the middle to which the pad is brought, share of half a picture
_LEAST_FOLLOWED = 0.6  # least share of an ordered turn that counts as following it
_STEEP = math.radians(-60.0)  # pitch below which yaw hardly moves the pad in the picture


@dataclass(frozen=True)
class Mark:
    """Measured position of the landing point from the gimbal's pivot of the level vehicle, m.

    The pad's north points in the direction of the vehicle's nose.
    """

    ahead: float
    right: float
    down: float

    @property
    def place(self) -> Vec3:
        """Ahead, right, down, m."""
        return (self.ahead, self.right, self.down)


@dataclass(frozen=True)
class Seen:
    """The pad in one picture; all but the time is None or NaN if it was not found."""

    t: float  # time of the exposure, s
    place: Vec3 | None  # landing point from the gimbal's pivot: ahead, right, down, m
    heading: float | None  # of the pad's north from the vehicle's nose, rad; None: unknown
    off_middle: float  # angle of the landing point from the picture's middle, rad
    sigma_m: float  # largest sigma of the position along an axis, as vision states it


@dataclass(frozen=True)
class Swing:
    """How the core turned the gimbal back to a pad from which it had been turned away."""

    axis: str
    step: float  # angle by which the gimbal had been turned away, rad, signed
    seen: tuple[Seen, ...]  # the pad from then on
    start: float  # time from which the core moved the gimbal, s


class MarkTrial:
    """A test with the pad on one mark; each method opens the devices and closes them."""

    def __init__(
        self,
        config: Config,
        layout: PadLayout,
        camera: CameraModel,
        devices: Devices,
        search: Search,
        *,
        is_measured: bool,
        with_autopilot: bool,
    ) -> None:
        """Prepare.

        Args:
            config: of the vehicle.
            layout: of the pad.
            camera: calibration of the pictures.
            devices: of the vehicle, still closed.
            search: finds the pad in a picture, while links are served.
            is_measured: whether the gimbal measures its angles.
            with_autopilot: whether the autopilot must be heard, and be disarmed; else the airframe
                must stand level.
        """
        self._config, self._camera, self._search = config, camera, search
        self._bench = Bench(devices, with_autopilot=with_autopilot, heard=self._hear)
        self._lander = Lander(config, layout)
        self._poses = PoseHistory(config)
        self._rest_s = REST_S if is_measured else REST_UNMEASURED_S
        self._with_autopilot = with_autopilot
        self._let_go = True  # whether the core's orders go to the gimbal
        self._aimed: GimbalCommand | None = None

    async def at_rest(self, pictures: int) -> list[Seen]:
        """Point at the pad as in flight, and return what a number of pictures show.

        Raises:
            DeviceLost: a device is gone.
            Refused: the pad is not found, a device sends nothing, or the vehicle is armed.
        """
        async with self._running():
            await self._find()
            return [await self._look() for _ in range(pictures)]

    async def swings(self, pictures: int) -> tuple[list[Seen], list[Swing]]:
        """Turn the camera away from the pad in each axis, and let the core turn it back.

        Args:
            pictures: number of pictures at rest before.

        Returns:
            what these pictures show, and the swings.

        Raises:
            DeviceLost: a device is gone.
            Refused: as for `at_rest`, or an axis does not follow.
        """
        async with self._running():
            await self._find()
            rest = [await self._look() for _ in range(pictures)]
            swings = []
            for axis, step in self._steps():
                swing = await self._swing(axis, step)
                swings += [swing] if swing is not None else []
            return rest, swings

    # ---- the gimbal ----------------------------------------------------------------------------

    async def _find(self) -> None:
        """Wait until the pad is seen and the gimbal has come to rest on it."""
        loop = asyncio.get_running_loop()
        end = loop.time() + _FOUND_WITHIN_S
        while (await self._look()).place is None:
            if loop.time() > end:
                raise Refused(
                    "the pad is nowhere to be seen: is it lit, flat, whole in the picture, and "
                    "the one that pad.layout names?"
                )
        await self._watch(self._rest_s)

    def _steps(self) -> list[tuple[str, float]]:
        """Return axes and signed angles, rad, by which the camera can be turned from the pad."""
        assert self._aimed is not None
        camera, section = self._camera, self._config.gimbal
        sizes = {
            "pitch": _OFF_MIDDLE * math.atan(0.5 * camera.height / camera.fy),
            "yaw": _OFF_MIDDLE * math.atan(0.5 * camera.width / camera.fx),
        }
        limits = {"pitch": section.pitch_limits_deg, "yaw": section.yaw_limits_deg}
        steps = []
        for axis, size in sizes.items():
            if axis == "yaw" and self._aimed.pitch < _STEEP:
                continue
            at = getattr(self._aimed, axis)
            low, high = (math.radians(angle) for angle in limits[axis])
            steps += [(axis, s) for s in (size, -size) if clamp(at + s, low, high) == at + s]
        return steps

    async def _swing(self, axis: str, step: float) -> Swing | None:
        """Turn the camera away, let the core turn it back, and watch; None: the pad was lost."""
        assert self._aimed is not None
        aside = {"yaw": self._aimed.yaw, "pitch": self._aimed.pitch}
        aside[axis] += step
        self._let_go = False
        async with self._bench.ordering(lambda _: GimbalCommand(**aside)):
            seen = await self._watch(self._rest_s)
        if not seen or seen[-1].place is None:
            self._let_go = True
            await self._watch(self._rest_s)
            return None
        if seen[-1].off_middle < _LEAST_FOLLOWED * abs(step):
            raise Refused(
                f"{axis} does not follow: {math.degrees(step):+.0f} degrees were ordered, in "
                f"{self._rest_s:g} s the pad was {math.degrees(seen[-1].off_middle):.0f} degrees "
                "from the middle. Are its motors on? Is it slower than that?"
            )
        self._let_go = True
        start = asyncio.get_running_loop().time()
        return Swing(axis, step, tuple(await self._watch(_SWING_S)), start)

    # ---- pictures ------------------------------------------------------------------------------

    async def _watch(self, seconds: float) -> list[Seen]:
        """Return what all pictures show for some time."""
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        seen = []
        while loop.time() < end:
            seen.append(await self._look())
        return seen

    async def _look(self) -> Seen:
        """Search the next picture, give the sightings to the core, and return the pad."""
        frame = await self._bench.devices.camera.newest()
        self._bench.check()
        sightings = await self._search(frame, self._lander.prior(frame.t))
        self._lander.step(sightings)
        return self._place(sightings)

    def _place(self, sightings: Sightings) -> Seen:
        """Return the pad of some sightings relative to the vehicle."""
        R = self._poses.camera_rotation(self._poses.airframe(sightings.t), sightings.t)
        attitude = self._poses.attitude.at(sightings.t)
        if not sightings.pad or R is None or attitude is None:
            return Seen(sightings.t, None, None, math.nan, math.nan)
        pad = sightings.pad[0]
        R_level_local = rot_z(-attitude[2])
        place = rotate(R_level_local, rotate(R, pad.position))
        heading = None
        if pad.north is not None:
            north = rotate(R_level_local, rotate(R, pad.north))
            heading = math.atan2(north[1], north[0])
        x, y, z = pad.position
        sigma = math.sqrt(max(pad.covariance[i][i] for i in range(3)))
        return Seen(sightings.t, place, heading, math.atan2(math.hypot(x, y), z), sigma)

    # ---- the core ------------------------------------------------------------------------------

    @asynccontextmanager
    async def _running(self) -> AsyncIterator[None]:
        """Open the devices, and run the core, until the context is left."""
        async with self._bench.opened():
            task = asyncio.create_task(self._tick())
            try:
                yield
            finally:
                task.cancel()

    def _hear(self, message: GimbalState | Attitude) -> None:
        self._lander.step(message)
        self._poses.add(message)

    async def _tick(self) -> NoReturn:
        """Step the core, so that it aims the gimbal, until cancelled.

        The vehicle's position is given as constant, whether or not its autopilot has one.
        """
        loop = asyncio.get_running_loop()
        still = (0.0, 0.0, 0.0)
        while True:
            now = loop.time()
            self._lander.step(LocalPosition(now, still, still))
            if not self._with_autopilot:
                self._hear(Attitude(now, 0.0, 0.0, 0.0, still))
            for command in self._lander.step(Tick(now)):
                if isinstance(command, GimbalCommand):
                    self._aimed = command
                    if self._let_go:
                        self._bench.devices.gimbal.command(command)
            await asyncio.sleep(_TICK_S)


# ---- figures -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class PoseErrors:
    """Errors of the pad's position as seen against a mark; medians over the pictures."""

    found: float  # share of the pictures in which the pad was found
    range_share: float  # relative error of the range; positive: seen too far away
    direction: float  # angle between the directions as seen and as measured, rad
    heading: float | None  # error of the pad's heading, rad; None: its heading is unknown
    scatter_m: float  # standard deviation of the range
    sigma_m: float  # largest sigma of the position as vision states it


def pose_errors(mark: Mark, seen: list[Seen]) -> PoseErrors:
    """Return the errors of what was seen of a pad on a mark.

    Raises:
        Refused: the pad was not seen at all.
    """
    places = [s.place for s in seen if s.place is not None]
    if not places:
        raise Refused("the pad was not seen once it had been found")
    true_range = math.hypot(*mark.place)
    ranges = [math.hypot(*place) for place in places]
    mean = sum(ranges) / len(ranges)
    headings = [s.heading for s in seen if s.heading is not None]
    return PoseErrors(
        len(places) / len(seen),
        median(ranges) / true_range - 1.0,
        median(angle_between(place, mark.place) for place in places),
        median(headings) if headings else None,
        math.sqrt(sum((r - mean) ** 2 for r in ranges) / len(ranges)),
        median(s.sigma_m for s in seen if s.place is not None),
    )


@dataclass(frozen=True)
class SwingErrors:
    """How a gimbal turned back to the pad, and errors of the pad's direction meanwhile."""

    centred_s: float | None  # time until the pad stayed near its final place; None: never
    rest: float  # final angle of the pad from the picture's middle, rad
    found: float  # share of the pictures in which the pad was found
    direction: float  # rms error of the pad's direction while the gimbal turned, rad


def swing_errors(rest: list[Seen], swing: Swing) -> SwingErrors:
    """Return the errors of a swing; the true direction is that seen at rest.

    Args:
        rest: the pad in pictures at rest.
        swing: of the gimbal.

    Raises:
        Refused: the pad was not seen at rest.
    """
    places = [s.place for s in rest if s.place is not None]
    if not places:
        raise Refused("the pad was not seen at rest")
    still = tuple(median(place[i] for place in places) for i in range(3))
    found = [s for s in swing.seen if s.place is not None]
    turning = [s for s in found if s.t - swing.start < _TURNING_S]
    squares = [angle_between(s.place, still) ** 2 for s in turning if s.place is not None]
    last = found[-1].off_middle if found else math.nan
    settled = last + 0.1 * abs(swing.step)
    away = [s.t for s in swing.seen if not s.off_middle <= settled]
    after = [s.t for s in swing.seen if not away or s.t > away[-1]]
    return SwingErrors(
        max(0.0, after[0] - swing.start) if after else None,
        last,
        len(found) / len(swing.seen) if swing.seen else 0.0,
        math.sqrt(sum(squares) / len(squares)) if squares else math.nan,
    )


def angle_between(a: Vec3, b: tuple[float, ...]) -> float:
    """Return the angle between two vectors, rad."""
    ua, ub = unit(a), unit((b[0], b[1], b[2]))
    chord = math.hypot(*sub(ua, ub))
    return 2.0 * math.asin(min(1.0, 0.5 * chord))
