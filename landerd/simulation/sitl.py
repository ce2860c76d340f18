"""Simulates one landing with a real ArduCopter in SITL.

Camera, gimbal and pad are simulated here; SITL simulates the vehicle and keeps the clock. The
daemon, its driver and its link are those of a real vehicle. With a take-off height, a simulated
ground station does what a pilot would do.
"""

import asyncio
import contextlib
import gc
import math
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from hw.autopilots.arducopter import Mode
from hw.links import open_link
from hw.sim.cable import Cable
from hw.sim.fault_options import FAULTS
from hw.sim.faults.bench import Vehicle
from hw.sim.sitl import SitlPilot, SitlWorld, Truth
from hw.sim.stand_in.ground_station import GroundStation
from hw.sim.stand_in.shared_link import SharedLink
from hw.sim.stand_in.switch import GateSwitch, ObedientPilot
from landerd.config.files import Loaded
from landerd.devices import sim_options
from landerd.drivers import gimbal_speaks_over
from landerd.geometry import add, scale, sub
from landerd.pad import load_pad
from landerd.ports import DeviceLost
from landerd.runtime.clock import SlavedLoop, run_slaved
from landerd.simulation.flight import LONGEST_S, Simulation, as_coroutine
from landerd.simulation.result import result_of
from landerd.simulation.surroundings import (
    WALL_JITTER_S,
    Surroundings,
    beyond_pad,
    open_gate,
    speed_on_the_way,
)

CONNECTS_S = 10.0  # longest time to connect
# Longest time from the connection to the first true state: ArduCopter needs 42 s from its start to
# a local origin.
REPORTS_S = 90.0
TAKES_OFF_S = 120.0  # longest time for arming, take-off and the flight to the start
# Speed of flights in GUIDED: that of the simulated autopilot and of ArduCopter up to 4.1; newer
# versions would fly at 10 m/s.
ON_THE_WAY_MPS = 5.0
# Horizontal distance from the pad at which LAND is ordered: within ArduPilot's PLND_XY_DIST_MAX.
LANDS_FROM_M = 2.0
ASK_S = 1.0  # time without a true state after which it is requested again
REOPEN_S = 0.2  # time until a lost link is opened again
# Channel of the throttle: low to arm, and in the middle in flight, as LOITER would sink otherwise.
_THROTTLE_CHANNEL = 3
_BOTTOM_US, _LOW_US, _MIDDLE_US = 1000, 1100, 1500  # pulse widths of channels

Script = Callable[[Simulation], Awaitable[None]]


class AutopilotError(Exception):
    """The autopilot cannot be used; the text is one line for the user."""


class SitlFlight:
    """Brings the vehicle to the start, flies one landing, and puts the vehicle down.

    Attributes:
        link: shared by landerd, the ground station and the reader of true states.
        truth: the vehicle's true state; exists once `run` has begun.
        simulation: of the landing; exists once the vehicle is at the start.
        version: of the autopilot, as it reports it.
        rate: speed of the autopilot's clock relative to real time.
    """

    truth: Truth
    simulation: Simulation

    def __init__(
        self,
        loaded: Loaded,
        seed: int,
        url: str,
        *,
        take_off_m: float | None = None,
        log: Path | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        """Prepare a flight.

        Args:
            loaded: configuration of landerd and of the simulated world.
            seed: of all that is random.
            url: of the autopilot.
            take_off_m: height at which the landing starts; None: somebody else flies the vehicle.
            log: file of the flight log; None: none is written.
            progress: called with lines for the user; None: nobody is told.

        Raises:
            AutopilotError: the URL is not a link's.
        """
        self.version = ""
        self.rate = 1.0
        self._loaded = loaded
        self._options = sim_options(loaded)
        self._seed = seed
        self._url = url
        self._take_off_m = take_off_m
        self._log = log
        self._progress = progress
        try:
            self.link = SharedLink(open_link(url))
        except ValueError as e:
            raise AutopilotError(f"--autopilot: {e}") from None

    def say(self, line: str) -> None:
        """Show a line of progress."""
        if self._progress is not None:
            self._progress(line)

    async def run(self, script: Script | None = None) -> None:
        """Connect, fly to the start, land and put the vehicle down; to be run on a `SlavedLoop`.

        Args:
            script: runs beside the landing; None: nothing does.

        Raises:
            AutopilotError: the autopilot does not answer, or not like one in SITL.
        """
        loop = asyncio.get_running_loop()
        assert isinstance(loop, SlavedLoop)
        config = self._loaded.config
        system_id = config.autopilot.system_id
        self.truth = truth = Truth(self.link.side(), system_id, loop.place)
        self.link.listeners.append(truth.take)
        self._ground_station = GroundStation(self.link.side(), system_id=system_id)
        world = SitlWorld(
            self._options, config.vehicle, load_pad(config.pad.layout).plate, self._seed, truth
        )
        helpers = [asyncio.create_task(self._keep_asking(truth))]
        if self._take_off_m is not None:
            helpers.append(asyncio.create_task(self._ground_station.serve()))
        try:
            await self._until_ready()
            if self._take_off_m is not None:
                await self._to_start(world, self._take_off_m)
            self.version, self.rate = truth.version, loop.rate
            world.begin(loop.time())
            await self.fly(world, script)
            if self._take_off_m is not None:
                await self._finish()
        finally:
            for task in helpers:
                task.cancel()
            await self.link.close()

    async def _keep_asking(self, truth: Truth) -> None:
        """Request true states again whenever they stop, until cancelled."""
        while True:
            received = truth.received
            await asyncio.sleep(ASK_S)
            if truth.received == received or not truth.version:
                truth.ask()

    async def _read(self) -> None:
        """Read the link, and open it again if it is lost, while the daemon does not do so."""
        while True:
            try:
                while True:
                    await self.link.read()
            except DeviceLost:
                await asyncio.sleep(REOPEN_S)
                with contextlib.suppress(DeviceLost):
                    await self.link.open()

    async def _until_ready(self) -> None:
        """Connect, and wait for the first true state."""
        self.say(f"waiting for the autopilot at {self._url}")
        try:
            async with asyncio.timeout(CONNECTS_S):
                await self.link.open()
        except DeviceLost as e:
            raise AutopilotError(f"--autopilot {self._url}: no connection: {e}") from None
        except TimeoutError:
            raise AutopilotError(
                f"--autopilot {self._url}: no connection in {CONNECTS_S:g} s"
            ) from None
        self.truth.ask()

        async def first_state() -> None:
            while not self.truth.ready:
                await asyncio.sleep(0.1)

        await self.while_reading(
            first_state(),
            REPORTS_S,
            f"--autopilot {self._url}: no SIM_STATE from system "
            f"{self._loaded.config.autopilot.system_id}: expected an ArduCopter in SITL",
        )

    async def _to_start(self, world: SitlWorld, height_m: float) -> None:
        """Arm, take off and fly to where the scenario starts."""
        station = self._ground_station
        north, east, _ = world.vehicle.position
        heading = world.vehicle.yaw

        async def fly() -> None:
            station.set_rc(_THROTTLE_CHANNEL, _BOTTOM_US)
            station.set_rc(self._loaded.config.rc.gate_channel, _LOW_US)
            await asyncio.sleep(2.0)  # until a heartbeat shows whether it is armed
            self.say("putting the vehicle down first")
            await station.put_down()
            self.say("arming")
            await station.set_mode(Mode.GUIDED)
            await station.take_off(height_m)
            station.set_rc(_THROTTLE_CHANNEL, _MIDDLE_US)
            self.say("flying to the start")
            await station.bring_to((north, east, -height_m), heading)

        await self.while_reading(fly(), TAKES_OFF_S, "the vehicle did not get to the start")

    async def fly(self, world: SitlWorld, script: Script | None) -> None:
        """Land a vehicle that hovers at the start; `_read` must not run.

        Args:
            world: the simulated world around the vehicle.
            script: runs beside the landing; None: nothing does.
        """
        options = self._options
        moves = any(FAULTS[each.fault].device == "pad" for each in options.faults)
        moves = moves or options.pad.speed_mps > 0.0 or options.pad.turn_rate_deg_s != 0.0
        switch = GateSwitch(
            partial(self._ground_station.set_rc, self._loaded.config.rc.gate_channel), fades=False
        )
        pilot = SitlPilot(self._ground_station)
        # Without faults landerd's driver uses the link itself.
        cable = vehicle = None
        if options.faults:
            cable = Cable(self.link.side())
            vehicle = Vehicle(cable.near, cable.far, cable.tampering, switch, pilot)
        self.simulation = simulation = Simulation(
            self._loaded,
            self._seed,
            realtime=True,
            log=self._log,
            surroundings=Surroundings(
                world,
                self.link if cable is None else cable.near,
                self._ground_station,
                jitter_s=WALL_JITTER_S * max(1.0, self.rate),
                ends_at_contact=moves,
                vehicle=vehicle,
            ),
        )
        simulation.recording.progress = self._progress
        # ArduPilot does not forward landerd's texts on the link on which it received them.
        told: list[str] = []
        simulation.rules.on_text.append(lambda t, text: told.append(text))

        async def beside(simulation: Simulation) -> None:
            async with asyncio.TaskGroup() as tasks:
                if cable is not None:
                    tasks.create_task(self._read())
                    tasks.create_task(cable.run())
                if self._take_off_m is not None:
                    tasks.create_task(self._send_off(world, self._take_off_m, switch, told))
                    if options.pilot == "obeys":
                        obedient = ObedientPilot(switch, pilot, lambda: told)
                        tasks.create_task(obedient.run())
                if script is not None:
                    tasks.create_task(as_coroutine(script(simulation)))

        try:
            await simulation.run(longest_s=LONGEST_S, script=beside)
        finally:
            if simulation.recorder is not None:
                simulation.recorder.close()

    async def _send_off(
        self, world: SitlWorld, height_m: float, switch: GateSwitch, told: list[str]
    ) -> None:
        """Send the vehicle past the pad and open the gate, as without SITL."""
        if self._loaded.config.guidance.output == "landing_target":
            await self._let_it_land(world, height_m)
            return
        beyond = beyond_pad(world)
        await self._ground_station.set_speed(speed_on_the_way(world) or ON_THE_WAY_MPS)
        if beyond is not None:
            self._ground_station.send_to((beyond[0], beyond[1], -height_m))
        hold_s = self._options.autopilot.hold_s
        await open_gate(switch.move, self._loaded.config.rc, hold_s, lambda: told)

    async def _let_it_land(self, world: SitlWorld, height_m: float) -> None:
        """Bring the vehicle near the pad and order LAND: the autopilot lands on the pad itself."""
        vehicle, pad = world.vehicle, world.pad.position
        way = sub(vehicle.position, pad)
        level = math.hypot(way[0], way[1])
        near = add(pad, scale(way, min(1.0, LANDS_FROM_M / level))) if level > 0.0 else pad
        await self._ground_station.set_speed(ON_THE_WAY_MPS)
        await self._ground_station.bring_to((near[0], near[1], -height_m), vehicle.yaw)
        await self._ground_station.set_mode(Mode.LAND)

    async def _finish(self) -> None:
        """Leave the vehicle on the ground with its motors off, ready for the next landing."""
        self._ground_station.set_rc(self._loaded.config.rc.gate_channel, _LOW_US)
        await self.while_reading(self._ground_station.put_down(), 120.0, "it did not come down")

    async def while_reading(self, work: Awaitable[None], limit_s: float, trouble: str) -> None:
        """Wait for some work while the link is read.

        Args:
            work: to wait for.
            limit_s: longest time for it.
            trouble: beginning of the error's text if it takes longer.

        Raises:
            AutopilotError: the work took longer.
        """
        reading = asyncio.create_task(self._read())
        try:
            async with asyncio.timeout(limit_s):
                await work
        except TimeoutError:
            said = f"; it says: {self.truth.texts[-1]}" if self.truth.texts else ""
            raise AutopilotError(f"{trouble} within {limit_s:.0f} s{said}") from None
        finally:
            reading.cancel()


def simulate_sitl(
    loaded: Loaded,
    scenario: str,
    seed: int,
    url: str,
    *,
    take_off_m: float | None = None,
    picture: Path | None = None,
    log: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Fly one landing and return the object that `landerd sim --autopilot URL --json` prints.

    Args:
        loaded: configuration of landerd and of the simulated world.
        scenario: its name, for the result.
        seed: of all that is random.
        url: of the autopilot.
        take_off_m: height at which the landing starts; None: somebody else flies the vehicle.
        picture: file of the drawing; None: none is drawn.
        log: file of the flight log; None: none is written.
        progress: called with lines for the user; None: nobody is told.

    Raises:
        AutopilotError: the autopilot does not answer, or not like one in SITL.
        CalibrationError: the camera's calibration cannot be used.
        PadError: the pad's layout cannot be used.
        ImportError: a picture is wanted and matplotlib is not installed.
    """
    gimbal = loaded.config.gimbal.driver
    if gimbal_speaks_over(gimbal) == "autopilot":
        raise AutopilotError(f"gimbal.driver: {gimbal} needs the simulator's own autopilot")
    started = time.perf_counter()
    flight = SitlFlight(loaded, seed, url, take_off_m=take_off_m, log=log, progress=progress)
    gc.freeze()  # garbage collections then visit only objects that the flight makes
    try:
        run_slaved(flight.run())
    finally:
        gc.unfreeze()
    simulation = flight.simulation
    result = result_of(simulation.flown(), scenario, seed)
    result["autopilot"] = flight.version
    result["speedup"] = flight.rate
    result["disarmed"] = _how_disarmed(simulation)
    result["judged_at_contact"] = simulation.ends_at_contact
    result["logs"] = simulation.logs
    result["not_written"] = simulation.not_written(picture, result)
    result["wall_s"] = time.perf_counter() - started
    return result


def _how_disarmed(simulation: Simulation) -> str:
    """Return how the vehicle was disarmed, in words."""
    if simulation.score.disarm_t is None:
        return "no"
    return "by landerd's command" if simulation.rules.disarm_orders else "by itself"
