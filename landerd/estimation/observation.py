"""From a pose in the camera frame to an observation of the pad in local NED (thesis 2.3.6).

An observation says besides where the pad is how uncertain that is: by a covariance of what is new
in every frame (white), and by a Jacobian of the errors that all frames have in common (biases),
which the pad filter estimates.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from landerd.config.models import EstimationSection
from landerd.estimation.camera_pose import CameraPose, PoseHistory
from landerd.estimation.motion_filter import Jacobian
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    clamp,
    cross,
    diagonal,
    dot,
    heading_of,
    matadd,
    matscale,
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

# How far back the camera's pose is differenced to tell its motion, s: one period of the attitude
# at the 50 Hz that hw/autopilots/streams.py asks for.
DIFFERENCE_S = 0.04
# Ranges err alike from frame to frame: by the lens's scale and the print's size, and by so many of
# the standard deviations that vision states (a small ring's outline lies on the same pixels).
SIGMA_SCALE = 0.005
MIN_RANGE_M = 0.01  # nearer than this nothing has a direction
RANGE_CORRELATED = 2.0
# Step in the telemetry's time (s) and position (m^2), 1 sigma, that sightings are taken through.
# SITL beside a load of four processes steps by 3 to 10 ms (beyond 20 ms it is 4 sigma), GPS by cm.
HICCUP_S = 0.005
HICCUP = diagonal(0.02**2, 0.02**2, 0.02**2)


class Clocks(NamedTuple):
    """What clocks say more than the autopilot's, s."""

    pictures_s: float = 0.0  # positive: pictures are stamped late
    gimbal_s: float = 0.0  # of the gimbal's angles, less the pictures'


AS_STAMPED = Clocks()


class BiasModel(NamedTuple):
    """How the biases move what is seen, but for how far away it is.

    Attributes:
        about_x: axis of the camera, local NED, about which the lens may look too high.
        about_y: the same, too far to the right.
        by_clock: velocity of what is seen through local NED as the camera moves and turns, m/s.
        by_gimbal: the same as the gimbal alone turns, m/s.
        range_share: of the distance, 1 sigma of what ranges err by alike from frame to frame.
    """

    about_x: Vec3
    about_y: Vec3
    by_clock: Vec3 = ZERO
    by_gimbal: Vec3 = ZERO
    range_share: float = SIGMA_SCALE

    def jacobian(self, arm: Vec3, range_share: float) -> Jacobian:
        """Return how the biases move what is seen at the end of an arm from the camera, local NED.

        Columns of the first block: the lens's direction about camera x and y (m/rad), the clock of
        the pictures (m/s); of the second: the clock of the gimbal's angles (m/s), the range (m,
        times its standard deviation), the autopilot's heading (m/rad).

        Args:
            arm: local NED, m.
            range_share: of the distance, 1 sigma of what ranges err by alike.
        """
        # A lens turned by b about an axis of the camera shows the pad moved by arm x b.
        return (
            transpose((cross(arm, self.about_x), cross(arm, self.about_y), self.by_clock)),
            transpose((self.by_gimbal, scale(arm, range_share), (-arm[1], arm[0], 0.0))),
        )


@dataclass(frozen=True, slots=True)
class PadObservation:
    """The pad in local NED as one frame shows it."""

    t: float  # exposure, s
    position: Vec3  # landing point, m
    arm: Vec3  # from the camera to the landing point, local NED, m
    covariance: Mat3  # of what is new in every frame by vision and gimbal noise, m^2
    telemetry_noise: Mat3  # of what the telemetry's timing adds, however quiet it seems, m^2
    biases: BiasModel
    hiccup: Mat3  # covariance of what a step in the telemetry's time or position may bring, m^2
    heading: float | None  # rad
    sigma_heading: float  # rad; infinite without heading
    normal: Vec3  # unit vector into the pad
    sigma_tilt: float  # of the normal, rad
    cost: float  # chi-square of the picture's fit

    @property
    def range_m(self) -> float:
        """Distance from the camera, m."""
        return norm(self.arm)

    @property
    def sight(self) -> Vec3:
        """Unit vector from the camera to the landing point, local NED."""
        return unit(self.arm)

    @property
    def tilt(self) -> float:
        """Angle between the pad's normal and gravity, rad."""
        return math.acos(clamp(self.normal[2], -1.0, 1.0))


@dataclass(frozen=True, slots=True)
class PadFix:
    """Where one frame shows the pad from the feet, whatever the filter makes of it."""

    t: float  # exposure, s
    feet: Vec3  # centre of the feet then, local, m
    to_pad: Vec3  # from there to the landing point, local, m


class ObservationModel:
    """Makes observations of pose solutions by the camera's pose at their exposure."""

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
            t: exposure as the camera says, s.
            solution: the landing point's pose in the camera frame.
            clocks: as far as they are known.
        """
        camera = self._poses.camera_pose(t - clocks.pictures_s, gimbal_back_s=clocks.gimbal_s)
        if camera is None:
            return None
        R = camera.R_local_camera
        noise = _without_systematic(solution)
        arm = rotate(R, solution.position)
        if norm(arm) < MIN_RANGE_M:
            return None
        heading, sigma_heading = None, math.inf
        if solution.north is not None and solution.sigma_yaw is not None:
            heading = heading_of(rotate(R, solution.north))
            sigma_heading = math.hypot(noise.sigma_yaw or 0.0, self._sigma_bearing)
        sigma_range = math.sqrt(max(0.0, noise.covariance[2][2]))
        t_true = t - clocks.pictures_s
        turning, by_gimbal = self._sweeps(t_true, clocks.gimbal_s, R, solution.position)
        # Positions differenced over so short a time would be noise; the velocity is not.
        by_clock = add(self._poses.velocity(t_true), turning)
        # The filter takes errors as they show without a correction.
        shown = add(scale(by_clock, clocks.pictures_s), scale(by_gimbal, clocks.gimbal_s))
        return PadObservation(
            t=t,
            position=add(add(camera.position, arm), shown),
            arm=arm,
            covariance=matadd(rotate_covariance(R, noise.covariance), self._pointing_noise(arm)),
            telemetry_noise=self._telemetry_noise(sub(turning, by_gimbal), by_gimbal),
            biases=BiasModel(
                *camera_axes(camera),
                by_clock,
                by_gimbal,
                math.hypot(SIGMA_SCALE, RANGE_CORRELATED * sigma_range / norm(arm)),
            ),
            hiccup=matadd(HICCUP, matscale(outer(by_clock, by_clock), HICCUP_S**2)),
            heading=heading,
            sigma_heading=sigma_heading,
            normal=rotate(R, solution.normal),
            sigma_tilt=noise.sigma_tilt,
            cost=solution.cost,
        )

    def fix(self, seen: PadObservation, clocks: Clocks = AS_STAMPED) -> PadFix | None:
        """Return an observation against the feet, None where position or attitude do not reach.

        Args:
            seen: as `observe` made it.
            clocks: with which it did.
        """
        feet = self._poses.feet(seen.t - clocks.pictures_s)
        if feet is None:
            return None
        centre, to_camera = feet
        return PadFix(seen.t, centre, add(to_camera, scale(seen.sight, seen.range_m)))

    def _sweeps(self, t: float, gimbal_back_s: float, R: Mat3, point: Vec3) -> tuple[Vec3, Vec3]:
        """Return how fast a point of the camera frame is swept through local NED, m/s.

        Args:
            t: when the picture was exposed as far as the clocks are known, s.
            gimbal_back_s: how much older the gimbal's angles are to be.
            R: R_local_camera then.
            point: camera frame, m.

        Returns:
            as the camera turns with airframe and gimbal; as the gimbal alone turns.
        """
        half, back = 0.5 * DIFFERENCE_S, gimbal_back_s
        turn = self._poses.camera_rotation
        return (
            _sweep(
                R, turn(t + half, gimbal_back_s=back), turn(t - half, gimbal_back_s=back), point
            ),
            _sweep(
                R, turn(t, gimbal_back_s=back - half), turn(t, gimbal_back_s=back + half), point
            ),
        )

    def _pointing_noise(self, arm: Vec3) -> Mat3:
        """Return the covariance (m^2) of lens direction (across the arm) and vehicle position."""
        along = self._sigma_bearing**2
        across = along * dot(arm, arm) + self._sigma_position**2
        return matadd(diagonal(across, across, across), matscale(outer(arm, arm), -along))

    def _telemetry_noise(self, by_turning: Vec3, by_gimbal: Vec3) -> Mat3:
        """Return the covariance (m^2) of angles whose times jitter, by how fast they turn (m/s)."""
        late = self._sigma_late**2
        gimbal = outer(by_gimbal, by_gimbal)
        return matscale(matadd(gimbal, outer(by_turning, by_turning)), late)


def camera_axes(camera: CameraPose) -> tuple[Vec3, Vec3]:
    """Return the camera's x and y, local NED."""
    x, y, _ = transpose(camera.R_local_camera)
    return x, y


def _without_systematic(s: PoseSolution) -> PoseSolution:
    """Return a pose with the uncertainty of what is new in every frame.

    What is alike in all moves pad and prediction together: it is no noise that a filter averages.
    """
    if s.systematic is None:
        return s
    # The rest is positive but for rounding.
    yaw = None if s.sigma_yaw is None else _rest(s.sigma_yaw, s.systematic.sigma_yaw)
    return replace(
        s,
        covariance=matadd(s.covariance, matscale(s.systematic.covariance, -1.0)),
        sigma_yaw=yaw,
        sigma_tilt=_rest(s.sigma_tilt, s.systematic.sigma_tilt),
    )


def _rest(sigma: float, part: float) -> float:
    return math.sqrt(max(sigma * sigma - part * part, 0.0))


def _sweep(at: Mat3, after: Mat3 | None, before: Mat3 | None, point: Vec3) -> Vec3:
    """Return how fast a fixed point of the camera frame moves as the camera turns, local NED, m/s.

    Where one side is not known, as in the first picture, the other one tells. Taken for no motion
    it told the clock: seen from a gimbal that turned to the pad, to 4 ms by the second picture,
    and 24 ms off for the whole flight.

    Args:
        at: R_local_camera.
        after: the same half of DIFFERENCE_S later; None: not known.
        before: and earlier.
        point: camera frame, m.
    """
    known = sum(R is not None for R in (after, before))
    if not known:
        return ZERO
    moved = sub(rotate(after or at, point), rotate(before or at, point))
    return scale(moved, 2.0 / (known * DIFFERENCE_S))
