"""Where the camera was and how it looked, at the time of an exposure (thesis 2.3.6).

The thesis takes the camera's angles only; here the airframe's roll and pitch are part of the chain
of rotations (its chapter 5 asks for that), and a gimbal may measure against the body or against the
horizon.
"""

import math
from dataclasses import dataclass

from landerd import gimbal_frames
from landerd.config.models import Config
from landerd.estimation.history import History, Values
from landerd.estimation.outlier_rejector import OutlierRejector
from landerd.geometry import (
    ZERO,
    Mat3,
    Vec3,
    add,
    camera_mount,
    euler_rates,
    matmul,
    norm,
    rot_zyx,
    rotate,
    scale,
    sub,
    transpose,
    wrap,
)
from landerd.messages import Attitude, GimbalState, LocalPosition, Reference

DOWN: Vec3 = (0.0, 0.0, 1.0)  # gravity, local NED
# Beyond its newest report a gimbal is taken to look on as it did for so long, s: one and a half
# periods of the slowest that is asked (10 Hz). Held for 0.3 s, the angles of one that went silent
# as it turned let a pad turn that did not, and its velocity with it.
GIMBAL_HELD_S = 0.15
# Between two positions, beyond what their velocities explain, m: the autopilot has moved its local
# frame (a reset of its EKF). Chosen by hand: no flight within the limits explains as much.
FRAME_JUMP_M = 0.3
# In which the position follows the autopilot's, s, beside what its velocity says at once. GPS has
# it wander by some centimetres in a second, which is no motion: taken at once it was taken for the
# pad's, and flown after. And slowly beside the controllers' integrals (3 s): where the velocity is
# off by a constant, the one that is flown is too, and only a pad that is seen from what goes by it
# is flown to without an error. With 2 s it touched down 4 cm off from low over the pad.
POSITION_TIME_CONSTANT_S = 20.0
# No vehicle is faster from one report to the next, m/s^2, and by a knock, m/s; nor turns otherwise
# than its rate says, rad/s^2, and what noise adds, rad. Chosen by hand, well above what flies.
FASTEST_MPS2, KNOCK_MPS = 50.0, 1.0
FASTEST_TURN, HEADING_NOISE = math.radians(400.0), math.radians(3.0)
# Once a heading has jumped otherwise, one is believed that has been said for so long, s; until then
# the vehicle turns as its rates say, which gyros tell well for seconds. Of headings at random two
# in a row agree every now and then, and one in five is near the last: the pad's heading went with
# them, and took a second to come back.
HEADING_BELIEVED_S = 0.2
# Height and climb rate come from one filter and agree: in 60 flights of ArduCopter in SITL, with
# wind, vibration, GPS and barometer off, they differed by 0.4 m/s at most over a second. Both
# accelerometers off by 1 m/s^2 made it 5: it took itself to sink while it hovered, its controller
# to be behind, and as soon as it knew better it fell by 6 m/s.
CLIMB_RATE_ERROR_S = 1.0
WRONG_CLIMB_MPS = 0.5
RIGHT_AGAIN_S = 10.0  # and agree again once they have for so long: it was off, right, and off again


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Pose of the camera in local NED."""

    position: Vec3  # of the gimbal's pivot, taken for the camera's centre, m
    R_local_camera: Mat3


class PoseHistory:
    """Position, attitude and gimbal angles of the last second, and the camera's pose from them.

    Positions are the autopilot's without their noise and wander: they go by its velocity, and
    follow what it says of its position in POSITION_TIME_CONSTANT_S. Where that is off, pad and
    vehicle are alike. Where it moves its local frame, the frame of before is gone on with.

    Attributes:
        turned: by which the autopilot's heading is larger than the one that is gone on with, rad.
    """

    def __init__(self, config: Config) -> None:
        self._camera_offset = config.vehicle.camera_offset_m
        self._feet_offset: Vec3 = (0.0, 0.0, config.vehicle.gear_height_m)
        self._gimbal_lag_s = config.gimbal.lag_s
        self._R_gimbal_camera = camera_mount(config.gimbal.camera_rotation_deg)
        fresh = config.freshness
        # Held where it was last told it would fall behind a vehicle that goes along with a fast
        # pad, and the pad would seem to brake.
        self.position = History(
            angles=[False] * 6,
            max_gap_s=fresh.position_s,
            rates=lambda position: position[3:],
            ahead_s=fresh.position_s,
        )
        self.attitude = History(
            angles=[True] * 3 + [False] * 3,
            max_gap_s=fresh.attitude_s,
            rates=lambda attitude: euler_rates(attitude[0], attitude[1], attitude[3:]),
        )
        self.gimbal = History(
            angles=[True] * 3, max_gap_s=fresh.gimbal_s, held_s=min(GIMBAL_HELD_S, fresh.gimbal_s)
        )
        self._reference = Reference.BODY
        self.turned = 0.0
        self._frame = ZERO  # by which the autopilot's local frame has moved from this one, m
        self._measured = ZERO  # the newest position as it was told, in this frame, m
        self._wrong_climb_t = -math.inf  # when they did not agree last, s
        self._climb_error = 0.0  # of the climb rate against the height, lately, m/s
        self._velocities, self._headings = OutlierRejector(), OutlierRejector(HEADING_BELIEVED_S)

    def add(
        self, message: LocalPosition | Attitude | GimbalState, *, keeps_heading: bool = False
    ) -> None:
        """Take a measurement in; one that is not newer than its predecessor is dropped.

        So is a velocity that jumps as nothing can, unless the next one says the same; of an
        attitude whose heading does, all but that is taken.

        Args:
            message: the measurement.
            keeps_heading: where the autopilot sets its heading anew, the old one is gone on with.
        """
        if isinstance(message, LocalPosition):
            self._add_position(message)
        elif isinstance(message, Attitude):
            if not keeps_heading:
                self.turned = 0.0
            yaw = wrap(message.yaw - self.turned)
            said = (message.roll, message.pitch, yaw, *message.rates)
            turned = self._turned(message.t, said, keeps_heading=keeps_heading)
            self.attitude.add(message.t, turned)
        else:
            self._reference = message.reference
            t, yaw, pitch = message.t, message.yaw, message.pitch
            yaw = yaw if message.yaw_measured else self._lagged(t, yaw, 0)
            pitch = pitch if message.pitch_measured else self._lagged(t, pitch, 1)
            self.gimbal.add(t, (yaw, pitch, message.roll))

    def _turned(self, t: float, said: Values, *, keeps_heading: bool) -> Values:
        """Return an attitude of time t (s) as it is said; where its heading jumps, by its rates."""
        before = self.attitude.just_before(t)
        if before is None:
            return said
        dt, last = before
        rate_before, rate = (euler_rates(at[0], at[1], at[3:])[2] for at in (last, said))
        expected = wrap(last[2] + 0.5 * dt * (rate_before + rate))
        most = HEADING_NOISE + 0.5 * FASTEST_TURN * dt * dt
        jump = (0.0, 0.0, wrap(said[2] - expected))
        if not self._headings.rejects(t, jump, most):
            if not keeps_heading or abs(jump[2]) <= most:
                return said
            self.turned = wrap(self.turned + jump[2])
        return (*said[:2], expected, *said[3:])

    def _speeds_up_too_fast(self, new: LocalPosition) -> bool:
        before = self.position.just_before(new.t)
        if before is None:
            return False
        dt, (_, _, _, u, v, w) = before
        most = KNOCK_MPS + FASTEST_MPS2 * dt
        return self._velocities.rejects(new.t, sub(new.velocity, (u, v, w)), most)

    def _lagged(self, t: float, ordered: float, axis: int) -> float:
        """Return where an axis that only tells its order (rad) is at t (s): a first-order lag.

        Axis: its place in the gimbal's history.
        """
        last = self.gimbal.newest
        if last is None:
            return ordered
        angle, dt = last[1][axis], max(0.0, t - last[0])
        share = 1.0 - math.exp(-dt / self._gimbal_lag_s)
        return wrap(angle + share * wrap(ordered - angle))

    def _add_position(self, new: LocalPosition) -> None:
        """Take a position in by a complementary filter."""
        last = self.position.newest
        if last is not None and (new.t <= last[0] or self._speeds_up_too_fast(new)):
            return
        measured = position = sub(new.position, self._frame)
        if last is not None:
            x, y, z = last[1][:3]
            moved = self._moved(new)
            if moved is None:  # too long to go by the velocity
                position = add(measured, sub((x, y, z), self._measured))
            else:
                by = sub(measured, add(self._measured, moved))
                if norm(by) > FRAME_JUMP_M:
                    self._frame = add(self._frame, by)
                    measured = sub(measured, by)
                else:
                    self._compare_climb(new.t, by[2], new.t - last[0])
                carried_on = add((x, y, z), moved)
                k = min(1.0, (new.t - last[0]) / POSITION_TIME_CONSTANT_S)
                position = add(carried_on, scale(sub(measured, carried_on), k))
        self._measured = measured
        self.position.add(new.t, (*position, *new.velocity))

    def _compare_climb(self, t: float, beyond: float, dt: float) -> None:
        """Take by how much the height has changed beyond its rate, m, in dt until t, s."""
        k = min(1.0, dt / CLIMB_RATE_ERROR_S)
        self._climb_error += k * (beyond / dt - self._climb_error)
        if abs(self._climb_error) > WRONG_CLIMB_MPS:
            self._wrong_climb_t = t

    def _moved(self, new: LocalPosition) -> Vec3 | None:
        """Return how far it has moved since the newest position by velocity, m; None: too long."""
        before = self.position.just_before(new.t)
        if before is None:
            return None
        dt, (_, _, _, u, v, w) = before
        return scale(add((u, v, w), new.velocity), 0.5 * dt)

    def forget_autopilot(self) -> None:
        """Drop all that came from the autopilot: it restarted, its frame may be another."""
        self.position.clear()
        self.attitude.clear()
        self._frame, self.turned, self._climb_error = ZERO, 0.0, 0.0
        self._wrong_climb_t = -math.inf

    def camera_pose(self, t: float, *, gimbal_back_s: float = 0.0) -> CameraPose | None:
        """Return the camera's pose at time t, or None where a history does not reach.

        Args:
            t: s.
            gimbal_back_s: how much older the gimbal's angles are to be.
        """
        position, attitude = self.position.at(t), self.attitude.at(t)
        gimbal = self.gimbal.at(t - gimbal_back_s)
        if position is None or attitude is None or gimbal is None:
            return None
        roll, pitch, yaw = attitude[:3]
        origin = (position[0], position[1], position[2])
        pivot = add(origin, rotate(rot_zyx(yaw, pitch, roll), self._camera_offset))
        return CameraPose(pivot, self._looks(attitude, gimbal))

    def feet(self, t: float) -> tuple[Vec3, Vec3] | None:
        """Return the centre of the feet at time t (local, m), and the way from there to the camera.

        None where position or attitude does not reach.
        """
        position, attitude = self.position.at(t), self.attitude.at(t)
        if position is None or attitude is None:
            return None
        roll, pitch, yaw = attitude[:3]
        R = rot_zyx(yaw, pitch, roll)
        feet = add((position[0], position[1], position[2]), rotate(R, self._feet_offset))
        return feet, rotate(R, sub(self._camera_offset, self._feet_offset))

    def camera_rotation(self, t: float, *, gimbal_back_s: float = 0.0) -> Mat3 | None:
        """Return R_local_camera at time t, or None where attitude or gimbal does not reach."""
        attitude = self.attitude.at(t)
        gimbal = self.gimbal.at(t - gimbal_back_s)
        if attitude is None or gimbal is None:
            return None
        return self._looks(attitude, gimbal)

    def _looks(self, attitude: Values, gimbal: Values) -> Mat3:
        """Return R_local_camera, from what the histories have."""
        roll, pitch, yaw = attitude[:3]
        angles = (gimbal[0], gimbal[1], gimbal[2])
        R_local_gimbal = gimbal_frames.look(self._reference, (roll, pitch, yaw), angles)
        return matmul(R_local_gimbal, self._R_gimbal_camera)

    def climbs_otherwise(self, now: float) -> bool:
        """Tell whether the autopilot's height changes, or did lately, otherwise than it says."""
        return now - self._wrong_climb_t < RIGHT_AGAIN_S

    def velocity(self, t: float) -> Vec3:
        """Return the vehicle's velocity at time t, local NED, m/s; zero where it is not known."""
        p = self.position.at(t)
        return (p[3], p[4], p[5]) if p is not None else ZERO

    def down(self, t: float, *, gimbal_back_s: float = 0.0) -> Vec3 | None:
        """Return gravity's direction in the camera frame at time t, None as `camera_rotation`."""
        R = self.camera_rotation(t, gimbal_back_s=gimbal_back_s)
        return None if R is None else rotate(transpose(R), DOWN)

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
        pivot = add(origin, rotate(R, self._camera_offset))
        return pivot, gimbal_frames.base(self._reference, (roll, pitch, yaw))
