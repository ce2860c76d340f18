"""Histories of telemetry to see a pad by."""

import math

from landerd.config.models import Config
from landerd.estimation.camera_pose import PoseHistory
from landerd.geometry import Vec3
from landerd.messages import Attitude, GimbalState, LocalPosition, Reference

# The camera at the autopilot's position: the chain of rotations alone.
AT_ORIGIN = Config.model_validate({"vehicle": {"camera_offset_m": (0.0, 0.0, 0.0)}})
DEGREES = math.pi / 180.0


def history(
    config: Config = AT_ORIGIN,
    *,
    position: Vec3 = (0.0, 0.0, 0.0),
    attitude_deg: Vec3 = (0.0, 0.0, 0.0),  # roll, pitch, yaw
    gimbal_deg: Vec3 = (0.0, 0.0, 0.0),  # yaw, pitch, roll
    reference: Reference = Reference.BODY,
    t: float = 1.0,
) -> PoseHistory:
    made = PoseHistory(config)
    roll, pitch, yaw = (a * DEGREES for a in attitude_deg)
    gimbal_yaw, gimbal_pitch, gimbal_roll = (a * DEGREES for a in gimbal_deg)
    made.add(LocalPosition(t, position, (0.0, 0.0, 0.0)))
    made.add(Attitude(t, roll, pitch, yaw, (0.0, 0.0, 0.0)))
    made.add(GimbalState(t, gimbal_yaw, gimbal_pitch, gimbal_roll, reference))
    return made
