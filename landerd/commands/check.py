"""`landerd check`: opens and measures every device and says what would stop a landing."""

import argparse
import asyncio
import dataclasses
import json
import logging
import os
import shutil
import sys
from pathlib import Path

from hw.cameras import v4l2
from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.commands.run import SetUpError, fitting_camera, make_devices
from landerd.config.files import Loaded
from landerd.pad import PadError, load_pad
from landerd.preflight.autopilot import AutopilotCheck
from landerd.preflight.camera import check_camera
from landerd.preflight.finding import Finding
from landerd.preflight.gimbal import check_gimbal
from landerd.runtime.daemon import Devices

_ENOUGH_DISK_MB = 500.0
_MARKS = {"ok": "ok  ", "warn": "WARN", "fail": "FAIL"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, all but those of the configuration."""
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")


def run(args: argparse.Namespace, loaded: Loaded, overlay: Path) -> int:
    """Check; return 0 if ready, 1 if something would stop a landing, 2 for wrong input."""
    logging.basicConfig(level=logging.CRITICAL)  # what drivers would say is in the findings
    try:
        load_pad(loaded.config.pad.layout)
        load_camera(loaded.config.camera.calibration)
        devices = make_devices(loaded, overlay)
    except (CalibrationError, PadError, SetUpError, ValueError) as e:
        print(e, file=sys.stderr)
        return 2
    findings = asyncio.run(check(loaded, devices))
    ready = not any(f.level == "fail" for f in findings)
    if args.json:
        report = {"ready": ready, "findings": [dataclasses.asdict(f) for f in findings]}
        print(json.dumps(report, allow_nan=False))
    else:
        for finding in findings:
            mend = f" -> {finding.mend}" if finding.mend else ""
            print(f"{_MARKS[finding.level]} {finding.item}: {finding.what}{mend}")
        print("ready" if ready else "not ready: what is marked FAIL would stop a landing")
    return 0 if ready else 1


async def check(loaded: Loaded, devices: Devices) -> list[Finding]:
    """Return all findings; the devices are opened, measured side by side, and closed.

    The gimbal is moved only while the autopilot is heard to be disarmed.
    """
    config = loaded.config
    autopilot = AutopilotCheck(config)
    options = loaded.options.get(f"camera.{config.camera.driver}")
    try:
        model: CameraModel | None = fitting_camera(loaded)
        findings = []
    except CalibrationError as e:
        model = None
        mend = "set the camera's size, or calibrate at this size: landerd calibrate camera"
        findings = [Finding("fail", "calibration", str(e), mend)]

    async def camera() -> list[Finding]:
        if model is None:
            return []
        found = await check_camera(devices.camera, model, getattr(options, "fps", None))
        if any(f.item == "camera" and f.level == "fail" for f in found):
            found += [
                Finding("ok", "camera", f"there is {path}, {name}: {v4l2.in_words(modes)}")
                for path, name, modes in v4l2.cameras()
            ]
        return found

    async def gimbal() -> list[Finding]:
        await asyncio.sleep(1.5)  # until a heartbeat has told whether the vehicle is armed
        try:
            return await check_gimbal(devices.gimbal, config, lambda: autopilot.disarmed)
        finally:
            gimbal_done.set()

    gimbal_done = asyncio.Event()
    parts = await asyncio.gather(
        autopilot.run(devices.autopilot, gimbal_done),
        camera(),
        gimbal(),
    )
    cut = [Finding("ok", "gimbal limits", remark) for remark in loaded.remarks]
    return [*findings, *(f for part in parts for f in part), *cut, disk(loaded)]


def disk(loaded: Loaded) -> Finding:
    """Return whether flights can be recorded."""
    state = os.environ.get("STATE_DIRECTORY")
    folder = loaded.config.log.folder or (Path(state) / "logs" if state else None)
    if folder is None:
        what = "flights are not recorded here: log.folder is not set"
        return Finding("warn", "log", what, "set it, or run as the service, which does")
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    if not os.access(existing, os.W_OK):
        return Finding("warn", "log", f"{existing} cannot be written", "give it to landerd's user")
    free_mb = shutil.disk_usage(existing).free / 1e6
    if free_mb < _ENOUGH_DISK_MB:
        what = f"{free_mb:.0f} MB are free for logs in {existing}"
        return Finding("warn", "log", what, "delete old logs, or lower log.most_mb")
    return Finding("ok", "log", f"{free_mb / 1e3:.1f} GB are free in {existing}")
