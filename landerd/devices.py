"""The one place where devices are chosen and made: real, simulated or recorded ones.

What a vehicle does not need, the simulator and the players of recordings, is imported where it is
used.
"""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

from hw.autopilots.heartbeats import heartbeat_of
from hw.autopilots.signing import Signing
from hw.links import open_link
from hw.links.tapped import TappedLink
from landerd.camera_model import CalibrationError, CameraModel, load_camera
from landerd.config.files import Loaded
from landerd.config.models import Config
from landerd.config.parameters import ParameterSet
from landerd.drivers import DRIVERS, gimbal_speaks_over, import_named, names
from landerd.flightlog.recorder import Recorder
from landerd.messages import Frame
from landerd.pad import PadLayout
from landerd.ports import (
    Autopilot,
    AutopilotFactory,
    ByteLink,
    Camera,
    CameraFactory,
    CameraOptions,
    ExposureControl,
    Gimbal,
    GimbalBehindAutopilotFactory,
    GimbalFactory,
    GimbalOverLinkFactory,
    LinkOptions,
    MessageSigning,
    Parameters,
)
from landerd.runtime.daemon import Devices
from landerd.section import Section

if TYPE_CHECKING:
    from hw.autopilots.mavlink import MavlinkAutopilot
    from hw.replay.pictures import DrawnPictures
    from hw.replay.telemetry import Telemetry
    from hw.replay.vehicle import RecordedVehicle
    from hw.sim.gimbals.bench import Bench, Connected, Model
    from hw.sim.gimbals.mount import SimMount
    from hw.sim.options import SimOptions
    from hw.sim.physics.world import World
    from hw.sim.picture.camera import SimCamera
    from hw.sim.snapshot import Snapshot
    from hw.sim.stand_in.autopilot import SimAutopilot
    from landerd.geometry import Vec3


class SetUpError(Exception):
    """The configuration names what cannot be made; the text is one line."""


def camera_options(loaded: Loaded) -> CameraOptions | None:
    """Return what the configured camera is asked for; None: its driver does not say."""
    options = loaded.options.get(f"camera.{loaded.config.camera.driver}")
    return options if isinstance(options, CameraOptions) else None


def sim_options(loaded: Loaded) -> "SimOptions":
    """Return the options of the simulated world."""
    from hw.sim.options import SimOptions

    options = loaded.options["sim"]
    assert isinstance(options, SimOptions)
    return options


def fitting_camera(loaded: Loaded) -> CameraModel:
    """Return the calibration at the size of the pictures that the camera is asked for.

    Raises:
        CalibrationError: it cannot be read, or is of another aspect.
    """
    path = loaded.config.camera.calibration
    camera = load_camera(path)
    options = camera_options(loaded)
    if options is None:
        return camera
    try:
        return camera.scaled(options.width, options.height)
    except CalibrationError as e:
        raise CalibrationError(f"{path}: {e}") from None


# ---- real devices ------------------------------------------------------------------------------


def make_devices(loaded: Loaded, overlay: Path, recorder: Recorder | None = None) -> Devices:
    """Make camera, gimbal and autopilot as the configuration names them; none is opened.

    Args:
        loaded: the configuration.
        overlay: where parameters that a ground station saves are written.
        recorder: gets the bytes of the autopilot's link.

    Raises:
        SetUpError: a driver is the simulator's, or a link or key cannot be used.
    """
    config = loaded.config
    # Drivers first: a link may be refused too, but a wrong driver's name says more.
    camera = cast(CameraFactory, _factory("camera", config.camera.driver))
    gimbal = _factory("gimbal", config.gimbal.driver)
    try:
        signing = _signing(config)
        strangers: Counter[str] = Counter()
        is_peer = heartbeat_of(config.autopilot.system_id, signing, strangers)
        link = open_link(config.autopilot.url, is_peer)
        autopilot = make_autopilot(
            config,
            link if recorder is None else TappedLink(link, recorder.raw),
            ParameterSet(config, overlay),
            signing,
        )
        return Devices(
            _make_camera(camera, loaded),
            _make_gimbal(gimbal, loaded, autopilot),
            autopilot,
            strangers,
        )
    except ValueError as e:
        raise SetUpError(str(e)) from None


def _make_camera(factory: CameraFactory, loaded: Loaded) -> Camera:
    section = loaded.config.camera
    options = loaded.options[f"camera.{section.driver}"]
    if section.exposure == "auto" and getattr(options, "exposure_s", None) is not None:
        raise ValueError(
            f"camera.exposure: auto, but camera.{section.driver}.exposure_s is set; expected null"
        )
    camera = factory(options=options)
    if section.exposure == "pad" and not isinstance(camera, ExposureControl):
        raise ValueError(
            f"camera.exposure: the exposure of driver {section.driver} cannot be ordered; "
            "expected fixed or auto"
        )
    return camera


def make_autopilot(
    config: Config,
    link: ByteLink,
    parameters: Parameters,
    signing: MessageSigning | None = None,
) -> Autopilot:
    """Make the configured driver of the autopilot on a link; it is not opened."""
    section = config.autopilot
    factory = cast(AutopilotFactory, _factory("autopilot", section.driver))
    return factory(
        link,
        system_id=section.system_id,
        setpoint_frame=section.setpoint_frame,
        ground_stations=section.ground_stations,
        parameters=parameters,
        signing=signing,
    )


def _signing(config: Config) -> Signing | None:
    key = config.autopilot.signing_key
    if key is None:
        return None
    return Signing(key, config.autopilot.signing_time or key.with_suffix(".time"))


def _make_gimbal(factory: object, loaded: Loaded, autopilot: Autopilot) -> Gimbal:
    driver = loaded.config.gimbal.driver
    options = loaded.options[f"gimbal.{driver}"]
    match gimbal_speaks_over(driver):
        case "autopilot":
            behind = cast(GimbalBehindAutopilotFactory, factory)
            return behind(options=options, autopilot=autopilot)
        case "link":
            assert isinstance(options, LinkOptions)
            over_link = cast(GimbalOverLinkFactory, factory)
            return over_link(options=options, link=open_link(options.url))
        case None:
            return cast(GimbalFactory, factory)(options=options)


def _factory(section: str, driver: str) -> object:
    """Return what makes a device; of which kind a factory is, its section says, and `over`.

    Raises:
        SetUpError: only the simulated world has such a device.
    """
    path = DRIVERS[section][driver].factory
    if path is None:
        others = sorted(set(names()[section]) - {driver})
        raise SetUpError(
            f"{section}.driver: {driver} is only flown by landerd sim; "
            f"expected one of {', '.join(others)}"
        )
    return import_named(path)


# ---- simulated devices -------------------------------------------------------------------------


class SimulatedGimbal(NamedTuple):
    """A gimbal in the simulated world, and what of it only the world knows."""

    driver: Gimbal  # what the daemon has: a simulated device, or a real driver
    mount: "SimMount"  # the gimbal in the world
    model: "Model | None"  # the device below a real driver, where it has a life of its own

    def true_angles(self) -> tuple[float, float]:
        """Return yaw and pitch as they are, rad, against what the driver's are against."""
        return self.mount.angles(self.driver.traits.reference)


def simulated_camera(
    loaded: Loaded,
    layout: PadLayout,
    camera_model: CameraModel,
    world: "World",
    seed: int,
    delivered: "Callable[[Frame, Snapshot], None]",
    *,
    realtime: bool = False,
) -> "SimCamera":
    """Make a camera that sees a simulated world.

    Args:
        loaded: the configuration.
        layout: the pad in the world, as it was printed.
        camera_model: of the true lens.
        world: what there is to be seen.
        seed: of what is random in the pictures.
        delivered: told of every sound frame, with the truth at its exposure.
        realtime: whether the loop's clock is that of the machine.
    """
    from hw.sim.picture.camera import SimCamera
    from hw.sim.picture.levels import Sensitivity
    from hw.sim.picture.numbered import NumberedPictures
    from hw.sim.picture.renderer import Renderer

    options = sim_options(loaded)
    camera = options.camera
    # Under `fixed` the simulated camera is as its own options say.
    match loaded.config.camera.exposure:
        case "auto":
            camera = camera.model_copy(update={"exposure": "auto"})
        case "pad":
            camera = camera.model_copy(update={"exposure": "ordered"})
    renderer: Renderer | NumberedPictures
    if options.sight == "modelled":
        sensitivity = Sensitivity(options.render, camera, options.pad)
        renderer = NumberedPictures(camera_model, layout.plate, sensitivity)
    else:
        renderer = Renderer(layout, camera_model, options.render, seed, camera, options.pad)
    return SimCamera(renderer, world.snapshot, camera, delivered, seed, realtime=realtime)


def simulated_gimbal(
    loaded: Loaded,
    world: "World",
    seed: int,
    autopilot: "MavlinkAutopilot",
    stand_in: "SimAutopilot | None",
    *,
    realtime: bool,
) -> SimulatedGimbal:
    """Make the configured gimbal in a simulated world.

    Args:
        loaded: the configuration; its driver may be a real one, which then moves a model.
        world: where the gimbal is.
        seed: of its errors.
        autopilot: landerd's driver, through which some gimbals are spoken to.
        stand_in: the simulated autopilot, which drives those; None: a real one flies.
        realtime: real sockets and terminals instead of links in memory.
    """
    from hw.sim.gimbals.bench import Bench
    from hw.sim.gimbals.mount import SimMount
    from hw.sim.gimbals.sim import SimGimbal
    from hw.sim.physics.world import stream

    options, driver = sim_options(loaded).gimbal, loaded.config.gimbal.driver
    mount = SimMount(world, options, stream(seed, "gimbal"))
    connect = gimbal_model(driver)
    if connect is None:
        return SimulatedGimbal(SimGimbal(mount, options), mount, None)
    bench = Bench(mount, stand_in, autopilot, realtime=realtime)
    gimbal, model = connect(loaded.options[f"gimbal.{driver}"], bench)
    return SimulatedGimbal(gimbal, mount, model)


def gimbal_model(name: str) -> "Callable[[Section, Bench], Connected] | None":
    """Return what connects a gimbal's driver to the model of its device; None: there is none.

    Raises:
        KeyError: there is no such driver.
    """
    path = DRIVERS["gimbal"][name].model
    return (
        None if path is None else cast("Callable[[Section, Bench], Connected]", import_named(path))
    )


# ---- recorded devices --------------------------------------------------------------------------


def recorded_vehicle(
    telemetry: "Telemetry",
    camera_deg: tuple[float, float] | None,
    *,
    has_video: bool,
    start: float,
) -> "RecordedVehicle":
    """Make the vehicle of a recorded flight, with the gimbal that there was.

    Args:
        telemetry: the recording.
        camera_deg: yaw and pitch of a camera that did not move; None: it was on a gimbal, whose
            recorded angles count. Without either the gimbal is pretended, but for a real video.
        has_video: there are pictures of the flight.
        start: of the first measurements, s on the recording's clock.
    """
    from hw.replay.vehicle import RecordedVehicle

    pretended = not has_video and camera_deg is None and not telemetry.gimbal.times
    return RecordedVehicle(telemetry, camera_deg, pretended=pretended, start=start)


def drawn_pictures(
    loaded: Loaded,
    layout: PadLayout,
    camera_model: CameraModel,
    vehicle: "RecordedVehicle",
    pad: "Vec3",
    *,
    start: float,
    fps: float,
) -> "DrawnPictures":
    """Make pictures, for a recorded flight without any, of a pad that was not there.

    Args:
        loaded: the configuration, with the simulator's light, lens and ground.
        layout: the pad.
        camera_model: intrinsics.
        vehicle: where the camera was and how it looked.
        pad: landing point, local NED, m.
        start: of the first picture, s on the recording's clock.
        fps: pictures a second.
    """
    from hw.replay.pictures import DrawnPictures

    return DrawnPictures(
        layout,
        camera_model,
        sim_options(loaded).render,
        vehicle,
        loaded.config.vehicle,
        pad,
        start=start,
        fps=fps,
    )
