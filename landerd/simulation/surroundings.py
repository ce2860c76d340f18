"""The surroundings of a flight: world, vehicle's link, ground station and pilot."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from random import Random

from hw.autopilots.arducopter import Mode
from hw.autopilots.mavlink import COMPONENT
from hw.links.memory import LinkFaults, MemoryLink, memory_pair
from hw.sim.faults.bench import Vehicle
from hw.sim.options import LinkOptions
from hw.sim.physics.world import World, stream
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.copter import CopterParameters
from hw.sim.stand_in.ekf import Ekf
from hw.sim.stand_in.ground_station import GroundStation
from hw.sim.stand_in.shared_link import SharedLink
from hw.sim.stand_in.switch import HIGH_US, GateSwitch, ObedientPilot
from landerd.config.models import Config, RcSection
from landerd.geometry import Vec3, add, horizontal, scale, sub, unit
from landerd.guidance.pilot_texts import HOLDING_OVER

WALL_JITTER_S = 0.01  # of the control task beside rendering on the wall's clock
GATE_OPENS_S = 1.0  # when the pilot moves the switch
BEYOND_M = 170.0  # the ground station sends the vehicle past the pad, as the thesis does (3.5.1),
FOLLOWED_M = 5000.0  # and along the way of one that it follows


@dataclass(frozen=True)
class Surroundings:
    """A vehicle to fly, in its world."""

    world: World
    link: MemoryLink | SharedLink  # landerd's end
    ground_station: GroundStation
    jitter_s: float  # of the control task on the loop's clock
    ends_at_contact: bool = False  # what comes after it is not simulated
    # The link's other end, where it is in this process, with what else faults lay hands on.
    vehicle: Vehicle | None = None
    guid_timeout_s: float | None = None  # GUID_TIMEOUT, where it is known


class StandIn:
    """The stand-in for the autopilot, a ground station that sends it off, and its pilot.

    Attributes:
        link: landerd's end.
        autopilot_end: the other one.
        ekf: the autopilot's.
        switch: the pilot's, that opens the gate.
        pilot: what else he does.
    """

    def __init__(self, world: World, config: Config, seed: int) -> None:
        """Make them; the vehicle flies, and nobody does anything before the jobs run."""
        system_id = config.autopilot.system_id
        options = world.options
        self.link, self.autopilot_end = memory_pair()
        link = options.link
        if link != LinkOptions():
            self.link.faults = link_faults(link, link.delay_up_s, stream(seed, "up"))
            self.autopilot_end.faults = link_faults(link, link.delay_down_s, stream(seed, "down"))
        ground_end, autopilot_ground_end = memory_pair()
        self.ekf = Ekf(world, options.ekf, stream(seed, "ekf"))
        self.autopilot = SimAutopilot(
            world,
            [self.autopilot_end, autopilot_ground_end],
            ekf=self.ekf,
            rng=stream(seed, "autopilot"),
            parameters=CopterParameters(
                guid_timeout_s=options.autopilot.guid_timeout_s,
                wpnav_accel_mps2=options.response.acceleration_mps2,
                wpnav_accel_z_mps2=options.response.vertical_acceleration_mps2,
                psc_jerk_xy_mps3=options.response.jerk_mps3,
                psc_jerk_z_mps3=options.response.jerk_mps3,
            ),
            options=options.autopilot,
            flying=True,
            system_id=system_id,
        )
        self.ground_station = GroundStation(
            ground_end,
            destination=beyond_pad(world),
            speed_mps=speed_on_the_way(world),
            system_id=system_id,
        )
        channel, radio = config.rc.gate_channel, options.autopilot
        by_radio = radio.gate == "radio" and channel <= radio.rc_channels
        receiver = self.autopilot.pilot

        def override(us: int) -> None:
            others = [0xFFFF] * (channel - 1)
            receiver.override((*others, us), asyncio.get_running_loop().time())

        by_hand = partial(receiver.set, channel)
        self.switch = GateSwitch(by_hand if by_radio else override, fades=not by_radio)
        self.pilot = StandInPilot(self.autopilot)
        self._pilot_obeys = options.pilot == "obeys"
        self._rc, self._hold_s = config.rc, radio.hold_s

    @property
    def jobs(self) -> list[Callable[[], Awaitable[None]]]:
        """What runs beside the flight."""
        jobs: list[Callable[[], Awaitable[None]]] = [
            self.autopilot.run,
            self.ground_station.run,
            self.switch.run,
            self.open_gate,
        ]
        if self._pilot_obeys:
            jobs.append(ObedientPilot(self.switch, self.pilot, self._screen).run)
        return jobs

    def _screen(self) -> list[str]:
        return [t.text for t in self.ground_station.texts if t.component == COMPONENT]

    async def open_gate(self) -> None:
        """Move the pilot's switch up."""
        await open_gate(self.switch.move, self._rc, self._hold_s, self._screen)


class StandInPilot:
    """Who flies the stand-in; a hw.sim.stand_in.switch.Pilot."""

    def __init__(self, autopilot: SimAutopilot) -> None:
        self._autopilot = autopilot

    def select(self, mode: Mode) -> None:
        """Select a mode of the autopilot."""
        self._autopilot.copter.set_mode(mode)

    def lose_radio(self) -> None:
        """Switch the transmitter off."""
        self._autopilot.pilot.lose()

    def restore_radio(self) -> None:
        """Switch the transmitter on again."""
        self._autopilot.pilot.restore()


async def open_gate(
    move: Callable[[int], None],
    rc: RcSection,
    hold_s: float,
    screen: Callable[[], Sequence[str]],
) -> None:
    """Move the pilot's switch up, by way of its middle if the vehicle is to hold first.

    Args:
        move: the switch, to this pulse width, us.
        rc: where its positions are.
        hold_s: how long it holds; 0: not at all.
        screen: returns all lines of landerd's that the pilot has been shown.
    """
    await asyncio.sleep(GATE_OPENS_S)
    if hold_s > 0.0:
        move((rc.gate_threshold_us + rc.land_threshold_us) // 2)
        while not any(HOLDING_OVER in line for line in screen()):
            await asyncio.sleep(0.1)
        await asyncio.sleep(hold_s)
    move(HIGH_US)


def link_faults(options: LinkOptions, delay_s: float, rng: Random) -> LinkFaults:
    """Return what the link does to one direction."""
    return LinkFaults(
        drop=options.loss, delay_s=delay_s, jitter_s=options.jitter_s, baud=options.baud, rng=rng
    )


def beyond_pad(world: World) -> Vec3 | None:
    """Return a point beyond the pad on the vehicle's way, at its height; None above the pad."""
    start = world.vehicle.position
    way = sub(world.pad.position, start)
    level = (way[0], way[1], 0.0)
    if math.hypot(*level) < 1.0:
        return None
    beyond = FOLLOWED_M if world.follows else BEYOND_M
    return add(add(start, level), scale(unit(level), beyond))


def speed_on_the_way(world: World) -> float | None:
    """Return the speed behind a pad that is followed, m/s; else None: the autopilot's own."""
    if not world.follows:
        return None
    return horizontal(world.pad.velocity) + world.options.start.overtake_mps
