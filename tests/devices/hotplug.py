"""In the virtual machine: devices that come late, and cables that are pulled and put back."""

import asyncio
import contextlib
import logging
import math
import os
import time
from pathlib import Path

from hw.links.serial import SerialLink
from hw.sim.gimbals.mount import SimMount
from hw.sim.gimbals.simplebgc import SimpleBgcModel
from hw.sim.options import SimGimbalOptions
from hw.sim.physics.gimbal import GimbalPlant
from landerd.camera_model import load_camera
from landerd.devices import make_devices
from landerd.messages import Attitude, Command, Frame, GimbalState, Input, Prior, Sightings
from landerd.pad import load_pad
from landerd.runtime.daemon import Daemon
from landerd.runtime.observer import Observer
from tests.devices.bench import sh, show, wait_for
from tests.devices.kernel import (
    AUTOPILOT,
    CAMERA,
    GIMBAL,
    configuration,
    plug_in_camera,
    plug_in_serial,
)
from tests.hw.flight import PlainAirframe, plain_autopilot

BACK_S = TOLD_S = 1.0
LOOP_S = 0.4  # of a million turns of a loop on an emulated processor that has nothing else to do


# ---- the service ----


def check_the_service_takes_up_devices_whose_drivers_are_loaded_later() -> None:
    """It comes first: no module of cameras, USB serial ports or I2C has been loaded."""
    names = Path("/proc/devices").read_text()
    assert not any(name in names for name in ("video4linux", "ttyACM", "i2c")), names
    said = sh("systemctl start landerd")  # returns when it is ready
    assert show("ActiveState") == "active", said + sh("journalctl -u landerd -n 30")
    plug_in_camera()
    plug_in_serial()
    folder = Path(f"/proc/{show('MainPID')}/fd")

    unused = {CAMERA, AUTOPILOT, GIMBAL}

    def all_used() -> bool:
        with contextlib.suppress(OSError):  # a file closed in the meantime
            for path in folder.iterdir():
                unused.discard(os.readlink(path))
        return not unused

    try:
        print(f"  all taken up {wait_for(all_used, 'use of all'):.2f} s later")
        assert show("NRestarts") == "0"
        start = time.monotonic()
        sh("systemctl stop landerd")  # nobody takes what it has written to the ports
        print(f"  stopped in {time.monotonic() - start:.2f} s")
        assert show("Result") == "success", show("Result")
    except AssertionError:
        print(sh("journalctl -u landerd -o short-monotonic --no-hostname"))
        raise
    sh("rmmod vivid g_serial")


# ---- the daemon ----


def busyness() -> float:
    """Return how much slower this thread is than on a processor that has nothing else to do."""
    start, turns = time.monotonic(), 0
    for turn in range(1_000_000):
        turns += turn
    return max(1.0, (time.monotonic() - start) / LOOP_S)


class Seen(Observer):
    """An observer that keeps the time of the last input of each kind."""

    def __init__(self) -> None:
        self.t = {"camera": -math.inf, "gimbal": -math.inf, "autopilot": -math.inf}

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        self.t["camera"] = frame.t  # the search takes its time here

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        if isinstance(message, GimbalState):
            self.t["gimbal"] = now
        elif isinstance(message, Attitude):
            self.t["autopilot"] = now


class StillMount(SimMount):
    """The model of a gimbal that stands still, without a world."""

    def __init__(self) -> None:
        self.plant = GimbalPlant(SimGimbalOptions())
        self.measured_t = -math.inf
        self.reported = lambda _: None

    def advance(self) -> None:
        pass

    def aim(self, yaw: float, pitch: float) -> None:
        pass

    def measure(self, *, pitch_measured: bool = True) -> tuple[float, float]:
        return 0.0, -0.5


class Lines(logging.Handler):
    """A handler that keeps all log lines."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def check_camera_autopilot_and_gimbal_unplugged_in_flight_and_plugged_in_again() -> None:
    plug_in_camera()
    plug_in_serial()
    loaded = configuration()
    seen, lines = Seen(), Lines()
    logging.getLogger("landerd").addHandler(lines)

    async def back(what: str, limit_s: float) -> None:
        loop = asyncio.get_running_loop()
        start = loop.time()
        while seen.t[what] < start:
            assert loop.time() < start + 60.0, f"no {what}"
            await asyncio.sleep(0.01)
        took = seen.t[what] - start
        print(f"  {what} in use {took:.2f} s after it was plugged in")
        assert took < limit_s, f"limit {limit_s} s"

    async def lost(what: str, limit_s: float) -> None:
        start = time.monotonic()
        while not any(line.startswith(f"{what} lost: ") for line in lines.lines):
            assert time.monotonic() < start + limit_s, f"the loss of the {what} was not told"
            await asyncio.sleep(0.01)
        line = next(line for line in lines.lines if line.startswith(f"{what} lost: "))
        print(f"  told {time.monotonic() - start:.2f} s after the plug was pulled: {line}")

    async def main() -> None:
        model = load_camera(loaded.config.camera.calibration)
        devices = make_devices(loaded, Path("/tmp/saved.yaml"))
        pad = load_pad(loaded.config.pad.layout)
        daemon = Daemon(loaded.config, pad, model, devices, observers=(seen,))
        autopilot = plain_autopilot(
            PlainAirframe(), [SerialLink("/dev/ttyGS0", 115200)], flying=True
        )
        gimbal = SimpleBgcModel(StillMount(), SerialLink("/dev/ttyGS1", 115200))
        jobs = (autopilot.run(), gimbal.run(), daemon.run())
        tasks = [asyncio.create_task(job) for job in jobs]
        for what in seen.t:
            await back(what, 60.0)
        lines.lines.clear()
        busy = await asyncio.to_thread(busyness)
        print(
            f"  limits of 1 s are {busy:.1f} s here: so much slower is a thread beside the daemon"
        )
        await asyncio.to_thread(sh, f"v4l2-ctl -d {CAMERA} -c disconnect=1")
        await lost("camera", busy * TOLD_S)
        await asyncio.to_thread(sh, "rmmod vivid")
        await asyncio.to_thread(plug_in_camera)
        await back("camera", busy * BACK_S)
        await asyncio.to_thread(sh, "rmmod g_serial")
        await lost("autopilot", busy * TOLD_S)
        await lost("gimbal", busy * TOLD_S)
        await asyncio.sleep(1.0)
        await asyncio.to_thread(plug_in_serial)
        await asyncio.gather(*(back(what, busy * BACK_S) for what in ("autopilot", "gimbal")))
        for task in tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*tasks)

    asyncio.run(main())
    sh("rmmod vivid")
