"""From a pose in the camera frame to an observation of the pad in local NED (thesis 2.3.6).

An observation has two kinds of error: white noise, new in every frame, with its covariance; and
biases that all frames have in common, with the Jacobian by which the pad filter estimates them.
"""

import math
from typing import NamedTuple

from landerd.config.models import EstimationSection
from landerd.estimation.camera_pose import CameraPose, PoseHistory
from landerd.estimation.motion_filter import Jacobian
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    axial,
    clamp,
    cross,
    diagonal,
    dot,
    heading_of,
    matadd,
    matadd_scaled,
    matscale,
    matsub,
    norm,
    outer,
    rotate,
    rotate_covariance,
    scale,
    sub,
    transpose,
    unit,
)
from landerd.messages import PoseSolution

# Interval over which the camera's rotation is differenced, s: two periods of the attitude at the
# 50 Hz that hw/autopilots/streams.py asks for.
DIFFERENCE_S = 0.04
# Range errors common to all frames, 1 sigma: by the lens's scale and the print's size, as a share
# of the range; and this many of the standard deviations that vision states, since a small ring's
# outline lies on the same pixels from frame to frame.
SIGMA_SCALE = 0.005
RANGE_CORRELATED = 2.0
MIN_RANGE_M = 0.01  # nearer than this nothing has a direction
# Steps of the telemetry's time (1 sigma, s) and position (covariance, m^2) through which sightings
# are still accepted. SITL beside four busy processes steps by 3 to 10 ms, GPS by centimetres.
SIGMA_STEP_S = 0.005
STEP_COVARIANCE = diagonal(0.02**2, 0.02**2, 0.02**2)


class Clocks(NamedTuple):
    """Offsets of clocks, s."""

    pictures_s: float = 0.0  # pictures' minus autopilot's; positive: pictures are stamped late
    gimbal_s: float = 0.0  # how much earlier gimbal angles are stamped than the pictures they fit


AS_STAMPED = Clocks()


class BiasModel(NamedTuple):
    """What the Jacobian of a sighting with respect to the biases is made of.

    Attributes:
        about_x: the camera's x axis, local NED; about it the lens may look too high.
        about_y: the camera's y axis, local NED; about it the lens may look too far to the right.
        by_clock: velocity at which the camera's motion and rotation sweep the point seen through
            local NED, m/s.
        by_gimbal: the part of that velocity due to the gimbal's rotation, m/s.
        range_share: 1 sigma of range errors common to all frames, as a share of the range.
    """

    about_x: Vec3
    about_y: Vec3
    by_clock: Vec3 = ZERO
    by_gimbal: Vec3 = ZERO
    range_share: float = SIGMA_SCALE

    def jacobian(self, arm: Vec3, range_share: float) -> Jacobian:
        """Return the Jacobian of a measured position, local NED, with respect to the biases.

        Columns of the first block: the lens's direction about camera x and y (m/rad), the clock of
        the pictures (m/s). Of the second: the clock of the gimbal's angles (m/s), the range (m per
        standard deviation), the autopilot's heading (m/rad).

        Args:
            arm: from the camera to the point seen, local NED, m.
            range_share: 1 sigma of the common range error, as a share of the range.
        """
        # A lens turned by b about an axis of the camera moves the point seen by arm x b.
        return (
            transpose((cross(arm, self.about_x), cross(arm, self.about_y), self.by_clock)),
            transpose((self.by_gimbal, scale(arm, range_share), (-arm[1], arm[0], 0.0))),
        )


class PadObservation(NamedTuple):
    """The pad in local NED as one frame shows it."""

    t: float  # exposure, s
    position: Vec3  # landing point, m
    arm: Vec3  # from the camera to the landing point, local NED, m
    range_m: float  # its length, m
    sight: Vec3  # its direction, a unit vector
    covariance: Mat3  # white noise of vision and gimbal, m^2; noise_adaptation scales it
    telemetry_noise: Mat3  # white noise of the telemetry's timing, m^2; never scaled
    biases: BiasModel
    heading: float | None  # rad
    sigma_heading: float  # rad; infinite without heading
    normal: Vec3  # unit vector into the pad, local NED
    sigma_tilt: float  # of the normal, rad
    cost: float  # chi-square of the pose's fit to the picture

    @property
    def step_noise(self) -> Mat3:
        """Covariance of a step in the telemetry's time or position, m^2."""
        swept = self.biases.by_clock
        return matadd_scaled(STEP_COVARIANCE, outer(swept, swept), SIGMA_STEP_S**2)

    @property
    def tilt(self) -> float:
        """Angle between the pad's normal and gravity, rad."""
        return math.acos(clamp(self.normal[2], -1.0, 1.0))


class PadFix(NamedTuple):
    """The pad relative to the feet as one frame shows it, unfiltered."""

    t: float  # exposure, s
    feet: Vec3  # centre of the feet then, local NED, m
    to_pad: Vec3  # from there to the landing point, local NED, m


class ObservationModel:
    """Turns pose solutions into observations, by the camera's pose at their exposure."""

    def __init__(self, options: EstimationSection, poses: PoseHistory) -> None:
        self._sigma_bearing = math.radians(options.bearing_noise_deg)
        self._sigma_late = options.gimbal_late_s
        self._sigma_position = options.position_sigma_m
        self._poses = poses

    def observe(
        self, t: float, solution: PoseSolution, clocks: Clocks = AS_STAMPED
    ) -> PadObservation | None:
        """Return the pad in local NED, or None without position, attitude, gimbal or a distance.

        Args:
            t: exposure by the camera's clock, s.
            solution: the landing point's pose in the camera frame.
            clocks: their estimated offsets.
        """
        camera = self._poses.camera_pose(t - clocks.pictures_s, gimbal_back_s=clocks.gimbal_s)
        if camera is None:
            return None
        R = camera.R_local_camera
        covariance, sigma_yaw, sigma_tilt = _white_noise(solution)
        arm = rotate(R, solution.position)
        range_m = norm(arm)
        if range_m < MIN_RANGE_M:
            return None
        heading, sigma_heading = None, math.inf
        if solution.north is not None and solution.sigma_yaw is not None:
            heading = heading_of(rotate(R, solution.north))
            sigma_heading = math.hypot(sigma_yaw, self._sigma_bearing)
        sigma_range = math.sqrt(max(0.0, covariance[2][2]))
        t_true = t - clocks.pictures_s
        turning, by_gimbal = self._sweeps(t_true, clocks.gimbal_s, camera, solution.position)
        # The velocity as reported: positions differenced over so short a time would be noise.
        by_clock = add(self._poses.velocity(t_true), turning)
        # The filter's biases are total ones: undo to first order what `clocks` has corrected.
        about_x, about_y, _ = transpose(R)
        shown = add(scale(by_clock, clocks.pictures_s), scale(by_gimbal, clocks.gimbal_s))
        return PadObservation(
            t=t,
            position=add(add(camera.position, arm), shown),
            arm=arm,
            range_m=range_m,
            sight=unit(arm),
            covariance=matadd(rotate_covariance(R, covariance), self._pointing_noise(arm)),
            telemetry_noise=self._telemetry_noise(sub(turning, by_gimbal), by_gimbal),
            biases=BiasModel(
                about_x,
                about_y,
                by_clock,
                by_gimbal,
                math.hypot(SIGMA_SCALE, RANGE_CORRELATED * sigma_range / range_m),
            ),
            heading=heading,
            sigma_heading=sigma_heading,
            normal=rotate(R, solution.normal),
            sigma_tilt=sigma_tilt,
            cost=solution.cost,
        )

    def fix(self, seen: PadObservation, clocks: Clocks = AS_STAMPED) -> PadFix | None:
        """Return the pad relative to the feet; None without position or attitude at its exposure.

        Args:
            seen: made by `observe`.
            clocks: those given to `observe`.
        """
        feet = self._poses.feet(seen.t - clocks.pictures_s)
        if feet is None:
            return None
        centre, to_camera = feet
        return PadFix(seen.t, centre, add(to_camera, scale(seen.sight, seen.range_m)))

    def _sweeps(
        self, t: float, gimbal_back_s: float, camera: CameraPose, point: Vec3
    ) -> tuple[Vec3, Vec3]:
        """Return the velocities of a fixed point of the camera frame through local NED, m/s.

        Args:
            t: exposure by the autopilot's clock, s.
            gimbal_back_s: how much older the gimbal's angles are to be, s.
            camera: its pose then.
            point: camera frame, m.

        Returns:
            the velocity by the rotation of airframe and gimbal; by that of the gimbal alone.
        """
        half, gimbal_t = 0.5 * DIFFERENCE_S, t - gimbal_back_s
        after, before = gimbal_t + half, gimbal_t - half
        airframe, turned = self._poses.airframe, self._poses.camera_rotation
        R, still = camera.R_local_camera, camera.airframe
        return (
            _sweep(R, turned(airframe(t + half), after), turned(airframe(t - half), before), point),
            _sweep(R, turned(still, after), turned(still, before), point),
        )

    def _pointing_noise(self, arm: Vec3) -> Mat3:
        """Return the covariance (m^2) due to lens direction (across the arm) and own position."""
        along = self._sigma_bearing**2
        across = along * dot(arm, arm) + self._sigma_position**2
        return axial(arm, -along, across)

    def _telemetry_noise(self, by_turning: Vec3, by_gimbal: Vec3) -> Mat3:
        """Return the covariance (m^2) due to jitter in the times of attitude and gimbal angles.

        Args:
            by_turning: velocity of the point seen by the airframe's rotation, m/s.
            by_gimbal: the same by the gimbal's rotation, m/s.
        """
        late = self._sigma_late**2
        gimbal = outer(by_gimbal, by_gimbal)
        return matscale(matadd(gimbal, outer(by_turning, by_turning)), late)


def _white_noise(s: PoseSolution) -> tuple[Mat3, float, float]:
    """Return the white part of a pose's covariance (m^2), sigma_yaw and sigma_tilt (rad).

    The systematic part moves pad and prediction alike: a filter does not average it out.
    """
    sigma_yaw = s.sigma_yaw or 0.0
    if s.systematic is None:
        return s.covariance, sigma_yaw, s.sigma_tilt
    return (
        matsub(s.covariance, s.systematic.covariance),
        _rest(sigma_yaw, s.systematic.sigma_yaw),
        _rest(s.sigma_tilt, s.systematic.sigma_tilt),
    )


def _rest(sigma: float, part: float) -> float:
    """Return what is left of a standard deviation without an independent part of it."""
    return math.sqrt(max(sigma * sigma - part * part, 0.0))


def _sweep(at: Mat3, after: Mat3 | None, before: Mat3 | None, point: Vec3) -> Vec3:
    """Return the velocity of a fixed point of the camera frame as the camera turns, local NED, m/s.

    A central difference; a one-sided one where a side is not known, as in the first picture. Taken
    for no motion there, it made a picture count as evidence on the clock: seen from a gimbal that
    turned to the pad, the clock was "known" to 4 ms by the second picture, and was 24 ms off for
    the whole flight.

    Args:
        at: R_local_camera.
        after: the same DIFFERENCE_S / 2 later; None: not known.
        before: the same DIFFERENCE_S / 2 earlier; None: not known.
        point: camera frame, m.
    """
    known = (after is not None) + (before is not None)
    if not known:
        return ZERO
    moved = sub(rotate(after or at, point), rotate(before or at, point))
    return scale(moved, 2.0 / (known * DIFFERENCE_S))
