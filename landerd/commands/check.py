"""`landerd check`: opens and measures every device, and reports what would prevent a landing."""

import argparse
import asyncio
import dataclasses
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Awaitable, Sequence
from pathlib import Path

from hw.cameras import v4l2
from landerd.camera_model import (
    CalibrationError,
    CameraModel,
    camera_info,
    left_out,
    load_camera,
)
from landerd.commands.shared import (
    InputError,
    add_json,
    add_vehicle,
    config_path,
    load_with_saved,
    print_json,
    refusing,
    service_folder,
    tell,
)
from landerd.config.files import ConfigError, Loaded, config_dir
from landerd.devices import SetUpError, camera_options, fitting_camera, make_devices
from landerd.drivers import read_configuration
from landerd.pad import PadError, PadLayout, load_pad
from landerd.ports import Camera
from landerd.preflight.autopilot import AutopilotCheck
from landerd.preflight.camera import CameraCheck
from landerd.preflight.computer import SYSTEM, budget_finding, computer_findings
from landerd.preflight.configuration import (
    descent_findings,
    first_flight,
    pad_findings,
    placeholder,
    stance_findings,
    view_findings,
)
from landerd.preflight.finding import Finding
from landerd.preflight.gimbal import check_gimbal
from landerd.preflight.sensors import FILE, last_flight_findings
from landerd.preflight.status_page import foxglove_findings, page_findings
from landerd.runtime.daemon import Devices
from landerd.vision import Vision

_LEAST_FREE_MB = 500.0  # with less free space on the logs' disk there is a warning
_AGAIN_S = 2.0  # pause before a configuration that cannot be read is read again
# Settings with which the vehicle's configuration is flown in the simulator for --budget.
_IN_THE_SIMULATOR = (
    "camera.driver=sim",
    "camera.exposure=fixed",
    "gimbal.driver=sim",
    "gimbal.yaw_limits_deg=[-90,90]",
    "gimbal.pitch_limits_deg=[-180,0]",
    'autopilot.url="memory:"',
    "guidance.output=velocity",
    "sim.start.position_m=[-3.0,2.0]",
    "sim.start.altitude_m=6.0",
    "sim.start.spread_m=0.0",
)
_MARKS = {"ok": "ok  ", "warn": "WARN", "fail": "FAIL"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_json(parser)
    add_vehicle(parser)
    parser.add_argument(
        "--watch", action="store_true", help="repeat the check until nothing would stop a landing"
    )
    parser.add_argument(
        "--budget",
        action="store_true",
        help="measure this computer, too: pictures per second, time from picture to set-point "
        "(takes a minute)",
    )


def run(args: argparse.Namespace) -> int:
    """Check and print the findings; return 0 if ready, or 1 if something would stop a landing.

    Raises:
        InputError: an argument or the configuration cannot be used.
    """
    if args.watch and args.json:
        raise InputError("--watch: not with --json, which prints one object")
    logging.basicConfig(level=logging.CRITICAL)  # what drivers would log is in the findings
    budget = _budget(args) if args.budget else []
    findings = [*_once(args), *budget]
    shown: set[str] = set()
    while args.watch and _is_stopped_by(findings):
        new = [f for f in findings if f.level != "ok" and f"{f.item} {f.mend}" not in shown]
        if new:
            _show(new)
            tell("not ready yet; mend this, the check is repeated (Ctrl-C ends it)")
        shown = {f"{f.item} {f.mend}" for f in findings}
        findings = [*_once_more(args), *budget]
    ready = not _is_stopped_by(findings)
    if args.json:
        print_json({"ready": ready, "findings": [dataclasses.asdict(f) for f in findings]})
    else:
        _show(findings)
        print("ready" if ready else "not ready: what is marked FAIL would stop a landing")
    return 0 if ready else 1


def _is_stopped_by(findings: Sequence[Finding]) -> bool:
    """Tell whether one of the findings would stop a landing."""
    return any(f.level == "fail" for f in findings)


def _show(findings: Sequence[Finding]) -> None:
    for finding in findings:
        mend = f" -> {finding.mend}" if finding.mend else ""
        print(f"{_MARKS[finding.level]} {finding.item}: {finding.what}{mend}", flush=True)


def _once(args: argparse.Namespace) -> list[Finding]:
    """Read the configuration and check. Raises InputError."""
    loaded, overlay = load_with_saved(args)
    with refusing(CalibrationError, PadError, SetUpError):
        load_pad(loaded.config.pad.layout)
        load_camera(loaded.config.camera.calibration)
        devices = make_devices(loaded, overlay)
    saved = [Finding("ok", "saved parameters", f"{overlay} is laid over")]
    return [
        *(saved if overlay.exists() else ()),
        *asyncio.run(check(loaded, devices, service_folder(args.config))),
    ]


def _once_more(args: argparse.Namespace) -> list[Finding]:
    """Check again; a configuration that cannot be used is a finding here.

    It may be just being edited.
    """
    try:
        return _once(args)
    except InputError as e:
        time.sleep(_AGAIN_S)
        return [Finding("fail", "configuration", str(e), "mend and save it")]


def _budget(args: argparse.Namespace) -> list[Finding]:
    """Measure this computer's speed with the vehicle's configuration, in the simulator.

    Raises:
        InputError: the configuration, the calibration or the pad file cannot be used.
    """
    from landerd.simulation.budget import measure

    loaded, _ = load_with_saved(args)
    options = camera_options(loaded)
    tell("measuring this computer")
    with tempfile.TemporaryDirectory() as folder, refusing(CalibrationError, PadError, ConfigError):
        calibration = Path(folder) / "camera.yaml"
        calibration.write_text(camera_info(fitting_camera(loaded), "camera"), encoding="utf-8")
        flown = read_configuration(
            config_path(args),
            overlays=[config_dir() / "scenarios" / "stationary.yaml"],
            overrides=[*args.set, *_IN_THE_SIMULATOR, f"camera.calibration={calibration}"],
        )
        found = measure(flown)
    fps = options.fps if options is not None else None
    return [
        budget_finding(found.pictures_hz, found.median_s, found.p99_s, found.gap_s, fps),
    ]


async def check(
    loaded: Loaded, devices: Devices, state: Path, system: Path = SYSTEM
) -> list[Finding]:
    """Open all devices, measure them concurrently, close them, and return all findings.

    The gimbal is moved only while the autopilot reports that the vehicle is disarmed.

    Args:
        loaded: the configuration.
        devices: not open.
        state: state folder of the service; $STATE_DIRECTORY replaces it.
        system: root of the files in which Linux describes this computer.
    """
    config = loaded.config
    given = os.environ.get("STATE_DIRECTORY")
    state = Path(given) if given else state
    autopilot = AutopilotCheck(config, devices.strangers)
    model, calibration = _calibration(loaded)
    layout = load_pad(config.pad.layout)
    gimbal_done = asyncio.Event()

    camera_check = None if model is None else _camera_check(loaded, layout, model)

    async def camera() -> list[Finding]:
        return [] if camera_check is None else await _camera(camera_check, devices.camera)

    async def gimbal() -> list[Finding]:
        await asyncio.sleep(1.5)  # until a heartbeat shows whether the vehicle is armed
        try:
            return await check_gimbal(devices.gimbal, config, lambda: autopilot.disarmed)
        finally:
            gimbal_done.set()

    parts = await asyncio.gather(
        _or_failure("autopilot link", autopilot.run(devices.autopilot, gimbal_done)),
        _or_failure("camera", camera()),
        _or_failure("gimbal", gimbal()),
    )
    shown = [] if camera_check is None else await _or_failure("pad", camera_check.pad())
    cut = [Finding("ok", "gimbal limits", remark) for remark in loaded.remarks]
    return [
        *pad_findings(layout),
        *stance_findings(config, layout),
        *placeholder(config),
        *descent_findings(config),
        *calibration,
        *(view_findings(config, layout, model) if model is not None else ()),
        *(finding for part in parts for finding in part),
        *shown,
        *first_flight(config, state),
        *cut,
        *last_flight_findings(config, state / FILE),
        *computer_findings(config.autopilot.url, system),
        disk(loaded, state),
        *page_findings(config.web),
        *foxglove_findings(config.web),
    ]


async def _or_failure(item: str, looking: Awaitable[list[Finding]]) -> list[Finding]:
    """Return the findings on a device, or a finding on the unexpected error that ended its check.

    Args:
        item: name of the device.
        looking: the check.
    """
    try:
        return await looking
    except Exception as e:  # unexpected error of a driver: the other findings are still reported
        what = " ".join(f"an unknown error, {type(e).__name__}: {e}".split())
        return [Finding("fail", item, what, "tell us (docs/contributing.md)")]


def _calibration(loaded: Loaded) -> tuple[CameraModel | None, list[Finding]]:
    """Return the calibration at the pictures' size, or None and findings on why not."""
    try:
        camera = fitting_camera(loaded)
    except CalibrationError as e:
        mend = "set the camera's size, or calibrate at this size: landerd calibrate camera"
        return None, [Finding("fail", "calibration", str(e), mend)]
    remark = left_out(camera)
    mend = "calibrate again, with the board in the corners of the picture too (docs/cameras.md)"
    return camera, [Finding("warn", "calibration", remark, mend)] if remark else []


def _camera_check(loaded: Loaded, layout: PadLayout, model: CameraModel) -> CameraCheck:
    """Return the check of a camera with this calibration at the size of its pictures."""
    options, config = camera_options(loaded), loaded.config
    fps = options.fps if options is not None else None
    # Greatest age of a picture with which the core still counts the pad as seen: it must not become
    # too old before the next control step.
    oldest_s = config.guidance.lost.after_s - config.estimation.clock_sigma_s
    oldest_s -= 1.0 / config.control.rate_hz
    return CameraCheck(Vision(layout, model, config.vision), model, fps, oldest_s)


async def _camera(camera_check: CameraCheck, camera: Camera) -> list[Finding]:
    """Return the findings on the camera; if it fails, also the cameras that are connected."""
    found = await camera_check.run(camera)
    if any(f.item == "camera" and f.level == "fail" for f in found):
        found += [
            Finding("ok", "camera", f"connected: {path}, {name}: {v4l2.in_words(modes)}")
            for path, name, modes in v4l2.cameras()
        ]
    return found


def disk(loaded: Loaded, state: Path) -> Finding:
    """Return a finding on whether flights can be recorded, and how much disk space is left.

    Args:
        loaded: the configuration, with log.folder.
        state: state folder of the service, which systemd makes; used without log.folder.
    """
    folder = loaded.config.log.folder or state / "logs"
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
