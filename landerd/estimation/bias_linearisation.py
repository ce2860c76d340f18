"""The linearisation point of the measurement biases, kept free of a single picture's noise."""

import math

from landerd.estimation.motion_filter import Jacobian, MotionFilter
from landerd.estimation.observation import BiasModel, PadObservation
from landerd.geometry import Vec3, add, clamp, dot, rotate, sub, towards, unit

# Of range errors, which change as the pad comes nearer. In twelve days of the field world they
# changed by 0.3 to 0.9 of their stated sigma within 2 s, and this says 0.9. With 2 s the filter
# expected three to ten times the changes of the reference world's ranges: its innovations were a
# fifth too small, and a heaving deck's velocity was learned a sixth worse.
RANGE_TIME_CONSTANT_S = 4.0
ANOTHER_MARKER = 2.0  # a range error that changes by this factor is that of another marker
# The axes that the lens errs about are smoothed over this time constant, s, unless they turn by
# more than this, rad. Taken from the newest frame they are as noisy as the sighting: 1.2 m behind a
# pad of 1 m/s, 6 m up, the filter then learned 0.05 degrees of lens error a second, without end.
# Axes that lag a turn mislead too: with 3 degrees in place of 0.25 a lens that was off by 2 degrees
# was estimated at 0.4 +- 0.5.
AXES_TIME_CONSTANT_S, AXES_TURN = 0.3, math.radians(0.25)


class BiasLinearisation:
    """Smooths the inputs of the biases' Jacobian; call `average` once for each frame."""

    def __init__(self) -> None:
        # Means of: local z of the pad, m; 1 sigma of common range errors, a share of the range.
        self._down = self._range_share = 0.0
        self._axes: tuple[float, Vec3, Vec3] | None = None  # the camera's x and y: s, local, local

    def start(self, seen: PadObservation) -> None:
        """Start afresh from one observation."""
        self._down, self._range_share = seen.position[2], seen.biases.range_share
        self._axes = (seen.t, seen.biases.about_x, seen.biases.about_y)

    def jacobian(self, seen: PadObservation, motion: MotionFilter) -> Jacobian:
        """Return the Jacobian of a sighting with respect to the biases, at the predicted position.

        Linearised at the measured position instead, each sighting's noise would count as evidence
        on the lens: hovering at 2 m with ranges that erred by 2 % from picture to picture, the
        filter learned 3 degrees within 10 s. (An EKF gains spurious information about what it
        cannot observe when its linearisation point moves with each measurement: Huang, Mourikis
        and Roumeliotis 2010.)
        """
        biases = self._with_steady_axes(seen)
        camera = sub(seen.position, seen.arm)
        arm = sub((motion.position[0], motion.position[1], self._down), camera)
        shown = apparent_shift(motion, biases.jacobian(arm, self._range_share))
        return biases.jacobian(add(arm, shown), self._range_share)

    def _with_steady_axes(self, seen: PadObservation) -> BiasModel:
        """Return a sighting's bias model with smoothed axes of the camera."""
        new = seen.biases
        if self._axes is None:
            return new
        t, x, y = self._axes
        if min(dot(x, new.about_x), dot(y, new.about_y)) < math.cos(AXES_TURN):
            return new
        k = clamp((seen.t - t) / AXES_TIME_CONSTANT_S, 0.0, 1.0)
        x = unit(towards(x, new.about_x, k))
        y = unit(towards(y, new.about_y, k))
        return new._replace(about_x=x, about_y=y)

    def average(self, seen: PadObservation, dt: float, pad_down: float) -> None:
        """Take one frame into the means.

        Args:
            seen: the frame's observation; the range error it states is as noisy as its range.
            dt: since the last frame, s.
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


def apparent_shift(motion: MotionFilter, B: Jacobian) -> Vec3:
    """Return measured minus true position of the pad that the biases cause, local NED, m.

    Without those of the clocks, which `ObservationModel.observe` has corrected already.
    """
    (x, y, _), (_, range_, heading) = motion.biases
    return add(rotate(B[0], (x, y, 0.0)), rotate(B[1], (0.0, range_, heading)))
