"""`landerd run`: the daemon; drives camera, gimbal and autopilot until it is stopped."""

import argparse
import asyncio
import contextlib
import gc
import logging
import os
import signal
import threading
import time
from pathlib import Path

from hw.autopilots.tlog import TlogEncoder
from landerd.camera_model import CalibrationError, CameraModel, left_out
from landerd.commands.shared import add_vehicle, load_with_saved, refusing
from landerd.config.models import Config
from landerd.devices import SetUpError, fitting_camera, make_devices
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.lander import Lander
from landerd.messages import Command, Input
from landerd.pad import PadError, PadLayout, load_pad
from landerd.preflight.computer import temperature_c
from landerd.preflight.sensors import LastFlight, sensors_file, write_sensors
from landerd.runtime.daemon import CoreFailed, Daemon
from landerd.runtime.observer import Observer
from landerd.runtime.service import ServiceNotifier, log_to_stderr
from landerd.web import FoxgloveServer, StatusPage

log = logging.getLogger("landerd")

CLOSE_S = 2.0  # longest wait for the disk at the process's end: a disk may hang for ever


class SensorNotes(Observer):
    """Writes what each landing found out about camera, gimbal and vision, for `landerd check`.

    It is written by a thread: a landing may end in the air, and orders must go on while a slow disk
    is waited for.
    """

    def __init__(self, path: Path) -> None:
        """Path: of the file, which each landing replaces."""
        self._path = path
        self._outcome: str | None = None
        self._writing: threading.Thread | None = None  # the newest thread that writes

    def on_flight(self, lander: Lander) -> None:
        """Take the lander, when a flight begins."""
        self._lander = lander

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Start a thread that writes the file, if a landing has ended in this step."""
        outcome, self._outcome = self._outcome, self._lander.outcome
        if self._outcome is None or self._outcome == outcome:
            return
        found = LastFlight(self._lander.sensor_errors, self._lander.flight_health)
        arguments = found, self._writing
        self._writing = threading.Thread(
            target=self._write, args=arguments, name="sensor notes", daemon=True
        )
        self._writing.start()

    def close(self) -> None:
        """Wait until the file is written, for at most CLOSE_S."""
        if self._writing is not None:
            self._writing.join(CLOSE_S)

    def _write(self, found: LastFlight, after: threading.Thread | None) -> None:
        """Write the file, after the thread that writes the landing before has ended."""
        if after is not None:
            after.join()
        try:
            write_sensors(self._path, found)
        except OSError as e:
            log.warning("what was found out about camera and gimbal is not kept: %s", e)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_vehicle(parser)


def run(args: argparse.Namespace) -> int:
    """Fly until SIGTERM or SIGINT and return 0, or until the core fails and return 1."""
    loaded, overlay = load_with_saved(args)
    config = loaded.config
    with refusing(CalibrationError, PadError, SetUpError):
        layout = load_pad(config.pad.layout)
        camera_model = fitting_camera(loaded)
        folder = _folder(config)
        recorder = _recorder(config, layout, camera_model, folder)
        devices = make_devices(loaded, overlay, recorder)
    log_to_stderr()
    if overlay.exists():
        log.info("saved parameters in %s replace those of the configuration", overlay)
    if remark := left_out(camera_model):
        log.warning("%s: %s", config.camera.calibration, remark)
    if recorder is None:
        log.warning("flights are not recorded: log.folder is not set")

    page = StatusPage.of(config, camera_model, layout, folder, temperature_c)
    both = (page, FoxgloveServer.of(config, camera_model, layout))
    viewers: list[StatusPage | FoxgloveServer] = [viewer for viewer in both if viewer is not None]
    kept = sensors_file()
    notes = SensorNotes(kept) if kept is not None else None

    async def fly() -> None:
        observers: list[Observer] = [ServiceNotifier()]
        if recorder is not None:
            observers.append(recorder)
        if notes is not None:
            observers.append(notes)
        daemon = Daemon(config, layout, camera_model, devices, observers=tuple(observers))
        for viewer in viewers:
            viewer.watch(daemon)
        await _run_until_signal(daemon)

    # Objects made so far are exempt from later garbage collections: collecting them, too, takes
    # 40 ms on a PC.
    gc.collect()
    gc.freeze()
    code = 0
    try:
        asyncio.run(fly())
    except CoreFailed:
        code = 1  # systemd starts it again
    finally:
        for each in (recorder, notes, *viewers):
            if each is not None:
                each.close()
    return code


async def _run_until_signal(daemon: Daemon) -> None:
    """Run the daemon until SIGTERM or SIGINT; it stops the vehicle before it ends."""
    signalled = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, signalled.set)
    flying = asyncio.create_task(daemon.run())
    ending = asyncio.create_task(signalled.wait())
    await asyncio.wait({flying, ending}, return_when=asyncio.FIRST_COMPLETED)
    if not flying.done():
        await daemon.shut_down()
        flying.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await flying


def _folder(config: Config) -> Path | None:
    """Return the folder for flight logs: log.folder, or the service's; None: there is neither."""
    state = os.environ.get("STATE_DIRECTORY")
    return config.log.folder or (Path(state) / "logs" if state else None)


def _recorder(
    config: Config, layout: PadLayout, camera: CameraModel, folder: Path | None
) -> Recorder | None:
    """Return the recorder that writes flight logs into a folder; None without a folder."""
    if folder is None:
        return None
    head = Head(config, layout, camera, wall_offset_s=time.time() - time.monotonic())
    return Recorder(head, config.log, folder, background=True, mavlink=TlogEncoder)
