"""From a pose in the camera frame to the pad in local NED, at the time of exposure (thesis 2.3.6).

The thesis takes the camera's angles only; here the airframe's roll and pitch are part of the chain
(its chapter 5 asks for that), and a gimbal may measure against the body or against the horizon.
"""

import math
from dataclasses import dataclass

from landerd import gimbal_frames
from landerd.config.models import Config
from landerd.estimation.history import History
from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    camera_mount,
    clamp,
    diagonal,
    dot,
    heading_of,
    matadd,
    matmul,
    matscale,
    norm,
    outer,
    rot_zyx,
    rotate,
    rotate_covariance,
    scale,
    sub,
    transpose,
    wrap,
)
from landerd.messages import Attitude, GimbalState, LocalPosition, PoseSolution, Reference

DOWN: Vec3 = (0.0, 0.0, 1.0)
JUMP_M = 0.3  # between two positions beyond what was flown: the autopilot moved its frame
SWING_S = 0.02  # over this time it is measured how fast the lens swings


@dataclass(frozen=True, slots=True)
class PlacedPad:
    """The pad in local NED as one frame shows it."""

    t: float
    position: Vec3  # landing point, m
    range_m: float  # from the camera
    covariance: Mat3  # of what is new in every frame, m^2
    common: Mat3  # how errors common to all frames move it: lens about x and y, m/rad; clock, m/s
    heading: float | None  # rad
    sigma_heading: float  # rad; infinite without heading
    normal: Vec3  # unit vector into the pad
    sigma_tilt: float  # of the normal, rad
    cost: float  # chi-square of the picture's fit

    @property
    def tilt(self) -> float:
        """Angle between the pad's normal and gravity, rad."""
        return math.acos(clamp(self.normal[2], -1.0, 1.0))


@dataclass(frozen=True, slots=True)
class CameraPlace:
    """Where the camera is and how it looks, local NED."""

    position: Vec3
    R_local_camera: Mat3


class Placement:
    """Histories of position, attitude and gimbal, and the chain of rotations through them."""

    def __init__(self, config: Config) -> None:
        self._offset = config.vehicle.camera_offset_m
        self._sigma_bearing = math.radians(config.estimation.bearing_noise_deg)
        self._sigma_late = config.estimation.gimbal_late_s
        self._gimbal_lag_s = config.gimbal.lag_s
        self._R_gimbal_camera = camera_mount(config.gimbal.camera_rotation_deg)
        self._sigma_position = config.estimation.position_sigma_m
        fresh = config.freshness
        self.position = History(angles=[False] * 6, max_gap_s=fresh.position_s)
        self.attitude = History(angles=[True] * 3 + [False] * 3, max_gap_s=fresh.attitude_s)
        self.gimbal = History(angles=[True] * 3, max_gap_s=fresh.gimbal_s)
        self._reference = Reference.BODY

    def add(self, message: LocalPosition | Attitude | GimbalState) -> Vec3 | None:
        """Take a measurement in; one older than its predecessor is dropped.

        Returns:
            by how much the local frame jumped, m; None if it did not. What was known is moved
            with it.
        """
        if isinstance(message, LocalPosition):
            jump = self._jump(message)
            if jump is not None:
                self.position.shift((*jump, 0.0, 0.0, 0.0))
            self.position.add(message.t, (*message.position, *message.velocity))
            return jump
        if isinstance(message, Attitude):
            angles = (message.roll, message.pitch, message.yaw)
            self.attitude.add(message.t, (*angles, *message.rates))
        else:
            self._reference = message.reference
            pitch = message.pitch if message.pitch_measured else self._followed(message)
            self.gimbal.add(message.t, (message.yaw, pitch, message.roll))
        return None

    def _followed(self, ordered: GimbalState) -> float:
        """Return the pitch of a gimbal that only tells its order: it follows with a lag, rad."""
        last = self.gimbal.newest
        if last is None:
            return ordered.pitch
        pitch, dt = last[1][1], max(0.0, ordered.t - last[0])
        return pitch + (1.0 - math.exp(-dt / self._gimbal_lag_s)) * wrap(ordered.pitch - pitch)

    def _jump(self, new: LocalPosition) -> Vec3 | None:
        """Return how far a position lies from where its velocity says, if no flight explains it."""
        last = self.position.newest
        if last is None:
            return None
        dt = new.t - last[0]
        if not 0.0 < dt <= self.position.max_gap_s:
            return None
        x, y, z, u, v, w = last[1]
        mean = scale(add((u, v, w), new.velocity), 0.5)
        jump = sub(new.position, add((x, y, z), scale(mean, dt)))
        return jump if norm(jump) > JUMP_M else None

    def forget(self) -> None:
        """Drop all that came from the autopilot: it restarted, its frame may be another."""
        self.position.clear()
        self.attitude.clear()

    def camera(self, t: float, *, gimbal_back_s: float = 0.0) -> CameraPlace | None:
        """Return the camera's place at time t, or None where a history does not reach.

        Args:
            t: s.
            gimbal_back_s: how much older the gimbal's angles are to be.
        """
        position, attitude = self.position.at(t), self.attitude.at(t)
        R = self.look(t, gimbal_back_s=gimbal_back_s)
        if position is None or attitude is None or R is None:
            return None
        roll, pitch, yaw = attitude[:3]
        origin = (position[0], position[1], position[2])
        pivot = add(origin, rotate(rot_zyx(yaw, pitch, roll), self._offset))
        return CameraPlace(pivot, R)

    def look(self, t: float, *, gimbal_back_s: float = 0.0) -> Mat3 | None:
        """Return R_local_camera at time t, or None where attitude or gimbal does not reach."""
        attitude = self.attitude.at(t)
        gimbal = self.gimbal.at(t - gimbal_back_s)
        if attitude is None or gimbal is None:
            return None
        roll, pitch, yaw = attitude[:3]
        angles = (gimbal[0], gimbal[1], gimbal[2])
        R_local_gimbal = gimbal_frames.look(self._reference, (roll, pitch, yaw), angles)
        return matmul(R_local_gimbal, self._R_gimbal_camera)

    def gimbal_base(self, ahead_s: float) -> tuple[Vec3, Mat3] | None:
        """Return the gimbal's pivot (local, m) and R_local_base, ahead_s after the newest attitude.

        The base is what the gimbal's angles are measured against: the airframe, or the horizon.
        """
        position, attitude = self.position.newest, self.attitude.newest
        if position is None or attitude is None:
            return None
        roll, pitch, yaw, p, q, r = attitude[1]
        roll, pitch, yaw = roll + ahead_s * p, pitch + ahead_s * q, yaw + ahead_s * r
        x, y, z, u, v, w = position[1]
        dt = attitude[0] + ahead_s - position[0]
        R = rot_zyx(yaw, pitch, roll)
        origin = (x + dt * u, y + dt * v, z + dt * w)
        pivot = add(origin, rotate(R, self._offset))
        return pivot, gimbal_frames.base(self._reference, (roll, pitch, yaw))

    def place(self, t: float, solution: PoseSolution) -> PlacedPad | None:
        """Return the pad in local NED, or None where position, attitude or gimbal is missing."""
        camera = self.camera(t)
        if camera is None:
            return None
        R = camera.R_local_camera
        arm = rotate(R, solution.position)
        position = add(camera.position, arm)
        turned = self.camera(t, gimbal_back_s=SWING_S)
        swing = self._change(position, turned, solution.position)
        heading, sigma_heading = None, math.inf
        if solution.north is not None and solution.sigma_yaw is not None:
            heading = heading_of(rotate(R, solution.north))
            sigma_heading = math.hypot(solution.sigma_yaw, self._sigma_bearing)
        return PlacedPad(
            t=t,
            position=position,
            range_m=norm(arm),
            covariance=matadd(
                rotate_covariance(R, solution.covariance),
                matadd(self._noise(arm), matscale(outer(swing, swing), self._sigma_late**2)),
            ),
            common=self.common(t, camera, solution.position),
            heading=heading,
            sigma_heading=sigma_heading,
            normal=rotate(R, solution.normal),
            sigma_tilt=solution.sigma_tilt,
            cost=solution.cost,
        )

    def common(self, t: float, camera: CameraPlace, seen: Vec3) -> Mat3:
        """Return how errors common to all frames move what is seen at a point of the camera frame.

        Columns: the lens's direction about camera x and y (m/rad), the clock (m/s); local NED.
        """
        R = camera.R_local_camera
        x, y, z = seen
        # R (b x arm) is how an error b of the lens's direction about camera x and y moves the pad.
        about_x, about_y = rotate(R, (0.0, z, -y)), rotate(R, (-z, 0.0, x))
        position = add(camera.position, rotate(R, seen))
        drift = self._change(position, self.camera(t - SWING_S), seen)
        return transpose((about_x, about_y, drift))

    def _change(self, position: Vec3, before: CameraPlace | None, seen: Vec3) -> Vec3:
        """Return how fast what is seen seems to move as the camera did since SWING_S ago, m/s."""
        if before is None:
            return (0.0, 0.0, 0.0)
        earlier = add(before.position, rotate(before.R_local_camera, seen))
        return scale(sub(position, earlier), 1.0 / SWING_S)

    def down(self, t: float) -> Vec3 | None:
        """Return gravity's direction in the camera frame at time t."""
        R = self.look(t)
        return None if R is None else rotate(transpose(R), DOWN)

    def _noise(self, arm: Vec3) -> Mat3:
        """Covariance from the noise of the lens's direction (across the arm) and the position."""
        along = self._sigma_bearing**2
        across = along * dot(arm, arm) + self._sigma_position**2
        return matadd(diagonal(across, across, across), matscale(outer(arm, arm), -along))
