"""landerd held to a quarter of a core, and at full speed: what a small computer would do with it.

    python -m bench.small_computer                # a quarter of one core, then without limit
    python -m bench.small_computer --shares 0.5
    python -m bench.small_computer --shares 1 --viewer    # with the status page, and one who looks

A simulated vehicle lands with `landerd run` in a process of its own: MAVLink over UDP, 30 pictures
of 640x480 a second through a socket. That process, with all its threads, may use so much of one
core and no more (a cgroup's bandwidth, in slices of 10 ms; needs root); world and pictures are made
outside of the limit. A Raspberry Pi 4's core is four to six times slower than one of a PC, and it
has four of them, of which landerd uses two: a quarter of one core of a PC is the stricter.

Printed: pictures searched a second while the pad is not in view (`looking`); of the time between
the first sighting and contact pictures that came and that were searched a second, from a picture's
coming to the next set-point (p50, p99), gaps between set-points (p99, longest), and how much of a
core landerd used. Of the whole run: from the start of the program to its first heartbeat, and the
most memory it held (at most 3 s and 150 MB at full speed, else exit code 1). `late` is the longest
pause of the world outside: with more than 0.05 s the computer was busy with other things.
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

SHARES = (0.25, 1.0)  # of one core; 1: no limit
PERIOD_US = 10_000
CGROUPS = Path("/sys/fs/cgroup")
PORT, PAGE_PORT = 14_592, 14_593
CONFIG = f"""\
include: [{config_dir()}/default.yaml, {config_dir()}/scenarios/hover.yaml]
autopilot: {{url: "udpin:127.0.0.1:{PORT}"}}
gimbal: {{driver: mavlink}}
aim: {{idle_pitch_deg: -30.0}}
camera: {{exposure: fixed}}
sim: {{start: {{position_m: [-0.8, 0.4], altitude_m: 10.0, spread_m: 0.0}}}}
"""
PAGE = f"""\
web: {{listen: "127.0.0.1:{PAGE_PORT}"}}
"""
LOW_US, HIGH_US = 1100, 1900
LONGEST_S = 90.0
MOST_START_S, MOST_MB = 3.0, 150.0


# ---- inside the limit --------------------------------------------------------------------------


@dataclass
class Notes(Observer):
    """When what was done with which picture, on the clock that all processes share; s."""

    searched: dict[int, float] = field(default_factory=dict)  # by the picture's number
    followed: dict[int, float] = field(default_factory=dict)  # by a set-point, what was seen in it
    setpoints: list[float] = field(default_factory=list)
    first_seen: float | None = None
    used_before_s: float = 0.0  # of the processor, until then
    _last: int | None = None

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """A picture was searched."""
        self.searched[frame.seq] = time.monotonic()
        if sightings.pad and self.first_seen is None:
            self.first_seen = time.monotonic()
            self.used_before_s = time.process_time()

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """The core gave orders."""
        if isinstance(message, Sightings):
            self._last = message.seq
        if any(isinstance(c, Setpoint) for c in commands):
            self.setpoints.append(time.monotonic())
            if self._last is not None:
                self.followed[self._last] = time.monotonic()
                self._last = None


def inside(folder: Path) -> int:
    """Run `landerd run`, and write down what came of its pictures."""
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


# ---- outside of it -----------------------------------------------------------------------------


class NotLimitedError(Exception):
    """A process cannot be held to a share of a core here."""


@contextlib.contextmanager
def limited(share: float) -> Iterator[list[str]]:
    """Yield what stands before a command that may use so much of one core; 1: no limit."""
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
    """What is seen of landerd from outside, on the same clock."""

    came: dict[int, float] = field(default_factory=dict)  # when pictures were sent
    first_byte: float | None = None
    late_s: float = 0.0
    memory_mb: float = 0.0
    used_s: float = 0.0  # by landerd, of the processor, until contact

    def watch(self, simulation: Simulation) -> None:
        """Note what goes to landerd's camera and what comes from it."""
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
        """Note what landerd has used, by its folder in /proc."""
        (line,) = [x for x in (process / "status").open() if x.startswith("VmHWM")]
        self.memory_mb = int(line.split()[1]) / 1e3
        user, system = (process / "stat").read_text(encoding="utf-8").split()[13:15]
        self.used_s = (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    async def own_pauses(self) -> None:
        """Measure how late this process is."""
        while True:
            due = time.monotonic() + 0.02
            await asyncio.sleep(0.02)
            self.late_s = max(self.late_s, time.monotonic() - due)


def compiled(folder: Path) -> dict[str, str]:
    """Return the environment of a program whose modules are compiled, as an installed one's are."""
    env = {**os.environ, "PYTHONPYCACHEPREFIX": str(folder / "compiled")}
    env.pop("PYTHONDONTWRITEBYTECODE", None)
    imports = "import bench.small_computer, landerd.commands.run; from landerd import drivers"
    call = [sys.executable, "-c", f"{imports}; drivers.options_models()"]
    subprocess.run(call, env=env, check=True)
    return env


async def look() -> None:
    """Ask for what the status page shows, as often as the page itself does."""
    seen = 0
    while True:
        began = time.monotonic()
        address = f"http://127.0.0.1:{PAGE_PORT}/view?seen={seen}"
        with contextlib.suppress(OSError):  # not served yet
            view = json.loads(await asyncio.to_thread(fetched, address))
            seen = (view.get("picture") or {"seq": seen})["seq"]
        await asyncio.sleep(max(0.02, 0.2 - (time.monotonic() - began)))


def fetched(address: str) -> bytes:
    """Return what stands there. Raises OSError."""
    with urllib.request.urlopen(address, timeout=4.0) as answer:
        data: bytes = answer.read()
    return data


async def landing(share: float, folder: Path, is_looked_at: bool) -> dict[str, float]:
    """Let a vehicle land; return what was measured."""
    (folder / "landerd.yaml").write_text(CONFIG + PAGE * is_looked_at, encoding="utf-8")
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
                simulation.autopilot.pilot.set(simulation.config.rc.gate_channel, HIGH_US)
                outside.late_s = 0.0
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
    """Read notes; JSON has made texts of the numbers of pictures."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return {
        k: {int(n): t for n, t in v.items()} if isinstance(v, dict) else v for k, v in data.items()
    }


def figures(notes: Notes, outside: Outside, ended: float) -> dict[str, float]:
    """Return what is printed."""
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
        "gap_most_ms": 1e3 * max(gaps),
        "cores_used": (outside.used_s - notes.used_before_s) / length,
        "memory_mb": outside.memory_mb,
        "late_s": outside.late_s,
    }


async def until(done: Any) -> None:
    """Wait. Raises TimeoutError."""
    async with asyncio.timeout(LONGEST_S):
        while not done():
            await asyncio.sleep(0.02)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each share of a core."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--shares", nargs="+", type=float, default=list(SHARES))
    parser.add_argument("--viewer", action="store_true", help="one who looks at the status page")
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    if args.inside is not None:
        return inside(args.inside)
    code = 0
    for share in args.shares:
        try:
            with tempfile.TemporaryDirectory() as name:
                found = run_realtime(landing(share, Path(name), args.viewer))
        except NotLimitedError as e:
            print(f"{share:g} of a core: not measured: {e}")
            continue
        print(f"{share:g} of a core: " + ", ".join(f"{k} {v:.4g}" for k, v in found.items()))
        if share >= 1.0 and (found["start_s"] > MOST_START_S or found["memory_mb"] > MOST_MB):
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
