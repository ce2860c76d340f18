"""Tells that the vehicle swings over the pad: it is slower than its gain takes it for.

An error that closes as it is to falls to nothing within seconds. One that stays as large, and
changes as fast as the gain would close it or faster, is a swing: in a steady offset nothing moves,
and gusts move it less.
"""

import math

from landerd.geometry import Vec3, horizontal

NEAR_M = 1.0  # farther off it is on its way
WINDOW_S = 2.0  # a swing of vehicles that swung had 1.6 s
LEAST_M = 0.07  # rms: smaller swings do no harm
LASTS = 0.7  # of the window before
FAST = 0.9  # of the gain times the error


class Swing:
    """Looks at the error over one window after another.

    Attributes:
        size: rms of the error in the last one, m.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what was seen."""
        self.size = math.inf
        self._begin()

    def _begin(self) -> None:
        self._t = self._error = self._rate = 0.0  # s, m^2 s, (m/s)^2 s

    def step(self, error: Vec3, error_rate: Vec3, gain: float, dt: float) -> bool:
        """Take an error; tell, once for each window, whether it swings.

        Args:
            error: pad relative to vehicle, level as far as it counts, m.
            error_rate: its rate, m/s.
            gain: that closes the error, 1/s.
            dt: time since the last step, s.
        """
        if horizontal(error) > NEAR_M:
            self.restart()
            return False
        self._t += dt
        self._error += dt * horizontal(error) ** 2
        self._rate += dt * horizontal(error_rate) ** 2
        if self._t < WINDOW_S:
            return False
        size, speed = math.sqrt(self._error / self._t), math.sqrt(self._rate / self._t)
        stays = size > LEAST_M and size > LASTS * self.size
        self.size = size
        self._begin()
        return stays and speed > FAST * gain * size
