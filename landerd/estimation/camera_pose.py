"""The camera's pose in local NED at the time of an exposure (thesis 2.3.6).

The thesis uses the gimbal's angles only; here the airframe's roll and pitch are part of the chain
of rotations (its chapter 5 asks for that), and a gimbal's angles may be relative to the body or to
the horizon.
"""

import math
from collections import deque
from typing import NamedTuple

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
    horizontal,
    matmul,
    norm,
    rot_zyx,
    rotate,
    scale,
    sub,
    towards,
    transpose,
    wrap,
)
from landerd.messages import Attitude, GimbalState, LocalPosition, Reference

DOWN: Vec3 = (0.0, 0.0, 1.0)  # gravity, local NED
# A gimbal's newest angles are held for this long, s: one and a half periods of the slowest report
# rate asked for (10 Hz). Held for 0.3 s, the angles of a gimbal that went silent while it turned
# made a standing pad turn, and its velocity with it.
GIMBAL_HELD_S = 0.15
# A change of position beyond what the velocities explain, m, from which on the autopilot has moved
# its local frame (a reset of its EKF). Chosen by hand: no flight within the limits explains it.
FRAME_JUMP_M = 0.3
# Time constant of the complementary filter in which the position follows the autopilot's, s; short
# of it the reported velocity is integrated. GPS makes the position wander by centimetres a second:
# followed at once, that looks like motion of the pad, and is flown after. It is also slow beside
# the controllers' integrals (3 s). Where the reported velocity has a constant error, so has the
# flown one, and the error cancels only for a pad placed by the integral of that same velocity: with
# 2 s the vehicle touched down 4 cm off, coming from low over the pad.
POSITION_TIME_CONSTANT_S = 20.0
# Bounds of what is possible from one report to the next without doubt: acceleration, m/s^2, and a
# sudden change of velocity by a knock, m/s; change of the yaw rate, rad/s^2, and heading noise,
# rad. Chosen by hand, above what flies. A harder knock is believed as soon as the positions of the
# last MOVES_S agree within KNOCK_MPS: by two alone, their noise of 1 cm would be 0.7 m/s.
FASTEST_MPS2, KNOCK_MPS, MOVES_S = 12.0, 0.3, 0.1
FASTEST_TURN, HEADING_NOISE = math.radians(400.0), math.radians(3.0)
# A heading that has jumped is believed once reports have agreed for this long, s; until then the
# gyros' rates are integrated, which holds for seconds. Of random headings two in a row agree every
# now and then, and one in five is near the last good one: without this the pad's heading followed
# them, and took a second to come back.
HEADING_BELIEVED_S = 0.2
# The autopilot's height and climb rate come from one filter and should agree: in 60 flights of
# ArduCopter in SITL, with wind, vibration and errors of GPS and barometer, they differed by 0.4 m/s
# at most over a second. With both accelerometers off by 1 m/s^2 it was 5: the autopilot believed
# that it sank while it hovered, its controller climbed, and once corrected it fell at 6 m/s.
CLIMB_RATE_ERROR_S = 1.0
WRONG_CLIMB_MPS = 0.5
RIGHT_AGAIN_S = 10.0  # agreement must last this long to be believed: the error came back once


class CameraPose(NamedTuple):
    """Pose of the camera in local NED."""

    position: Vec3  # of the gimbal's pivot, taken for the camera's centre, m
    R_local_camera: Mat3
    airframe: tuple[Mat3, float]  # see `PoseHistory.airframe`


class PoseHistory:
    """Position, attitude and gimbal angles of the last second, and the camera's pose from them.

    Positions are the autopilot's without their noise and wander: its velocity is integrated, and
    the result follows the reported position with POSITION_TIME_CONSTANT_S. An error of that is
    common to pad and vehicle. When the autopilot moves its local frame or resets its heading, the
    old ones are kept, and reports are converted to them.

    Attributes:
        heading_offset: the autopilot's heading minus the one kept, rad.
    """

    def __init__(self, config: Config) -> None:
        self._camera_offset = config.vehicle.camera_offset_m
        self._feet_offset: Vec3 = (0.0, 0.0, config.vehicle.gear_height_m)
        self._gimbal_lag_s = config.gimbal.lag_s
        self._R_gimbal_camera = camera_mount(config.gimbal.camera_rotation_deg)
        fresh = config.freshness
        # Extrapolated as long as it is known: held, it would fall behind a vehicle that follows a
        # fast pad, and the pad would seem to brake.
        self.position = History(
            angles=0,
            max_gap_s=fresh.position_s,
            rates=lambda position: position[3:],
            ahead_s=fresh.position_s,
        )
        self.attitude = History(
            angles=3,
            max_gap_s=fresh.attitude_s,
            rates=lambda attitude: euler_rates(attitude[0], attitude[1], attitude[3:]),
        )
        self.gimbal = History(
            angles=3, max_gap_s=fresh.gimbal_s, held_s=min(GIMBAL_HELD_S, fresh.gimbal_s)
        )
        self._reference = Reference.BODY
        self.heading_offset = 0.0
        self._frame = ZERO  # displacement of the autopilot's local frame from the one kept, m
        self._measured = ZERO  # the newest reported position, in the frame kept, m
        self._wrong_climb_t = -math.inf  # last time that height and climb rate disagreed, s
        self._climb_error = 0.0  # low-passed change of height minus climb rate, m/s, down
        self._headings = OutlierRejector(HEADING_BELIEVED_S)
        # Reports of the last MOVES_S and the one before, taken or not.
        self._reported: deque[LocalPosition] = deque()
        self._doubts = False  # its velocity is not believed

    def add(
        self, message: LocalPosition | Attitude | GimbalState, *, keeps_heading: bool = False
    ) -> None:
        """Take a measurement; one that is not newer than its predecessor is dropped.

        A velocity that jumps as no vehicle can is dropped too, until the positions move with it; of
        an attitude whose heading jumps all but the heading is taken.

        Args:
            message: the measurement.
            keeps_heading: the old heading is kept when the autopilot resets its own.
        """
        if isinstance(message, LocalPosition):
            self._add_position(message)
        elif isinstance(message, Attitude):
            if not keeps_heading:
                self.heading_offset = 0.0
            yaw = wrap(message.yaw - self.heading_offset)
            reported = (message.roll, message.pitch, yaw, *message.rates)
            attitude = self._with_heading(message.t, reported, keeps_heading=keeps_heading)
            self.attitude.add(message.t, attitude)
        else:
            self._reference = message.reference
            t, yaw, pitch = message.t, message.yaw, message.pitch
            yaw = yaw if message.yaw_measured else self._lagged(t, yaw, 0)
            pitch = pitch if message.pitch_measured else self._lagged(t, pitch, 1)
            self.gimbal.add(t, (yaw, pitch, message.roll))

    def _with_heading(self, t: float, reported: Values, *, keeps_heading: bool) -> Values:
        """Return an attitude reported for time t (s), a jump of its heading taken out."""
        before = self.attitude.just_before(t)
        if before is None:
            return reported
        dt, last = before
        rate = euler_rates(reported[0], reported[1], reported[3:])[2]
        expected = wrap(last[2] + 0.5 * dt * (self.attitude.newest_rates[2] + rate))
        most = HEADING_NOISE + 0.5 * FASTEST_TURN * dt * dt
        jump = (0.0, 0.0, wrap(reported[2] - expected))
        if not self._headings.rejects(t, jump, most):
            if not keeps_heading or abs(jump[2]) <= most:
                return reported
            self.heading_offset = wrap(self.heading_offset + jump[2])
        return (*reported[:2], expected, *reported[3:])

    def _is_doubtful(self, new: LocalPosition) -> bool:
        """Tell whether a velocity has jumped as none can while the positions do not move with it.

        An EKF that was reset goes on from its new velocity. One of 3 m/s that was reported for a
        second of a vehicle that stood 0.2 m over its pad was flown after, and tipped it over there.
        """
        reported = self._reported
        while len(reported) > 1 and new.t - reported[1].t >= MOVES_S:
            reported.popleft()
        first, dt = reported[0], new.t - reported[-1].t
        before = self.position.just_before(new.t)
        has_jumped = self._doubts  # also for longer than max_gap_s
        if before is not None:
            _, (_, _, _, u, v, w) = before
            has_jumped = norm(sub(new.velocity, (u, v, w))) > KNOCK_MPS + FASTEST_MPS2 * dt
        moves = scale(sub(new.position, first.position), 1.0 / (new.t - first.t))
        off = sub(new.velocity, moves)
        # A climb rate that stays wrong is told as such: it is doubted once only.
        off_mps = horizontal(off) if self._doubts else norm(off)
        self._doubts = has_jumped and off_mps > KNOCK_MPS
        return self._doubts

    def _lagged(self, t: float, ordered: float, axis: int) -> float:
        """Return the modelled angle (rad) at t (s) of an axis that only reports its set-point.

        Args:
            t: of the report, s.
            ordered: the set-point, rad; the axis follows it with a first-order lag.
            axis: index of the axis in the gimbal's history.
        """
        last = self.gimbal.newest
        if last is None:
            return ordered
        angle, dt = last[1][axis], max(0.0, t - last[0])
        share = 1.0 - math.exp(-dt / self._gimbal_lag_s)
        return wrap(angle + share * wrap(ordered - angle))

    def _add_position(self, new: LocalPosition) -> None:
        """Take a position and velocity into the complementary filter."""
        reported = self._reported
        if reported and new.t <= reported[-1].t:
            return
        is_doubtful = bool(reported) and self._is_doubtful(new)
        reported.append(new)
        if is_doubtful:
            return
        last = self.position.newest
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
                k = min(1.0, (new.t - last[0]) / POSITION_TIME_CONSTANT_S)
                position = towards(add((x, y, z), moved), measured, k)
        self._measured = measured
        self.position.add(new.t, (*position, *new.velocity))

    def _compare_climb(self, t: float, beyond: float, dt: float) -> None:
        """Compare height and climb rate.

        Args:
            t: of the report, s.
            beyond: change of the local z since the last report minus what its rate explains, m.
            dt: since the last report, s.
        """
        k = min(1.0, dt / CLIMB_RATE_ERROR_S)
        self._climb_error += k * (beyond / dt - self._climb_error)
        if abs(self._climb_error) > WRONG_CLIMB_MPS:
            self._wrong_climb_t = t

    def _moved(self, new: LocalPosition) -> Vec3 | None:
        """Return the displacement since the newest position by the velocities, m.

        None where the gap is longer than max_gap_s.
        """
        before = self.position.just_before(new.t)
        if before is None:
            return None
        dt, (_, _, _, u, v, w) = before
        return scale(add((u, v, w), new.velocity), 0.5 * dt)

    def forget_autopilot(self) -> None:
        """Drop all that came from the autopilot: it restarted, and its frame may be another."""
        self.position.clear()
        self.attitude.clear()
        self._frame, self.heading_offset, self._climb_error = ZERO, 0.0, 0.0
        self._wrong_climb_t = -math.inf
        self._reported.clear()
        self._doubts = False

    def camera_pose(self, t: float, *, gimbal_back_s: float = 0.0) -> CameraPose | None:
        """Return the camera's pose at time t, or None where a history does not reach.

        Args:
            t: s.
            gimbal_back_s: how much earlier than the attitude the gimbal's angles are stamped, s.
        """
        position, airframe = self.position.at(t), self.airframe(t)
        R_local_camera = self.camera_rotation(airframe, t - gimbal_back_s)
        if position is None or airframe is None or R_local_camera is None:
            return None
        origin = (position[0], position[1], position[2])
        pivot = add(origin, rotate(airframe[0], self._camera_offset))
        return CameraPose(pivot, R_local_camera, airframe)

    def feet(self, t: float) -> tuple[Vec3, Vec3] | None:
        """Return the centre of the feet and the vector from there to the camera at t (s), local, m.

        None where position or attitude does not reach.
        """
        position, airframe = self.position.at(t), self.airframe(t)
        if position is None or airframe is None:
            return None
        R, _ = airframe
        feet = add((position[0], position[1], position[2]), rotate(R, self._feet_offset))
        return feet, rotate(R, sub(self._camera_offset, self._feet_offset))

    def airframe(self, t: float) -> tuple[Mat3, float] | None:
        """Return R_local_body and the heading (rad) at t (s); None: not known."""
        attitude = self.attitude.at(t)
        if attitude is None:
            return None
        roll, pitch, yaw = attitude[:3]
        return rot_zyx(yaw, pitch, roll), yaw

    def camera_rotation(self, airframe: tuple[Mat3, float] | None, gimbal_t: float) -> Mat3 | None:
        """Return R_local_camera by an `airframe` and the gimbal's angles at gimbal_t (s).

        None where either is not known.
        """
        gimbal = self.gimbal.at(gimbal_t)
        if airframe is None or gimbal is None:
            return None
        R_local_body, heading = airframe
        angles = (gimbal[0], gimbal[1], gimbal[2])
        R_local_gimbal = gimbal_frames.rotation_local_gimbal(
            self._reference, R_local_body, heading, angles
        )
        return matmul(R_local_gimbal, self._R_gimbal_camera)

    def climb_rate_is_wrong(self, now: float) -> bool:
        """Tell whether the autopilot's climb rate disagrees, or did lately, with its height."""
        return now - self._wrong_climb_t < RIGHT_AGAIN_S

    def velocity(self, t: float) -> Vec3:
        """Return the vehicle's velocity at time t, local NED, m/s; zero where it is not known."""
        p = self.position.at(t)
        return (p[3], p[4], p[5]) if p is not None else ZERO

    def down(self, t: float, *, gimbal_back_s: float = 0.0) -> Vec3 | None:
        """Return the unit vector of gravity in the camera frame at t (s); None: not known."""
        R = self.camera_rotation(self.airframe(t), t - gimbal_back_s)
        return None if R is None else rotate(transpose(R), DOWN)

    def gimbal_base(self, ahead_s: float) -> tuple[Vec3, Mat3] | None:
        """Return the gimbal's pivot (local, m) and R_local_base, ahead_s after the newest attitude.

        The base is the frame that the gimbal is aimed in (gimbal_frames.rotation_local_base).
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
        return pivot, gimbal_frames.rotation_local_base(self._reference, R, yaw)
