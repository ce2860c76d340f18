"""The simulated multicopter: answers velocity and yaw-rate orders as a measured ArduCopter does.

In calm air it follows hw.sim.physics.response exactly. Against disturbances (wind, turbulence, feet
on the pad) it tilts by no more than ANGLE_MAX; stronger ones make it drift.
"""

import math
from dataclasses import dataclass
from random import Random
from typing import Literal

from hw.sim.options import AirframeOptions, ResponseOptions
from hw.sim.physics.contact import GRAVITY, GYRATION_SQUARED, LandingGear
from hw.sim.physics.ground_effect import GroundEffect
from hw.sim.physics.land_detector import LandDetector
from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.response import (
    MEASURED,
    STEP_S,
    DampedYawResponse,
    HorizontalResponse,
    MeasuredYawResponse,
    VerticalResponse,
    WindResponse,
    YawResponse,
)
from hw.sim.physics.wander import Wander
from landerd.geometry import Vec3, add, clamp, rot_zyx, sub, wrap

# Deceleration by the air is DRAG_1 v + DRAG_2 v^2: tilts of 11.5 degrees at 5 m/s of airspeed and
# 28.9 at 10 m/s as measured, and in between (8.5 at 4 m/s, 14.8 at 6 m/s).
DRAG_1, DRAG_2 = 0.257, 0.0284
REFERENCE_KG = 3.0  # mass of the measured model

# Lever arm from the centre of a 3 kg quadrocopter to the middle of the two rotors on one side, m;
# and the angular acceleration by the hover thrust, all of it on that side, rad/s^2.
_ROTOR_ARM_M = 0.2
_TURN_OF_HOVER = GRAVITY * _ROTOR_ARM_M / GYRATION_SQUARED[0]

_LEVEL = (0.0, 0.0)
_NO_FEET = (False, False, False, False)
_LEANS_AGAIN = 1e-3  # share of the lean still missing after a level attitude that is neglected


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """The properties in which airframes differ."""

    angle_max: float  # rad
    drag: float  # relative to the reference model's
    ground_effect: float = 0.0  # share of thrust that the ground adds to a standing vehicle
    response: ResponseOptions = MEASURED


MODELS: dict[Literal["reference", "fast"], VehicleModel] = {
    "reference": VehicleModel(math.radians(30.0), 1.0),
    # Tilts 30 degrees at 20 m/s, an ordinary 7-inch or hexacopter set-up.
    "fast": VehicleModel(
        math.radians(45.0),
        GRAVITY * math.tan(math.radians(30.0)) / (20.0 * DRAG_1 + 400.0 * DRAG_2),
    ),
}


def vehicle_model(
    name: Literal["reference", "fast"], airframe: AirframeOptions, response: ResponseOptions
) -> VehicleModel:
    """Return a named model with the options applied.

    Drag decelerates a light vehicle more: for geometrically similar ones area over mass is
    proportional to mass^(-1/3).
    """
    model = MODELS[name]
    lean = airframe.angle_max_deg
    return VehicleModel(
        model.angle_max if lean is None else math.radians(lean),
        model.drag * (REFERENCE_KG / airframe.mass_kg) ** (1.0 / 3.0),
        airframe.ground_effect,
        response,
    )


@dataclass(frozen=True, slots=True)
class Touchdown:
    """The first contact after flight."""

    t: float
    on_pad: bool  # all feet that touched were on the plate
    velocity: Vec3  # of the vehicle relative to the surface just before, local, m/s


class Vehicle:
    """Position, velocity and attitude in local NED, step by step.

    Attributes:
        ground_effect: model of the ground effect; None: there is none.
    """

    _VERTICAL_P = 5.0  # PSC_VELZ_P, 1/s
    _VERTICAL_I = 29.7  # takes the thrust away 0.95 s after contact at 0.3 m/s of descent, 1/s^2
    _ATTITUDE_OMEGA, _ATTITUDE_ZETA = 12.0, 0.7
    _YAW_P = 5.0  # 1/s
    _LEVELLING_S = 0.15  # ATC_INPUT_TC
    _ON_ITS_SIDE = math.radians(70.0)  # roll or pitch from which on it lies on its side

    def __init__(
        self,
        model: VehicleModel,
        yaw_response: Literal["measured", "damped"],
        gear: LandingGear,
        rng: Random,
    ) -> None:
        self._drag_factor = model.drag
        self._acceleration_max = GRAVITY * math.tan(model.angle_max)
        self._gear = gear
        self._wander = Wander(rng)
        self._horizontal = HorizontalResponse(model.response)
        self._vertical = VerticalResponse(model.response)
        self.ground_effect = GroundEffect(model.ground_effect) if model.ground_effect else None
        self._yaw_response: YawResponse = (
            MeasuredYawResponse() if yaw_response == "measured" else DampedYawResponse()
        )
        self._wind_n = self._wind_e = WindResponse(0.0)
        self._detector = LandDetector()

        self.position: Vec3 = (0.0, 0.0, 0.0)  # of the body frame's origin, m
        self.velocity: Vec3 = (0.0, 0.0, 0.0)  # m/s
        self.acceleration: Vec3 = (0.0, 0.0, 0.0)  # m/s^2
        self.roll = self.pitch = self.yaw = 0.0  # rad
        self.rates: Vec3 = (0.0, 0.0, 0.0)  # body, rad/s
        self.motors = True
        # Thrusts, in units of the hover thrust.
        self.thrust = 1.0  # its vertical part
        self._throttle = 1.0  # vertical part needed to climb or sink as ordered
        self._steering = 0.0  # part needed to steer
        self.load = 1.0  # the whole thrust
        self.feet = (False, False, False, False)  # front left, front right, rear left, rear right
        self.on_pad = False  # at least one foot touches, and all that touch stand on the plate
        self.touchdown: Touchdown | None = None

        self._velocity_order: Vec3 = (0.0, 0.0, 0.0)
        self._yaw_rate_order = 0.0
        self._level = self._landing = False
        self._tilt_limited = False  # the tilt is at ANGLE_MAX
        self._levelled = 0.0  # share of its lean that is missing since a level attitude was ordered
        self._integral = 0.0  # vertical controller's, which reduces thrust on the ground, m/s^2
        self._airborne = True  # has been well clear of any surface since the last touchdown
        # Roll and pitch are the ordered tilt plus an error caused by the feet and in free fall.
        self._tilt = (0.0, 0.0)  # ordered roll, pitch, rad
        self._error = (0.0, 0.0)  # roll, pitch, rad
        self._error_rate = (0.0, 0.0)  # rad/s
        self._yaw_error_rate = 0.0  # rad/s

    def start(
        self,
        position: Vec3,
        velocity: tuple[float, float],
        heading: float,
        wind: tuple[float, float],
    ) -> None:
        """Fly in trim: position (m), velocity and wind north and east (m/s), heading (rad)."""
        vn, ve = velocity
        self.position, self.velocity, self.yaw = position, (vn, ve, 0.0), heading
        self._velocity_order = self.velocity
        self._horizontal.settle(vn, ve)
        windy_n, windy_e = self._drag(vn - wind[0], ve - wind[1])
        calm_n, calm_e = self._drag(vn, ve)
        self._wind_n = WindResponse(windy_n - calm_n)
        self._wind_e = WindResponse(windy_e - calm_e)
        self._tilt = self.roll, self.pitch = self._tilt_for(windy_n, windy_e)

    def order(
        self, velocity: Vec3, yaw_rate: float, *, level: bool = False, landing: bool = False
    ) -> None:
        """Fly this velocity (local NED, m/s) and yaw rate (rad/s) from now on.

        Level: a level attitude, whatever the horizontal velocity. Landing: in LAND.

        After a detected landing it idles until a climb is ordered.
        """
        if velocity[2] < 0.0 and self.motors and self._detector.landed:
            self._detector.flying()
            self._fly_from_here()
        self._velocity_order = velocity
        self._yaw_rate_order = yaw_rate
        self._level, self._landing = level, landing

    def motors_off(self) -> None:
        """Stop the motors, in the air too."""
        if self.motors:
            self.motors = False
            self.thrust = 0.0
            self._tilt, self._error = (0.0, 0.0), (self.roll, self.pitch)
            self._yaw_error_rate += self._yaw_response.rate
            self._yaw_response.settle(0.0)

    def motors_on(self) -> None:
        """Start the motors; on the ground they idle."""
        if not self.motors:
            self.motors = True
            self._fly_from_here()
            self._integral = GRAVITY if any(self.feet) else 0.0

    def _fly_from_here(self) -> None:
        self._horizontal.settle(self.velocity[0], self.velocity[1])
        self._vertical.settle(self.velocity[2])
        self._yaw_response.settle(0.0)
        self._wind_n, self._wind_e = WindResponse(0.0), WindResponse(0.0)

    @property
    def landed_detected(self) -> bool:
        """Whether ArduCopter's land detector says that it stands on the ground."""
        return self._detector.landed

    def step(self, t: float, wind: tuple[float, float], pad: PadState | None) -> None:
        """Advance by STEP_S.

        Args:
            t: time at the end of the step, s
            wind: velocity of the air, north and east, m/s
            pad: None while the vehicle is too high to touch anything
        """
        vn, ve, vd = self.velocity
        feet_down = self.feet.count(True)
        disturbed = feet_down > 0 or self._error != _LEVEL or self._yaw_error_rate != 0.0
        tilt = self._tilt
        push_n = push_e = 0.0
        ad = GRAVITY
        if self.motors:
            self._wander.step()
            ad = self._fly_vertical(vd, feet_down)
            if self.ground_effect is not None and pad is not None:
                ad -= self.ground_effect.step(self.position, pad)
            push_n, push_e = self._fly_horizontal(vn, ve)
            self._yaw_response.step(self._yaw_rate_order)
            if disturbed:
                push_n, push_e = self._push_of_attitude()
        if disturbed:
            self._restore()

        drag_n, drag_e = self._drag(vn - wind[0], ve - wind[1])
        an, ae = push_n - drag_n, push_e - drag_e
        self.acceleration = (an, ae, ad)
        self.velocity = (vn + an * STEP_S, ve + ae * STEP_S, vd + ad * STEP_S)
        tilt_rates = self._tilt_rates(tilt, feet_down)
        if pad is not None:
            self._touch(t, tilt_rates, pad)
        else:
            self.feet, self.on_pad, self._airborne = _NO_FEET, False, True
            self._detector.flying()

        n, e, d = self.position
        vn, ve, vd = self.velocity
        self.position = (n + vn * STEP_S, e + ve * STEP_S, d + vd * STEP_S)
        self._turn_body(tilt_rates)

    def _fly_vertical(self, vd: float, feet_down: int) -> float:
        """Return the acceleration down (m/s^2) that the motors allow; sets the thrust."""
        if self._detector.landed:
            self.thrust = self._throttle = self._steering = 0.0
            return GRAVITY
        error = self._vertical.v + self._wander.velocity[2] - vd
        self._vertical.step(self._velocity_order[2])
        if feet_down or self._integral:
            self._integral = clamp(self._integral + self._VERTICAL_I * error * STEP_S, 0.0, GRAVITY)
        ad = min(
            GRAVITY,
            self._vertical.a
            + self._wander.acceleration[2]
            + self._VERTICAL_P * error
            + self._integral,
        )
        self._throttle = 1.0 - ad / GRAVITY
        self._steering = self._steering_thrust()
        self.thrust = max(
            self._throttle, self._steering * math.cos(self.roll) * math.cos(self.pitch)
        )
        return GRAVITY * (1.0 - self.thrust)

    def _steering_thrust(self) -> float:
        """Return the thrust needed to steer, however small the throttle; in hover thrusts.

        All of it is on one side. ArduCopter's mixer allows it up to the throttle mix. Measured in
        SITL: half of the hover thrust from contact on while a lean of 22 degrees against the wind
        was requested, and a tenth 0.15 s after a level attitude was requested.
        """
        if self._error == _LEVEL and self._error_rate == _LEVEL:
            return 0.0
        wanted = math.hypot(*self._turning()) / _TURN_OF_HOVER
        return min(wanted, self._detector.throttle_mix)

    def _turning(self) -> tuple[float, float]:
        """Return the roll and pitch accelerations wanted to remove the tilt's error, rad/s^2."""
        omega, zeta = self._ATTITUDE_OMEGA, self._ATTITUDE_ZETA
        (roll, pitch), (roll_rate, pitch_rate) = self._error, self._error_rate
        return (
            -omega * (omega * roll + 2.0 * zeta * roll_rate),
            -omega * (omega * pitch + 2.0 * zeta * pitch_rate),
        )

    def _fly_horizontal(self, vn: float, ve: float) -> tuple[float, float]:
        """Return the push of the tilted thrust, north and east, m/s^2; sets the tilt."""
        response = self._horizontal
        if self._level:
            # The velocity controllers are reset, for the next velocity order.
            self._level_out(vn, ve)
            return self._push_of_attitude()
        wander_n, wander_e, _ = self._wander.velocity
        # On the ground, too: a velocity order that it cannot follow winds the integrals up.
        self._wind_n.step(vn - response.vn - wander_n, self._tilt_limited)
        self._wind_e.step(ve - response.ve - wander_e, self._tilt_limited)
        drag_n, drag_e = self._drag(response.vn, response.ve)
        response.step(self._velocity_order[0], self._velocity_order[1])
        wander_n, wander_e, _ = self._wander.acceleration
        push_n = response.an + wander_n + drag_n + self._wind_n.a
        push_e = response.ae + wander_e + drag_e + self._wind_e.a
        push = math.hypot(push_n, push_e)
        self._tilt_limited = push > self._acceleration_max
        if self._tilt_limited:
            push_n *= self._acceleration_max / push
            push_e *= self._acceleration_max / push
        tilt = self._tilt_for(push_n, push_e)
        if self._levelled == 0.0:
            self._tilt = tilt
            return push_n, push_e
        # After a level attitude it leans again with the same time constant as it levelled.
        leans = 1.0 - self._levelled
        self._levelled *= 1.0 - STEP_S / self._LEVELLING_S
        if self._levelled < _LEANS_AGAIN:
            self._levelled = 0.0
        self._tilt = (leans * tilt[0], leans * tilt[1])
        return self._push_of_attitude()

    def _level_out(self, vn: float, ve: float) -> None:
        self._levelled = 1.0
        self._horizontal.settle(vn, ve)
        self._wind_n, self._wind_e = WindResponse(0.0), WindResponse(0.0)
        roll, pitch = self._tilt
        decay = 1.0 - STEP_S / self._LEVELLING_S
        self._tilt = (decay * roll, decay * pitch)

    def _tilt_for(self, push_n: float, push_e: float) -> tuple[float, float]:
        """Return roll and pitch that give this push, m/s^2, while the thrust carries the weight."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        forward = (c * push_n + s * push_e) / GRAVITY
        right = (c * push_e - s * push_n) / GRAVITY
        return math.atan(right / math.sqrt(1.0 + forward * forward)), -math.atan(forward)

    def _push_of_attitude(self) -> tuple[float, float]:
        """Return the thrust's horizontal acceleration in the present attitude, m/s^2, n and e."""
        up = GRAVITY * max(0.0, self.thrust)
        forward = -up * math.tan(self.pitch)
        right = up * math.tan(self.roll) / math.cos(self.pitch)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return c * forward - s * right, s * forward + c * right

    def _drag(self, vn: float, ve: float) -> tuple[float, float]:
        """Return the air's resistance to this airspeed, north and east, m/s^2, along it."""
        k = self._drag_factor * (DRAG_1 + DRAG_2 * math.hypot(vn, ve))
        return k * vn, k * ve

    def _restore(self) -> None:
        """Let the motors bring the body back to the ordered tilt, as far as their thrust can."""
        authority = 0.0
        (roll, pitch), (roll_rate, pitch_rate) = self._error, self._error_rate
        if self.motors and not self._detector.landed:
            x, y = self._turning()
            wanted = math.hypot(x, y)
            most = _TURN_OF_HOVER * max(0.0, self._throttle, self._steering)
            authority = 1.0 if wanted <= most else most / wanted
            roll_rate += authority * x * STEP_S
            pitch_rate += authority * y * STEP_S
        self._error_rate = (roll_rate, pitch_rate)
        self._error = (roll + roll_rate * STEP_S, pitch + pitch_rate * STEP_S)
        self._yaw_error_rate -= self._YAW_P * authority * self._yaw_error_rate * STEP_S
        if (
            not any(self.feet)
            and max(map(abs, (*self._error, *self._error_rate, self._yaw_error_rate))) < 1e-4
        ):
            self._error = self._error_rate = _LEVEL
            self._yaw_error_rate = 0.0

    def _touch(self, t: float, tilt_rates: tuple[float, float], pad: PadState) -> None:
        """Let the feet act on velocity and attitude."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        roll_rate = tilt_rates[0] + self._error_rate[0]
        pitch_rate = tilt_rates[1] + self._error_rate[1]
        rates = (
            c * roll_rate - s * pitch_rate,
            s * roll_rate + c * pitch_rate,
            self._yaw_response.rate + self._yaw_error_rate,
        )
        R_local_body = rot_zyx(self.yaw, self.pitch, self.roll)
        contact = self._gear.react(self.position, self.velocity, R_local_body, rates, pad)
        if contact is None:
            self.feet, self.on_pad = _NO_FEET, False
            return
        self.feet, self.on_pad = contact.feet, contact.on_pad
        if self._airborne:
            self._airborne = False
            relative = sub(self.velocity, contact.surface_velocity)
            self.touchdown = Touchdown(t, contact.on_pad, relative)
        self.velocity = add(self.velocity, contact.velocity_change)
        x, y, z = contact.rate_change
        self._error_rate = (
            self._error_rate[0] + c * x + s * y,
            self._error_rate[1] - s * x + c * y,
        )
        self._yaw_error_rate += z
        self._detector.step(
            self._throttle if self.motors else 0.0,
            descending=self._velocity_order[2] > 0.0 or not self.motors,
            landing=self._landing,
            tilt=math.hypot(*self._tilt) if self.motors else 0.0,
            velocity=self.velocity,
        )

    def _tilt_rates(self, before: tuple[float, float], feet_down: int) -> tuple[float, float]:
        """Return the roll and pitch rates at which a changed tilt order turns the body, rad/s.

        In the air the body follows the order at once. With a foot down the change becomes an error,
        which the motors reduce against the feet as far as their thrust allows.
        """
        roll, pitch = self._tilt[0] - before[0], self._tilt[1] - before[1]
        if not feet_down:
            return roll / STEP_S, pitch / STEP_S
        self._error = (self._error[0] - roll, self._error[1] - pitch)
        return _LEVEL

    def _turn_body(self, tilt_rates: tuple[float, float]) -> None:
        """Advance the attitude by one step."""
        self.roll = self._tilt[0] + self._error[0]
        self.pitch = self._tilt[1] + self._error[1]
        yaw_rate = self._yaw_response.rate + self._yaw_error_rate
        self.yaw = wrap(self.yaw + yaw_rate * STEP_S)
        if max(abs(self.roll), abs(self.pitch)) > self._ON_ITS_SIDE:
            self._error_rate = _LEVEL
        sr, cr = math.sin(self.roll), math.cos(self.roll)
        sp, cp = math.sin(self.pitch), math.cos(self.pitch)
        roll_rate = tilt_rates[0] + self._error_rate[0]
        pitch_rate = tilt_rates[1] + self._error_rate[1]
        self.load = self.thrust / (cr * cp)
        self.rates = (
            roll_rate - yaw_rate * sp,
            pitch_rate * cr + yaw_rate * sr * cp,
            yaw_rate * cr * cp - pitch_rate * sr,
        )
