"""The autopilot's estimate of its state: the true state with delay, noise and bias."""

import math
from random import Random
from typing import NamedTuple

from hw.sim.options import EkfOptions
from hw.sim.physics.world import World
from landerd.geometry import Vec3, add, wrap


class Estimate(NamedTuple):
    """The estimated state at one time, local NED."""

    t: float  # of validity as the autopilot states it, s
    position: Vec3  # m
    velocity: Vec3  # m/s
    roll: float  # rad
    pitch: float
    yaw: float
    rates: Vec3  # body, rad/s


class Ekf:
    """Models the output of an EKF by adding errors to the true state; there is no filter.

    Heights over the local origin have the barometer's scale error, velocities a constant bias. If
    so configured, horizontal positions wander and jump, and the heading has an error that drifts.

    Attributes:
        velocity_bias: error of the velocity, local, m/s.
        height_scale: estimated height over the local origin divided by the true one.
    """

    def __init__(self, world: World, options: EkfOptions, rng: Random) -> None:
        """Draw the errors that are constant during the flight."""
        self._world = world
        self._options = options
        self._rng = rng
        least, most = options.velocity_bias_mps
        bias, heading = rng.uniform(least, most), rng.uniform(-math.pi, math.pi)
        self.velocity_bias: Vec3 = (
            bias * math.cos(heading),
            bias * math.sin(heading),
            options.vertical_bias_mps,
        )
        self.height_scale = 1.0 + rng.uniform(0.0, options.height_scale_max)
        self._drift = PositionDrift(options, Random(rng.random())) if _drifts(options) else None
        self._heading_error = math.radians(options.heading_error_deg)
        self._heading_drift = math.radians(options.heading_drift_deg_per_min) / 60.0
        self._began = world.t

    def estimate(self, t: float) -> Estimate:
        """Return the autopilot's estimated state at time t, s."""
        options, rng = self._options, self._rng
        self._world.advance(t)
        s = self._world.state_at(t - options.delay_s)
        n, e, d = s.position
        if self._drift is not None:
            wander_n, wander_e = self._drift.at(t)
            n, e = n + wander_n, e + wander_e
        heading_error = self._heading_error + self._heading_drift * (t - self._began)
        sigma = math.radians(options.attitude_noise_deg)
        return Estimate(
            t,
            self._noisy((n, e, d * self.height_scale), options.position_noise_m),
            self._noisy(add(s.velocity, self.velocity_bias), options.velocity_noise_mps),
            s.roll + rng.gauss(0.0, sigma),
            s.pitch + rng.gauss(0.0, sigma),
            wrap(s.yaw + heading_error + rng.gauss(0.0, sigma)),
            s.rates,
        )

    def _noisy(self, v: Vec3, sigma: float) -> Vec3:
        gauss = self._rng.gauss
        return (v[0] + gauss(0.0, sigma), v[1] + gauss(0.0, sigma), v[2] + gauss(0.0, sigma))


class PositionDrift:
    """The horizontal position's error by GPS: a random walk with occasional jumps."""

    UPDATE_S = 0.2  # a GPS's five fixes a second

    def __init__(self, options: EkfOptions, rng: Random) -> None:
        self._rng = rng
        self._step_m = options.position_wander_m_per_min * math.sqrt(self.UPDATE_S / 60.0)
        self._jump_m = options.position_jump_m
        self._jump_share = self.UPDATE_S / options.jump_every_s
        self._offset = (0.0, 0.0)
        self._due: float | None = None

    def at(self, t: float) -> tuple[float, float]:
        """Return the error north and east (m) at time t (s), which must not decrease."""
        if self._due is None:
            self._due = t
        while t >= self._due:
            self._due += self.UPDATE_S
            n, e = self._offset
            n += self._rng.gauss(0.0, self._step_m)
            e += self._rng.gauss(0.0, self._step_m)
            if self._jump_m and self._rng.random() < self._jump_share:
                size, way = self._rng.uniform(0.0, self._jump_m), self._rng.uniform(0, 2 * math.pi)
                n, e = n + size * math.cos(way), e + size * math.sin(way)
            self._offset = (n, e)
        return self._offset


def _drifts(options: EkfOptions) -> bool:
    return options.position_wander_m_per_min > 0.0 or options.position_jump_m > 0.0
