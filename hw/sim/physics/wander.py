"""The small movements of a hovering vehicle, which controls its position by noisy measurements."""

import math
from random import Random

from hw.sim.physics.response import STEP_S
from landerd.geometry import Vec3

_UPDATE_STEPS = 8
_UPDATE_S = _UPDATE_STEPS * STEP_S


class Wander:
    """Velocity and acceleration added to the ordered motion.

    Sized for the measured hover of 30 s: position within 6 / 2 / 0.6 mm, velocity within
    6 / 2.5 / 0.6 mm/s, roll and pitch within 0.02 to 0.03 degrees (standard deviations, north /
    east / down). Position and velocity of these sizes are a slow swing of about 1 rad/s.
    """

    _VELOCITY = (0.006, 0.0025, 0.0006)  # standard deviation north, east, down, m/s
    _OMEGA, _ZETA = 1.0, 0.35  # of the swing: angular frequency, rad/s, and damping ratio
    _DRIVE_S = 1.5  # correlation time of the noise that drives the swing
    _DRIVE = 1.25  # standard deviation of that noise over that of the velocity, 1/s

    def __init__(self, rng: Random) -> None:
        self.velocity: Vec3 = (0.0, 0.0, 0.0)  # m/s
        self.acceleration: Vec3 = (0.0, 0.0, 0.0)  # m/s^2
        self._rng = rng
        self._position: Vec3 = (0.0, 0.0, 0.0)
        self._drive: Vec3 = (0.0, 0.0, 0.0)
        self._jerk: Vec3 = (0.0, 0.0, 0.0)
        self._steps_left = 0
        self._decay = math.exp(-_UPDATE_S / self._DRIVE_S)
        noise = math.sqrt(1.0 - self._decay * self._decay)
        n, e, d = self._VELOCITY
        self._noise = (n * self._DRIVE * noise, e * self._DRIVE * noise, d * self._DRIVE * noise)

    def step(self) -> None:
        """Advance by STEP_S."""
        if self._steps_left == 0:
            self._steps_left = _UPDATE_STEPS
            self._drive_on()
        self._steps_left -= 1
        an, ae, ad = self.acceleration
        jn, je, jd = self._jerk
        an, ae, ad = an + jn * STEP_S, ae + je * STEP_S, ad + jd * STEP_S
        vn, ve, vd = self.velocity
        self.acceleration = (an, ae, ad)
        self.velocity = (vn + an * STEP_S, ve + ae * STEP_S, vd + ad * STEP_S)

    def _drive_on(self) -> None:
        """Compute the jerk until the next update, so that the acceleration is continuous."""
        n, e, d = (self._axis(i) for i in range(3))
        self._position = (n[0], e[0], d[0])
        self._drive = (n[1], e[1], d[1])
        self._jerk = (n[2], e[2], d[2])

    def _axis(self, i: int) -> Vec3:
        position = self._position[i] + self.velocity[i] * _UPDATE_S
        drive = self._decay * self._drive[i] + self._noise[i] * self._rng.gauss(0.0, 1.0)
        pull = self._OMEGA * (self._OMEGA * position + 2.0 * self._ZETA * self.velocity[i])
        return position, drive, (drive - pull - self.acceleration[i]) / _UPDATE_S
