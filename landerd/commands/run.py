"""`landerd run`: makes the devices that the configuration names, and drives them until stopped."""

import asyncio
import contextlib
import logging
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from hw.autopilots.signing import Signing
from hw.autopilots.tlog import TlogEncoder
from hw.links import open_link
from hw.links.tapped import TappedLink
from landerd import devices as registry
from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.config.files import Loaded
from landerd.config.parameters import ParameterSet
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.pad import PadError, PadLayout, load_pad
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.service import ServiceNotifier, log_to_stderr

log = logging.getLogger("landerd")


class SetUpError(Exception):
    """The configuration names what cannot be made; the text is one line."""


def run(loaded: Loaded, overlay: Path) -> int:
    """Fly until SIGTERM or SIGINT; return 0, or 2 if the configuration cannot be used.

    Args:
        loaded: the configuration, with the overlay in it.
        overlay: where parameters that a ground station saves are written.
    """
    config = loaded.config
    try:
        layout = load_pad(config.pad.layout)
        camera_model = fitting_camera(loaded)
        recorder = _recorder(loaded, layout, camera_model)
        devices = make_devices(loaded, overlay, recorder)
    except (CalibrationError, PadError, SetUpError, ValueError) as e:
        print(e, file=sys.stderr)
        return 2
    log_to_stderr()
    if overlay.exists():
        log.info("saved parameters of %s are laid over", overlay)
    if recorder is None:
        log.warning("flights are not recorded: log.folder is not set")

    async def serve() -> None:
        observers = (ServiceNotifier(),) if recorder is None else (ServiceNotifier(), recorder)
        daemon = Daemon(config, layout, camera_model, devices, observers=observers)
        ended = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, ended.set)
        flying = asyncio.create_task(daemon.run())
        told = asyncio.create_task(ended.wait())
        await asyncio.wait({flying, told}, return_when=asyncio.FIRST_COMPLETED)
        if not flying.done():
            await daemon.shut_down()
            flying.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await flying

    try:
        asyncio.run(serve())
    finally:
        if recorder is not None:
            recorder.close()
    return 0


def fitting_camera(loaded: Loaded) -> CameraModel:
    """Return the calibration at the size of the pictures that the camera is asked for.

    Raises:
        CalibrationError: it cannot be read, or is of another aspect.
    """
    path = loaded.config.camera.calibration
    camera = load_camera(path)
    options = _options(loaded, "camera", loaded.config.camera.driver)
    if options is None or not hasattr(options, "width"):
        return camera
    try:
        return camera.scaled(options.width, options.height)
    except CalibrationError as e:
        raise CalibrationError(f"{path}: {e}") from None


def make_devices(loaded: Loaded, overlay: Path, recorder: Recorder | None = None) -> Devices:
    """Make camera, gimbal and autopilot as the configuration names them; none is opened.

    Raises:
        SetUpError: a driver is the simulator's.
        ValueError: an option cannot be used.
    """
    config = loaded.config
    key = config.autopilot.signing_key
    # Drivers first: a link may be refused too, but a wrong driver's name says more.
    camera = _maker(loaded, "camera", config.camera.driver)
    gimbal = _maker(loaded, "gimbal", config.gimbal.driver)
    make_autopilot = _maker(loaded, "autopilot", config.autopilot.driver)
    link = open_link(config.autopilot.url)
    autopilot = make_autopilot(
        link if recorder is None else TappedLink(link, recorder.raw),
        system_id=config.autopilot.system_id,
        setpoint_frame=config.autopilot.setpoint_frame,
        ground_stations=config.autopilot.ground_stations,
        parameters=ParameterSet(config, overlay),
        signing=Signing(key, config.autopilot.signing_time or key.with_suffix(".time"))
        if key
        else None,
    )
    match registry.over("gimbal", config.gimbal.driver):
        case "autopilot":
            gimbal = partial(gimbal, autopilot=autopilot)
        case "link":
            url = _options(loaded, "gimbal", config.gimbal.driver).url
            gimbal = partial(gimbal, link=open_link(url))
    return Devices(camera(), gimbal(), autopilot)


def _maker(loaded: Loaded, section: str, driver: str) -> Callable[..., Any]:
    factory = registry.factory(section, driver)
    if factory is None:
        others = sorted(set(registry.names()[section]) - {driver})
        raise SetUpError(
            f"{section}.driver: {driver} is only flown by landerd sim; "
            f"expected one of {', '.join(others)}"
        )
    options = _options(loaded, section, driver)
    return partial(factory, options=options) if options else factory


def _options(loaded: Loaded, section: str, driver: str) -> Any:
    return loaded.options.get(f"{section}.{driver}")


def _recorder(loaded: Loaded, layout: PadLayout, camera: CameraModel) -> Recorder | None:
    """Return what records the flights; None if nothing says where."""
    config = loaded.config
    state = os.environ.get("STATE_DIRECTORY")
    folder = config.log.folder or (Path(state) / "logs" if state else None)
    if folder is None:
        return None
    head = Head(config, layout, camera, wall_offset_s=time.time() - time.monotonic())
    return Recorder(head, config.log, folder, background=True, mavlink=TlogEncoder)
