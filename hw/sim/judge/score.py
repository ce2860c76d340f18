"""What a landing was worth, from the simulator's truth alone."""

import math
from dataclasses import dataclass

from hw.sim.physics.world import Airframe, World
from landerd.geometry import Vec3, add, horizontal, norm, rot_zyx, rotate, sub
from landerd.pad import Plate

STANDS_M = 0.01  # so close to the plate a foot stands on it: gusts take the load off some by turns
WITHIN_M = 18.0  # the thesis counts from the first sighting; it saw the pad from 18 m on


@dataclass(frozen=True, slots=True)
class Contact:
    """The first contact of a foot, relative to the pad."""

    t: float
    error_m: float  # landing point to centre of the feet, horizontal
    vertical_mps: float  # positive down
    horizontal_mps: float
    yaw_error: float  # rad
    on_plate: bool  # all four feet over the pad's plate


class Score:
    """Watches a world from its step hook; ask it when the flight is over."""

    def __init__(self, world: World, airframe: Airframe, plate: Plate) -> None:
        self._world = world
        x, y = 0.5 * airframe.footprint_m[0], 0.5 * airframe.footprint_m[1]
        self._feet: list[Vec3] = [(a, b, airframe.gear_height_m) for a in (x, -x) for b in (y, -y)]
        self._plate = plate
        self._energy_start_j = 0.0
        self.contact: Contact | None = None  # the last one after flight
        self.disarm_t: float | None = None
        self.first_sighting_t: float | None = None  # within 18 m slant range
        self.energy_j: float | None = None  # from that sighting to disarm
        world.on_step.append(self._on_step)

    def on_sighting(self, t: float) -> None:
        """A frame with a marker really in it was delivered, exposed at t."""
        world = self._world
        slant_m = norm(sub(world.pad.position, world.vehicle.position))
        if self.first_sighting_t is None and slant_m <= WITHIN_M:
            self.first_sighting_t = t
            self._energy_start_j = world.battery.energy_j

    @property
    def landed(self) -> bool:
        """All four feet on the pad's plate, motors off."""
        vehicle = self._world.vehicle
        return not vehicle.motors and any(vehicle.feet) and self._over_plate(STANDS_M)

    def _over_plate(self, at_most_m: float = math.inf) -> bool:
        """Tell whether all four feet are over the plate, none of them higher than this."""
        v, pad, plate = self._world.vehicle, self._world.pad, self._plate
        R = rot_zyx(v.yaw, v.pitch, v.roll)
        for foot in self._feet:
            x, y, down = pad.in_pad(add(v.position, rotate(R, foot)))
            if down < -at_most_m:
                return False
            if not (-plate.south_m <= x <= plate.north_m and -plate.west_m <= y <= plate.east_m):
                return False
        return True

    def _on_step(self, world: World) -> None:
        touchdown = world.vehicle.touchdown
        if touchdown is not None and (self.contact is None or touchdown.t > self.contact.t):
            self.contact = Contact(
                t=touchdown.t,
                error_m=math.hypot(*world.offset),
                vertical_mps=touchdown.velocity[2],
                horizontal_mps=horizontal(touchdown.velocity),
                yaw_error=world.heading_error,
                on_plate=self._over_plate(),
            )
        if self.contact is not None and not world.vehicle.motors and self.disarm_t is None:
            self.disarm_t = world.t
            self.energy_j = world.battery.energy_j - self._energy_start_j
