"""The vehicle at the time of a control step, from its newest telemetry."""

import math
from typing import NamedTuple

from landerd.config.models import VehicleSection
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.history import Values
from landerd.geometry import Vec3, add, cross, dot, rot_zyx, rotate, scale, wrap

COURSE_MPS = 1.5  # a slower vehicle hovers: its motion is that of wind and control


class VehicleState(NamedTuple):
    """The vehicle at one time, local NED."""

    feet: Vec3  # centre of the footprint in the plane of the feet, m
    down: Vec3  # the airframe's down axis, unit vector
    velocity: Vec3  # m/s
    yaw: float  # rad
    autopilot_yaw: float  # by the autopilot, rad; differs from yaw after a reset of its heading
    yaw_rate: float  # of the heading, rad/s: a leaning airframe turns otherwise about its own axis
    tilt: float  # of the airframe from level, rad
    roll_pitch_rate: float  # magnitude of the body's roll and pitch rates, rad/s
    airframe: VehicleSection
    attitude: Values  # roll, pitch, yaw, rad, and the body's rates, rad/s

    @property
    def foot_velocity(self) -> Vec3:
        """Velocity of the foot that sinks slowest, m/s."""
        return slowest_foot(self.airframe, self.velocity, self.attitude)

    def lowest_foot(self, normal: Vec3) -> float:
        """Return how far the lowest foot is below the feet's centre along a normal, m.

        Args:
            normal: unit vector into the plane to stand on, local NED.
        """
        roll, pitch, *_ = self.attitude
        R = rot_zyx(self.yaw, pitch, roll)
        return max(dot(rotate(R, foot), normal) for foot in feet_of(self.airframe, 0.0))

    @property
    def course(self) -> float | None:
        """Direction of its motion relative to its nose, rad, right positive; None in hover."""
        north, east, _ = self.velocity
        moves = math.hypot(north, east) > COURSE_MPS
        return wrap(math.atan2(east, north) - self.yaw) if moves else None


def vehicle_state(poses: PoseHistory, vehicle: VehicleSection, now: float) -> VehicleState | None:
    """Return the vehicle at time now (s) from its newest position and attitude, None without them.

    Position and yaw are extrapolated by velocity and yaw rate; roll and pitch are not.
    """
    position, attitude = poses.position.newest, poses.attitude.newest
    if position is None or attitude is None:
        return None
    t, p = position
    roll, pitch, yaw, p_rate, q_rate, _ = attitude[1]
    yaw_rate = poses.attitude.newest_rates[2]
    velocity = (p[3], p[4], p[5])
    origin = add((p[0], p[1], p[2]), scale(velocity, now - t))
    (_, _, down_n), (_, _, down_e), (_, _, down_d) = rot_zyx(yaw, pitch, roll)
    down = (down_n, down_e, down_d)
    feet = add(origin, scale(down, vehicle.gear_height_m))
    yaw = wrap(yaw + (now - attitude[0]) * yaw_rate)
    tilt, roll_pitch_rate = math.hypot(roll, pitch), math.hypot(p_rate, q_rate)
    autopilot_yaw = wrap(yaw + poses.heading_offset)
    return VehicleState(
        feet=feet,
        down=down,
        velocity=velocity,
        yaw=yaw,
        autopilot_yaw=autopilot_yaw,
        yaw_rate=yaw_rate,
        tilt=tilt,
        roll_pitch_rate=roll_pitch_rate,
        airframe=vehicle,
        attitude=attitude[1],
    )


def slowest_foot(vehicle: VehicleSection, velocity: Vec3, attitude: Values) -> Vec3:
    """Return the velocity (local, m/s) of the foot that sinks slowest.

    A foot that touches down first becomes a pivot: the airframe's centre goes on sinking and moves
    across the pad, the foot that stands does not.

    Args:
        vehicle: its geometry.
        velocity: of the body frame's origin, local, m/s.
        attitude: roll, pitch, yaw, rad, and the body's rates, rad/s.
    """
    roll, pitch, yaw, *rates = attitude
    R = rot_zyx(yaw, pitch, roll)
    turn = rotate(R, (rates[0], rates[1], rates[2]))
    feet = [
        add(velocity, cross(turn, rotate(R, foot)))
        for foot in feet_of(vehicle, vehicle.gear_height_m)
    ]
    return min(feet, key=lambda foot: foot[2])


def feet_of(vehicle: VehicleSection, down_m: float) -> list[Vec3]:
    """Return the four feet in the body frame, at z = down_m, m."""
    length, width = vehicle.footprint_m
    return [
        (x, y, down_m) for x in (-0.5 * length, 0.5 * length) for y in (-0.5 * width, 0.5 * width)
    ]
