"""`landerd check`: opens and measures every device and says what would stop a landing."""

import argparse
import asyncio
import dataclasses
import logging
import os
import shutil
from pathlib import Path

from hw.cameras import v4l2
from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.commands.shared import (
    add_config,
    add_json,
    add_overlay,
    load_with_saved,
    print_json,
    refusing,
)
from landerd.config.files import Loaded
from landerd.devices import SetUpError, camera_options, fitting_camera, make_devices
from landerd.pad import PadError, load_pad
from landerd.ports import Camera
from landerd.preflight.autopilot import AutopilotCheck
from landerd.preflight.camera import check_camera
from landerd.preflight.finding import Finding
from landerd.preflight.gimbal import check_gimbal
from landerd.preflight.sensors import read_sensors, sensor_findings, sensors_file
from landerd.runtime.daemon import Devices
from landerd.vision import Vision

_STATE = Path("/var/lib")  # in it systemd gives each service a folder of its name
_LEAST_FREE_MB = 500.0  # of the logs' disk
_MARKS = {"ok": "ok  ", "warn": "WARN", "fail": "FAIL"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_json(parser)
    add_config(parser, required=True)
    add_overlay(parser)


def run(args: argparse.Namespace) -> int:
    """Check; return 0 if ready, or 1 if something would stop a landing."""
    loaded, overlay = load_with_saved(args)
    logging.basicConfig(level=logging.CRITICAL)  # what drivers would say is in the findings
    with refusing(CalibrationError, PadError, SetUpError):
        load_pad(loaded.config.pad.layout)
        load_camera(loaded.config.camera.calibration)
        devices = make_devices(loaded, overlay)
    findings = asyncio.run(check(loaded, devices, _service_folder(args.config)))
    ready = not any(f.level == "fail" for f in findings)
    if args.json:
        print_json({"ready": ready, "findings": [dataclasses.asdict(f) for f in findings]})
    else:
        for finding in findings:
            mend = f" -> {finding.mend}" if finding.mend else ""
            print(f"{_MARKS[finding.level]} {finding.item}: {finding.what}{mend}")
        print("ready" if ready else "not ready: what is marked FAIL would stop a landing")
    return 0 if ready else 1


def _service_folder(config: Path) -> Path:
    """Return where the service that reads a configuration, /etc/landerd/NAME.yaml, keeps things."""
    return _STATE / (config.stem if config.stem.startswith("landerd") else "landerd")


async def check(loaded: Loaded, devices: Devices, state: Path) -> list[Finding]:
    """Return all findings; the devices are opened, measured side by side, and closed.

    The gimbal is moved only while the autopilot is heard to be disarmed.

    Args:
        loaded: the configuration.
        devices: not open.
        state: folder that the service has for what it keeps.
    """
    config = loaded.config
    autopilot = AutopilotCheck(config)
    model, calibration = _calibration(loaded)
    gimbal_done = asyncio.Event()

    async def camera() -> list[Finding]:
        return [] if model is None else await _camera(loaded, devices.camera, model)

    async def gimbal() -> list[Finding]:
        await asyncio.sleep(1.5)  # until a heartbeat has told whether the vehicle is armed
        try:
            return await check_gimbal(devices.gimbal, config, lambda: autopilot.disarmed)
        finally:
            gimbal_done.set()

    parts = await asyncio.gather(autopilot.run(devices.autopilot, gimbal_done), camera(), gimbal())
    cut = [Finding("ok", "gimbal limits", remark) for remark in loaded.remarks]
    notes = sensors_file()
    found = read_sensors(notes) if notes is not None else None
    learned = sensor_findings(config, found) if found is not None else []
    of_devices = [finding for part in parts for finding in part]
    return [*calibration, *of_devices, *cut, *learned, disk(loaded, state)]


def _calibration(loaded: Loaded) -> tuple[CameraModel | None, list[Finding]]:
    """Return the calibration at the size of the pictures; None: what is wrong with it."""
    try:
        return fitting_camera(loaded), []
    except CalibrationError as e:
        mend = "set the camera's size, or calibrate at this size: landerd calibrate camera"
        return None, [Finding("fail", "calibration", str(e), mend)]


async def _camera(loaded: Loaded, camera: Camera, model: CameraModel) -> list[Finding]:
    options = camera_options(loaded)
    layout = load_pad(loaded.config.pad.layout)
    vision = Vision(layout, model, loaded.config.vision)
    fps = options.fps if options is not None else None
    found = await check_camera(camera, vision, model, fps)
    if any(f.item == "camera" and f.level == "fail" for f in found):
        found += [
            Finding("ok", "camera", f"there is {path}, {name}: {v4l2.in_words(modes)}")
            for path, name, modes in v4l2.cameras()
        ]
    return found


def disk(loaded: Loaded, state: Path) -> Finding:
    """Return whether flights can be recorded: into log.folder, or else the service's own folder.

    Args:
        loaded: the configuration.
        state: folder that the service has for what it keeps; systemd makes it.
    """
    given = os.environ.get("STATE_DIRECTORY")
    folder = loaded.config.log.folder or (Path(given) if given else state) / "logs"
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    if loaded.config.log.folder is not None and not os.access(existing, os.W_OK):
        what = f"{existing} cannot be written by this user"
        return Finding("warn", "log", what, "give it to the user that landerd runs as")
    free_mb = shutil.disk_usage(existing).free / 1e6
    if free_mb < _LEAST_FREE_MB:
        what = f"{free_mb:.0f} MB are free for logs in {existing}"
        return Finding("warn", "log", what, "delete old logs, or lower log.most_mb")
    text = f"{free_mb / 1e3:.1f} GB are free in {existing}"
    if loaded.config.log.folder is None:
        text += f"; the service records into {folder}, landerd run by hand nowhere"
    return Finding("ok", "log", text)
