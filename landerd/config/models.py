"""The typed models of the configuration, which `landerd.config.files` reads from YAML.

Lengths are in m and times in s. Angles are in degrees, as people type them, and their keys end in
`_deg`. Drivers and the simulator have models of their own (landerd.drivers), which are added to the
section that they belong to.

Comments on keys become the table in docs/configuration-keys.md (landerd.reference).
"""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from landerd.section import Angle, Finite, NotNegative, Positive, Section

_ADDRESS = re.compile(r"(?:\[([0-9A-Fa-f:.%\w]+)\]|([^\s:\[\]]+)):(\d{1,5})", re.ASCII)

Gain = Annotated[float, Field(ge=0, le=10)]
# Lengths of an airframe, m. Their limits refuse values that were typed in cm or mm.
Arm = Annotated[float, Field(ge=-3, le=3)]
Width = Annotated[float, Field(gt=0, le=5)]


def split_address(text: str) -> tuple[str, int]:
    """Return the address and the port of ADDRESS:PORT, as 127.0.0.1:8080 or [::1]:8080.

    Raises:
        ValueError: the text has not this form.
    """
    found = _ADDRESS.fullmatch(text)
    if found is None or not 1 <= int(found[3]) <= 65535:
        raise ValueError("expected ADDRESS:PORT, as 127.0.0.1:8080")
    return found[1] or found[2], int(found[3])


class PadSection(Section):
    """Which pad to land on."""

    layout: Path = Path("pads/thesis.yaml")  # markers and plate; the landing point is its origin


class VehicleSection(Section):
    """Geometry of the airframe, body frame (FRD), from the point of the autopilot's position."""

    camera_offset_m: tuple[Arm, Arm, Arm] = (0.10, 0.0, 0.04)  # to the gimbal's pivot
    gear_height_m: Annotated[float, Field(ge=0, le=3)] = 0.20  # down to the plane of the feet
    footprint_m: tuple[Width, Width] = (0.44, 0.26)  # distance of the feet: along x, along y


class MeteringSection(Section):
    """How landerd controls the exposure (`camera.exposure: pad`)."""

    shortest_s: Annotated[float, Field(gt=0, le=0.1)] = 1e-4  # shortest exposure
    # up to gain_max, gain is raised before the exposure exceeds this, against motion blur
    short_s: Annotated[float, Field(gt=0, le=0.1)] = 0.008
    longest_s: Annotated[float, Field(gt=0, le=0.1)] = 0.015  # longest exposure, at gain_max
    gain_max: Annotated[float, Field(ge=1, le=64)] = 4.0  # highest gain / lowest gain

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.shortest_s <= self.short_s <= self.longest_s:
            raise ValueError("expected shortest_s <= short_s <= longest_s")
        return self


class CameraSection(Section):
    """Which camera, and its calibration."""

    driver: str = "sim"
    # fixed: as set in the driver's block; auto: by the camera; pad: by landerd, for the pad
    exposure: Literal["fixed", "auto", "pad"] = "pad"
    metering: MeteringSection = MeteringSection()
    calibration: Path = Path("cameras/thesis.yaml")  # ROS camera_info: landerd calibrate camera
    # time stamp of a picture minus exposure of its middle row; positive: stamped late
    clock_offset_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0


class GimbalSection(Section):
    """Which gimbal, and the limits of its angles (thesis 2.3.3)."""

    driver: str = "sim"
    yaw_limits_deg: tuple[Angle, Angle] = (-90.0, 90.0)  # positive right
    pitch_limits_deg: tuple[Angle, Angle] = (-180.0, 0.0)  # positive up; -90 is straight down
    # rotation of the camera on the last axis: roll right, pitch up, yaw right
    camera_rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    # time constant with which it follows its orders; used if it does not measure its angles
    lag_s: Annotated[float, Field(gt=0, le=0.5)] = 0.08

    @field_validator("yaw_limits_deg", "pitch_limits_deg")
    @classmethod
    def _in_order(cls, limits: tuple[float, float]) -> tuple[float, float]:
        if limits[0] > limits[1]:
            raise ValueError(f"found {limits[0]:g} to {limits[1]:g}, expected the lower one first")
        return limits


class AutopilotSection(Section):
    """The link to the autopilot, and the autopilot's parameters that landerd has to know."""

    driver: str = "mavlink"
    url: str = "memory:"  # of the link: serial:DEVICE?baud=N, udpin:HOST:PORT, tcp:HOST:PORT, ...
    setpoint_frame: Literal["local_ned", "body_ned"] = "local_ned"  # body_ned: as in the thesis
    system_id: Annotated[int, Field(ge=1, le=255)] = 1  # the autopilot's SYSID_THISMAV (MAV_SYSID)
    # the autopilot's GUID_TIMEOUT, until it reports its own
    guided_timeout_s: Annotated[float, Field(ge=0.1, le=3600)] = 1.0
    # the autopilot's WPNAV_ACCEL, until it reports its own
    acceleration_mps2: Annotated[float, Field(ge=0.5, le=10)] = 2.5
    # the autopilot's WPNAV_ACCEL_Z, until it reports its own
    vertical_acceleration_mps2: Annotated[float, Field(ge=0.3, le=5)] = 1.0
    # the autopilot's PSC_JERK_XY, until it reports its own
    jerk_mps3: Annotated[float, Field(ge=1, le=50)] = 5.0
    # the autopilot's PSC_JERK_Z, until it reports its own
    vertical_jerk_mps3: Annotated[float, Field(ge=1, le=50)] = 5.0
    # the autopilot's ATC_INPUT_TC (time constant of its attitude), until it reports its own
    attitude_time_constant_s: Annotated[float, Field(ge=0.01, le=2)] = 0.15
    # system IDs of the ground stations whose parameter changes and commands are accepted
    ground_stations: tuple[Annotated[int, Field(ge=1, le=255)], ...] = (255,)
    signing_key: Path | None = None  # file with the key of signed messages; None: unsigned
    signing_time: Path | None = None  # file with their last time stamp; None: beside the key

    @property
    def shaper_lag_s(self) -> float:
        """Lag of the velocity shaper, s: it asks for jerk / acceleration (1/s) times the error."""
        return self.acceleration_mps2 / self.jerk_mps3

    @property
    def vertical_shaper_lag_s(self) -> float:
        """Lag of the shaper of vertical velocities, s: likewise."""
        return self.vertical_acceleration_mps2 / self.vertical_jerk_mps3


class RcSection(Section):
    """The switch by which the pilot lets landerd fly (the gate)."""

    # RC channel of the switch: landerd flies only while it is high
    gate_channel: Annotated[int, Field(ge=5, le=18)] = 11
    # pulse width above which the switch is high
    gate_threshold_us: Annotated[int, Field(ge=1200, le=1800)] = 1500
    # for a switch with three positions: above this landerd lands, between the two thresholds it
    # holds the vehicle over the pad (guidance.hold); 0: a switch with two positions
    land_threshold_us: Annotated[int, Field(ge=0, le=1800)] = 0

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if 0 < self.land_threshold_us < self.gate_threshold_us + 200:
            raise ValueError("expected land_threshold_us 200 above gate_threshold_us, or 0")
        return self


class FreshnessSection(Section):
    """Largest age of each kind of data, by its own time stamp, with which landerd flies."""

    heartbeat_s: Annotated[float, Field(gt=0, le=3)] = 3.0
    rc_s: Annotated[float, Field(gt=0, le=1)] = 0.5
    attitude_s: Annotated[float, Field(gt=0, le=0.5)] = 0.2
    position_s: Annotated[float, Field(gt=0, le=0.5)] = 0.3
    gimbal_s: Annotated[float, Field(gt=0, le=0.5)] = 0.3


class VisionSection(Section):
    """The search for markers in images."""

    min_ring_px: Positive = 10.0  # smallest outer diameter of a ring that is searched for
    max_sigma_m: Positive = 1.0  # poses less certain than this are not reported
    # relative error of the calibrated focal length, 1 sigma: of a hand-held chessboard, and of
    # changes by focus and temperature
    focal_sigma: Annotated[float, Field(ge=0, le=0.1)] = 0.005
    # from the exposure of the first row to that of the last: 10 to 33 ms for ordinary cameras, 0
    # for a global shutter. No more than it really is: the error that it allows the image of a
    # moving pad hides that the pad has stopped (with 0.02 a wave-off came 0.1 s later)
    readout_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0


class EstimationSection(Section):
    """Noise the pad filter assumes."""

    pad_acceleration_mps2: Positive = 0.3  # process noise of a new pad; then it is adapted
    # slowly varying error of the lens's direction
    gimbal_sigma_deg: Annotated[float, Field(ge=0, le=90)] = 1.0
    # noise of that direction from frame to frame
    bearing_noise_deg: Annotated[float, Field(ge=0, le=90)] = 0.05
    # jitter of the times of attitude and gimbal angles
    gimbal_late_s: Annotated[float, Field(ge=0, le=1)] = 0.002
    # error of the pictures' clock relative to the telemetry's
    clock_sigma_s: Annotated[float, Field(ge=0, le=1)] = 0.02
    position_sigma_m: Positive = 0.002  # noise of the autopilot's position from frame to frame
    # innovations beyond this many standard deviations are refused
    gate_sigma: Annotated[float, Field(ge=1, le=20)] = 4.0


class PidGains(Section):
    """Gains of one controller; output = kp e + ki int(e) + kd de/dt, all positive here."""

    kp: Gain
    ki: Gain = 0.0
    kd: Gain = 0.0


class PidSection(Section):
    """The thesis's four PID controllers (2.4.3); north and east have the same gains.

    The gains of up, yaw and the approach are the thesis's (Tables 3.7, 3.8). Nearer the pad the
    thesis's low kp and high kd converge slowly, with a time constant of 6 s, so these gains are
    stiffer. The thesis's gains are in config/thesis-gains.yaml.
    """

    approach: PidGains = PidGains(kp=0.7, kd=0.4)
    close_approach: PidGains = PidGains(kp=0.6, kd=0.5)
    final: PidGains = PidGains(kp=0.8, ki=0.3, kd=0.4)  # YAW_CORRECTION and DESCENT
    up: PidGains = PidGains(kp=0.9, kd=0.5)
    yaw: PidGains = PidGains(kp=1.5, kd=0.1)
    integral_limit_mps: Annotated[float, Field(ge=0, le=5)] = 1.0  # limit on the integral output
    speed_mps: Annotated[float, Field(gt=0, le=20)] = 5.0  # limit on the horizontal output


class TrackingSection(Section):
    """The controller on the pad filter's state."""

    kp: Annotated[float, Field(gt=0, le=5)] = 2.5  # closing speed per m of distance, near the pad
    ki: Annotated[float, Field(ge=0, le=2)] = 0.6  # integral gain on a distance that does not close
    lead_s: Annotated[float, Field(ge=0, le=2)] = 0.0  # the vehicle's lag beyond ArduPilot's shaper
    approach_mps: Annotated[float, Field(gt=0, le=15)] = 6.0  # fastest closing speed
    brake_mps2: Annotated[float, Field(gt=0, le=5)] = 1.5  # deceleration counted on for braking
    descent_brake_mps2: Annotated[float, Field(gt=0, le=5)] = 0.45  # to brake the descent
    yaw_kp: Annotated[float, Field(gt=0, le=5)] = 1.0  # rad/s per rad


MAX_HEADING_DEG = 5.0  # largest heading error allowed below the alignment height


class DescentSection(Section):
    """Where descent is allowed (thesis eq. 2.3) and when it is committed."""

    k1_m: Annotated[float, Field(gt=0, le=1)] = 0.12  # descent within k1 exp(k2 height) of the pad
    k2_per_m: Annotated[float, Field(ge=0, le=1)] = 0.36
    widest_k1_m: Annotated[float, Field(gt=0, le=1)] = 0.16  # k1 grows to this in gusts
    # CLOSE_APPROACH begins at this many radii of the descent region
    close_factor: Annotated[float, Field(gt=1, le=10)] = 3.0
    # no lower than this while the heading is off
    alignment_height_m: Annotated[float, Field(gt=0, le=10)] = 2.0
    align_deg: Positive = 1.2  # the heading counts as aligned within this
    # beyond this the heading counts as off again; the rest up to 5 degrees is for errors of gimbal
    # and mounting, which are not seen in the pictures
    realign_deg: Positive = 2.5
    commit_height_m: Annotated[float, Field(gt=0, le=0.2)] = 0.16  # below, a landing is committed
    # largest predicted distance from the landing point at touch-down to commit with
    commit_miss_m: Annotated[float, Field(gt=0, le=1)] = 0.2
    # largest horizontal speed relative to the pad to commit with
    commit_slip_mps: Annotated[float, Field(gt=0, le=2)] = 0.3
    # largest sink rate relative to the pad to commit with
    commit_sink_mps: Annotated[float, Field(ge=0.5, le=2)] = 0.8
    # if it may not commit, the vehicle climbs to this height and tries again
    retry_height_m: Annotated[float, Field(ge=0.3, le=10)] = 1.0
    # method pid: slowest descent where descent is allowed
    slowest_mps: Annotated[float, Field(gt=0, le=0.5)] = 0.15

    @model_validator(mode="after")
    def _hysteresis(self) -> Self:
        if not self.align_deg < self.realign_deg <= MAX_HEADING_DEG:
            raise ValueError("expected align_deg < realign_deg <= 5")
        return self


class LimitsSection(Section):
    """Limits that all set-points obey, whichever controller computes them."""

    speed_mps: Annotated[float, Field(ge=0.5, le=20)] = 20.0
    climb_mps: Annotated[float, Field(ge=0.3, le=5)] = 1.0
    descent_mps: Annotated[float, Field(gt=0, le=3)] = 1.5
    # with less than 0.5 the vehicle would stop only after the pad is out of sight
    acceleration_mps2: Annotated[float, Field(ge=0.5, le=10)] = 2.5
    # with 0.3 the vehicle touched a rising deck at 0.7 m/s
    vertical_acceleration_mps2: Annotated[float, Field(ge=0.5, le=5)] = 1.0
    jerk_mps3: Annotated[float, Field(ge=2, le=50)] = 15.0
    yaw_rate_deg_s: Annotated[float, Field(gt=0, le=180)] = 30.0


class LostSection(Section):
    """The search after the pad went out of sight, and when landerd hands back to the pilot."""

    after_s: Annotated[float, Field(gt=0, le=0.5)] = 0.5  # without a sighting (thesis: abort time)
    hold_s: Annotated[float, Field(ge=0, le=60)] = 3.0  # hover before the climb
    climb_mps: Annotated[float, Field(ge=0.2, le=3)] = 0.5
    climb_m: Annotated[float, Field(ge=0, le=50)] = 5.0  # height to climb; 0: do not climb
    give_up_s: Annotated[float, Field(gt=0, le=600)] = 30.0  # search before landerd hands back
    # a landing without commit after this time is handed back
    total_s: Annotated[float, Field(gt=0, le=3600)] = 120.0
    # number of descents that may be broken off; with one more, landerd hands back
    retries: Annotated[int, Field(ge=0, le=100)] = 5


class HoldSection(Section):
    """Where the vehicle hovers while the pilot's switch asks to hold (rc.land_threshold_us)."""

    height_m: Annotated[float, Field(ge=0.5, le=20)] = 2.0  # of the feet above the pad


class GuidanceSection(Section):
    """How the vehicle is guided onto the pad."""

    method: Literal["tracking", "pid"] = "tracking"  # pid: the thesis's controller
    # landing_target: the pad's direction is sent, for the autopilot's own precision landing
    output: Literal["velocity", "landing_target"] = "velocity"
    tracking: TrackingSection = TrackingSection()
    pid: PidSection = PidSection()
    descent: DescentSection = DescentSection()
    limits: LimitsSection = LimitsSection()
    lost: LostSection = LostSection()
    hold: HoldSection = HoldSection()
    # after the gate closed, zero velocity is sent for this long
    release_s: Annotated[float, Field(ge=0.5, le=3)] = 1.0
    touchdown_descent_mps: Annotated[float, Field(ge=0.1, le=0.6)] = 0.3  # sink rate after commit
    # without ON_GROUND for this long after contact (where none is noticed, after commit) the pilot
    # is told to disarm by hand. With less than 3 he would be told in the air: the feet touch down
    # one or two seconds after commit, and ArduCopter detects it two seconds later
    touchdown_timeout_s: Annotated[float, Field(ge=3, le=5)] = 5.0


class AimSection(Section):
    """How the gimbal is aimed at the pad (thesis 2.3.4)."""

    method: Literal["predicted", "increment"] = "predicted"  # increment: the thesis's control law
    lead_s: Annotated[float, Field(ge=0, le=0.5)] = 0.1  # predicted: the gimbal's lag
    gain: Annotated[float, Field(gt=0, le=1)] = 0.5  # increment: k of eq. 2.1
    idle_yaw_deg: Finite = 0.0  # where the camera looks while no pad is known
    # where the camera looks while no pad is known; the default shows a pad near the flight's start
    idle_pitch_deg: Finite = -50.0
    # without a sighting for this long the gimbal sweeps down and up
    search_after_s: Annotated[float, Field(ge=0.5, le=600)] = 5.0


class ControlSection(Section):
    """The control loop."""

    rate_hz: Annotated[float, Field(ge=20, le=100)] = 40.0  # rate of set-points


class LogSection(Section):
    """What is recorded of flights, and the disk space that it may take."""

    folder: Path | None = None  # None: $STATE_DIRECTORY/logs, which systemd sets
    images: Literal["none", "jpeg", "lossless"] = "jpeg"  # landerd replay needs lossless for vision
    every_nth: Annotated[int, Field(ge=1)] = 3  # of the searched frames, every n-th is recorded
    disarmed_images: bool = False  # whether images are recorded while disarmed, too
    most_file_mb: Annotated[float, Field(ge=1)] = 500.0  # a larger log goes on in another file
    # size of all logs but the one being written; beyond this the oldest are deleted
    most_mb: Positive = 8000.0
    keep_free_mb: NotNegative = 200.0  # with less free space on the disk no images are recorded


class WebSection(Section):
    """The status page, and the server for Foxglove (docs/status-page.md)."""

    listen: str | None = None  # ADDRESS:PORT of the status page; None: there is no page
    # file with the page's token; needed if other computers can reach the page
    token_file: Path | None = None
    foxglove: str | None = None  # ADDRESS:PORT of the server, this computer only; None: no server

    @field_validator("listen", "foxglove", mode="before")
    @classmethod
    def _address_and_port(cls, address: object) -> object:
        if address is not None:
            split_address(str(address))  # YAML reads a port alone as a number
        return address


class Config(Section):
    """The whole configuration, without the blocks of drivers and of the simulator."""

    pad: PadSection = PadSection()
    vehicle: VehicleSection = VehicleSection()
    camera: CameraSection = CameraSection()
    gimbal: GimbalSection = GimbalSection()
    autopilot: AutopilotSection = AutopilotSection()
    rc: RcSection = RcSection()
    freshness: FreshnessSection = FreshnessSection()
    vision: VisionSection = VisionSection()
    estimation: EstimationSection = EstimationSection()
    guidance: GuidanceSection = GuidanceSection()
    aim: AimSection = AimSection()
    control: ControlSection = ControlSection()
    log: LogSection = LogSection()
    web: WebSection = WebSection()
