"""Whether a vehicle could land on a day at all: from the drawn world alone, before it is flown."""

import math

from hw.sim.options import PadOptions, SimOptions, WindOptions
from hw.sim.physics.contact import GRAVITY
from hw.sim.physics.land_detector import LandDetector
from hw.sim.physics.vehicle import DRAG_1, DRAG_2, vehicle_model

RESERVE_MPS2 = 0.8  # of the push that leaning gives: for what steers and brakes relative to the pad
TURBULENCE_SIGMAS = 2.0  # of turbulence that must be held against
THESIS_WIND_MPS = 4.4  # 1.4 m/s, a sine of 1 m/s and noise of 1 m/s, at two sigmas
# A vehicle that leans farther than this against steady air tips over as its first foot levels it
# (docs/safety.md, what cannot be kept).
TIPS_AT = math.radians(31.0)
# A deck's vertical acceleration against the vehicle's: half is for braking the descent
# (docs/how-it-lands.md, heaving decks).
HEAVE_SHARE = 0.5


def infeasible(options: SimOptions) -> str | None:
    """Return why the vehicle cannot follow the pad in that air; None if it can."""
    pad, response = options.pad, options.response
    curving = pad.speed_mps * math.radians(abs(pad.turn_rate_deg_s))
    level = max(curving, pad.brake_mps2 if pad.speed_mps else 0.0)
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
    lean = math.atan(_drag(model.drag, _least_airspeed(options)) / GRAVITY)
    if lean > TIPS_AT:
        return f"it leans by {math.degrees(lean):.0f} degrees: the touch tips it over"
    heave = _heave_acceleration(pad)
    if heave > HEAVE_SHARE * response.vertical_acceleration_mps2:
        return f"the deck heaves with {heave:.1f} m/s2, more than can be followed"
    return None


def _drag(factor: float, airspeed: float) -> float:
    return factor * (DRAG_1 + DRAG_2 * airspeed) * airspeed  # m/s2


def _airspeed(options: SimOptions) -> float:
    """Return the most air that passes a vehicle that keeps pace with the pad, m/s."""
    wind, pad = options.wind, options.pad
    if wind.model == "thesis":
        return pad.speed_mps + THESIS_WIND_MPS
    unsteady = wind.gust_mps + TURBULENCE_SIGMAS * wind.turbulence_mps
    if wind.from_deg is None or pad.turn_rate_deg_s:
        return pad.speed_mps + wind.speed_mps + unsteady
    return _steady_airspeed(pad, wind, wind.from_deg) + unsteady


def _least_airspeed(options: SimOptions) -> float:
    """Return the air that passes it all the time, without gusts, m/s: a pad may turn out of it."""
    wind, pad = options.wind, options.pad
    if wind.model == "thesis":
        return max(0.0, pad.speed_mps - THESIS_WIND_MPS)
    if wind.from_deg is None or pad.turn_rate_deg_s:
        return abs(pad.speed_mps - wind.speed_mps)
    return _steady_airspeed(pad, wind, wind.from_deg)


def _steady_airspeed(pad: PadOptions, wind: WindOptions, from_deg: float) -> float:
    into = math.radians(pad.course_deg - from_deg)
    north = pad.speed_mps + wind.speed_mps * math.cos(into)
    return math.hypot(north, wind.speed_mps * math.sin(into))


def _heave_acceleration(pad: PadOptions) -> float:
    return pad.heave_m * (2.0 * math.pi * pad.heave_hz) ** 2
