"""The `sim:` section of the configuration: the simulated world. Nothing here depends on a seed."""

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
    bearings: Annotated[int, Field(ge=1, le=360)] = 1  # seeds start from so many sides in turn
    spread_m: NotNegative = 0.0  # each seed starts up to this far away north and east
    heading_spread_deg: Annotated[float, Field(ge=0, le=180)] = 0.0
    # behind a pad this fast or faster it starts on the pad's course and at its velocity, as a drone
    # that follows its truck; heading_deg then counts from the course
    follow_from_mps: NotNegative = 5.0
    follow_m: NotNegative = 15.0  # distance behind such a pad at the start
    overtake_mps: NotNegative = 0.0  # speed of the vehicle beyond that of such a pad


class WindOptions(Section):
    """The air."""

    model: Literal["steady", "thesis"] = "steady"  # thesis: 3.8, the other keys do nothing
    speed_mps: Annotated[float, Field(ge=0, le=40)] = 0.0
    from_deg: Finite | None = 0.0  # direction the mean wind comes from; null: by seed
    gust_mps: Annotated[float, Field(ge=0, le=20)] = 0.0
    gust_s: Annotated[float, Field(gt=0, le=60)] = 5.0  # how long one gust lasts
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
    brake_mps2: Annotated[float, Field(ge=0, le=10)] = 0.0  # deceleration to a stand; 0: none
    brake_after_s: NotNegative = 10.0  # when it begins to brake, from the start
    tilt_deg: Annotated[float, Field(ge=0, le=30)] = 0.0
    tilt_azimuth_deg: Finite | None = 0.0  # where it slopes down, from pad north; null: by seed
    # the true print's scale over the pad file's, of markers and their distances; the landing point
    # stays the file's
    print_scale: Annotated[float, Field(ge=0.8, le=1.2)] = 1.0
    marker_error_m: Annotated[float, Field(ge=0, le=0.2)] = 0.0  # of each marker, direction by seed
    # the plate is folded between its outermost markers: slope of the part without the landing
    # point, positive down. The vehicle's feet do not feel it
    bend_deg: Annotated[float, Field(ge=-15, le=15)] = 0.0
    black: Annotated[float, Field(ge=0.02, le=0.5)] | None = None  # share of white; null: 0.12
    dirt: Annotated[float, Field(ge=0, le=0.6)] = 0.0  # share of the plate covered


class LinkOptions(Section):
    """The link between landerd and the autopilot; bytes keep their order."""

    delay_up_s: Annotated[float, Field(ge=0, le=1)] = 0.0  # from landerd to the autopilot
    delay_down_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    jitter_s: Annotated[float, Field(ge=0, le=0.5)] = 0.0  # longest extra delay, either way
    loss: Annotated[float, Field(ge=0, le=1)] = 0.0  # share of messages lost, either way
    baud: Annotated[float, Field(ge=9600)] | None = None  # null: bytes take no time


class AutopilotOptions(Section):
    """The stand-in's clock, rates, radio and parameters."""

    timesync_delay_s: Annotated[float, Field(ge=0, le=1)] = 0.0  # extra delay of its answers
    telemetry_hz: Annotated[float, Field(gt=0, le=100)] | None = None  # highest rate; null: any
    boot_age_s: Annotated[float, Field(ge=0, lt=2**32)] = 60.0  # on its clock at the start
    rc_channels: Annotated[int, Field(ge=4, le=18)] = 16  # of the receiver
    gate: Literal["radio", "override"] = "radio"  # how the pilot's switch reaches it
    # the pilot asks to hold, and lets it land this long after he was told that it holds; 0: he does
    # not ask. Needs rc.land_threshold_us
    hold_s: NotNegative = 0.0
    guid_timeout_s: Annotated[float, Field(ge=0.1, le=5)] = 3.0  # GUID_TIMEOUT


class ResponseOptions(Section):
    """How the vehicle answers velocities; as measured of ArduCopter 4.5.7 in SITL."""

    delay_s: Annotated[float, Field(ge=0, le=0.5)] = 0.0  # before anything happens
    bandwidth: Annotated[float, Field(ge=0.3, le=3)] = 1.0  # of the inner loops, times measured
    jerk_mps3: Annotated[float, Field(ge=1, le=50)] = 5.0  # PSC_JERK_XY and _Z
    acceleration_mps2: Annotated[float, Field(ge=0.5, le=10)] = 2.5  # WPNAV_ACCEL
    vertical_acceleration_mps2: Annotated[float, Field(ge=0.3, le=5)] = 1.0  # WPNAV_ACCEL_Z


class AirframeOptions(Section):
    """What the vehicle is, on top of `vehicle`."""

    mass_kg: Annotated[float, Field(ge=0.3, le=30)] = 3.0
    angle_max_deg: Annotated[float, Field(ge=10, le=80)] | None = None  # null: the vehicle's
    # share by which the ground raises the thrust of a standing vehicle; it fades with the height
    ground_effect: Annotated[float, Field(ge=0, le=0.5)] = 0.0


class BuildOptions(Section):
    """Where things really are, minus where the configuration has them."""

    camera_offset_error_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)  # body
    gear_height_error_m: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0


class CompanionOptions(Section):
    """The computer that landerd runs on."""

    vision_factor: Annotated[float, Field(ge=0.1, le=20)] = 1.0  # on the time of a search
    stall_s: Annotated[float, Field(ge=0, le=3)] = 0.0  # how long the event loop stands still
    stall_every_s: Annotated[float, Field(gt=0)] = 10.0  # mean time between two stalls


class MountOptions(Section):
    """How the gimbal really is built in, in the terms of the drivers' options."""

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
    noise_deg: NotNegative = 0.05
    scale_error: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0  # of reported angles
    backlash_deg: Annotated[float, Field(ge=0, le=5)] = 0.0  # of the gears before the encoders
    mount: MountOptions = MountOptions()
    pitch_feedback: bool = True  # false: a servo without an encoder, which reports its set-point


class RenderOptions(Section):
    """Light, lens, sensor and surroundings of the simulated camera."""

    model_config = ConfigDict(allow_inf_nan=False)

    noise_sigma: Annotated[float, Field(ge=0, le=30)] = 3.0  # grey levels
    defocus_px: Annotated[float, Field(ge=0, le=5)] = 0.6  # sigma of the blur
    illumination: Annotated[float, Field(gt=0, le=5)] = 1.0  # white saturates above 1.27
    gradient: Share = 0.1  # of illumination, from the middle of the image to its side
    ground: Ground = "grass"  # a kind, or a photograph straight from above
    ground_m: Annotated[float, Field(ge=0.5, le=2000)] = 20.0  # longer side of a photograph
    look_alikes: Annotated[int, Field(ge=0, le=30)] = 0  # things like markers round the pad
    wet: Share = 0.0  # share of ground and pad
    ground_down_m: float = 0.0  # of the ground, local NED
    sun_elevation_deg: Annotated[float, Field(ge=5, le=90)] = 55.0
    sun_azimuth_deg: float = 120.0  # where the sun stands, clockwise from north
    shadow_darkness: Share = 0.6  # the sun's share of the light
    vehicle_shadow: bool = True
    legs: bool = True
    shadow_edge: bool = False  # something tall keeps the sun off one side of the pad
    shadow_edge_m: float = 0.0  # distance of that shadow's edge from the landing point
    shadow_edge_heading_deg: float = 90.0  # direction from the pad's north of the shaded side
    shadow_softness_m: Annotated[float, Field(ge=0, le=5)] = 0.02  # sd of its penumbra
    leaf_shade: Annotated[float, Field(ge=0, le=0.9)] = 0.0  # share of the light lost under leaves
    leaf_m: Annotated[float, Field(ge=0.05, le=5)] = 0.2  # size of flecks
    glare: Share = 0.0  # a lamp's or the sun's image on the print, against full scale


class EkfOptions(Section):
    """How the autopilot's own estimate differs from the truth."""

    delay_s: Annotated[float, Field(ge=0, le=0.1)] = 0.008
    position_noise_m: NotNegative = 0.002
    velocity_noise_mps: NotNegative = 0.002
    velocity_bias_mps: tuple[NotNegative, NotNegative] = (0.01, 0.03)  # magnitude, drawn in between
    attitude_noise_deg: NotNegative = 0.02
    position_wander_m_per_min: NotNegative = 0.0  # horizontal; standard deviation after a minute
    position_jump_m: NotNegative = 0.0  # horizontal; the longest of the jumps
    jump_every_s: Positive = 20.0  # mean time between two jumps
    vertical_bias_mps: Annotated[float, Field(ge=-1, le=1)] = 0.0  # of the downward velocity
    heading_error_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0  # at the start
    heading_drift_deg_per_min: Annotated[float, Field(ge=-30, le=30)] = 0.0
    height_scale_max: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.05  # barometer reads too high


class SimOptions(Section):
    """The whole simulated world."""

    # modelled: no picture is made; what vision would have seen is drawn from the truth
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
    # once: he opens the gate; obeys: he lowers and raises the switch where landerd asks for it, too
    pilot: Literal["once", "obeys"] = "once"
    faults: tuple[FaultOptions, ...] = ()
    render: RenderOptions = RenderOptions()
