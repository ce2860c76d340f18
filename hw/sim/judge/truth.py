"""The simulated truth that the judge goes by, and the vehicle's feet on the plate."""

import math
from dataclasses import dataclass

from hw.sim.physics.contact import feet_of
from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.response import STEP_S
from hw.sim.physics.world import Airframe, World
from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    clamp,
    cross,
    horizontal,
    rot_zyx,
    rotate,
    scale,
    sub,
    transpose,
    wrap,
)
from landerd.pad import Plate

PLATE_M = 1.0  # distance from the landing point up to which the plate's tilt counts in heights
STANDS_M = 0.01  # height up to which a foot counts as standing: gusts unload feet by turns
_SLOWEST_SINK_MPS = 0.1  # least sink rate assumed in predicting where it will touch


@dataclass(frozen=True, slots=True)
class Truth:
    """What the rules need of the world, local NED."""

    t: float
    distance: float  # centre of the feet to the landing point, horizontal, m
    height: float  # of the feet's centre over the plate's plane, level beyond PLATE_M, m
    heading_error: float  # vehicle minus pad, rad
    yaw: float  # rad
    pad_velocity: Vec3  # of the plate where the feet's centre is over it, m/s
    feet_down: int
    slip: float = 0.0  # speed of the vehicle across the plate, m/s
    foot_slip: float = 0.0  # of its lowest foot, about which it may turn meanwhile, m/s
    misses: bool = False  # at its present velocity it will touch with a foot beside the plate
    on_plate: bool = False  # all four feet stand on the plate
    landing_point: Vec3 = (0.0, 0.0, 0.0)  # local, m
    velocity: Vec3 = (0.0, 0.0, 0.0)  # of the vehicle, m/s
    lean_m: float = 0.0  # how far the lowest foot is below the feet's centre, pad frame
    tilt: float = 0.0  # of the airframe from level, rad

    @property
    def pad_heading(self) -> float:
        """Heading of the pad, local, rad."""
        return self.yaw - self.heading_error


class Feet:
    """The four feet and the plate, in a world."""

    def __init__(self, world: World, airframe: Airframe, plate: Plate) -> None:
        self._arms = feet_of(airframe.footprint_m, airframe.gear_height_m)
        self._world = world
        self._plate = plate

    def over_plate(self, at_most_m: float = math.inf) -> bool:
        """Tell whether all four feet are over the plate, none of them higher than this, m."""
        vehicle = self._world.vehicle
        R = rot_zyx(vehicle.yaw, vehicle.pitch, vehicle.roll)
        return self._are_over(self._world.pad, R, vehicle.position, at_most_m)

    def _are_over(self, pad: PadState, R: Mat3, position: Vec3, at_most_m: float) -> bool:
        """Tell the same of a vehicle at this position, turned by R_local_body."""
        R_pad_local = transpose(pad.R_local_pad)
        for arm in self._arms:
            foot = sub(add(position, rotate(R, arm)), pad.position)
            x, y, down = rotate(R_pad_local, foot)
            if down < -at_most_m or not self._plate.holds(x, y):
                return False
        return True

    def touching_velocity(self) -> Vec3:
        """Return the velocity (local, m/s) of the lowest foot against the plate under it.

        That of one step ago: at first contact, before the foot's spring has acted. The rates of
        roll, pitch and yaw carry the foot too: it may be twice as fast as the vehicle.
        """
        world, pad = self._world, self._world.pad
        s = world.state_at(world.t - STEP_S)
        R = rot_zyx(s.yaw, s.pitch, s.roll)
        arms = [rotate(R, arm) for arm in self._arms]
        arm = max(arms, key=lambda a: pad.in_pad(add(s.position, a))[2])
        own = add(s.velocity, cross(rotate(R, s.rates), arm))
        return sub(own, pad.velocity_at(add(s.position, arm)))

    def truth(self) -> Truth:
        """Return what the rules need of the world as it is now."""
        world, vehicle = self._world, self._world.vehicle
        # Called at every order: common terms are computed once.
        pad, centre = world.pad, world.footprint_centre
        R = rot_zyx(vehicle.yaw, vehicle.pitch, vehicle.roll)
        surface = pad.velocity_at(centre)
        across = sub(vehicle.velocity, surface)
        north, east, down = sub(centre, pad.position)
        away = math.hypot(north, east)
        k = PLATE_M / max(away, PLATE_M)
        R_pad_local = transpose(pad.R_local_pad)
        height = -rotate(R_pad_local, (k * north, k * east, down))[2]
        aside = (rotate(R, (x, y, 0.0)) for x, y, _ in self._arms)
        touches_in_s = max(0.0, height) / max(_SLOWEST_SINK_MPS, across[2])
        ahead = scale((across[0], across[1], 0.0), touches_in_s)
        # A vehicle beside the plate does not slide because the pad drives on.
        on_ground = any(vehicle.feet) and not vehicle.on_pad
        slip = horizontal(vehicle.velocity if on_ground else across)
        return Truth(
            t=world.t,
            distance=away,
            height=height,
            heading_error=wrap(vehicle.yaw - pad.heading),
            yaw=vehicle.yaw,
            pad_velocity=surface,
            feet_down=sum(vehicle.feet),
            slip=slip,
            foot_slip=horizontal(self.touching_velocity()),
            misses=not self._are_over(pad, R, add(vehicle.position, ahead), math.inf),
            on_plate=self._are_over(pad, R, vehicle.position, STANDS_M),
            landing_point=pad.position,
            velocity=vehicle.velocity,
            lean_m=max(rotate(R_pad_local, arm)[2] for arm in aside),
            tilt=math.acos(clamp(R[2][2], -1.0, 1.0)),
        )
