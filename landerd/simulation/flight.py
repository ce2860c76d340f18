"""One closed-loop landing: the real daemon with simulated devices, judged from truth.

This and the command line are where landerd and hw meet; the daemon cannot tell these devices from
real ones. On the virtual clock a landing is the same to the bit each time.
"""

import asyncio
import gc
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.tlog import TlogEncoder
from hw.links.memory import MemoryLink, memory_pair
from hw.links.tapped import TappedLink
from hw.sim.gimbals.bench import Bench
from hw.sim.gimbals.mount import SimMount
from hw.sim.gimbals.sim import SimGimbal
from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.rules import Rules, Truth
from hw.sim.judge.score import Score
from hw.sim.options import SimOptions
from hw.sim.physics.world import World, stream
from hw.sim.picture.camera import SimCamera
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.picture.view import Frustum, visible_markers
from hw.sim.snapshot import Snapshot
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.ekf import Ekf
from hw.sim.stand_in.ground_station import GroundStation
from hw.sim.stand_in.shared_link import SharedLink
from landerd import devices as registry
from landerd.analysis.picture import Sample, write_picture
from landerd.camera_model import load_camera
from landerd.config.files import Loaded
from landerd.config.models import Config
from landerd.config.parameters import ParameterSet
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.geometry import Vec3, add, horizontal, norm, rotate, scale, sub, transpose, unit
from landerd.lander import Lander
from landerd.messages import (
    Command,
    Frame,
    GimbalCommand,
    GimbalState,
    Input,
    Phase,
    PhaseChange,
    Prior,
    Sightings,
    Tick,
)
from landerd.pad import load_pad
from landerd.runtime.clock import run_realtime, run_virtual
from landerd.runtime.daemon import Daemon, Devices
from landerd.simulation.result import result_of, trace_of

VISION_LATENCY_S = 0.025  # searching a frame on a Raspberry Pi 4, modelled
WALL_JITTER_S = 0.01  # of the control task beside rendering on the wall's clock
GATE_OPENS_S = 1.0  # when the pilot moves the switch
AFTER_LANDING_S = 1.2  # heartbeats tell of the disarming once a second
LONGEST_S = 150.0
BEYOND_M = 170.0  # the ground station sends the vehicle past the pad, as the thesis does (3.5.1),
FOLLOWED_M = 5000.0  # and along the way of one that it follows
SAMPLE_S = 0.1
KNOWN_AFTER_S = 2.0  # from the first sighting to when the pad's velocity is to be known


@dataclass(frozen=True)
class Surroundings:
    """A vehicle of somebody else's to fly in, in place of the stand-in."""

    world: World
    link: SharedLink
    ground_station: GroundStation
    jitter_s: float  # of the control task on the loop's clock
    ends_at_contact: bool  # what comes after it is not simulated


class Simulation:
    """A world, its devices, the daemon that flies in it, and the judge.

    Attributes:
        over: set it to end the flight.
        timed_out: the flight took longer than it may.
    """

    # Of the stand-in; not there if it flies in other surroundings.
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
    ) -> None:
        """Build everything; nothing runs yet.

        Args:
            loaded: the configuration.
            seed: of all that is random.
            realtime: the loop's clock does not wait for the machine: vision in a thread.
            surroundings: None: the stand-in flies, sent on its way by a fake ground station.
            log: where to record the flight.

        Raises:
            CalibrationError: the camera's calibration cannot be used.
            PadError: the pad's layout cannot be used.
        """
        config = self.config = loaded.config
        options = loaded.options["sim"]
        assert isinstance(options, SimOptions)
        self.layout = load_pad(config.pad.layout)
        self.camera_model = load_camera(config.camera.calibration)
        self._frustum = Frustum(self.camera_model)
        link: MemoryLink | SharedLink
        self._outside: list[Callable[[], Awaitable[None]]] = []  # all but the daemon
        self.over = False
        self.ends_at_contact = False
        self.timed_out = False
        jitter_s = WALL_JITTER_S if realtime else 0.0
        if surroundings is None:
            self.world = World(options, config.vehicle, self.layout.plate, seed)
            link = self.link = self._make_autopilot(seed)
        else:
            self.world, link = surroundings.world, surroundings.link
            self.ground_station = surroundings.ground_station
            self.ends_at_contact = surroundings.ends_at_contact
            jitter_s = surroundings.jitter_s
        self.began = self.world.t
        self._start_pad = self.world.pad
        # The world's pad is not quite what its file says; the daemon knows but the file.
        self._printed = printed(self.layout, options.pad, seed)
        renderer = Renderer(self._printed, self.camera_model, options.render, seed, pad=options.pad)
        self.camera = SimCamera(
            renderer, self.world.snapshot, options.camera, delivered=self._on_delivered
        )
        self.score = Score(self.world, config.vehicle, self.layout.plate)
        self.rules = Rules(
            _bounds(config, has_heading=self.layout.has_heading, jitter_s=jitter_s),
            self._truth,
        )
        link.tap = self.rules.from_landerd
        link.heard = self.rules.to_landerd
        self._judged = link
        self.recording = Recording(self)
        self.recorder = _recorder(self, log, realtime=realtime) if log is not None else None
        autopilot = MavlinkAutopilot(
            TappedLink(link, self.recorder.raw) if self.recorder else link,
            system_id=config.autopilot.system_id,
            setpoint_frame=config.autopilot.setpoint_frame,
            ground_stations=config.autopilot.ground_stations,
            parameters=ParameterSet(config),
        )
        mount = self._mount = SimMount(self.world, options.gimbal, stream(seed, "gimbal"))
        connect = registry.model("gimbal", config.gimbal.driver)
        self.gimbal: Any  # the tests break it
        self.gimbal_model: Any = None  # the device below a real driver
        if connect is None:
            self.gimbal = SimGimbal(mount, options.gimbal)
        else:
            stand_in = self.autopilot if surroundings is None else None
            bench = Bench(mount, stand_in, autopilot, realtime=realtime)
            block = loaded.options[f"gimbal.{config.gimbal.driver}"]
            self.gimbal, self.gimbal_model = connect(block, bench)
            if self.gimbal_model is not None:
                self._outside.append(self.gimbal_model.run)
        self.daemon = Daemon(
            config,
            self.layout,
            self.camera_model,
            Devices(
                self.camera,
                self.gimbal,
                autopilot,
            ),
            vision_latency_s=None if realtime else VISION_LATENCY_S,
            observers=(self.recording, self.recorder) if self.recorder else (self.recording,),
        )

    async def run(
        self,
        *,
        longest_s: float = LONGEST_S,
        script: Callable[["Simulation"], Awaitable[None]] | None = None,
    ) -> None:
        """Fly until the vehicle is disarmed after contact, or the time is over.

        Args:
            longest_s: simulated time at most.
            script: what else happens; runs beside the flight and may break devices.
        """
        loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(_forever(work())) for work in self._outside]
            running.append(tasks.create_task(_forever(self.daemon.run())))
            if script is not None:
                running.append(tasks.create_task(_forever(script(self))))
            end = loop.time() + longest_s
            while loop.time() < end and not self.over:
                await asyncio.sleep(0.1)
                over_t = self.score.disarm_t
                if self.ends_at_contact and self.score.contact is not None:
                    over_t = self.score.contact.t
                if over_t is None:
                    continue
                if self.daemon.lander.outcome or loop.time() > over_t + AFTER_LANDING_S:
                    break
            else:
                self.timed_out = not self.over
            # The link may go on in others' hands; a daemon that has ended streams no set-points.
            self._judged.tap = self._judged.heard = None
            for task in running:
                task.cancel()

    def _make_autopilot(self, seed: int) -> MemoryLink:
        """Make the stand-in, and a ground station that sends it on its way and opens the gate."""
        system_id = self.config.autopilot.system_id
        link, self.autopilot_end = memory_pair()
        ground_end, autopilot_ground_end = memory_pair()
        self.autopilot = SimAutopilot(
            self.world,
            [self.autopilot_end, autopilot_ground_end],
            ekf=Ekf(self.world, self.world.options.ekf, stream(seed, "ekf")),
            rng=stream(seed, "autopilot"),
            flying=True,
            system_id=system_id,
        )
        self.ground_station = GroundStation(
            ground_end,
            destination=beyond_pad(self.world),
            speed_mps=speed_on_the_way(self.world),
            system_id=system_id,
        )
        self._outside = [self.autopilot.run, self.ground_station.run, self._open_gate]
        return link

    async def _open_gate(self) -> None:
        await asyncio.sleep(GATE_OPENS_S)
        self.autopilot.pilot.set(self.config.rc.gate_channel, 1900)

    def gimbal_angles(self) -> tuple[float, float]:
        """Return the gimbal's true yaw and pitch, rad, against what its driver's are against."""
        traits = getattr(self.gimbal, "traits", self.world.gimbal)
        return self._mount.angles(traits.reference)

    # ---- truth for camera and judge ------------------------------------------------------------

    def _truth(self) -> Truth:
        world = self.world
        world.advance(asyncio.get_running_loop().time())
        return Truth(
            t=world.t,
            distance=math.hypot(*world.offset),
            height=world.height,
            heading_error=world.heading_error,
            yaw=world.vehicle.yaw,
            pad_velocity=world.pad.velocity,
            feet_down=sum(world.vehicle.feet),
        )

    def _on_delivered(self, frame: Frame, snapshot: Snapshot) -> None:
        if visible_markers(self._printed, self._frustum, snapshot.camera, snapshot.pad):
            self.rules.on_sighting(snapshot.t)
            self.score.on_sighting(snapshot.t)


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
    """Return the pad's speed where the vehicle follows it, m/s; else None: the autopilot's own."""
    return horizontal(world.pad.velocity) if world.follows else None


class Recording:
    """An observer that keeps what the result and the picture need."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._sampled_t = -math.inf
        self.samples: list[Sample] = []
        self.phases: list[tuple[float, PhaseChange]] = []
        self.views: dict[Phase, tuple[float, Frame, Sightings]] = {}
        self.progress: Callable[[str], None] | None = None
        self.frames = 0  # searched
        self.off_centre_px: list[float] = []  # the marker looked at, in each picture with one
        self.gimbal_errors_px: list[float] = []  # where it points against where it was ordered to
        self.nis: list[float] = []  # of every sighting that the filter could compare
        self.pad_velocity_error_mps: float | None = None  # KNOWN_AFTER_S after the first sighting

    def on_flight(self, lander: Lander) -> None:
        """One flight is all there is."""

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Count, and keep the first picture with a marker of each phase."""
        self.frames += 1
        if sightings.markers:
            looked_at = min(sightings.markers, key=lambda m: m.kind.startswith("why"))
            x, y, z = looked_at.solutions[0].position
            model = self._simulation.camera_model
            self.off_centre_px.append(math.hypot(model.fx * x / z, model.fy * y / z))
        phase = self._simulation.daemon.lander.phase
        if sightings.markers and phase not in self.views:
            self.views[phase] = (frame.t - self._simulation.began, frame, sightings)

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Sample the truth, note changes of phase."""
        if isinstance(message, GimbalState):
            self._simulation.rules.on_gimbal(message.t)
        if self.off_centre_px:
            for command in commands:
                if isinstance(command, GimbalCommand):
                    self._compare_gimbal(command)
        self.phases += [(now, c) for c in commands if isinstance(c, PhaseChange)]
        if isinstance(message, Tick) and now - self._sampled_t >= SAMPLE_S:
            self._sampled_t = now
            self._sample(now)
            self._compare_velocity(now)
        elif isinstance(message, Sightings):
            nis = self._simulation.daemon.lander.nis
            if not math.isnan(nis):
                self.nis.append(nis)

    def _compare_gimbal(self, ordered: GimbalCommand) -> None:
        """Note how far off the picture is that an order has not moved yet."""
        yaw, pitch = self._simulation.gimbal_angles()
        yaw = (ordered.yaw - yaw) * math.cos(pitch)
        pitch = ordered.pitch - pitch
        self.gimbal_errors_px.append(self._simulation.camera_model.fx * math.hypot(yaw, pitch))

    def _compare_velocity(self, now: float) -> None:
        simulation = self._simulation
        first = simulation.score.first_sighting_t
        if (
            self.pad_velocity_error_mps is None
            and first is not None
            and now > first + KNOWN_AFTER_S
        ):
            relative = simulation.daemon.lander.relative(now)
            if relative is not None:
                difference = sub(relative.pad_velocity, simulation.world.pad.velocity)
                self.pad_velocity_error_mps = norm(difference)

    def _sample(self, now: float) -> None:
        simulation = self._simulation
        world, lander = simulation.world, simulation.daemon.lander
        world.advance(now)
        origin = simulation._start_pad
        to_pad = transpose(origin.R_local_pad)

        def place(p: Vec3) -> Vec3:
            x, y, z = rotate(to_pad, sub(p, origin.position))
            return (x, y, -z)

        flown_s = now - simulation.began
        self.samples.append(
            Sample(
                flown_s,
                place(world.footprint_centre),
                place(world.pad.position),
                lander.phase,
            )
        )
        if self.progress is not None:
            distance = math.hypot(*world.offset)
            self.progress(
                f"{flown_s:5.1f} s  {lander.phase.value:14}  {distance:5.1f} m away  "
                f"{world.height:5.2f} m up  {lander.reason}"
            )


def simulate(
    loaded: Loaded,
    scenario: str,
    seed: int,
    *,
    realtime: bool = False,
    picture: Path | None = None,
    log: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Fly one landing and return the object that `landerd sim --json` prints.

    Raises:
        CalibrationError: the camera's calibration cannot be used.
        PadError: the pad's layout cannot be used.
        ImportError: a picture is wanted and matplotlib is not installed.
    """
    started = time.perf_counter()
    simulation = Simulation(loaded, seed, realtime=realtime, log=log)
    simulation.recording.progress = progress
    gc.freeze()  # collections then look only at what the flight makes
    try:
        run = run_realtime if realtime else run_virtual
        run(simulation.run())
    finally:
        gc.unfreeze()
        if simulation.recorder is not None:
            simulation.recorder.close()
    result = result_of(simulation, scenario, seed)
    if picture is not None:
        write_picture(trace_of(simulation, result), picture)
    result["wall_s"] = time.perf_counter() - started
    return result


def _recorder(simulation: Simulation, path: Path, *, realtime: bool) -> Recorder:
    path.unlink(missing_ok=True)
    path.with_suffix(".tlog").unlink(missing_ok=True)
    return Recorder(
        Head(simulation.config, simulation.layout, simulation.camera_model),
        simulation.config.log,
        path,
        background=realtime,
        mavlink=TlogEncoder,
    )


def _bounds(config: Config, *, has_heading: bool, jitter_s: float) -> RuleBounds:
    guidance, fresh = config.guidance, config.freshness
    limits, descent = guidance.limits, guidance.descent
    return RuleBounds(
        control_period_s=1.0 / config.control.rate_hz,
        gate_channel=config.rc.gate_channel,
        gate_threshold_us=config.rc.gate_threshold_us,
        release_s=guidance.release_s,
        heartbeat_s=fresh.heartbeat_s,
        rc_s=fresh.rc_s,
        attitude_s=fresh.attitude_s,
        position_s=fresh.position_s,
        gimbal_s=fresh.gimbal_s,
        speed_mps=limits.speed_mps,
        climb_mps=limits.climb_mps,
        descent_mps=limits.descent_mps,
        acceleration_mps2=limits.acceleration_mps2,
        vertical_acceleration_mps2=limits.vertical_acceleration_mps2,
        jerk_mps3=limits.jerk_mps3,
        yaw_rate=math.radians(limits.yaw_rate_deg_s),
        k1_m=descent.k1_m,
        k2_per_m=descent.k2_per_m,
        alignment_height_m=descent.alignment_height_m,
        has_heading=has_heading,
        jitter_s=jitter_s,
    )


async def _forever(work: Awaitable[Any]) -> None:
    await work
