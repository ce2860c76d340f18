"""One closed-loop landing: the real daemon with simulated devices, judged from truth.

The daemon cannot distinguish these devices from real ones. On the virtual clock every repetition of
a landing is the same to the bit.
"""

import asyncio
import gc
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.tlog import TlogEncoder
from hw.links.memory import MemoryLink
from hw.links.tapped import TappedLink
from hw.sim.faults.bench import Bench, Vehicle
from hw.sim.judge.feasible import infeasible
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.physics.world import World, as_built, stream
from hw.sim.picture.camera import Renders
from hw.sim.picture.lens import true_camera
from hw.sim.picture.numbered import NumberedPictures
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.view import Frustum
from hw.sim.stand_in.autopilot import SimAutopilot
from landerd.analysis.picture import write_picture
from landerd.camera_model import load_camera
from landerd.config.files import Loaded
from landerd.config.parameters import ParameterSet
from landerd.devices import make_autopilot, sim_options, simulated_camera, simulated_gimbal
from landerd.flightlog.contents import Head
from landerd.flightlog.disk import later_flight
from landerd.flightlog.recorder import Recorder
from landerd.pad import load_pad
from landerd.ports import ByteLink
from landerd.runtime.clock import run_realtime, run_virtual
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.observer import Observer
from landerd.simulation.companion import Companion
from landerd.simulation.faults import Faults
from landerd.simulation.judge import Judge
from landerd.simulation.path import path_of
from landerd.simulation.process import (
    BreakableDaemon,
    BreakableLink,
    Computer,
    FaultyDisk,
    Process,
)
from landerd.simulation.recording import Recording
from landerd.simulation.result import Flown, result_of, trace_of
from landerd.simulation.seed_draws import seed_draws
from landerd.simulation.sight.detectors import ModelledDetectors
from landerd.simulation.surroundings import WALL_JITTER_S, StandIn, Surroundings
from landerd.vision import Detectors

AFTER_END_S = 5.0  # simulated time after landerd has ended, to see what the vehicle does
AFTER_LANDING_S = 1.2  # simulated time after disarming, of which heartbeats tell once a second
LONGEST_S = 150.0


class Simulation:
    """A world, its devices, the daemon that flies in it, and the judge.

    Attributes:
        over: ends the flight as soon as it is True.
        has_pictures: whether pictures are rendered and searched; else sight is modelled.
        timed_out: whether the flight took longer than allowed.
        gimbal_model: the simulated device of a real gimbal's driver, if it runs as a task.
    """

    # The simulated autopilot and its links; they do not exist in other surroundings.
    stand_in: StandIn
    autopilot: SimAutopilot
    link: MemoryLink
    autopilot_end: MemoryLink

    def __init__(
        self,
        loaded: Loaded,
        seed: int,
        *,
        realtime: bool = False,
        log: Path | None = None,
        surroundings: Surroundings | None = None,
        observers: tuple[Observer, ...] = (),
    ) -> None:
        """Make world, devices, daemon and judge; nothing runs yet.

        Args:
            loaded: the configuration.
            seed: of all that is random.
            realtime: whether the loop's clock is that of the machine, with vision in a thread.
            surroundings: world and autopilot; None: those of the simulator.
            log: file in which to record the flight; None: it is not recorded.
            observers: further observers of the daemon.

        Raises:
            CalibrationError: the camera's calibration cannot be used.
            PadError: the pad's layout cannot be used.
        """
        self._loaded, self._options, self._seed = loaded, sim_options(loaded), seed
        self._realtime = realtime
        self.config = loaded.config
        self.layout = load_pad(self.config.pad.layout)
        self.camera_model = load_camera(self.config.camera.calibration)
        # The daemon uses calibration and layout; the true lens and pad may differ from them.
        self._lens = true_camera(self.camera_model, self._options.camera.calibration_error)
        self._pad = printed(self.layout, self._options.pad, seed)
        self.over = self.timed_out = False
        self.has_pictures = self._options.sight == "pictures"
        self._beside: list[Callable[[], Awaitable[None]]] = []  # all tasks except the daemon
        around = surroundings or self._with_stand_in()
        self.world, self._vehicle = around.world, around.vehicle
        self.ground_station = around.ground_station
        self.ends_at_contact = around.ends_at_contact

        self._judge = Judge(loaded, self._pad, self._lens, around)
        self._judge.listen()
        self.score, self.rules = self._judge.score, self._judge.rules
        self.monitor = self._judge.monitor

        self.recorder = self._make_recorder(log) if log is not None else None
        self._companion = Companion(self._options.companion, stream(seed, "companion"))
        self._computer = Computer()
        self._link: ByteLink = around.link
        if self.recorder is not None:
            self._link = TappedLink(self._link, self.recorder.raw)
        if self._options.faults:
            self._link = BreakableLink(self._link, self._computer)
        autopilot = self._make_autopilot()
        self._make_devices(autopilot, self.autopilot if surroundings is None else None)
        ekf = self.stand_in.ekf if surroundings is None else None
        self.drawn = {**loaded.world, **seed_draws(self.world, self._mount, ekf)}

        recorders = (self.recorder,) if self.recorder else ()
        disks = (FaultyDisk(self._computer),) if self._options.faults else ()
        self.process = self._computer.process = self._make_process(
            autopilot, (self.recording, *recorders, *disks, *observers)
        )
        faults = self.faults = Faults(
            self._options.faults, self._bench, lambda: self.daemon.lander.phase
        )
        self.reach = self._judge.watch_reach(lambda: not faults.lasts) if faults.happened else None

    @property
    def daemon(self) -> Daemon:
        """The daemon that runs, or ran last."""
        return self.process.daemon

    def _make_autopilot(self) -> MavlinkAutopilot:
        autopilot = make_autopilot(self.config, self._link, ParameterSet(self.config))
        assert isinstance(autopilot, MavlinkAutopilot)  # the simulated one speaks MAVLink only
        return autopilot

    def _make_devices(self, autopilot: MavlinkAutopilot, flown_by: SimAutopilot | None) -> None:
        """Make camera and gimbal, and the recording, which needs the gimbal's true angles.

        Args:
            autopilot: the daemon's driver, through which some gimbals are driven.
            flown_by: the simulated autopilot, which drives some gimbals; None: SITL flies.
        """
        loaded, world, seed = self._loaded, self.world, self._seed
        self.camera = simulated_camera(
            loaded,
            self._pad,
            self._lens,
            world,
            seed,
            self._judge.on_delivered,
            realtime=self._realtime,
        )
        gimbal = simulated_gimbal(loaded, world, seed, autopilot, flown_by, realtime=self._realtime)
        self.gimbal, self.gimbal_model = gimbal.driver, gimbal.model
        self._mount = gimbal.mount
        self._judge.watch(gimbal.mount)
        if gimbal.model is not None:
            self._beside.append(gimbal.model.run)
        self.recording = Recording(
            world, self.score, self.camera_model, gimbal.true_angles, has_pictures=self.has_pictures
        )

    def _make_process(
        self, autopilot: MavlinkAutopilot, observers: tuple[Observer, ...]
    ) -> Process:
        """Return the process; its first daemon has this autopilot driver, later ones a new one."""
        companion = self._companion
        drivers = [autopilot]

        def start() -> Daemon:
            driver = drivers.pop() if drivers else self._make_autopilot()
            return BreakableDaemon(
                self.config,
                self.layout,
                self.camera_model,
                Devices(self.camera, self.gimbal, driver),
                vision_latency_s=None if self._realtime else companion.vision_latency_s,
                detectors=self._modelled_detectors(),
                observers=observers,
                computer=self._computer,
            )

        restarts = bool(self._options.faults)
        return Process(start, companion, self.rules.on_death, restarts=restarts)

    def _bench(self, number: int) -> Bench:
        """Return the bench on which the fault of this number acts."""
        assert self._vehicle is not None, "faults need it, see SitlFlight.fly"
        pad, lens, seed = self._pad, self._lens, self._seed

        def renderer(render: RenderOptions, print_: PadOptions) -> Renders:
            if not self.has_pictures:
                return self.camera.pictures  # modelled sight has no effects of light and print
            return Renderer(pad, lens, render, seed, self.world.options.camera, print_)

        return Bench(
            world=self.world,
            camera=self.camera,
            gimbal=self.gimbal,
            mount=self._mount,
            vehicle=self._vehicle,
            computer=self._computer,
            plate=pad.plate,
            frustum=Frustum(lens),
            renderer=renderer,
            rng=stream(seed, f"fault {number}"),
        )

    def _modelled_detectors(self) -> Detectors | None:
        """Return the detectors of modelled sight; None: the camera renders pictures."""
        pictures = self.camera.pictures
        if not isinstance(pictures, NumberedPictures):
            return None
        return ModelledDetectors(
            self.layout,
            self._pad,
            self.camera_model,
            self._lens,
            self._options,
            pictures,
            self._seed,
        )

    def _with_stand_in(self) -> Surroundings:
        """Make the simulated autopilot, ground station and pilot, and return the surroundings."""
        config, options, seed = self.config, self._options, self._seed
        built = as_built(config.vehicle, options.build)
        world = World(options, built, self.layout.plate, seed)
        stand_in = self.stand_in = StandIn(world, config, seed)
        self.autopilot = stand_in.autopilot
        self.link, self.autopilot_end = stand_in.link, stand_in.autopilot_end
        self._beside += stand_in.jobs
        jitter_s = WALL_JITTER_S if self._realtime else 0.0
        return Surroundings(
            world,
            stand_in.link,
            stand_in.ground_station,
            jitter_s,
            vehicle=Vehicle(
                stand_in.link,
                stand_in.autopilot_end,
                stand_in.autopilot.tampering,
                stand_in.switch,
                stand_in.pilot,
                stand_in.autopilot,
            ),
            guid_timeout_s=world.options.autopilot.guid_timeout_s,
        )

    def _make_recorder(self, path: Path) -> Recorder:
        """Return a recorder; logs of an earlier run at this path are removed."""
        _remove_logs(path)
        options = self.config.log
        if not self.has_pictures:
            options = options.model_copy(update={"images": "none"})
        return Recorder(
            Head(self.config, self.layout, self.camera_model),
            options,
            path,
            background=self._realtime,
            mavlink=TlogEncoder,
        )

    @property
    def logs(self) -> list[str]:
        """Paths of the flight logs, of which there is one more for each restart of landerd."""
        return [] if self.recorder is None else [str(path) for path in self.recorder.logs]

    # ---- the flight ----------------------------------------------------------------------------

    async def run(
        self,
        *,
        longest_s: float = LONGEST_S,
        script: Callable[["Simulation"], Awaitable[None]] | None = None,
    ) -> None:
        """Fly until the vehicle is disarmed after contact, or the longest time has passed.

        Args:
            longest_s: longest simulated time.
            script: runs beside the flight, and may make devices fail; None: nothing does.
        """
        loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(as_coroutine(work())) for work in self._beside]
            running.append(tasks.create_task(self._companion.stall()))
            self.process.begin()
            running.append(tasks.create_task(self.process.run()))
            if self.faults.happened:
                running.append(tasks.create_task(self.faults.run()))
            if script is not None:
                running.append(tasks.create_task(as_coroutine(script(self))))
            end = loop.time() + longest_s
            while loop.time() < end and not self.over:
                await asyncio.sleep(0.1)
                if self._has_ended(loop.time()):
                    break
            else:
                self.timed_out = not self.over
            # Others may still use the link; a daemon that has ended sends no set-points.
            self._judge.stop_listening()
            for task in running:
                task.cancel()

    def _has_ended(self, now: float) -> bool:
        """Tell whether the landing is over and landerd has reported it, or had time to."""
        ended_t = self.process.over_t
        if ended_t is not None and now > ended_t + AFTER_END_S:
            return True
        if self.ends_at_contact and self.score.contact is not None:
            return True  # from here on SITL's ground and the pad would differ
        over_t = self.score.disarm_t
        if over_t is None:
            return False
        is_told = self.daemon.lander.outcome not in (None, "touchdown_unconfirmed")
        return is_told or now > over_t + AFTER_LANDING_S

    def flown(self) -> Flown:
        """Return the data of the flight for its result, once it is over."""
        return Flown(
            began=self.recording.began,
            ended=self.world.t,
            timed_out=self.timed_out,
            ends_at_contact=self.ends_at_contact,
            score=self.score,
            rules_broken=self.rules.broken,
            lander=self.daemon.lander,
            faults=self.daemon.faults,
            findings=self.monitor.found,
            happened=self.faults,
            worst=self.monitor.worst,
            left_reach_t=self.reach.left_t if self.reach else None,
            recording=self.recording,
            innovation_gate=float(self.config.estimation.gate_sigma**2),
        )

    def not_written(self, picture: Path | None, result: dict[str, Any]) -> list[str]:
        """Draw the flight's picture; return which files could not be written, and why."""
        lost = []
        if picture is not None:
            try:
                write_picture(trace_of(self.recording, self.layout, result), picture)
            except OSError as e:
                lost.append(f"{picture}: cannot be written: {e.strerror}")
        if self.recorder is not None:
            lost += self.recorder.failures
        return lost


def simulate(
    loaded: Loaded,
    scenario: str,
    seed: int,
    *,
    longest_s: float = LONGEST_S,
    realtime: bool = False,
    picture: Path | None = None,
    log: Path | None = None,
    progress: Callable[[str], None] | None = None,
    watch: Callable[[Daemon], None] | None = None,
    with_path: bool = False,
) -> dict[str, Any]:
    """Fly one landing and return the object that `landerd sim --json` prints.

    Args:
        loaded: the configuration.
        scenario: its name, for the result.
        seed: of all that is random.
        longest_s: longest simulated time.
        realtime: whether to fly in real time, instead of as fast as possible.
        picture: file of the flight's drawing; None: none is drawn.
        log: file of the flight log; None: none is written.
        progress: called with lines for the user; None: nobody is told.
        watch: called with the daemon before it runs, so that it may observe it.
        with_path: whether the result has `path`, for figures (landerd.simulation.path).

    Raises:
        CalibrationError: the camera's calibration cannot be used.
        PadError: the pad's layout cannot be used.
        ImportError: a picture is wanted and matplotlib is not installed.
    """
    started = time.perf_counter()
    simulation = Simulation(loaded, seed, realtime=realtime, log=log)
    simulation.recording.progress = progress
    if watch is not None:
        watch(simulation.daemon)
    gc.freeze()  # garbage collections then visit only objects that the flight makes
    try:
        run = run_realtime if realtime else run_virtual
        run(simulation.run(longest_s=longest_s))
    finally:
        gc.unfreeze()
        if simulation.recorder is not None:
            simulation.recorder.close()
    result = result_of(simulation.flown(), scenario, seed)
    result["sight"] = sim_options(loaded).sight
    result["world"] = simulation.drawn
    result["infeasible"] = infeasible(sim_options(loaded))
    if with_path:
        result["path"] = path_of(simulation.recording, simulation.score.first_sighting_t)
    result["logs"] = simulation.logs
    result["not_written"] = simulation.not_written(picture, result)
    result["wall_s"] = time.perf_counter() - started
    result["held_up_s"] = simulation.daemon.monitor.longest_s if realtime else None
    return result


def _remove_logs(path: Path) -> None:
    """Remove the logs of all flights of an earlier run at this path."""
    old, number = path, 1
    while number == 1 or old.exists():
        old.unlink(missing_ok=True)
        old.with_suffix(".tlog").unlink(missing_ok=True)
        number += 1
        old = later_flight(path, number)


async def as_coroutine(work: Awaitable[None]) -> None:
    """Await an awaitable, as a task can be made only of a coroutine."""
    await work
