"""Where the errors that all frames have in common are linearised, free of one picture's noise."""

import math

from landerd.estimation.motion_filter import Jacobian, MotionFilter
from landerd.estimation.observation import BiasModel, PadObservation
from landerd.geometry import Vec3, add, clamp, dot, rotate, scale, sub, unit

RANGE_TIME_CONSTANT_S = 2.0  # of the errors of ranges, which change as the pad comes nearer
ANOTHER_MARKER = 2.0  # by which is seen what says that its range errs by so much more, or less
# Over which the camera's axes are told that the lens errs about, s, while they turn by less than
# this, rad. In the newest frame they are as noisy as what it shows: 1.2 m behind a pad of 1 m/s,
# 6 m up, that taught the filter 0.05 degrees of the lens a second, without end. Axes that lag a
# turn tell of the lens too: with 3 degrees one that was 2 degrees off was taken for 0.4 +- 0.5.
AXES_TIME_CONSTANT_S, AXES_TURN = 0.3, math.radians(0.25)


class BiasLinearisation:
    """Averages what the Jacobian of the biases goes by; call `average` once for each frame."""

    def __init__(self) -> None:
        # On average: how far down the pad is, local, m; what its ranges err by alike, 1 sigma.
        self._down = self._range_share = 0.0
        self._axes: tuple[float, Vec3, Vec3] | None = None  # the camera's x and y: when, local

    def start(self, seen: PadObservation) -> None:
        """Begin anew from one observation."""
        self._down, self._range_share = seen.position[2], seen.biases.range_share
        self._axes = (seen.t, seen.biases.about_x, seen.biases.about_y)

    def jacobian(self, seen: PadObservation, motion: MotionFilter) -> Jacobian:
        """Return how the biases move what is seen where it should be seen.

        Were it where it is seen, every sighting's noise would tell of the lens: hovering at 2 m,
        of ranges that erred by 2 % from picture to picture, it learned 3 degrees within 10 s. (An
        EKF that linearises where its newest measurement moved it learns what it cannot observe:
        Huang, Mourikis and Roumeliotis 2010.)
        """
        biases = self._with_steady_axes(seen)
        camera = sub(seen.position, seen.arm)
        arm = sub((motion.position[0], motion.position[1], self._down), camera)
        shown = shown_by(motion, biases.jacobian(arm, self._range_share))
        return biases.jacobian(add(arm, shown), self._range_share)

    def _with_steady_axes(self, seen: PadObservation) -> BiasModel:
        """Return how the biases move what is seen, about axes that are free of its noise."""
        new = seen.biases
        if self._axes is None:
            return new
        t, x, y = self._axes
        if min(dot(x, new.about_x), dot(y, new.about_y)) < math.cos(AXES_TURN):
            return new
        k = clamp((seen.t - t) / AXES_TIME_CONSTANT_S, 0.0, 1.0)
        x = unit(add(x, scale(sub(new.about_x, x), k)))
        y = unit(add(y, scale(sub(new.about_y, y), k)))
        return new._replace(about_x=x, about_y=y)

    def average(self, seen: PadObservation, dt: float, pad_down: float) -> None:
        """Go on with what the Jacobian goes by, free of one picture's noise.

        Args:
            seen: says what its range may err by alike: that goes up and down with the range as it
                was measured.
            dt: since the last one, s.
            pad_down: local z of the pad as predicted, m.
        """
        range_share, steady = seen.biases.range_share, self._with_steady_axes(seen)
        self._axes = (seen.t, steady.about_x, steady.about_y)
        ratio = range_share / self._range_share if self._range_share > 0.0 else math.inf
        if not 1.0 / ANOTHER_MARKER < ratio < ANOTHER_MARKER:
            self._range_share = range_share
        newer = min(1.0, dt / RANGE_TIME_CONSTANT_S)
        self._range_share += newer * (range_share - self._range_share)
        self._down += newer * (pad_down - self._down)


def shown_by(motion: MotionFilter, B: Jacobian) -> Vec3:
    """Return how far from where it is the errors common to all frames show the pad, m.

    But those of the clocks, which are put right where pictures are placed.
    """
    (x, y, _), (_, range_, heading) = motion.biases
    return add(rotate(B[0], (x, y, 0.0)), rotate(B[1], (0.0, range_, heading)))
