"""What a landing was worth, from the simulator's truth alone."""

import math
from dataclasses import dataclass

from hw.sim.judge.truth import STANDS_M, Feet
from hw.sim.physics.world import World
from landerd.geometry import horizontal, norm, sub

WITHIN_M = 18.0  # the thesis counts from the first sighting; it saw the pad from 18 m on
CLEAR_M = 0.2  # height over the pad from which on a vehicle that touched has climbed away


@dataclass(frozen=True, slots=True)
class Contact:
    """The first contact of a foot in the flight, relative to the plate under that foot."""

    t: float
    error_m: float  # landing point to centre of the feet, horizontal
    vertical_mps: float  # of that foot, positive down
    horizontal_mps: float
    yaw_error: float  # rad
    on_plate: bool  # all four feet over the pad's plate


class Score:
    """Watches a world from its step hook; ask it when the flight is over.

    Attributes:
        contact: the first one of the flight.
        touch_and_climbs: how often the vehicle climbed away again after a touch.
        disarm_t: when the motors stopped after a contact, s.
        first_sighting_t: of the first picture with a marker within WITHIN_M, s.
        energy_j: from that sighting to disarm.
    """

    def __init__(self, world: World, feet: Feet) -> None:
        self._world = world
        self._feet = feet
        self._energy_start_j = 0.0
        self._touched = False  # and not climbed away since
        self.contact: Contact | None = None
        self.touch_and_climbs = 0
        self.disarm_t: float | None = None
        self.first_sighting_t: float | None = None
        self.energy_j: float | None = None
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
        return not vehicle.motors and any(vehicle.feet) and self._feet.over_plate(STANDS_M)

    def _on_step(self, world: World) -> None:
        if any(world.vehicle.feet):
            self._touched = True
            if self.contact is None:
                self.contact = self._contact_now(world)
        elif self._touched and world.height > CLEAR_M:
            self._touched = False
            self.touch_and_climbs += 1
        if self.contact is not None and not world.vehicle.motors and self.disarm_t is None:
            self.disarm_t = world.t
            self.energy_j = world.battery.energy_j - self._energy_start_j

    def _contact_now(self, world: World) -> Contact:
        velocity = self._feet.touching_velocity()
        return Contact(
            t=world.t,
            error_m=math.hypot(*world.offset),
            vertical_mps=velocity[2],
            horizontal_mps=horizontal(velocity),
            yaw_error=world.heading_error,
            on_plate=self._feet.over_plate(),
        )
