"""From a pose in the camera frame to an observation of the pad in local NED (thesis 2.3.6).

An observation says besides where the pad is how uncertain that is: by a covariance of what is new
in every frame (white), and by a Jacobian of the errors that all frames have in common (biases),
which the pad filter estimates.
"""

import math
from dataclasses import dataclass, replace

from landerd.config.models import EstimationSection
from landerd.estimation.camera_pose import CameraPose, PoseHistory
from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    clamp,
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
)
from landerd.messages import PoseSolution

# How far back the camera's pose is differenced to tell its motion, s: one period of the attitude
# at the 50 Hz that hw/autopilots/streams.py asks for.
DIFFERENCE_S = 0.02


@dataclass(frozen=True, slots=True)
class PadObservation:
    """The pad in local NED as one frame shows it."""

    t: float  # exposure, s
    position: Vec3  # landing point, m
    range_m: float  # from the camera
    covariance: Mat3  # of what is new in every frame, m^2
    bias_jacobian: Mat3  # of the position by the biases: lens about x and y, m/rad; clock, m/s
    heading: float | None  # rad
    sigma_heading: float  # rad; infinite without heading
    normal: Vec3  # unit vector into the pad
    sigma_tilt: float  # of the normal, rad
    cost: float  # chi-square of the picture's fit

    @property
    def tilt(self) -> float:
        """Angle between the pad's normal and gravity, rad."""
        return math.acos(clamp(self.normal[2], -1.0, 1.0))


class ObservationModel:
    """Makes observations of pose solutions by the camera's pose at their exposure."""

    def __init__(self, options: EstimationSection, poses: PoseHistory) -> None:
        self._sigma_bearing = math.radians(options.bearing_noise_deg)
        self._sigma_late = options.gimbal_late_s
        self._sigma_position = options.position_sigma_m
        self._poses = poses

    def observe(self, t: float, solution: PoseSolution) -> PadObservation | None:
        """Return the pad in local NED, or None where position, attitude or gimbal is missing.

        Args:
            t: exposure, s.
            solution: the landing point's pose in the camera frame.
        """
        camera = self._poses.camera_pose(t)
        if camera is None:
            return None
        R = camera.R_local_camera
        noise = _without_systematic(solution)
        arm = rotate(R, solution.position)
        position = add(camera.position, arm)
        gimbal_earlier = self._poses.camera_pose(t, gimbal_back_s=DIFFERENCE_S)
        sweep = _sweep(position, gimbal_earlier, solution.position)
        heading, sigma_heading = None, math.inf
        if solution.north is not None and solution.sigma_yaw is not None:
            heading = heading_of(rotate(R, solution.north))
            sigma_heading = math.hypot(noise.sigma_yaw or 0.0, self._sigma_bearing)
        return PadObservation(
            t=t,
            position=position,
            range_m=norm(arm),
            covariance=matadd(
                rotate_covariance(R, noise.covariance),
                matadd(
                    self._pointing_noise(arm), matscale(outer(sweep, sweep), self._sigma_late**2)
                ),
            ),
            bias_jacobian=self.bias_jacobian(t, camera, solution.position),
            heading=heading,
            sigma_heading=sigma_heading,
            normal=rotate(R, solution.normal),
            sigma_tilt=noise.sigma_tilt,
            cost=solution.cost,
        )

    def bias_jacobian(self, t: float, camera: CameraPose, point: Vec3) -> Mat3:
        """Return how the biases move what is seen at a point of the camera frame.

        Columns: the lens's direction about camera x and y (m/rad), the clock (m/s); local NED.

        Args:
            t: exposure, s.
            camera: its pose then.
            point: camera frame, m.
        """
        R = camera.R_local_camera
        x, y, z = point
        # R (b x arm) is how an error b of the lens's direction about camera x and y moves the pad.
        about_x, about_y = rotate(R, (0.0, z, -y)), rotate(R, (-z, 0.0, x))
        position = add(camera.position, rotate(R, point))
        by_clock = _sweep(position, self._poses.camera_pose(t - DIFFERENCE_S), point)
        return transpose((about_x, about_y, by_clock))

    def _pointing_noise(self, arm: Vec3) -> Mat3:
        """Return the covariance (m^2) of lens direction (across the arm) and vehicle position."""
        along = self._sigma_bearing**2
        across = along * dot(arm, arm) + self._sigma_position**2
        return matadd(diagonal(across, across, across), matscale(outer(arm, arm), -along))


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


def _sweep(position: Vec3, earlier: CameraPose | None, point: Vec3) -> Vec3:
    """Return how fast a fixed point of the camera frame moves through local NED, m/s.

    Args:
        position: where it is now, local NED, m.
        earlier: the camera's pose DIFFERENCE_S ago; None: not known, taken for no motion.
        point: camera frame, m.
    """
    if earlier is None:
        return (0.0, 0.0, 0.0)
    before = add(earlier.position, rotate(earlier.R_local_camera, point))
    return scale(sub(position, before), 1.0 / DIFFERENCE_S)
