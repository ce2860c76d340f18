"""Measures landerd limited to a quarter of a core, as on a small computer, and without limit.

    python -m bench.small_computer                # a quarter of one core, then without limit
    python -m bench.small_computer --shares 0.5
    python -m bench.small_computer --shares 1 --viewer    # with the status page, and one who looks
    python -m bench.small_computer --shares 1 --hold 600 --busy 4

A simulated vehicle lands with `landerd run` in a process of its own: MAVLink over UDP, and 30
pictures of 640x480 per second through a socket. That process, with all its threads, may use only a
share of one core (the bandwidth of a cgroup, in periods of 10 ms; this needs root); world and
pictures are made outside that limit. A core of a Raspberry Pi 4 is four to six times slower than
one of a PC, but it has four, of which landerd uses two: a quarter of one core of a PC is less.

Printed are: the rate at which pictures are searched while the pad is not in view (`looking`);
between the first sighting and contact, the rates of pictures that arrived and that were searched,
the time from a picture's arrival to the next set-point (p50, p99), the gaps between set-points
(p99, p99.9, longest), and the share of a core that landerd used; and for the whole run, the time
from the start of the program to its first heartbeat and its peak memory (at most 3 s and 150 MB
without limit, else the exit code is 1). `late` is the longest pause of the world outside: above
0.05 s, the computer was busy with other things. With `--hold` the pilot first asks to hold over the
pad for so many seconds, and with `--busy` so many processes beside compute all the time. Flights
are logged with pictures, as delivered.
"""

import argparse
import asyncio
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np

import landerd.commands.run as run_command
from landerd.cli import main as landerd
from landerd.config.files import config_dir
from landerd.drivers import DRIVERS, Driver
from landerd.messages import Command, Frame, Input, Prior, Setpoint, Sightings
from landerd.runtime.clock import run_realtime
from landerd.runtime.daemon import Daemon
from landerd.runtime.observer import Observer
from landerd.simulation.flight import Simulation
from tests.devices.outside import SocketCamera, flying

SHARES = (0.25, 1.0)  # shares of one core; 1: no limit
PERIOD_US = 10_000  # of a cgroup's bandwidth
CGROUPS = Path("/sys/fs/cgroup")
PORT, PAGE_PORT = 14_592, 14_593
CONFIG = f"""\
include: [{config_dir()}/default.yaml, {config_dir()}/scenarios/hover.yaml]
rc: {{gate_threshold_us: 1300, land_threshold_us: 1700}}
autopilot: {{url: "udpin:127.0.0.1:{PORT}"}}
gimbal: {{driver: mavlink}}
aim: {{idle_pitch_deg: -30.0}}
camera: {{exposure: fixed}}
sim: {{start: {{position_m: [-0.8, 0.4], altitude_m: 10.0, spread_m: 0.0}}}}
"""
LOGS = """\
log: {{folder: "{folder}"}}
"""
PAGE = f"""\
web: {{listen: "127.0.0.1:{PAGE_PORT}"}}
"""
LOW_US, HOLD_US, HIGH_US = 1100, 1500, 1900  # pulse widths of the pilot's switch
LONGEST_S = 90.0  # longest time for each step of a flight
BUSY = "while True: pass"
MOST_START_S, MOST_MB = 3.0, 150.0  # limits of start and memory without a limit of the core


# ---- inside the limit --------------------------------------------------------------------------


@dataclass
class Notes(Observer):
    """What landerd did when; times are on the clock that all processes share, s."""

    searched: dict[int, float] = field(default_factory=dict)  # end of a search, by picture
    # The first set-point after a picture's sightings, by the picture's number.
    followed: dict[int, float] = field(default_factory=dict)
    setpoints: list[float] = field(default_factory=list)  # all set-points
    first_seen: float | None = None  # the first sighting of the pad
    used_before_s: float = 0.0  # CPU time until then
    _last: int | None = None  # picture of the last sightings without a set-point yet

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Note that a picture was searched."""
        self.searched[frame.seq] = time.monotonic()
        if sightings.pad and self.first_seen is None:
            self.first_seen = time.monotonic()
            self.used_before_s = time.process_time()

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Note the set-points of a step."""
        if isinstance(message, Sightings):
            self._last = message.seq
        if any(isinstance(c, Setpoint) for c in commands):
            self.setpoints.append(time.monotonic())
            if self._last is not None:
                self.followed[self._last] = time.monotonic()
                self._last = None


def inside(folder: Path) -> int:
    """Run `landerd run`, and write its notes to a file; return the exit code."""
    notes = Notes()

    class Watched(Daemon):
        def __init__(self, *args: Any, observers: tuple[Observer, ...] = (), **kwargs: Any) -> None:
            super().__init__(*args, observers=(*observers, notes), **kwargs)

    vars(run_command)["Daemon"] = Watched
    module = "tests.devices.outside"
    cameras = cast(dict[str, Driver], DRIVERS["camera"])
    cameras["sim"] = Driver(f"{module}:SocketCamera", f"{module}:SocketCameraOptions")
    SocketCamera.path = folder / "pictures"
    code = landerd(["run", "-c", str(folder / "landerd.yaml")])
    (folder / "notes.json").write_text(json.dumps(vars(notes)), encoding="utf-8")
    return code


# ---- outside the limit -------------------------------------------------------------------------


class NotLimitedError(Exception):
    """A process cannot be limited to a share of a core here."""


@contextlib.contextmanager
def limited(share: float) -> Iterator[list[str]]:
    """Yield the beginning of a command line that limits a command to a share of one core.

    A share of 1 is no limit.

    Raises:
        NotLimitedError: there are no cgroups, or no rights to use them.
    """
    if share >= 1.0:
        yield []
        return
    quota = round(share * PERIOD_US)
    is_v2 = (CGROUPS / "cgroup.controllers").exists()
    group = CGROUPS / ("" if is_v2 else "cpu") / f"landerd-bench-{os.getpid()}"
    try:
        group.mkdir()
        if is_v2:
            (group / "cpu.max").write_text(f"{quota} {PERIOD_US}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(PERIOD_US))
            (group / "cpu.cfs_quota_us").write_text(str(quota))
    except OSError as e:
        raise NotLimitedError(f"{group}: {e.strerror}: a limit needs root and cgroups") from None
    try:
        yield ["sh", "-c", f'echo $$ >{group}/cgroup.procs && exec "$@"', "sh"]
    finally:
        group.rmdir()


@dataclass
class Outside:
    """What is observed of landerd from outside, on the same clock as `Notes`."""

    came: dict[int, float] = field(default_factory=dict)  # when pictures were sent, by number
    first_byte: float | None = None  # of landerd on the link
    late_s: float = 0.0  # longest pause of this process
    memory_mb: float = 0.0  # landerd's peak memory
    used_s: float = 0.0  # landerd's CPU time until contact

    def watch(self, simulation: Simulation) -> None:
        """Note pictures on their way to landerd, and its first byte on the link."""
        newest, tap = simulation.camera.newest, simulation.link.tap

        async def noted() -> Frame:
            frame = await newest()
            self.came[frame.seq] = time.monotonic()
            return frame

        def heard(t: float, data: bytes) -> None:
            self.first_byte = self.first_byte or time.monotonic()
            if tap is not None:
                tap(t, data)

        simulation.camera.newest = noted  # type: ignore[method-assign]
        simulation.link.tap = heard

    def take_stock(self, process: Path) -> None:
        """Note the memory and CPU time of a process by its folder in /proc."""
        (line,) = [x for x in (process / "status").open() if x.startswith("VmHWM")]
        self.memory_mb = int(line.split()[1]) / 1e3
        user, system = (process / "stat").read_text(encoding="utf-8").split()[13:15]
        self.used_s = (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    async def own_pauses(self) -> None:
        """Measure how long this process pauses, until cancelled."""
        while True:
            due = time.monotonic() + 0.02
            await asyncio.sleep(0.02)
            self.late_s = max(self.late_s, time.monotonic() - due)


def compiled(folder: Path) -> dict[str, str]:
    """Return an environment in which modules are compiled already, as those of an installed one."""
    env = {**os.environ, "PYTHONPYCACHEPREFIX": str(folder / "compiled")}
    env.pop("PYTHONDONTWRITEBYTECODE", None)
    imports = "import bench.small_computer, landerd.commands.run; from landerd import drivers"
    call = [sys.executable, "-c", f"{imports}; drivers.options_models()"]
    subprocess.run(call, env=env, check=True)
    return env


async def look() -> None:
    """Request what the status page shows as often as the page does, until cancelled."""
    seen = 0
    while True:
        began = time.monotonic()
        address = f"http://127.0.0.1:{PAGE_PORT}/view?seen={seen}"
        with contextlib.suppress(OSError):  # not served yet
            view = json.loads(await asyncio.to_thread(fetched, address))
            seen = (view.get("picture") or {"seq": seen})["seq"]
        await asyncio.sleep(max(0.02, 0.2 - (time.monotonic() - began)))


def fetched(address: str) -> bytes:
    """Return the document at an address. Raises OSError."""
    with urllib.request.urlopen(address, timeout=4.0) as answer:
        data: bytes = answer.read()
    return data


@contextlib.contextmanager
def busy(number: int) -> Iterator[None]:
    """Keep this number of processes computing."""
    processes = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


async def landing(
    share: float, folder: Path, hold_s: float, *, is_looked_at: bool
) -> dict[str, float]:
    """Let a vehicle land; return what was measured.

    Args:
        share: of one core, that landerd may use.
        folder: for files of this landing.
        hold_s: time for which it holds over the pad first, s.
        is_looked_at: whether the status page is served and requested.
    """
    config = CONFIG + LOGS.format(folder=folder / "logs") + PAGE * is_looked_at
    (folder / "landerd.yaml").write_text(config, encoding="utf-8")
    SocketCamera.path = folder / "pictures"
    outside = Outside()
    async with flying(folder / "landerd.yaml", f"udpout:127.0.0.1:{PORT}") as simulation:
        outside.watch(simulation)
        simulation.autopilot.pilot.set(simulation.config.rc.gate_channel, LOW_US)
        env = await asyncio.to_thread(compiled, folder)
        with limited(share) as before:
            began = time.monotonic()
            command = [*before, sys.executable, "-m", "bench.small_computer", "--inside"]
            said = (folder / "said").open("w+", encoding="utf-8")
            process = subprocess.Popen([*command, str(folder)], stderr=said, env=env)
            tasks = [asyncio.create_task(outside.own_pauses())]
            if is_looked_at:
                tasks.append(asyncio.create_task(look()))
            try:
                await until(lambda: outside.first_byte is not None)
                await asyncio.sleep(5.0)
                switch = partial(simulation.autopilot.pilot.set, simulation.config.rc.gate_channel)
                outside.late_s = 0.0
                if hold_s > 0.0:
                    switch(HOLD_US)
                    await asyncio.sleep(hold_s)
                switch(HIGH_US)
                await until(lambda: simulation.score.contact is not None)
                ended = time.monotonic()
                outside.take_stock(Path("/proc") / str(process.pid))
            except TimeoutError:
                told = [text for _, text in simulation.rules.texts]
                raise SystemExit(
                    f"no landing; the pilot was told {told}; landerd said\n"
                    + (folder / "said").read_text(encoding="utf-8")
                ) from None
            finally:
                for task in tasks:
                    task.cancel()
                process.terminate()
                await asyncio.to_thread(process.wait)
    notes = Notes(**{k: v for k, v in read(folder / "notes.json").items() if k != "_last"})
    assert outside.first_byte is not None
    return {"start_s": outside.first_byte - began, **figures(notes, outside, ended)}


def read(path: Path) -> dict[str, Any]:
    """Return the notes in a file, with the numbers of pictures, which JSON keeps as texts."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return {
        k: {int(n): t for n, t in v.items()} if isinstance(v, dict) else v for k, v in data.items()
    }


def figures(notes: Notes, outside: Outside, ended: float) -> dict[str, float]:
    """Return what is printed of a landing that ended at a time, s."""
    began = notes.first_seen or ended
    length = ended - began
    came = [t for t in outside.came.values() if began < t < ended]
    searched = [t for t in notes.searched.values() if began < t < ended]
    after = [t - outside.came[n] for n, t in notes.followed.items() if began < t < ended]
    setpoints = [t for t in notes.setpoints if began < t < ended]
    gaps = [b - a for a, b in pairwise(setpoints)]
    looked = sorted(t for t in notes.searched.values() if t < began)
    return {
        "looking_hz": (len(looked) - 1) / (looked[-1] - looked[0]) if len(looked) > 2 else np.nan,
        "landing_s": length,
        "came_hz": len(came) / length,
        "searched_hz": len(searched) / length,
        "after_p50_ms": 1e3 * float(np.quantile(after, 0.5)),
        "after_p99_ms": 1e3 * float(np.quantile(after, 0.99)),
        "gap_p99_ms": 1e3 * float(np.quantile(gaps, 0.99)),
        "gap_p999_ms": 1e3 * float(np.quantile(gaps, 0.999)),
        "gap_most_ms": 1e3 * max(gaps),
        "cores_used": (outside.used_s - notes.used_before_s) / length,
        "memory_mb": outside.memory_mb,
        "late_s": outside.late_s,
    }


async def until(done: Any) -> None:
    """Wait until a function returns True. Raises TimeoutError."""
    async with asyncio.timeout(LONGEST_S):
        while not done():
            await asyncio.sleep(0.02)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each share of a core; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--shares", nargs="+", type=float, default=list(SHARES))
    parser.add_argument("--viewer", action="store_true", help="one who looks at the status page")
    parser.add_argument("--hold", type=float, default=0.0, metavar="SECONDS", help="over the pad")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="processes beside it")
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    if args.inside is not None:
        return inside(args.inside)
    code = 0
    for share in args.shares:
        try:
            with tempfile.TemporaryDirectory() as name, busy(args.busy):
                found = run_realtime(
                    landing(share, Path(name), args.hold, is_looked_at=args.viewer)
                )
        except NotLimitedError as e:
            print(f"{share:g} of a core: not measured: {e}")
            continue
        print(f"{share:g} of a core: " + ", ".join(f"{k} {v:.4g}" for k, v in found.items()))
        if share >= 1.0 and (found["start_s"] > MOST_START_S or found["memory_mb"] > MOST_MB):
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
