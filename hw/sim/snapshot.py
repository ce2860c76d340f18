"""The true state of the simulated world at one instant, as the camera and the scorer see it."""

from dataclasses import dataclass

from landerd.geometry import Mat3, Vec3


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Where the lens is and how it looks."""

    position: Vec3  # of the lens, local NED, m
    R_local_camera: Mat3


@dataclass(frozen=True, slots=True)
class PadPose:
    """Where the pad lies."""

    position: Vec3  # of the landing point, local NED, m
    R_local_pad: Mat3


@dataclass(frozen=True, slots=True)
class VehiclePose:
    """Where the airframe is, and the geometry of its landing gear."""

    position: Vec3  # of the body frame's origin, local NED, m
    R_local_body: Mat3
    footprint_m: tuple[float, float]  # between the feet: along body x, along body y
    gear_height_m: float  # from the body frame's origin down to the feet


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The world at one time."""

    t: float  # on the event loop's clock, s
    camera: CameraPose
    pad: PadPose
    vehicle: VehiclePose
