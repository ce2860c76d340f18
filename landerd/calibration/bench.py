"""Gimbal, camera and autopilot of a vehicle that stands still: their messages, and orders to them.

The calibration of gimbals (`gimbal_motion`) and bench tests (`marks`) use it.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, NoReturn

from landerd.messages import Attitude, GimbalCommand, GimbalState, Heartbeat
from landerd.ports import Autopilot, Camera, Gimbal
from landerd.runtime.daemon import Devices

# Time from an order until the camera stands still: of a gimbal that measures its angles, and of one
# that does not, and may still creep.
REST_S = 1.2
REST_UNMEASURED_S = 6.0
_ORDER_S = 0.025  # period of orders, as in flight
_HEARD_WITHIN_S = 5.0  # longest time until autopilot and gimbal have sent messages


class Refused(Exception):
    """The calibration or test cannot be done like this; the text says why in one line."""


class Bench:
    """The devices of a disarmed vehicle on a bench, and their messages.

    Attributes:
        states: all reports of the gimbal.
        orders: all orders to the gimbal: time (s), yaw and pitch (rad).
        attitude: the newest from the autopilot; None: none yet.
    """

    def __init__(
        self,
        devices: Devices,
        *,
        with_autopilot: bool,
        heard: Callable[[GimbalState | Attitude], None] = lambda _: None,
    ) -> None:
        """Take the devices, which are still closed.

        Args:
            devices: of the vehicle.
            with_autopilot: whether the autopilot must be heard, and be disarmed; else there is
                none, and the airframe must stand level.
            heard: called with every report of the gimbal and attitude from the autopilot.
        """
        self.devices = devices
        self.states: list[GimbalState] = []
        self.orders: list[tuple[float, float, float]] = []
        self.attitude: Attitude | None = None
        self._with_autopilot = with_autopilot
        self._heard = heard
        self._disarmed: bool | None = None if with_autopilot else True
        self._tasks: list[asyncio.Task[NoReturn]] = []

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[None]:
        """Open the devices until the context is left; the gimbal then turns to where it was.

        Raises:
            DeviceLost: a device is gone.
            Refused: a device sends nothing, or the vehicle is armed.
        """
        devices = self.devices
        opened: list[Camera | Gimbal | Autopilot] = [devices.gimbal, devices.camera]
        jobs: list[Callable[[], Coroutine[Any, Any, NoReturn]]] = [self._hear_gimbal]
        if self._with_autopilot:
            opened.insert(0, devices.autopilot)
            jobs += [self._hear_autopilot, self._beat]
        try:
            for device in opened:
                await device.open()
            self._tasks = [asyncio.create_task(job()) for job in jobs]
            await self._hear()
            yield
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            if self.states:
                start = self.states[0]
                devices.gimbal.command(GimbalCommand(start.yaw, start.pitch))
            for device in reversed(opened):
                await device.close()

    @asynccontextmanager
    async def ordering(self, target: Callable[[float], GimbalCommand]) -> AsyncIterator[None]:
        """Send orders to the gimbal until the context is left; `target` gives them by time, s."""
        task = asyncio.create_task(self._order(target))
        try:
            yield
        finally:
            task.cancel()

    def check(self) -> None:
        """Raise the exception that ended a task, or Refused if the vehicle is armed."""
        for task in self._tasks:
            if task.done():
                task.result()
        if self._disarmed is False:
            raise Refused("the vehicle is armed: disarm it first")

    async def _order(self, target: Callable[[float], GimbalCommand]) -> NoReturn:
        loop = asyncio.get_running_loop()
        while True:
            now = loop.time()
            command = target(now)
            self.devices.gimbal.command(command)
            self.orders.append((now, command.yaw, command.pitch))
            await asyncio.sleep(_ORDER_S)

    # ---- what is heard -------------------------------------------------------------------------

    async def _hear(self) -> None:
        """Wait until gimbal and autopilot have sent messages. Raises Refused."""
        loop = asyncio.get_running_loop()
        end = loop.time() + _HEARD_WITHIN_S
        while loop.time() < end and not (self.states and self._disarmed is not None):
            self.check()
            await asyncio.sleep(0.1)
        if self._disarmed is None:
            raise Refused(
                "the autopilot is not heard: the gimbal is moved only while the vehicle is known "
                "to be disarmed (--without-autopilot on a bench)"
            )
        if not self.states:
            raise Refused("the gimbal says nothing of its angles")

    async def _hear_gimbal(self) -> NoReturn:
        while True:
            state = await self.devices.gimbal.state()
            self.states.append(state)
            self._heard(state)

    async def _hear_autopilot(self) -> NoReturn:
        while True:
            message = await self.devices.autopilot.receive()
            if isinstance(message, Heartbeat):
                self._disarmed = not message.armed
            elif isinstance(message, Attitude):
                self.attitude = message
                self._heard(message)

    async def _beat(self) -> NoReturn:
        """Send heartbeats to the autopilot, as it expects of a companion computer."""
        while True:
            self.devices.autopilot.heartbeat()
            await asyncio.sleep(1.0)
