"""The `sim:` section of the configuration: the simulated world.

Values do not depend on the seed; what is random is drawn from it elsewhere.
"""

from pathlib import Path
from typing import Annotated, Literal, get_args

import cv2
from pydantic import AfterValidator, ConfigDict, Field

from hw.sim.camera_options import Share, SimCameraOptions
from hw.sim.fault_options import FaultOptions
from landerd.section import Finite, NotNegative, Positive, Section

GroundKind = Literal[
    "grass", "asphalt", "plain",
    "meadow", "gravel", "paving", "canopy", "roof", "car_park", "water",
]  # fmt: skip


def _picture(ground: GroundKind | Path) -> GroundKind | Path:
    """Refuse a photograph that cannot be read."""
    if isinstance(ground, Path):
        if not ground.is_file():
            raise ValueError(f"found {ground}, expected one of {_KINDS} or a picture's file")
        if cv2.imread(str(ground), cv2.IMREAD_REDUCED_GRAYSCALE_8) is None:
            raise ValueError(f"{ground} cannot be read as a picture (JPEG, PNG, ...)")
    return ground


_KINDS = ", ".join(get_args(GroundKind))
Ground = Annotated[GroundKind | Path, Field(union_mode="left_to_right"), AfterValidator(_picture)]


class StartOptions(Section):
    """Where and how the vehicle hovers when the simulation starts."""

    position_m: tuple[Finite, Finite] = (-30.0, 0.0)  # north, east of the landing point
    altitude_m: Annotated[float, Field(ge=0.5, le=120)] = 10.0  # above the pad's mean height
    heading_deg: Finite = 0.0
    bearings: Annotated[int, Field(ge=1, le=360)] = 1  # number of sides seeds start from in turn
    spread_m: NotNegative = 0.0  # largest random offset of the start, north and east, by seed
    heading_spread_deg: Annotated[float, Field(ge=0, le=180)] = 0.0  # the same of the heading
    # least speed of a pad behind which the vehicle starts, on the pad's course and with its
    # velocity, like a drone that follows its truck; heading_deg then counts from that course
    follow_from_mps: NotNegative = 5.0
    follow_m: NotNegative = 15.0  # distance behind such a pad at the start
    overtake_mps: NotNegative = 0.0  # speed of the vehicle relative to such a pad at the start


class WindOptions(Section):
    """The air."""

    model: Literal["steady", "thesis"] = "steady"  # thesis: section 3.8; ignores the other keys
    speed_mps: Annotated[float, Field(ge=0, le=40)] = 0.0
    from_deg: Finite | None = 0.0  # direction the mean wind comes from; null: by seed
    gust_mps: Annotated[float, Field(ge=0, le=20)] = 0.0
    gust_s: Annotated[float, Field(gt=0, le=60)] = 5.0  # duration of one gust
    turbulence_mps: Annotated[float, Field(ge=0, le=5)] = 0.0  # standard deviation (Dryden)


class PadOptions(Section):
    """Where the pad is and how it moves."""

    position_m: tuple[Finite, Finite] = (35.0, 12.0)  # at the start: north, east of local's origin
    heading_deg: Finite = 0.0  # of the pad's north
    height_m: NotNegative = 0.0  # above the ground
    speed_mps: Annotated[float, Field(ge=0, le=30)] = 0.0
    course_deg: Finite = 0.0  # direction of travel; turns with the pad
    turn_rate_deg_s: Annotated[float, Field(ge=-90, le=90)] = 0.0
    heave_m: Annotated[float, Field(ge=0, le=3)] = 0.0  # amplitude
    heave_hz: Annotated[float, Field(ge=0, le=2)] = 0.2
    sway_m: Annotated[float, Field(ge=0, le=3)] = 0.0  # amplitude, to the pad's east
    sway_hz: Annotated[float, Field(ge=0, le=2)] = 0.2
    brake_mps2: Annotated[float, Field(ge=0, le=10)] = 0.0  # deceleration to a stop; 0: none
    brake_after_s: NotNegative = 10.0  # time from the start until it brakes
    tilt_deg: Annotated[float, Field(ge=0, le=30)] = 0.0
    tilt_azimuth_deg: Finite | None = 0.0  # direction of its slope, from pad north; null: by seed
    # size of markers and their distances, over that in the pad's file; the landing point stays
    print_scale: Annotated[float, Field(ge=0.8, le=1.2)] = 1.0
    marker_error_m: Annotated[float, Field(ge=0, le=0.2)] = 0.0  # of each marker, direction by seed
    # slope of the plate's part without the landing point, positive down, if the plate is folded
    # between its outermost markers; it is only seen: the vehicle's feet touch a flat pad
    bend_deg: Annotated[float, Field(ge=-15, le=15)] = 0.0
    black: Annotated[float, Field(ge=0.02, le=0.5)] | None = None  # over white; null: 0.12
    dirt: Annotated[float, Field(ge=0, le=0.6)] = 0.0  # share of the plate covered


class LinkOptions(Section):
    """The link between landerd and the autopilot; bytes keep their order."""

    delay_up_s: Annotated[float, Field(ge=0, le=1)] = 0.0  # from landerd to the autopilot
    delay_down_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    jitter_s: Annotated[float, Field(ge=0, le=0.5)] = 0.0  # longest extra delay, either way
    loss: Annotated[float, Field(ge=0, le=1)] = 0.0  # share of messages lost, either way
    baud: Annotated[float, Field(ge=9600)] | None = None  # null: bytes take no time


class AutopilotOptions(Section):
    """The simulated autopilot's clock, rates, radio and parameters."""

    timesync_delay_s: Annotated[float, Field(ge=0, le=1)] = 0.0  # extra delay of its answers
    telemetry_hz: Annotated[float, Field(gt=0, le=100)] | None = None  # highest rate; null: any
    boot_age_s: Annotated[float, Field(ge=0, lt=2**32)] = 60.0  # its time since boot at the start
    rc_channels: Annotated[int, Field(ge=4, le=18)] = 16  # number of the receiver's channels
    gate: Literal["radio", "override"] = "radio"  # how the pilot's switch reaches it
    # time from the report that the vehicle holds, as the pilot asked, until he lets it land; 0: he
    # does not ask for a hold. Needs rc.land_threshold_us
    hold_s: NotNegative = 0.0
    guid_timeout_s: Annotated[float, Field(ge=0.1, le=5)] = 3.0  # GUID_TIMEOUT


class ResponseOptions(Section):
    """How the vehicle follows ordered velocities, as measured on ArduCopter 4.5.7 in SITL."""

    delay_s: Annotated[float, Field(ge=0, le=0.5)] = 0.0  # from an order to the first reaction
    bandwidth: Annotated[float, Field(ge=0.3, le=3)] = 1.0  # of the inner loops, over the measured
    jerk_mps3: Annotated[float, Field(ge=1, le=50)] = 5.0  # PSC_JERK_XY and _Z
    acceleration_mps2: Annotated[float, Field(ge=0.5, le=10)] = 2.5  # WPNAV_ACCEL
    vertical_acceleration_mps2: Annotated[float, Field(ge=0.3, le=5)] = 1.0  # WPNAV_ACCEL_Z


class AirframeOptions(Section):
    """The airframe, in addition to `sim.vehicle`."""

    mass_kg: Annotated[float, Field(ge=0.3, le=30)] = 3.0
    angle_max_deg: Annotated[float, Field(ge=10, le=80)] | None = None  # null: that of the vehicle
    # share by which the ground raises the thrust of a standing vehicle; less with height
    ground_effect: Annotated[float, Field(ge=0, le=0.5)] = 0.0


class BuildOptions(Section):
    """True dimensions of the vehicle minus those of the configuration."""

    camera_offset_error_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)  # body frame
    gear_height_error_m: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0


class CompanionOptions(Section):
    """The computer that landerd runs on."""

    vision_factor: Annotated[float, Field(ge=0.1, le=20)] = 1.0  # on the time of searching a frame
    stall_s: Annotated[float, Field(ge=0, le=3)] = 0.0  # duration of a stall of the event loop
    stall_every_s: Annotated[float, Field(gt=0)] = 10.0  # mean time between stalls


class MountOptions(Section):
    """How the gimbal is really mounted, in the terms of the drivers' options."""

    yaw_sign: Literal[1, -1] = 1
    pitch_sign: Literal[1, -1] = 1
    yaw_zero_deg: Finite = 0.0
    pitch_zero_deg: Finite = 0.0
    camera_rotation_deg: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)  # roll, pitch, yaw


class SimGimbalOptions(Section):
    """The simulated gimbal."""

    lag_s: Annotated[float, Field(ge=0.02, le=0.5)] = 0.08  # behind a moving set-point
    rate_limit_deg_s: Positive = 120.0
    bias_deg: Annotated[float, Field(ge=0, le=10)] = 0.5  # of reported angles; sign by seed
    pitch_bias_deg: Annotated[float, Field(ge=0, le=10)] | None = None  # of pitch; null: bias_deg
    noise_deg: NotNegative = 0.05  # sd of reported angles
    scale_error: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0  # of reported angles, relative
    backlash_deg: Annotated[float, Field(ge=0, le=5)] = 0.0  # play of the gears to the encoders
    mount: MountOptions = MountOptions()
    pitch_feedback: bool = True  # false: a servo without an encoder, which reports its set-point


class RenderOptions(Section):
    """Light, lens, sensor and surroundings of the simulated camera."""

    model_config = ConfigDict(allow_inf_nan=False)

    noise_sigma: Annotated[float, Field(ge=0, le=30)] = 3.0  # grey levels
    defocus_px: Annotated[float, Field(ge=0, le=5)] = 0.6  # sigma of the blur
    illumination: Annotated[float, Field(gt=0, le=5)] = 1.0  # white saturates above 1.27
    gradient: Share = 0.1  # relative change of light from the image's centre to its side
    ground: Ground = "grass"  # a kind, or the file of a photograph taken straight down
    ground_m: Annotated[float, Field(ge=0.5, le=2000)] = 20.0  # longer side of a photograph
    look_alikes: Annotated[int, Field(ge=0, le=30)] = 0  # number of things that look like markers
    wet: Share = 0.0  # share of ground and pad that is wet
    ground_down_m: float = 0.0  # of the ground, local NED
    sun_elevation_deg: Annotated[float, Field(ge=5, le=90)] = 55.0
    sun_azimuth_deg: float = 120.0  # direction to the sun, clockwise from north
    shadow_darkness: Share = 0.6  # the sun's share of the light
    vehicle_shadow: bool = True  # whether the vehicle's shadow is drawn
    legs: bool = True  # whether the vehicle's legs are drawn
    shadow_edge: bool = False  # whether something tall shades one side of the pad
    shadow_edge_m: float = 0.0  # distance of that shadow's edge from the landing point
    shadow_edge_heading_deg: float = 90.0  # direction from the pad's north of the shaded side
    shadow_softness_m: Annotated[float, Field(ge=0, le=5)] = 0.02  # sd of its penumbra
    leaf_shade: Annotated[float, Field(ge=0, le=0.9)] = 0.0  # share of the light lost under leaves
    leaf_m: Annotated[float, Field(ge=0.05, le=5)] = 0.2  # size of flecks of their shade
    glare: Share = 0.0  # reflection of a lamp or the sun on the print, share of full scale


class EkfOptions(Section):
    """Errors of the autopilot's own estimate."""

    delay_s: Annotated[float, Field(ge=0, le=0.1)] = 0.008
    position_noise_m: NotNegative = 0.002
    velocity_noise_mps: NotNegative = 0.002
    velocity_bias_mps: tuple[NotNegative, NotNegative] = (0.01, 0.03)  # least, largest magnitude
    attitude_noise_deg: NotNegative = 0.02
    position_wander_m_per_min: NotNegative = 0.0  # horizontal; standard deviation after a minute
    position_jump_m: NotNegative = 0.0  # horizontal; length of the largest jump
    jump_every_s: Positive = 20.0  # mean time between jumps
    vertical_bias_mps: Annotated[float, Field(ge=-1, le=1)] = 0.0  # of the downward velocity
    heading_error_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0  # at the start
    heading_drift_deg_per_min: Annotated[float, Field(ge=-30, le=30)] = 0.0
    # largest relative error of the height over the local origin
    height_scale_max: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.05


class SimOptions(Section):
    """The whole simulated world."""

    # modelled: no picture is drawn; sightings are made from the truth with random errors
    sight: Literal["pictures", "modelled"] = "pictures"
    vehicle: Literal["reference", "fast"] = "reference"
    yaw_response: Literal["measured", "damped"] = "measured"
    start: StartOptions = StartOptions()
    wind: WindOptions = WindOptions()
    pad: PadOptions = PadOptions()
    gimbal: SimGimbalOptions = SimGimbalOptions()
    camera: SimCameraOptions = SimCameraOptions()
    ekf: EkfOptions = EkfOptions()
    link: LinkOptions = LinkOptions()
    autopilot: AutopilotOptions = AutopilotOptions()
    response: ResponseOptions = ResponseOptions()
    airframe: AirframeOptions = AirframeOptions()
    build: BuildOptions = BuildOptions()
    companion: CompanionOptions = CompanionOptions()
    # once: he only opens the gate; obeys: he also moves the switch when landerd asks him to
    pilot: Literal["once", "obeys"] = "once"
    faults: tuple[FaultOptions, ...] = ()
    render: RenderOptions = RenderOptions()
