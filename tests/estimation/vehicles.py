"""A vehicle in flight, from its telemetry."""

from landerd.config.models import Config, VehicleSection
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.vehicle_state import VehicleState, vehicle_state
from landerd.geometry import Vec3
from landerd.messages import Attitude, LocalPosition

GEAR = VehicleSection(gear_height_m=0.2)


def flying(
    *,
    velocity: Vec3 = (0.0, 0.0, 0.0),
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
    rates: Vec3 = (0.0, 0.0, 0.3),
) -> PoseHistory:
    poses = PoseHistory(Config())
    poses.add(LocalPosition(10.0, (1.0, 2.0, -5.0), velocity))
    poses.add(Attitude(10.0, roll, pitch, yaw, rates))
    return poses


def vehicle(poses: PoseHistory, now: float = 10.0) -> VehicleState:
    found = vehicle_state(poses, GEAR, now)
    assert found is not None
    return found
