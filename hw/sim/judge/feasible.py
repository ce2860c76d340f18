"""Whether any vehicle could land in a drawn world at all; told before the flight."""

import math

from hw.sim.options import PadOptions, SimOptions, WindOptions
from hw.sim.physics.contact import GRAVITY
from hw.sim.physics.land_detector import LandDetector
from hw.sim.physics.vehicle import DRAG_1, DRAG_2, vehicle_model
from landerd.geometry import angle_between, matmul, rot_y, rot_z, rotate, unit

RESERVE_MPS2 = 0.8  # of the push that leaning gives: for what steers and brakes relative to the pad
TURBULENCE_SIGMAS = 2.0  # of turbulence that must be held against
THESIS_WIND_MPS = 4.4  # 1.4 m/s, a sine of 1 m/s and noise of 1 m/s, at two sigmas
THESIS_STEADY_MPS = 1.4  # of it
# Where a vehicle in steady air hangs farther than this off the plate's normal, no gear holds it:
# half lifted by the thrust it steers with it slides (26 degrees on), and tips over once that is
# gone (30 degrees on; docs/safety.md, what cannot be kept). Flown on 77 days without landerd's own
# refusal (footprint.MAX_LEAN): of 24 to 27 degrees 42 of 52 stood, of 27 to 31 10 of 25.
TIPS_AT = math.radians(27.0)
# A deck's vertical acceleration against the vehicle's: half is for braking the descent
# (docs/how-it-lands.md, "Heaving decks").
HEAVE_SHARE = 0.5


def infeasible(options: SimOptions) -> str | None:
    """Return why the vehicle cannot follow the pad in this wind; None if it can."""
    pad, response = options.pad, options.response
    curving = pad.speed_mps * math.radians(abs(pad.turn_rate_deg_s))
    swaying = _harmonic_acceleration(pad.sway_m, pad.sway_hz)
    level = max(curving, pad.brake_mps2 if pad.speed_mps else 0.0) + swaying
    if level > response.acceleration_mps2:
        return f"the pad accelerates by {level:.1f} m/s2, the vehicle by no more than " + (
            f"{response.acceleration_mps2:.1f}"
        )
    if curving > LandDetector.STATIONARY_MPS2:
        return f"the pad turns with {curving:.1f} m/s2: no autopilot takes that for standing"
    model = vehicle_model(options.vehicle, options.airframe, response)
    airspeed = _airspeed(options)
    drag = _drag(model.drag, airspeed)
    push = GRAVITY * math.tan(model.angle_max)
    if drag + level + RESERVE_MPS2 > push:
        return f"airspeed of {airspeed:.1f} m/s takes more lean than the vehicle has"
    lean = _lean(options, model.drag)
    if lean > TIPS_AT:
        return f"it leans by {math.degrees(lean):.0f} degrees to the pad: it cannot stand there"
    heave = _harmonic_acceleration(pad.heave_m, pad.heave_hz)
    if heave > HEAVE_SHARE * response.vertical_acceleration_mps2:
        return f"the deck heaves with {heave:.1f} m/s2, more than can be followed"
    return None


def _drag(factor: float, airspeed: float) -> float:
    return factor * (DRAG_1 + DRAG_2 * airspeed) * airspeed  # m/s2


def _airspeed(options: SimOptions) -> float:
    """Return the largest airspeed of a vehicle that keeps pace with the pad, m/s."""
    wind, pad = options.wind, options.pad
    if wind.model == "thesis":
        return pad.speed_mps + THESIS_WIND_MPS
    unsteady = wind.gust_mps + TURBULENCE_SIGMAS * wind.turbulence_mps
    if wind.from_deg is None or pad.turn_rate_deg_s:
        return pad.speed_mps + wind.speed_mps + unsteady
    return math.hypot(*_steady_air(pad, wind, wind.from_deg)) + unsteady


def _lean(options: SimOptions, drag: float) -> float:
    """Return how far off the plate's normal it hangs all the time, without gusts, rad.

    Where it is not known which way it leans or the plate slopes, as far as it does at least: a pad
    that turns may turn out of the wind, and slope the other way.
    """
    wind, pad = options.wind, options.pad
    if wind.model == "thesis":
        least_mps, most_mps = pad.speed_mps - THESIS_WIND_MPS, pad.speed_mps + THESIS_STEADY_MPS
        return _least_lean(drag, max(0.0, least_mps), most_mps, pad)
    if wind.from_deg is None or pad.turn_rate_deg_s:
        least_mps, most_mps = abs(pad.speed_mps - wind.speed_mps), pad.speed_mps + wind.speed_mps
        return _least_lean(drag, least_mps, most_mps, pad)
    north, east = _steady_air(pad, wind, wind.from_deg)
    airspeed = math.hypot(north, east)
    if pad.tilt_azimuth_deg is None:
        return _least_lean(drag, airspeed, airspeed, pad)
    pull = drag * (DRAG_1 + DRAG_2 * airspeed)  # of the air, per m/s of it, 1/s
    down = unit((pull * north, pull * east, GRAVITY))
    downhill = math.radians(pad.heading_deg + pad.tilt_azimuth_deg)
    R = matmul(rot_z(downhill), rot_y(-math.radians(pad.tilt_deg)))
    return angle_between(down, rotate(R, (0.0, 0.0, 1.0)))


def _least_lean(drag: float, least_mps: float, most_mps: float, pad: PadOptions) -> float:
    """Return the least angle between airframe and plate in air of these speeds, m/s, rad."""
    least, most = (math.atan(_drag(drag, speed) / GRAVITY) for speed in (least_mps, most_mps))
    tilt = math.radians(pad.tilt_deg)
    return max(least - tilt, tilt - most, 0.0)


def _steady_air(pad: PadOptions, wind: WindOptions, from_deg: float) -> tuple[float, float]:
    """Return the air's velocity against a vehicle that goes with the pad, north and east, m/s."""
    course, source = math.radians(pad.course_deg), math.radians(from_deg)
    return (
        -wind.speed_mps * math.cos(source) - pad.speed_mps * math.cos(course),
        -wind.speed_mps * math.sin(source) - pad.speed_mps * math.sin(course),
    )


def _harmonic_acceleration(amplitude_m: float, hz: float) -> float:
    return amplitude_m * (2.0 * math.pi * hz) ** 2
