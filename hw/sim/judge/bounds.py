"""What the safety rules allow."""

import math
from dataclasses import dataclass

ZERO = 1e-3  # m/s and rad/s that count as zero on the wire
STREAM_S = 0.05  # between set-points: 20 Hz


@dataclass(frozen=True)
class RuleBounds:
    """What the rules allow: the configured limits, and the times of the rules themselves."""

    control_period_s: float
    system_id: int  # of the vehicle
    ground_stations: frozenset[int]  # system ids that may ask landerd for something
    servo_outputs: frozenset[int]  # of the autopilot, that landerd may move: its gimbal's
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
    # What the autopilot brakes with, whatever more the limits allow.
    braking_mps2: float
    vertical_braking_mps2: float
    k1_m: float
    k2_per_m: float
    alignment_height_m: float
    commit_slip_mps: float
    has_heading: bool
    guid_timeout_s: float | None = None  # after so long the autopilot stops; None: not known
    heading: float = math.radians(5.0)  # rad
    sighting_s: float = 0.5
    blind_commit_s: float = 1.0  # from the last sighting until contact is noticed
    notice_s: float = 0.2  # of it: to notice contact
    commit_height_m: float = 0.20  # at most
    commits_at_m: float = 0.20  # as configured
    dead_companion_mps: float = 0.5  # the fastest that it may let the vehicle sink to the ground
    wave_off_pad_mps: float = 0.5  # over a faster pad a stop waits until the vehicle is clear
    wave_off_s: float = 1.0
    wave_off_m: float = 0.5
    ride_mps: float = 0.3  # across the pad while pressed down
    rocks_m: float = 0.03  # its lowest foot below the feet's centre, while it lies on the pad
    settle_s: float = 5.0
    total_s: float = 120.0
    land_threshold_us: int = 0  # between the gate's and this the pilot asks to hold
    hold_height_m: float = 2.0  # over the pad
    stall_s: float = 0.0  # for so long the world lets the companion computer stand still
    jitter_s: float = 0.0  # of the times at which set-points are seen: none on a virtual clock

    @property
    def stream_s(self) -> float:
        """Longest gap between set-points: 20 Hz, while the computer does not stand still."""
        return STREAM_S + self.stall_s

    @property
    def tick_s(self) -> float:
        """How late landerd may be: one control step, while the computer does not stand still."""
        return 1.05 * self.control_period_s + self.stall_s

    @property
    def early_s(self) -> float:
        """How much sooner landerd may take data to be stale: half the round trip counts as age."""
        return 4.0 * self.tick_s

    @property
    def least_hold_height_m(self) -> float:
        """The height over which to hold, less what the range to the pad may be wrong by."""
        return 0.95 * self.hold_height_m - 0.1
