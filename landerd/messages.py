"""The messages between devices, vision and the core.

SI units and radians. Every message carries the time of exposure or measurement on the event
loop's clock, never that of arrival. All are immutable; vectors are plain tuples of floats so that
the core below vision gives the same bits on every machine.
"""

from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from landerd.geometry import Mat3, Vec3

# ---- from the camera ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Frame:
    """One grey image."""

    t: float  # middle of the exposure, s
    seq: int  # counts up by one a frame at the source; a gap is a lost frame
    image: NDArray[np.uint8]  # (height, width)
    sigma_t: float = 0.0  # of t as far as the camera's driver knows it, 1 sigma, s


# ---- between the core and vision ---------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PadPrior:
    """Where the estimate expects the pad at a frame's exposure, camera frame."""

    position: Vec3  # landing point, m
    sigma_m: float  # 1 sigma of the position, largest direction, m
    north: Vec3 | None  # unit vector to the pad's north, None if the heading is not known
    normal: Vec3 | None = None  # unit vector into the pad; None: along gravity


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known before a frame is searched. Every field may be missing."""

    down: Vec3 | None = None  # unit vector of gravity, camera frame
    pad: PadPrior | None = None
    maybe: PadPrior | None = None  # of one seen lately, but not often enough to be believed in


# ---- from vision -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SystematicError:
    """The part of a pose's uncertainty that is alike in all frames: print, placing, bend, lens."""

    covariance: Mat3  # of position, m^2
    sigma_yaw: float  # rad
    sigma_tilt: float  # rad


@dataclass(frozen=True, slots=True)
class PoseSolution:
    """One pose of a marker or of the pad that explains the image, camera frame.

    A pad's uncertainty is all there is, and tells how much of it is systematic; a marker's is that
    of the picture, the marker taken to be as the pad file has it.
    """

    position: Vec3  # the marker's centre or the pad's landing point, m
    normal: Vec3  # unit vector into the pad (its z), away from the camera
    # Unit vector to the marker's or pad's north (its x); of a plain ring to the pad's, where its
    # plate shows it; None: unknown.
    north: Vec3 | None
    covariance: Mat3  # of position, m^2
    sigma_yaw: float | None  # of the rotation about the normal, rad; None without north
    sigma_tilt: float  # of the normal, rad
    cost: float  # chi-square of the fit; of two solutions the lower is the likelier
    systematic: SystematicError | None = None  # part of the above; None: none


# What a `MarkerSighting` was fitted to.
GREY, EDGES, BESIDE, PLATE = "grey", "edges", "beside", "plate"


@dataclass(frozen=True, slots=True)
class MarkerSighting:
    """One marker found in one frame."""

    kind: str  # "whycon", "whycode", "apriltag" or "aruco"
    id: int | None  # None for plain rings
    solutions: tuple[PoseSolution, ...]  # of the marker, best first; one or two
    outline_px: tuple[tuple[float, float], ...]  # polygon in image pixels, for drawing
    # What the pose was fitted to: "grey" levels, or the places of "edges" alone where a tone curve,
    # clipped white, shade or dirt leaves the levels unexplained: less exact, and sigma says so.
    # A square's "beside": only its heading was found, round a ring that tells the place. A ring's
    # "plate": its plate's sides tell the place, on level ground.
    stage: str = GREY


CLIPPED_LEVEL = 248.0  # from here on a grey level says only that it is too bright


@dataclass(frozen=True, slots=True)
class Light:
    """How bright a frame shows what its exposure goes by, grey levels from 0 to 255."""

    level: float  # of the pad's white, or of the ordinary on the ground
    on_pad: bool
    clipped: float = 0.0  # share of the ground from `CLIPPED_LEVEL` on; of a pad not told


@dataclass(frozen=True, slots=True)
class Sightings:
    """All that one frame shows of the pad."""

    t: float  # exposure time of the frame, s
    seq: int
    markers: tuple[MarkerSighting, ...]
    pad: tuple[PoseSolution, ...]  # of the landing point from all markers, best first; 0 to 2
    light: Light | None = None  # None: nobody exposes by it
    sigma_t: float = 0.0  # the frame's
    arrived_t: float | None = None  # when the camera gave the frame, s; None: not told
    other_id: int | None = None  # of a tag beside a ring of the pad's kind: another pad, left out
    # Only rings show it whose plate is not in view enough to tell it from another one.
    may_be_another: bool = False


# ---- from the autopilot ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The autopilot lives, and says how it flies."""

    t: float
    armed: bool
    guided: bool
    mode: str  # ArduCopter's name of the mode, as "GUIDED"


@dataclass(frozen=True, slots=True)
class AutopilotRestarted:
    """The autopilot's boot time went back."""

    t: float


@dataclass(frozen=True, slots=True)
class ClockSync:
    """How well the autopilot's clock is known: its data are older than they seem by as much."""

    t: float
    uncertainty_s: float  # half the round trip of the exchange, and what the filter adds


@dataclass(frozen=True, slots=True)
class Attitude:
    """Attitude of the body in local NED, rad and rad/s."""

    t: float
    roll: float
    pitch: float
    yaw: float
    rates: Vec3  # body rates


@dataclass(frozen=True, slots=True)
class LocalPosition:
    """Position (m) and velocity (m/s) in local NED."""

    t: float
    position: Vec3
    velocity: Vec3


@dataclass(frozen=True, slots=True)
class RcChannels:
    """Pulse widths of the receiver's channels, us; index 0 is channel 1; 0 is no signal."""

    t: float
    channels_us: tuple[int, ...]


class Landed(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


@dataclass(frozen=True, slots=True)
class LandedState:
    """What the autopilot's land detector says."""

    t: float
    state: Landed


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A number of the configuration has changed, and was found good.

    The ground station has changed it, or the autopilot told what is its own (GUID_TIMEOUT).
    """

    t: float
    key: str  # dotted, as "guidance.pid.up.kp"
    value: float


@dataclass(frozen=True, slots=True)
class Battery:
    """Battery as the autopilot measures it; None: not reported."""

    t: float
    voltage_v: float | None
    energy_consumed_j: float | None


# ---- from the gimbal ---------------------------------------------------------------------------


class Reference(Enum):
    """What a gimbal's angles are measured against."""

    BODY = "body"  # servo gimbals: the airframe
    HORIZON = "horizon"  # stabilised gimbals: gravity for pitch and roll, the airframe for yaw
    # servos with a sensor on the camera: gravity for pitch, the airframe for the rest
    TILT = "tilt"


@dataclass(frozen=True, slots=True)
class GimbalState:
    """Measured or modelled gimbal angles, rad: yaw right, pitch up (-pi/2 is down), roll right.

    Turned in the order of most gimbals' axes, Rz(yaw) Rx(roll) Ry(pitch): straight down, too, a
    roll is a small angle of its own.
    """

    t: float
    yaw: float
    pitch: float
    roll: float
    reference: Reference
    pitch_measured: bool = True  # False: a servo without feedback, pitch is what was ordered
    yaw_measured: bool = True  # the same of yaw
    from_autopilot: bool = False  # over its link, half whose round trip counts as age


# ---- the clock's ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Tick:
    """The control period has passed."""

    t: float


@dataclass(frozen=True, slots=True)
class Shutdown:
    """landerd is about to end: stop the vehicle and let go."""

    t: float


# ---- commands from the core --------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Velocity and yaw rate to fly from now on."""

    velocity: Vec3  # local NED, m/s
    yaw_rate: float  # rad/s, positive right


@dataclass(frozen=True, slots=True)
class GimbalCommand:
    """Angles for the gimbal to take, rad, measured as its GimbalState is."""

    yaw: float
    pitch: float


@dataclass(frozen=True, slots=True)
class ExposureOrder:
    """How the camera is to expose from now on; it takes what is nearest of what it can."""

    time_s: float
    gain: float  # 1: the sensor's own, without amplification


class Severity(IntEnum):
    """MAV_SEVERITY, the part used."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFO = 6


@dataclass(frozen=True, slots=True)
class StatusText:
    """A line for the pilot, at most 50 characters."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class LandingTarget:
    """Where the pad is, for the autopilot's own precision landing."""

    t: float  # exposure of the picture, s
    position: Vec3  # landing point from the autopilot's position, body frame, m


@dataclass(frozen=True, slots=True)
class PressDown:
    """Stand level on the pad without thrust: asks for no tilt, as a velocity in wind would."""

    heading: float  # to keep, local, rad


@dataclass(frozen=True, slots=True)
class Disarm:
    """Stop the motors by the ordinary command, never forced."""


class Phase(Enum):
    """Landing phases, named as in the thesis's Table 2.1: what the pilot and the log see.

    LANDED is the thesis's word for committed to the touch-down: the vehicle is still in the air
    when the phase begins (below the commit height, 0.16 m), and stands on the pad when it ends.
    What landerd does meanwhile is told by guidance.states.
    """

    NOT_LANDING = "NOT_LANDING"
    APPROACH = "APPROACH"
    CLOSE_APPROACH = "CLOSE_APPROACH"
    YAW_CORRECTION = "YAW_CORRECTION"
    DESCENT = "DESCENT"
    LANDED = "LANDED"  # committed, then on the pad


@dataclass(frozen=True, slots=True)
class PhaseChange:
    """The core entered a phase; reason says why in plain words."""

    phase: Phase
    reason: str


AutopilotMessage = (
    Heartbeat
    | AutopilotRestarted
    | ClockSync
    | Attitude
    | LocalPosition
    | RcChannels
    | LandedState
    | Battery
    | ParameterChange
)
Input = AutopilotMessage | GimbalState | Sightings | Tick | Shutdown
Command = (
    Setpoint
    | PressDown
    | LandingTarget
    | GimbalCommand
    | ExposureOrder
    | StatusText
    | Disarm
    | PhaseChange
)
