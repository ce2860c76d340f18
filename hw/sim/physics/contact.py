"""The landing gear on pad or ground: four feet, each a damped spring with friction.

All forces are per kilogram of vehicle, so its mass does not appear.
"""

import math
from dataclasses import dataclass

from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.response import STEP_S
from landerd.geometry import Mat3, Vec3, add, cross, dot, norm, rotate, scale, sub
from landerd.pad import Plate

GRAVITY = 9.80665
# Squared radii of gyration: 3 kg with 0.04 kg m^2 about roll and pitch, 0.07 about yaw.
GYRATION_SQUARED = (0.04 / 3.0, 0.04 / 3.0, 0.07 / 3.0)

_DEFLECTION_M = 0.003  # of the feet under the whole weight
_STIFFNESS = GRAVITY / 4.0 / _DEFLECTION_M  # of one foot, (m/s^2)/m
_DAMPING = 12.0  # of one foot, (m/s^2)/(m/s): rebounds with about a quarter of the speed
_FRICTION = 1.0  # rubber on the plate; the thesis's pad (2.3.5) does not let feet slip
_PLATE_DEPTH_M = 0.3  # a foot deeper below the plate's top than this is under the pad, not on it

_DOWN: Vec3 = (0.0, 0.0, 1.0)


@dataclass(slots=True)
class Reaction:
    """What one step of contact does to the vehicle."""

    feet: tuple[bool, bool, bool, bool]  # front left, front right, rear left, rear right
    on_pad: bool  # all touching feet stand on the plate
    velocity_change: Vec3  # local, m/s
    rate_change: Vec3  # of the angular velocity, local, rad/s
    surface_velocity: Vec3  # of what the feet touch, local, m/s


@dataclass(slots=True)
class _Press:
    """Sum of the spring forces of the touching feet, per kilogram of vehicle."""

    feet: tuple[bool, bool, bool, bool]
    on_pad: bool
    load: float  # along the normal, m/s^2
    force: Vec3  # local, m/s^2
    torque: Vec3  # about the body's origin, local, m^2/s^2
    centre: Vec3  # of the touching feet, from the body's origin, local, m
    normal: Vec3  # of what they touch, into it
    surface_velocity: Vec3  # of the same, local, m/s


def feet_of(footprint_m: tuple[float, float], gear_height_m: float) -> tuple[Vec3, ...]:
    """Return where the feet are: front left, front right, rear left, rear right; body, m."""
    x, y, z = 0.5 * footprint_m[0], 0.5 * footprint_m[1], gear_height_m
    return ((x, -y, z), (x, y, z), (-x, -y, z), (-x, y, z))


class LandingGear:
    """Four feet at the corners of the footprint."""

    def __init__(
        self, footprint_m: tuple[float, float], gear_height_m: float, plate: Plate
    ) -> None:
        self._feet = feet_of(footprint_m, gear_height_m)
        self._plate = plate
        self._grip_radius = math.hypot(*self._feet[0][:2])

    def react(
        self, position: Vec3, velocity: Vec3, R_local_body: Mat3, rates: Vec3, pad: PadState
    ) -> Reaction | None:
        """Return what the feet do in one STEP_S, or None if none touches.

        Args:
            position: of the body frame's origin, local NED, m
            velocity: of the same, m/s
            R_local_body: attitude
            rates: angular velocity, local, rad/s
            pad: pose and motion of the pad
        """
        press = self._press(position, velocity, R_local_body, rates, pad)
        if press is None:
            return None
        dv, dw = scale(press.force, STEP_S), _angular(scale(press.torque, STEP_S))
        grip = _FRICTION * press.load * STEP_S
        rub = _friction(press, grip, add(velocity, dv), add(rates, dw))
        if rub is not None:
            dv, dw = add(dv, rub), add(dw, _angular(cross(press.centre, rub)))
        if press.feet.count(True) > 1:
            spin = rates[2] + dw[2] - (pad.turn_rate if press.on_pad else 0.0)
            most = grip * self._grip_radius / GYRATION_SQUARED[2]
            dw = (dw[0], dw[1], dw[2] - max(-most, min(most, spin)))
        return Reaction(press.feet, press.on_pad, dv, dw, press.surface_velocity)

    def _press(
        self, position: Vec3, velocity: Vec3, R_local_body: Mat3, rates: Vec3, pad: PadState
    ) -> _Press | None:
        """Return what the springs do, or None if no foot touches. Arguments as of `react`."""
        touching = [False, False, False, False]
        on_pad = True
        force = torque = centre = normal = surface = (0.0, 0.0, 0.0)
        load = 0.0
        for i, foot in enumerate(self._feet):
            arm = rotate(R_local_body, foot)
            point = add(position, arm)
            depth, foot_normal, foot_surface, is_pad = self._surface(point, pad)
            if depth <= 0.0:
                continue
            touching[i] = True
            on_pad = on_pad and is_pad
            speed = dot(foot_normal, sub(add(velocity, cross(rates, arm)), foot_surface))
            push = max(0.0, _STIFFNESS * depth + _DAMPING * speed)
            foot_force = scale(foot_normal, -push)
            load += push
            force = add(force, foot_force)
            torque = add(torque, cross(arm, foot_force))
            centre = add(centre, arm)
            normal = add(normal, foot_normal)
            surface = add(surface, foot_surface)
        if not any(touching):
            return None
        share = 1.0 / touching.count(True)
        return _Press(
            (touching[0], touching[1], touching[2], touching[3]),
            on_pad,
            load,
            force,
            torque,
            scale(centre, share),
            scale(normal, 1.0 / norm(normal)),
            scale(surface, share),
        )

    def _surface(self, point: Vec3, pad: PadState) -> tuple[float, Vec3, Vec3, bool]:
        """Return depth below the surface (m), its normal (into it), velocity, and if it is pad."""
        x, y, z = pad.in_pad(point)
        if z < _PLATE_DEPTH_M and self._plate.holds(x, y):
            R = pad.R_local_pad
            return z, (R[0][2], R[1][2], R[2][2]), pad.velocity_at(point), True
        return point[2], _DOWN, (0.0, 0.0, 0.0), False


def _friction(press: _Press, grip: float, velocity: Vec3, rates: Vec3) -> Vec3 | None:
    """Return the impulse per mass (m/s) at the feet's centre that stops their slip; None: no slip.

    Args:
        press: spring forces of the touching feet.
        grip: largest impulse that friction allows under the load, m/s.
        velocity: of the body's origin, after the springs' impulse, local, m/s.
        rates: angular velocity, after the springs' impulse, local, rad/s.
    """
    slip = sub(add(velocity, cross(rates, press.centre)), press.surface_velocity)
    slip = sub(slip, scale(press.normal, dot(press.normal, slip)))
    slip_speed = norm(slip)
    if slip_speed > 0.0:
        arm_height = dot(press.normal, press.centre)
        stop = slip_speed / (1.0 + arm_height * arm_height / GYRATION_SQUARED[0])
        return scale(slip, -min(stop, grip) / slip_speed)
    return None


def _angular(impulse: Vec3) -> Vec3:
    """Return the change of angular velocity by an angular impulse per kilogram.

    Roll and pitch inertia are alike, and the vehicle is near level while it touches, so local
    axes serve.
    """
    return (
        impulse[0] / GYRATION_SQUARED[0],
        impulse[1] / GYRATION_SQUARED[1],
        impulse[2] / GYRATION_SQUARED[2],
    )
