"""Bounds of the rules for the judge's tests."""

from hw.sim.judge.bounds import RuleBounds

BOUNDS = RuleBounds(
    system_id=1,
    ground_stations=frozenset({255}),
    servo_outputs=frozenset({9}),
    control_period_s=0.025,
    gate_channel=11,
    gate_threshold_us=1500,
    release_s=1.0,
    heartbeat_s=3.0,
    rc_s=0.5,
    attitude_s=0.2,
    position_s=0.3,
    gimbal_s=0.3,
    speed_mps=5.0,
    climb_mps=1.0,
    descent_mps=1.0,
    acceleration_mps2=2.5,
    vertical_acceleration_mps2=1.0,
    jerk_mps3=15.0,
    yaw_rate=0.5,
    braking_mps2=2.5,
    vertical_braking_mps2=1.0,
    k1_m=0.12,
    k2_per_m=0.36,
    alignment_height_m=2.0,
    commit_slip_mps=0.3,
    commits_at_m=0.16,
    has_heading=True,
)
