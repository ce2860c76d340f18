"""The autopilot's own estimate of its state: the truth, late, noisy and biased."""

import math
from dataclasses import dataclass
from random import Random

from hw.sim.options import EkfOptions
from hw.sim.physics.world import World
from landerd.geometry import Vec3, add, wrap


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the EKF says at one time, local NED."""

    t: float  # of validity as the autopilot states it, s
    position: Vec3  # m
    velocity: Vec3  # m/s
    roll: float  # rad
    pitch: float
    yaw: float
    rates: Vec3  # body, rad/s


class Ekf:
    """An EKF's output without the filter.

    Heights over the local origin are off by the barometer's scale, velocities by a constant bias;
    positions do not drift.
    """

    def __init__(self, world: World, options: EkfOptions, rng: Random) -> None:
        """Draw the errors that stay for the flight."""
        self._world = world
        self._options = options
        self._rng = rng
        least, most = options.velocity_bias_mps
        bias, heading = rng.uniform(least, most), rng.uniform(-math.pi, math.pi)
        self._velocity_bias: Vec3 = (bias * math.cos(heading), bias * math.sin(heading), 0.0)
        self._height_scale = 1.0 + rng.uniform(0.0, options.height_scale_max)

    def estimate(self, t: float) -> Estimate:
        """Return what the autopilot takes its state to be at time t, s."""
        options, rng = self._options, self._rng
        self._world.advance(t)
        s = self._world.state_at(t - options.delay_s)
        n, e, d = s.position
        sigma = math.radians(options.attitude_noise_deg)
        return Estimate(
            t,
            self._noisy((n, e, d * self._height_scale), options.position_noise_m),
            self._noisy(add(s.velocity, self._velocity_bias), options.velocity_noise_mps),
            s.roll + rng.gauss(0.0, sigma),
            s.pitch + rng.gauss(0.0, sigma),
            wrap(s.yaw + rng.gauss(0.0, sigma)),
            s.rates,
        )

    def _noisy(self, v: Vec3, sigma: float) -> Vec3:
        gauss = self._rng.gauss
        return (v[0] + gauss(0.0, sigma), v[1] + gauss(0.0, sigma), v[2] + gauss(0.0, sigma))
