"""The surroundings of a simulated flight: world, link to the autopilot, ground station, pilot."""

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

WALL_JITTER_S = 0.01  # jitter of the control task in real time, while pictures are drawn
GATE_OPENS_S = 1.0  # time from the start until the pilot moves the switch
# Distance of the point to which the ground station sends the vehicle past the pad, as the thesis
# does (3.5.1), and the same along the course of a pad that the vehicle follows.
BEYOND_M = 170.0
FOLLOWED_M = 5000.0


@dataclass(frozen=True)
class Surroundings:
    """A vehicle to fly, in its world."""

    world: World
    link: MemoryLink | SharedLink  # landerd's end of the link to the autopilot
    ground_station: GroundStation
    jitter_s: float  # of the control task on the loop's clock
    ends_at_contact: bool = False  # whether nothing is simulated after the first contact
    # The other end of the link and whatever else faults act on; None: outside this process.
    vehicle: Vehicle | None = None
    guid_timeout_s: float | None = None  # the parameter GUID_TIMEOUT; None: unknown


class StandIn:
    """The simulated autopilot, a ground station that sends it to the pad, and the pilot.

    Attributes:
        link: landerd's end of the link.
        autopilot_end: the autopilot's end.
        ekf: the autopilot's estimator.
        switch: the pilot's switch, which opens the gate.
        pilot: the pilot's other actions.
    """

    def __init__(self, world: World, config: Config, seed: int) -> None:
        """Make them; the vehicle flies, and nothing happens before the jobs run.

        Args:
            world: in which the vehicle flies.
            config: landerd's.
            seed: of all that is random.
        """
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
        """Functions to be run beside the flight."""
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
        """Return landerd's texts that the ground station has received."""
        return [t.text for t in self.ground_station.texts if t.component == COMPONENT]

    async def open_gate(self) -> None:
        """Move the pilot's switch up, see the function of this name."""
        await open_gate(self.switch.move, self._rc, self._hold_s, self._screen)


class StandInPilot:
    """The pilot of the simulated autopilot; implements hw.sim.stand_in.switch.Pilot."""

    def __init__(self, autopilot: SimAutopilot) -> None:
        """Take the autopilot."""
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
    """Move the pilot's switch up; if the vehicle is to hold first, pause in its middle position.

    Args:
        move: moves the switch to a pulse width, us.
        rc: thresholds of the switch's positions.
        hold_s: time between landerd's text that the vehicle holds and the move up; 0: no hold.
        screen: returns all of landerd's texts that the pilot has seen.
    """
    await asyncio.sleep(GATE_OPENS_S)
    if hold_s > 0.0:
        move((rc.gate_threshold_us + rc.land_threshold_us) // 2)
        while not any(HOLDING_OVER in line for line in screen()):
            await asyncio.sleep(0.1)
        await asyncio.sleep(hold_s)
    move(HIGH_US)


def link_faults(options: LinkOptions, delay_s: float, rng: Random) -> LinkFaults:
    """Return the faults of one direction of the link, with a delay in s."""
    return LinkFaults(
        drop=options.loss, delay_s=delay_s, jitter_s=options.jitter_s, baud=options.baud, rng=rng
    )


def beyond_pad(world: World) -> Vec3 | None:
    """Return a point beyond the pad, seen from the vehicle, at its height, local NED, m.

    None: the vehicle is above the pad.
    """
    start = world.vehicle.position
    way = sub(world.pad.position, start)
    level = (way[0], way[1], 0.0)
    if math.hypot(*level) < 1.0:
        return None
    beyond = FOLLOWED_M if world.follows else BEYOND_M
    return add(add(start, level), scale(unit(level), beyond))


def speed_on_the_way(world: World) -> float | None:
    """Return the speed with which the vehicle follows a pad, m/s.

    None: it does not follow one, and flies at the autopilot's own speed.
    """
    if not world.follows:
        return None
    return horizontal(world.pad.velocity) + world.options.start.overtake_mps
