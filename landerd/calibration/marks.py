"""Bench tests before the first flight (thesis 4.2.3): the pad on marked places of the floor.

The vehicle stands still and the core runs as in flight, but for the orders to the autopilot, of
which none is sent. What it sees is compared with where the marks were measured to be.
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

_TICK_S = 0.025  # as in flight
_FOUND_WITHIN_S = 25.0  # the gimbal's sweeps included
_SWING_S = 2.5  # watched after the gimbal was let go
_TURNING_S = 1.0  # of it the gimbal is said to turn
_OFF_MIDDLE = 0.6  # of half the picture: how far the pad is brought aside
_LEAST_FOLLOWED = 0.6  # of it must have come
_STEEP = math.radians(-60.0)  # looking down more than this, yaw hardly moves the picture


@dataclass(frozen=True)
class Mark:
    """Where the landing point lies, from the gimbal's pivot, the vehicle level, m.

    The pad's north points where the nose does.
    """

    ahead: float
    right: float
    down: float

    @property
    def place(self) -> Vec3:
        """Ahead, right, down; m."""
        return (self.ahead, self.right, self.down)


@dataclass(frozen=True)
class Seen:
    """The pad in one picture; `place` is None where it was not found."""

    t: float  # exposure, s
    place: Vec3 | None  # landing point from the pivot: ahead, right, down; m
    heading: float | None  # of the pad's north from the nose, rad
    off_middle: float  # of the landing point from the picture's middle, rad
    sigma_m: float  # as vision states, largest direction


@dataclass(frozen=True)
class Swing:
    """What came of letting the gimbal turn to a pad that was aside."""

    axis: str
    step: float  # how far it was aside, rad, signed
    seen: tuple[Seen, ...]  # from when it was let go
    start: float  # s


class MarkTrial:
    """The pad on one mark; the devices are opened for it and closed after it."""

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
        """Take what is needed.

        Args:
            config: of the vehicle.
            layout: of the pad.
            camera: calibration of the pictures.
            devices: closed.
            search: finds the pad in a picture; links are served meanwhile.
            is_measured: the gimbal knows where it is.
            with_autopilot: whether it has to be heard, disarmed; else the airframe stands level.
        """
        self._config, self._camera, self._search = config, camera, search
        self._bench = Bench(devices, with_autopilot=with_autopilot, heard=self._hear)
        self._lander = Lander(config, layout)
        self._poses = PoseHistory(config)
        self._rest_s = REST_S if is_measured else REST_UNMEASURED_S
        self._with_autopilot = with_autopilot
        self._let_go = True  # the gimbal does as the core says
        self._aimed: GimbalCommand | None = None

    async def at_rest(self, pictures: int) -> list[Seen]:
        """Point at the pad as in flight and return what so many pictures show.

        Raises:
            DeviceLost: a device is gone.
            Refused: the pad is not found, nothing is heard, or the vehicle is armed.
        """
        async with self._running():
            await self._find()
            return [await self._look() for _ in range(pictures)]

    async def swings(self, pictures: int) -> tuple[list[Seen], list[Swing]]:
        """Turn the camera aside in each axis and let it go; return what was seen at rest and then.

        Raises: as `at_rest`.
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
        """Return how far the camera can be turned aside, by axis, rad."""
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
        """Hold the camera aside, let it go, and watch; None: the pad left the picture."""
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
        loop = asyncio.get_running_loop()
        end = loop.time() + seconds
        seen = []
        while loop.time() < end:
            seen.append(await self._look())
        return seen

    async def _look(self) -> Seen:
        """Search the next picture and tell the core."""
        frame = await self._bench.devices.camera.newest()
        self._bench.check()
        sightings = await self._search(frame, self._lander.prior(frame.t))
        self._lander.step(sightings)
        return self._place(sightings)

    def _place(self, sightings: Sightings) -> Seen:
        R = self._poses.camera_rotation(sightings.t)
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
        """Let the core aim: the vehicle stands, whether or not its autopilot has a position."""
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
    """How far what was seen is from a mark; medians over the pictures."""

    found: float  # share of the pictures
    range_share: float  # too far: positive
    direction: float  # between where it was seen and where it is, rad
    heading: float | None  # rad; None: the pad tells none
    scatter_m: float  # standard deviation of the distance
    sigma_m: float  # as vision states of it


def pose_errors(mark: Mark, seen: list[Seen]) -> PoseErrors:
    """Return the errors of what was seen of a pad on a mark.

    Raises:
        Refused: it was not seen at all.
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
    """How a gimbal came to the pad, and what the pad's place was meanwhile."""

    centred_s: float | None  # until the pad stayed as near the middle as it came; None: never
    rest: float  # from the picture's middle in the end, rad
    found: float  # share of the pictures
    direction: float  # rms error of the pad's direction while the gimbal turned, rad


def swing_errors(rest: list[Seen], swing: Swing) -> SwingErrors:
    """Return the errors of a swing against what was seen at rest.

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
