"""What the safety rules allow."""

import math
from dataclasses import dataclass

ZERO = 1e-3  # m/s and rad/s that count as zero on the wire


@dataclass(frozen=True)
class RuleBounds:
    """What the rules allow: the configured limits, and the times of the rules themselves."""

    control_period_s: float
    gate_channel: int
    gate_threshold_us: int
    release_s: float
    heartbeat_s: float
    rc_s: float
    attitude_s: float
    position_s: float
    gimbal_s: float
    speed_mps: float
    climb_mps: float
    descent_mps: float
    acceleration_mps2: float
    vertical_acceleration_mps2: float
    jerk_mps3: float
    yaw_rate: float  # rad/s
    k1_m: float
    k2_per_m: float
    alignment_height_m: float
    has_heading: bool
    heading: float = math.radians(5.0)  # rad
    sighting_s: float = 0.5
    blind_commit_s: float = 1.0
    commit_height_m: float = 0.20
    settle_s: float = 5.0
    stream_s: float = 0.05
    jitter_s: float = 0.0  # of the times at which set-points are seen: none on a virtual clock
