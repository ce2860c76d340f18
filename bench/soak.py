"""Runs one daemon for a day of landings, and shows whether its memory, tasks and files grow.

    python -m bench.soak              # 24 h of virtual time: takes about five hours
    python -m bench.soak --hours 1

One process of landerd stays up while a pilot lands, stands for up to ten minutes, takes off and
lands again, with modelled sight; every sixth time he aborts by lowering the switch or by selecting
LOITER, and raises the switch again. The flights are logged, with at most 100 MB of logs, so that
old ones are deleted. Printed for each hour: landings, aborts, the process's resident memory, the
number of objects that Python's garbage collector knows, tasks, open files and the size of the logs.
At the end: the faults counted, and the kinds of objects of which there are more than after the
first hour; those of the simulated world are among them. The exit code is 1 if a landing was not
told as one, or if tasks or open files became more.
"""

import argparse
import asyncio
import collections
import gc
import os
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hw.autopilots.arducopter import Mode
from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.tlog import TlogEncoder
from hw.links.tapped import TappedLink
from hw.sim.physics.world import World, as_built, stream
from hw.sim.picture.lens import true_camera
from hw.sim.picture.numbered import NumberedPictures
from hw.sim.picture.pad_print import printed
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.parameters import ParameterSet
from landerd.devices import make_autopilot, sim_options, simulated_camera, simulated_gimbal
from landerd.drivers import read_configuration
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.geometry import add
from landerd.pad import load_pad
from landerd.runtime.clock import run_virtual
from landerd.runtime.daemon import Daemon, Devices
from landerd.simulation.companion import Companion
from landerd.simulation.sight.detectors import ModelledDetectors
from landerd.simulation.surroundings import StandIn

HOUR_S = 3600.0
STANDS_S = (10.0, 600.0)  # shortest and longest time on the ground between two flights
LANDS_WITHIN_S = 120.0  # after the switch was raised
ABORTS_EVERY = 6  # n-th landing
MOST_LOGS_MB = 100.0
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass
class Hour:
    """What the process holds at the end of an hour."""

    memory_mb: float
    objects: collections.Counter[str]
    tasks: int
    files: int


@dataclass
class Soak:
    """One daemon, its simulated devices, and a pilot who lands again and again."""

    hours: int
    seed: int
    folder: Path
    landings: int = 0
    aborts: int = 0
    failures: list[str] = field(default_factory=list)
    held: list[Hour] = field(default_factory=list)

    def __post_init__(self) -> None:
        loaded = read_configuration(
            config_dir() / "default.yaml",
            overlays=[config_dir() / "scenarios" / "stationary.yaml"],
            overrides=["sim.sight=modelled", "sim.wind.speed_mps=4", "sim.wind.gust_mps=1"],
            seed=self.seed,
        )
        config, options = loaded.config, sim_options(loaded)
        layout, camera_model = load_pad(config.pad.layout), load_camera(config.camera.calibration)
        pad = printed(layout, options.pad, self.seed)
        lens = true_camera(camera_model, options.camera.calibration_error)
        self._random = stream(self.seed, "soak")
        self._world = World(options, as_built(config.vehicle, options.build), pad.plate, self.seed)
        self._stand_in = StandIn(self._world, config, self.seed)
        self.recorder = Recorder(
            Head(config, layout, camera_model),
            config.log.model_copy(update={"images": "none", "most_mb": MOST_LOGS_MB}),
            self.folder,
            background=False,
            mavlink=TlogEncoder,
        )
        link = TappedLink(self._stand_in.link, self.recorder.raw)
        autopilot = make_autopilot(config, link, ParameterSet(config))
        assert isinstance(autopilot, MavlinkAutopilot)
        camera = simulated_camera(loaded, pad, lens, self._world, self.seed, lambda *_: None)
        assert isinstance(camera.pictures, NumberedPictures)
        gimbal = simulated_gimbal(
            loaded, self._world, self.seed, autopilot, self._stand_in.autopilot, realtime=False
        )
        companion = Companion(options.companion, stream(self.seed, "companion"))
        self.daemon = Daemon(
            config,
            layout,
            camera_model,
            Devices(camera, gimbal.driver, autopilot),
            vision_latency_s=companion.vision_latency_s,
            detectors=ModelledDetectors(
                layout, pad, camera_model, lens, options, camera.pictures, self.seed
            ),
            observers=(self.recorder,),
        )
        self._beside = [
            self._stand_in.autopilot.run,
            self._stand_in.ground_station.serve,
            self._stand_in.switch.run,
            *([gimbal.model.run] if gimbal.model else []),
        ]

    async def run(self) -> None:
        """Fly for as long as asked."""
        running: list[asyncio.Task[Any]] = [
            asyncio.ensure_future(work())
            for work in (*self._beside, self.daemon.run, self._land_for_ever)
        ]
        try:
            for hour in range(1, self.hours + 1):
                await asyncio.sleep(HOUR_S)
                self._look(hour)
                for task in running:
                    if task.done():
                        task.result()
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    async def _land_for_ever(self) -> None:
        copter, ground = self._stand_in.autopilot.copter, self._stand_in.ground_station
        random, switch = self._random, self._stand_in.switch
        copter.set_mode(Mode.GUIDED)
        while True:
            high_m = random.uniform(5.0, 12.0)
            aside = (random.uniform(-8.0, 8.0), random.uniform(-8.0, 8.0), -high_m)
            place = add(self._world.pad.position, aside)
            ground.send_to(place)
            await asyncio.sleep(random.uniform(5.0, 20.0))
            switch.set(high=True)
            if (self.landings + 1) % ABORTS_EVERY == 0:
                await self._abort()
            await self._until_down()
            switch.set(high=False)
            await asyncio.sleep(random.uniform(*STANDS_S))
            copter.set_mode(Mode.GUIDED)
            await ground.take_off(high_m)

    async def _abort(self) -> None:
        copter, switch = self._stand_in.autopilot.copter, self._stand_in.switch
        random = self._random
        await asyncio.sleep(random.uniform(2.0, 10.0))
        self.aborts += 1
        if random.random() < 0.5:
            copter.set_mode(Mode.LOITER)
        switch.set(high=False)
        await asyncio.sleep(random.uniform(1.0, 20.0))
        copter.set_mode(Mode.GUIDED)
        await asyncio.sleep(1.0)
        switch.set(high=True)

    async def _until_down(self) -> None:
        copter, loop = self._stand_in.autopilot.copter, asyncio.get_running_loop()
        end = loop.time() + LANDS_WITHIN_S
        while copter.armed and loop.time() < end:
            await asyncio.sleep(0.1)
        await asyncio.sleep(2.0)  # until heartbeats have told it
        lander = self.daemon.lander
        if not copter.armed and lander.outcome == "landed":
            self.landings += 1
            return
        said = f"{lander.phase.name}, {lander.outcome}"
        self.failures.append(
            f"{loop.time():.0f} s: not landed within {LANDS_WITHIN_S:.0f} s: {said}"
        )
        self._stand_in.switch.set(high=False)
        await self._stand_in.ground_station.put_down()

    def _look(self, hour: int) -> None:
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        objects = collections.Counter(type(o).__qualname__ for o in gc.get_objects())
        files = len(list(Path("/proc/self/fd").iterdir()))
        now = Hour(pages * PAGE / 1e6, objects, len(asyncio.all_tasks()), files)
        self.held.append(now)
        logs = sum(f.stat().st_size for f in self.folder.iterdir()) / 1e6
        print(
            f"{hour:2} h: {self.landings} landings, {self.aborts} aborts, "
            f"{len(self.failures)} failed, {now.memory_mb:.1f} MB, {now.objects.total()} objects, "
            f"{now.tasks} tasks, {now.files} files, {logs:.0f} MB of logs",
            flush=True,
        )

    @property
    def grew(self) -> bool:
        """Whether there are more tasks or open files than after the first hour."""
        first, last = self.held[0], self.held[-1]
        return last.tasks > first.tasks or last.files > first.files

    def report(self) -> None:
        """Print what failed and what has become more since the first hour."""
        for failure in (*self.failures, *self.recorder.failures):
            print(failure)
        print("faults counted:", dict(self.daemon.faults) or "none")
        more = self.held[-1].objects - self.held[0].objects
        print("more objects:", ", ".join(f"{n} {kind}" for kind, n in more.most_common(12)))


def main() -> None:
    """Soak, and print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--hours", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        soak = Soak(args.hours, args.seed, Path(folder))
        run_virtual(soak.run())
        soak.recorder.close()
        soak.report()
    sys.exit(bool(soak.failures or soak.grew))


if __name__ == "__main__":
    main()
