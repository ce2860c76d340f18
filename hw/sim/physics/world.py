"""The simulated world: vehicle, air, pad, gimbal and battery on one clock, from one seed."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import NamedTuple, Protocol

from hw.sim.options import BuildOptions, SimOptions
from hw.sim.physics.battery import Battery
from hw.sim.physics.contact import LandingGear
from hw.sim.physics.gimbal import GimbalPlant
from hw.sim.physics.pad_motion import Disturbance, PadMotion, PadState
from hw.sim.physics.response import STEP_S
from hw.sim.physics.vehicle import Vehicle, vehicle_model
from hw.sim.physics.wind import UPDATE_S, make_wind
from hw.sim.snapshot import CameraPose, PadPose, Snapshot, VehiclePose
from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    matmul,
    rot_z,
    rot_zyx,
    rotate,
    sub,
    wrap,
)
from landerd.messages import Reference
from landerd.pad import Plate

HISTORY_S = 0.6  # true states kept: for the longest camera latency, 0.5 s, plus an exposure
_WIND_STEPS = round(UPDATE_S / STEP_S)
_FOOT_DROP_M = 0.4  # how far below the gear's height a foot may be when the body tilts


class Airframe(Protocol):
    """The vehicle's geometry, as landerd.config.VehicleSection has it."""

    @property
    def camera_offset_m(self) -> Vec3:
        """Vector from the body frame's origin to the gimbal's pivot, body frame, m."""

    @property
    def gear_height_m(self) -> float:
        """Distance from the origin down to the feet, m."""

    @property
    def footprint_m(self) -> tuple[float, float]:
        """Distances between the feet along body x and y, m."""


@dataclass(frozen=True, slots=True)
class BuiltAirframe:
    """The true geometry of the vehicle."""

    camera_offset_m: Vec3
    gear_height_m: float
    footprint_m: tuple[float, float]


def as_built(believed: Airframe, options: BuildOptions) -> Airframe:
    """Return a vehicle's true geometry: the configured one plus the options' errors."""
    return BuiltAirframe(
        add(believed.camera_offset_m, options.camera_offset_error_m),
        believed.gear_height_m + options.gear_height_error_m,
        believed.footprint_m,
    )


class Sample(NamedTuple):  # made at every step: a frozen dataclass takes three times as long
    """True state at the end of one step."""

    position: Vec3
    velocity: Vec3
    roll: float
    pitch: float
    yaw: float
    rates: Vec3
    gimbal_yaw: float
    gimbal_pitch: float


def stream(seed: int, name: str) -> Random:
    """Return the random numbers of one part of the world, independent of the other parts'."""
    return Random(f"{seed}:{name}")


class World:
    """The true state of the simulated world.

    Times are the event loop's. The devices call `advance` before they read the state.

    Attributes:
        gust: velocity added to the wind, north and east, m/s.
    """

    def __init__(
        self, options: SimOptions, airframe: Airframe, plate: Plate, seed: int, t0: float = 0.0
    ) -> None:
        """Put the vehicle into a hover at the start position.

        Args:
            options: options of the simulated world
            airframe: geometry of the vehicle
            plate: outline of the pad
            seed: seed of all random numbers
            t0: present time of the event loop, s
        """
        self.options = options
        self.on_step: list[Callable[[World], None]] = []
        self.battery = Battery(options.airframe.mass_kg)
        self.gimbal = GimbalPlant(options.gimbal)
        self.airframe = airframe
        self._t0 = t0
        self._steps = 0
        self._motion = PadMotion(options.pad, plate, stream(seed, "pad"))
        self._wind = make_wind(options.wind, stream(seed, "wind"))
        self._wind_now = self._wind.at(0.0)
        self.gust = (0.0, 0.0)
        gear = LandingGear(airframe.footprint_m, airframe.gear_height_m, plate)
        self.vehicle = Vehicle(
            vehicle_model(options.vehicle, options.airframe, options.response),
            options.yaw_response,
            gear,
            stream(seed, "vehicle"),
        )
        # While the vehicle's origin is higher than this, its feet cannot touch anything.
        self._contact_height = self._motion.highest + airframe.gear_height_m + _FOOT_DROP_M
        self._start(stream(seed, "start"), seed)
        self._history: deque[Sample] = deque(maxlen=round(HISTORY_S / STEP_S) + 1)
        self._record()

    def _start(self, rng: Random, seed: int) -> None:
        start = self.options.start
        pad = self._motion.at(0.0)
        spread = start.spread_m
        vn, ve, _ = pad.velocity
        if self.follows:
            side = math.radians(self.options.pad.course_deg)
            x, y, _ = rotate(rot_z(side), (-start.follow_m, 0.0, 0.0))
        else:
            side = 2.0 * math.pi * (seed % start.bearings) / start.bearings
            x, y, _ = rotate(rot_z(side), (*start.position_m, 0.0))
        n = pad.position[0] + x + rng.uniform(-spread, spread)
        e = pad.position[1] + y + rng.uniform(-spread, spread)
        d = -self._motion.mean_height - start.altitude_m
        heading_deg = start.heading_deg + rng.uniform(-1.0, 1.0) * start.heading_spread_deg
        velocity = (vn, ve) if self.follows else (0.0, 0.0)
        self.vehicle.start(
            (n, e, d), velocity, wrap(math.radians(heading_deg) + side), self._wind_now
        )

    @property
    def follows(self) -> bool:
        """Whether the vehicle starts behind the pad and at its velocity."""
        return self.options.pad.speed_mps >= self.options.start.follow_from_mps

    @property
    def t(self) -> float:
        """The time that the world has reached, s; less than one step before that of `advance`."""
        return self._t0 + self.elapsed_s

    @property
    def elapsed_s(self) -> float:
        """The time since the start, s, of which the pad's motion is a function."""
        return self._steps * STEP_S

    def advance(self, t: float) -> None:
        """Advance the world to time t, s; a time in the past changes nothing."""
        target = math.floor((t - self._t0) / STEP_S + 1e-6)
        while self._steps < target:
            if self._steps % _WIND_STEPS == 0:
                n, e = self._wind.at(self._steps * STEP_S)
                self._wind_now = (n + self.gust[0], e + self.gust[1])
            self._steps += 1
            self._move(None if self.is_above(0.0) else self._motion.at(self.elapsed_s))
            self.gimbal.step()
            self._record()
            for hook in self.on_step:
                hook(self)

    def is_above(self, height_m: float) -> bool:
        """Tell whether the feet are certainly higher over the plate than this, wherever it is.

        It is cheap enough for every step; computing the pad's position takes far longer.
        """
        if self._motion.disturbances:  # which may lift the pad
            return False
        return -self.vehicle.position[2] - height_m >= self._contact_height

    def _move(self, pad: PadState | None) -> None:
        """Advance vehicle and battery by one step; pad: None while the vehicle is high above."""
        vehicle = self.vehicle
        vehicle.step(self.t, self._wind_now, pad)
        self.battery.step(vehicle.motors, vehicle.load, vehicle.velocity[2])

    def _record(self) -> None:
        v = self.vehicle
        self._history.append(
            Sample(
                v.position,
                v.velocity,
                v.roll,
                v.pitch,
                v.yaw,
                v.rates,
                self.gimbal.yaw.angle,
                self.gimbal.pitch.angle,
            )
        )

    # ---- the truth, now ------------------------------------------------------------------------

    @property
    def wind(self) -> tuple[float, float]:
        """Velocity of the air, north and east, m/s."""
        return self._wind_now

    @property
    def pad(self) -> PadState:
        """Pose and motion of the pad."""
        return self._motion.at(self.elapsed_s)

    @property
    def footprint_centre(self) -> Vec3:
        """The vehicle's reference point: the centre of the feet, local, m."""
        v = self.vehicle
        R = rot_zyx(v.yaw, v.pitch, v.roll)
        return add(v.position, rotate(R, (0.0, 0.0, self.airframe.gear_height_m)))

    @property
    def height(self) -> float:
        """Height of the footprint's centre over the landing point, m."""
        return self.pad.position[2] - self.footprint_centre[2]

    @property
    def offset(self) -> tuple[float, float]:
        """Offset of the footprint's centre from the landing point, north and east, m."""
        d = sub(self.footprint_centre, self.pad.position)
        return d[0], d[1]

    @property
    def relative_velocity(self) -> Vec3:
        """Velocity of the vehicle relative to the plate under it, local, m/s."""
        return sub(self.vehicle.velocity, self.pad.velocity_at(self.footprint_centre))

    @property
    def heading_error(self) -> float:
        """The vehicle's heading minus the pad's, rad."""
        return wrap(self.vehicle.yaw - self.pad.heading)

    # ---- the past ------------------------------------------------------------------------------

    def state_at(self, t: float) -> Sample:
        """Return the state at time t, which lies within HISTORY_S before now.

        Raises:
            ValueError: t is older than that.
        """
        self.advance(t)
        back = max(0.0, self._steps - (t - self._t0) / STEP_S)
        newer = len(self._history) - 1 - int(back)
        share = back - int(back)
        if newer - (share > 0.0) < 0:
            if self._steps * STEP_S < HISTORY_S:  # before the start the vehicle hovered there
                return self._history[0]
            raise ValueError(f"the world at {t:.3f} s is forgotten, it is {self.t:.3f} s now")
        b = self._history[newer]
        if share == 0.0:
            return b
        a = self._history[newer - 1]
        return Sample(
            interpolated(b.position, a.position, share),
            interpolated(b.velocity, a.velocity, share),
            b.roll + share * (a.roll - b.roll),
            b.pitch + share * (a.pitch - b.pitch),
            b.yaw + share * wrap(a.yaw - b.yaw),
            interpolated(b.rates, a.rates, share),
            b.gimbal_yaw + share * (a.gimbal_yaw - b.gimbal_yaw),
            b.gimbal_pitch + share * (a.gimbal_pitch - b.gimbal_pitch),
        )

    def disturb_pad(self, disturbance: Disturbance) -> None:
        """Add a disturbance of the pad's motion; its times count from the start, s."""
        self._motion.disturbances.append(disturbance)

    def snapshot(self, t: float) -> Snapshot:
        """Return the poses that a picture of time t (s) shows; t is within the last HISTORY_S.

        Raises:
            ValueError: t is older than that.
        """
        s = self.state_at(t)
        air = self.airframe
        R_local_body = rot_zyx(s.yaw, s.pitch, s.roll)
        R_base_gimbal = rot_zyx(s.gimbal_yaw, s.gimbal_pitch, 0.0)
        is_stabilised = self.gimbal.reference is Reference.HORIZON
        R_local_base = rot_z(s.yaw) if is_stabilised else R_local_body
        R_local_camera: Mat3 = matmul(
            matmul(R_local_base, R_base_gimbal), self.gimbal.R_gimbal_camera
        )
        lens = add(s.position, rotate(R_local_body, air.camera_offset_m))
        pad = self._motion.at(t - self._t0)
        return Snapshot(
            t,
            CameraPose(lens, R_local_camera),
            PadPose(pad.position, pad.R_local_pad),
            VehiclePose(s.position, R_local_body, air.footprint_m, air.gear_height_m),
        )


def interpolated(a: Vec3, b: Vec3, share: float) -> Vec3:
    """Return the point a + share (b - a)."""
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
    )
