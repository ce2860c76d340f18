"""The asyncio tasks that connect camera, gimbal and autopilot with vision and the core.

There are four tasks: one for each device, one for control. The control task never waits for vision.
On the wall's clock a worker thread searches the frames for the pad (OpenCV releases the
interpreter's lock). On a virtual clock the camera's task searches them itself, and the core gets
the result after a modelled latency.
"""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NoReturn

import cv2
import numpy as np

from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.guidance.last_orders import LastOrders
from landerd.guidance.pilot_texts import FAILED
from landerd.guidance.states import State
from landerd.lander import Lander
from landerd.messages import (
    Command,
    Disarm,
    ExposureOrder,
    Frame,
    GimbalCommand,
    GimbalState,
    Heartbeat,
    Input,
    LandingTarget,
    PhaseChange,
    PressDown,
    Prior,
    Setpoint,
    Severity,
    Shutdown,
    Sightings,
    StatusText,
    Tick,
)
from landerd.pad import PadLayout
from landerd.ports import Autopilot, Camera, DeviceLost, ExposureControl, Feedback, Gimbal
from landerd.runtime.fault_log import FaultLog
from landerd.runtime.frame_times import FUTURE_S, FrameTimes
from landerd.runtime.frozen_input import FrozenInput
from landerd.runtime.monitor import LoopMonitor
from landerd.runtime.observer import Observer
from landerd.runtime.plots import health_figures, landing_figures
from landerd.vision import Detectors, Vision
from landerd.worker import JobHangs, Worker

log = logging.getLogger("landerd")

HEARTBEAT_S = 1.0
PLOT_S = 0.2
HEALTH_PLOT_S = 1.0  # period of slowly changing figures: a telemetry radio carries 5 kB/s
IDLE_S = 0.1  # interval between two checks whether pictures are needed again
LAST_ORDERS_S = 4.5  # longest that landerd takes to end: a wave-off (1 s), then stop orders (3 s)
SEARCH_S = 1.0  # a search that takes longer counts as hung; its result would be too old to use
BACK_OFF_S = (0.1, 0.5)  # first and longest wait before a lost device is opened again
ARRIVALS_HZ = 300.0  # upper bound of the messages that arrive from all devices
CATCH_UP_S = 3.0  # messages older than this are of no use any more
# Longest wait for a device to close, as a camera may hang; CLOSE_S and LAST_ORDERS_S together are
# less than systemd waits (TimeoutStopSec).
CLOSE_S = 1.0


@dataclass(frozen=True)
class Devices:
    """The devices that the daemon drives.

    Attributes:
        strangers: numbers of messages of others that arrived on the autopilot's UDP port and were
            dropped before the driver got them, by kind; heartbeats of other autopilots count as
            "system N".
    """

    camera: Camera
    gimbal: Gimbal
    autopilot: Autopilot
    strangers: Mapping[str, int] = field(default_factory=dict)


class CoreFailed(Exception):
    """The core raised an exception; the vehicle was stopped, and only a new process may fly."""


class Daemon:
    """Drives the devices by the core until cancelled.

    Attributes:
        lander: the core; a new one for each flight.
        monitor: detects what holds up the event loop.
        faults: numbers of bad inputs, lost devices and failures, by kind.
    """

    def __init__(
        self,
        config: Config,
        layout: PadLayout,
        camera_model: CameraModel,
        devices: Devices,
        *,
        vision_latency_s: float | None = None,
        detectors: Detectors | None = None,
        observers: tuple[Observer, ...] = (),
    ) -> None:
        """Make a daemon.

        Args:
            config: the whole configuration.
            layout: the pad to land on.
            camera_model: intrinsics of the camera's images.
            devices: the devices, which the daemon opens and closes.
            vision_latency_s: None: frames are searched in a worker thread. Otherwise they are
                searched in the camera's task, and the core gets the result after this time, s.
            detectors: the part of vision that looks at pixels; None: the real one.
            observers: are told of every frame, input and command.
        """
        # Vision is to use one processor core; OpenCV's own threads would also use the control
        # task's.
        cv2.setNumThreads(1)
        self._config = config
        self._devices = devices
        self._shape = (camera_model.height, camera_model.width)
        self._layout, self._camera_model = layout, camera_model
        self._detectors = detectors
        self._vision = self._new_vision()
        self._vision_latency_s = vision_latency_s
        self._observers = observers
        self._fault_log = FaultLog()
        self.faults = self._fault_log.counts
        self._frame_times = FrameTimes()
        self._armed = True  # before the first heartbeat, as the vehicle may be flying
        self._frozen = FrozenInput()
        self._is_measured = devices.gimbal.traits.feedback is Feedback.MEASURED
        self._guided = False  # armed and in GUIDED by the last heartbeat
        self._worker: Worker | None = None
        if vision_latency_s is None:
            self._worker = Worker("vision")
        self._failure: Exception | None = None  # of the core
        self._last_orders: LastOrders | None = None
        self.monitor = LoopMonitor()
        self.lander = Lander(config, layout)

    def observe(self, observer: Observer) -> None:
        """Add an observer; call it before `run`."""
        self._observers = (*self._observers, observer)

    async def run(self) -> NoReturn:
        """Drive the devices until cancelled; a lost device is opened again, with back-off.

        Raises:
            CoreFailed: the core raised an exception; the stop orders were streamed.
        """
        devices = self._devices
        self._observe(lambda observer: observer.on_flight(self.lander))
        if self._worker is not None:  # on the wall's clock
            self.monitor.look_on()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._control())
                tasks.create_task(self._run_device("autopilot", devices.autopilot, self._autopilot))
                tasks.create_task(self._run_device("gimbal", devices.gimbal, self._gimbal))
                tasks.create_task(self._run_device("camera", devices.camera, self._camera))
        except ExceptionGroup as group:
            failures, _ = group.split(CoreFailed)
            raise failures.exceptions[0] if failures is not None else group from None
        finally:
            self.monitor.close()
            if self._worker is not None:
                self._worker.close()
        raise AssertionError("tasks run for ever")

    async def shut_down(self) -> None:
        """Stop the vehicle if landerd flies it; then `run` may be cancelled.

        Without this the autopilot would keep flying the last velocity until its own timeout.
        """
        loop = asyncio.get_running_loop()
        self._take(Shutdown(loop.time()))
        end = loop.time() + LAST_ORDERS_S
        await asyncio.sleep(2.0 / self._config.control.rate_hz)  # until the core has had a tick
        while self.lander.state is not State.SILENT and loop.time() < end:
            await asyncio.sleep(1.0 / self._config.control.rate_hz)

    # ---- device tasks --------------------------------------------------------------------------

    async def _run_device(
        self,
        name: str,
        device: Camera | Gimbal | Autopilot,
        serve: Callable[[], Awaitable[NoReturn]],
    ) -> NoReturn:
        """Open a device and receive from it, and do so again whenever it is lost."""
        wait = BACK_OFF_S[0]
        while True:
            try:
                await device.open()
                wait = BACK_OFF_S[0]
                await serve()
            except DeviceLost as e:
                self._fault_log.lose(name, str(e))
            except Exception as e:  # a defect of a driver must not end the flight
                log.debug("%s", name, exc_info=e)
                self._fault_log.lose(name, f"{type(e).__name__}: {e}")
            finally:
                await self._close(name, device)
            await asyncio.sleep(wait)
            wait = min(2.0 * wait, BACK_OFF_S[1])

    async def _close(self, name: str, device: Camera | Gimbal | Autopilot) -> None:
        try:
            async with asyncio.timeout(CLOSE_S):
                await device.close()
        except TimeoutError:
            self._fault_log.add(f"{name} not closed", f"it hangs for {CLOSE_S:g} s")
        except Exception as e:
            self._fault_log.add(f"{name} not closed", f"{type(e).__name__}: {e}")

    async def _autopilot(self) -> NoReturn:
        while True:
            self._take_from("autopilot", await self._devices.autopilot.receive())

    async def _gimbal(self) -> NoReturn:
        while True:
            self._take_from("gimbal", await self._devices.gimbal.state())

    async def _camera(self) -> NoReturn:
        loop = asyncio.get_running_loop()
        while True:
            if not self.lander.needs_sight:
                await asyncio.sleep(IDLE_S)
                continue
            frame = await self._devices.camera.newest()
            self._fault_log.find("camera")
            if not self._usable(frame, loop.time()):
                continue
            if self._worker is not None and self._worker.is_stuck:
                self._fault_log.add("image not searched", "too many searches hang")
                continue
            arrived_t = loop.time()
            searched = await self._search(frame)
            if searched is None:
                self._vision = self._new_vision()
                self._observe(lambda observer: observer.on_vision_reset())
                continue
            prior, sightings = searched
            sightings = replace(sightings, sigma_t=frame.sigma_t, arrived_t=arrived_t)
            self._observe(partial(_tell_frame, frame, prior, sightings))
            self._take(sightings)

    async def _search(self, frame: Frame) -> tuple[Prior, Sightings] | None:
        """Return a frame's prior and the sightings in it; None: the search failed."""
        try:
            prior = self.lander.prior(frame.t)
            search = partial(self._vision.process, frame, prior)
            if self._worker is None:
                sightings = search()
                await asyncio.sleep(self._vision_latency_s or 0.0)
            else:
                sightings = await self._worker.run(search, SEARCH_S)
        except JobHangs:
            self._fault_log.add("search of an image hangs", f"given up after {SEARCH_S:g} s")
        except Exception as e:  # a defect of vision must not end the flight
            self._fault_log.add("image not searched", f"{type(e).__name__}: {e}")
        else:
            return prior, sightings
        return None

    # ---- control -------------------------------------------------------------------------------

    async def _control(self) -> NoReturn:
        loop = asyncio.get_running_loop()
        period = 1.0 / self._config.control.rate_hz
        due = loop.time()
        beat = plotted = health_plotted = -math.inf
        while True:
            due = max(due + period, loop.time())
            await asyncio.sleep(due - loop.time())
            await _catch_up(self.monitor.woke(due))
            now = loop.time()
            if now - beat >= HEARTBEAT_S:
                beat = now
                self._send(self._devices.autopilot.heartbeat)
            self._take(Tick(now))
            if self._failure is not None:
                await self._end_flight(period)
                raise CoreFailed(f"{type(self._failure).__name__}: {self._failure}")
            if now - plotted >= PLOT_S:
                plotted = now
                self._send(
                    lambda: self._devices.autopilot.plot(landing_figures(self.lander, loop.time()))
                )
            if now - health_plotted >= HEALTH_PLOT_S:
                health_plotted = now
                self._send(lambda: self._devices.autopilot.plot(health_figures(self.lander)))

    async def _end_flight(self, period: float) -> None:
        """Stream the orders prepared before the core failed, while armed and GUIDED."""
        loop = asyncio.get_running_loop()
        autopilot, orders = self._devices.autopilot, self._last_orders
        self._send(lambda: autopilot.tell(StatusText(Severity.CRITICAL, FAILED)))
        began = loop.time()
        while orders is not None and self._guided:
            order = orders.at(loop.time() - began)
            if order is None:
                break
            self._carry_out(order)
            self._observe(lambda observer: observer.on_last_orders(loop.time()))
            await asyncio.sleep(period)

    def _take(self, message: Input) -> None:
        """Give the core a message and carry out its commands; after a failure do nothing."""
        if self._failure is not None:
            return
        try:
            with self.monitor.at(f"the core with {type(message).__name__}"):
                commands = self.lander.step(message)
                if isinstance(message, Tick):
                    self._last_orders = self.lander.last_orders
        except Exception as e:
            log.critical("the core failed: the vehicle is stopped, landerd ends", exc_info=e)
            self._failure = e
            return
        for command in commands:
            self._carry_out(command)
        now = asyncio.get_running_loop().time()
        self._observe(lambda observer: observer.on_step(now, message, commands))

    def _observe(self, tell: Callable[[Observer], None]) -> None:
        """Tell the observers; an observer's failure does not end the flight."""
        for observer in self._observers:
            name = type(observer).__name__
            try:
                with self.monitor.at(name):
                    tell(observer)
            except Exception as e:
                self._fault_log.add(f"{name} failed", f"{type(e).__name__}: {e}")

    def _carry_out(self, command: Command) -> None:
        self._send(lambda: self._give(command))

    def _send(self, send: Callable[[], None]) -> None:
        """Call a driver's method that sends something; if it raises, count a fault."""
        try:
            send()
        except Exception as e:
            self._fault_log.add("order not sent", f"{type(e).__name__}: {e}")

    def _give(self, command: Command) -> None:
        autopilot = self._devices.autopilot
        match command:
            case Setpoint():
                autopilot.fly(command)
            case PressDown():
                autopilot.press_down(command)
            case GimbalCommand():
                self._devices.gimbal.command(command)
            case ExposureOrder():
                camera = self._devices.camera
                if isinstance(camera, ExposureControl):
                    camera.expose(command)
            case StatusText():
                autopilot.tell(command)
            case Disarm():
                autopilot.disarm()
            case LandingTarget():
                autopilot.show_target(command)
            case PhaseChange():
                log.info("%s: %s", command.phase.value, command.reason)

    # ---- bad input -----------------------------------------------------------------------------

    def _take_from(self, source: str, message: Input) -> None:
        """Give a device's message to the core unless a number or its time is impossible."""
        self._fault_log.find(source)
        now = asyncio.get_running_loop().time()
        if not _finite(message):
            self._fault_log.add(f"{source} sent a number that is none", type(message).__name__)
        elif message.t > now + FUTURE_S:
            self._fault_log.add(f"{source} sent a time in the future", type(message).__name__)
        elif self._repeats(message):
            self._fault_log.add(f"{source} repeats itself", type(message).__name__)
        else:
            if isinstance(message, Heartbeat):
                self._watch_arming(message)
            self._take(message)

    def _repeats(self, message: Input) -> bool:
        if isinstance(message, GimbalState) and not self._is_measured:
            return False  # angles that are modelled or merely ordered may stay the same
        return self._frozen.repeats(message)

    def _watch_arming(self, heartbeat: Heartbeat) -> None:
        """Make a new core when the vehicle is armed: each flight's log then replays by itself."""
        self._guided = heartbeat.armed and heartbeat.guided
        if heartbeat.armed and not self._armed:
            self.lander = Lander(self.lander.config, self._layout)
            self._vision = self._new_vision()
            self._observe(lambda observer: observer.on_flight(self.lander))
        self._armed = heartbeat.armed

    def _new_vision(self) -> Vision:
        config = self._config
        meters = config.camera.exposure == "pad"
        return Vision(
            self._layout,
            self._camera_model,
            config.vision,
            meters=meters,
            detectors=self._detectors,
        )

    def _usable(self, frame: Frame, now: float) -> bool:
        image = frame.image
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
            self._fault_log.add("image of a wrong type", str(getattr(image, "dtype", type(image))))
        elif image.shape != self._shape:
            expected = f"{self._shape[1]}x{self._shape[0]}"
            self._fault_log.add(
                "image of a wrong size", f"{image.shape}, calibrated for {expected}"
            )
        elif (why := self._frame_times.why_false(frame.t, now)) is not None:
            self._fault_log.add(*why)
        elif self._frozen.picture_repeats(image):
            self._fault_log.add("camera repeats itself", "the same picture with another time")
        else:
            return True
        return False


async def _catch_up(gap_s: float) -> None:
    """Let the device tasks take the messages that arrived while the loop was held up for gap_s.

    Without them the core would find its data stale, and stop or climb, though fresh data has
    arrived. In each of its turns the loop may take only one datagram of a link.
    """
    for _ in range(math.ceil(min(gap_s, CATCH_UP_S) * ARRIVALS_HZ)):
        await asyncio.sleep(0.0)


def _tell_frame(frame: Frame, prior: Prior, sightings: Sightings, observer: Observer) -> None:
    observer.on_frame(frame, prior, sightings)


def _finite(message: Input) -> bool:
    """Tell whether every float of a flat message is finite."""
    for name in message.__dataclass_fields__:  # dataclasses.fields would double the time
        value = getattr(message, name)
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, float) and not math.isfinite(part):
                return False
    return True
