"""landerd's process on the simulated computer, which may hang, fail, be stopped or be killed."""

import asyncio
from collections.abc import Callable
from typing import NoReturn

from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.lander import Lander
from landerd.messages import Command, Frame, Input, Prior, Sightings, Tick
from landerd.pad import PadLayout
from landerd.ports import ByteLink
from landerd.runtime.daemon import SEARCH_S, CoreFailed, Daemon, Devices
from landerd.runtime.observer import Observer
from landerd.simulation.companion import Companion, stand_still
from landerd.vision import Detectors, Vision

RESTART_S = 2.0  # from a process's end to the first step of the next: RestartSec, Python's start


class Computer:
    """The faults of the computer; implements hw.sim.faults.bench.Computer.

    Attributes:
        search_s: time added to the search of a picture, s.
        slow_disk_s: time for which recording a picture blocks the event loop, s.
        errors: exceptions that parts of the process raise, by part.
        process: landerd's process.
    """

    process: "Process"

    def __init__(self) -> None:
        self.search_s = self.slow_disk_s = 0.0
        self.errors: dict[str, Exception] = {}

    def stall(self, duration_s: float) -> None:
        """Block the process for this time, s."""
        stand_still(duration_s)

    def fail(self, part: str, error: Exception | None) -> None:
        """Let a part raise an error from now on; None: no longer."""
        if error is None:
            self.errors.pop(part, None)
        else:
            self.errors[part] = error

    def check(self, part: str) -> None:
        """Raise the part's error, if it has one."""
        error = self.errors.get(part)
        if error is not None:
            raise error

    def terminate(self) -> None:
        """Ask the process to end, as SIGTERM and SIGINT do."""
        self.process.terminate()

    def kill(self) -> None:
        """Kill the process at once, as SIGKILL does; it is started again."""
        self.process.kill()


class Process:
    """Runs the daemon, and starts a new one when it ends, as systemd would.

    Attributes:
        daemon: the one that runs, or ran last.
        over_t: when it ended after it was asked to, s; None: it runs.
    """

    def __init__(
        self,
        start: Callable[[], Daemon],
        companion: Companion,
        died: Callable[[float], None],
        *,
        restarts: bool,
    ) -> None:
        """Make the first daemon.

        Args:
            start: makes a daemon.
            companion: the computer that it runs on.
            died: called when the process was killed.
            restarts: a daemon that fails is started again; otherwise its error is raised.
        """
        self.daemon = start()
        self.over_t: float | None = None
        self._start = start
        self._companion = companion
        self._died = died
        self._restarts = restarts
        self._running: asyncio.Task[NoReturn] | None = None
        self._ending: asyncio.Task[None] | None = None
        self._killed = False

    async def run(self) -> None:
        """Run the daemon until it is asked to end. Raises CoreFailed."""
        loop = asyncio.get_running_loop()
        running = self._running or self.begin()
        while True:
            try:
                await running
            except asyncio.CancelledError:
                if self._ending is not None:
                    self.over_t = loop.time()
                    return
                if not self._killed:
                    running.cancel()
                    raise
            except CoreFailed:
                if not self._restarts:
                    raise
            self._killed = False
            await asyncio.sleep(RESTART_S)
            if self._ending is not None:  # it was asked to end meanwhile
                self.over_t = loop.time()
                return
            self.daemon = self._start()
            running = self.begin()

    def begin(self) -> asyncio.Task[NoReturn]:
        """Start the daemon's tasks."""
        context = self._companion.context()
        running = asyncio.get_running_loop().create_task(self.daemon.run(), context=context)
        self._running = running
        return running

    def terminate(self) -> None:
        """Let the daemon stop the vehicle and end; one that is down is not started again."""
        running = self._running

        async def end() -> None:
            if running is not None and not running.done():
                await self.daemon.shut_down()
                running.cancel()

        if self._ending is None:
            context = self._companion.context()
            self._ending = asyncio.get_running_loop().create_task(end(), context=context)

    def kill(self) -> None:
        """Kill the daemon at once."""
        if self._running is not None and not self._running.done() and self._ending is None:
            self._killed = True
            self._died(asyncio.get_running_loop().time())
            self._running.cancel()


class BreakableDaemon(Daemon):
    """The daemon, whose core and sending may be made to fail."""

    def __init__(
        self,
        config: Config,
        layout: PadLayout,
        camera_model: CameraModel,
        devices: Devices,
        *,
        vision_latency_s: float | None,
        detectors: Detectors | None,
        observers: tuple[Observer, ...],
        computer: Computer,
    ) -> None:
        self.computer = computer
        super().__init__(
            config,
            layout,
            camera_model,
            devices,
            vision_latency_s=vision_latency_s,
            detectors=detectors,
            observers=observers,
        )

    def _new_vision(self) -> Vision:
        return BreakableVision(super()._new_vision(), self.computer)

    async def _search(self, frame: Frame) -> tuple[Prior, Sightings] | None:
        searched = await super()._search(frame)
        await asyncio.sleep(min(self.computer.search_s, SEARCH_S))
        if self.computer.search_s > SEARCH_S:
            self._fault_log.add("search of an image hangs", f"given up after {SEARCH_S:g} s")
            return None
        return searched

    def _take(self, message: Input) -> None:
        error = self.computer.errors.pop("core", None) if isinstance(message, Tick) else None
        if error is not None:

            def fails(message: Input) -> list[Command]:
                raise error

            self.lander.step = fails  # type: ignore[method-assign]
        super()._take(message)


class BreakableVision(Vision):
    """Vision that raises the computer's error, if there is one."""

    def __init__(self, vision: Vision, computer: Computer) -> None:
        self._inner = vision
        self._computer = computer

    def process(self, frame: Frame, prior: Prior | None = None) -> Sightings:
        """Return all that a frame shows of the pad."""
        self._computer.check("search")
        return self._inner.process(frame, prior)


class BreakableLink:
    """A ByteLink whose `write` raises the computer's error, if there is one."""

    def __init__(self, link: ByteLink, computer: Computer) -> None:
        self._link = link
        self._computer = computer

    async def open(self) -> None:
        """Connect. Raises DeviceLost."""
        await self._link.open()

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there. Raises DeviceLost."""
        return await self._link.read()

    def write(self, data: bytes) -> None:
        """Queue bytes, or raise."""
        self._computer.check("sending")
        self._link.write(data)

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
        await self._link.close()


class FaultyDisk(Observer):
    """An observer that passes everything to a recorder, with the faults of a full or slow disk."""

    def __init__(self, computer: Computer) -> None:
        self._computer = computer

    def on_flight(self, lander: Lander) -> None:
        """A flight begins."""
        self._computer.check("disk")

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """A picture is recorded."""
        self._computer.check("disk")
        if self._computer.slow_disk_s:
            stand_still(self._computer.slow_disk_s)

    def on_vision_reset(self) -> None:
        """Vision was replaced."""
        self._computer.check("disk")

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """A step is recorded."""
        self._computer.check("disk")
