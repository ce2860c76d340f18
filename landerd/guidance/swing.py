"""Detects that the vehicle oscillates over the pad: it answers later than its gain allows for.

A well-damped error decays within seconds. One that does not decay, and whose rate is as large as
the gain times the error, is an oscillation: in a steady offset nothing moves, and gusts move the
vehicle more slowly.
"""

import math

from landerd.geometry import Vec3, horizontal

NEAR_M = 1.0  # farther off the vehicle is still on its way to the pad
WINDOW_S = 2.0  # the oscillations that were flown had a period of 1.6 s
LEAST_M = 0.07  # rms error; smaller oscillations do no harm
LASTS = 0.7  # least rms error that does not decay, over that of the window before
FAST = 0.9  # least rms error rate of an oscillation, over the gain times the rms error


class Swing:
    """Judges the error in consecutive windows.

    Attributes:
        size: rms error of the last window, m; infinite before the first one is full.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Start afresh."""
        self.size = math.inf
        self._begin()

    def _begin(self) -> None:
        self._t = self._error = self._rate = 0.0  # integrals over the window: s, m^2 s, (m/s)^2 s

    def step(self, error: Vec3, error_rate: Vec3, gain: float, dt: float) -> bool:
        """Take an error; tell, at the end of a window, whether the vehicle oscillated in it.

        Args:
            error: pad relative to vehicle, m; its horizontal part counts.
            error_rate: its rate, m/s.
            gain: of the position controller, 1/s.
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
