"""Gimbal, camera and autopilot of a vehicle that stands still: their data, and orders to them."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, NoReturn

from landerd.messages import Attitude, GimbalCommand, GimbalState, Heartbeat
from landerd.ports import Autopilot, Camera, Gimbal
from landerd.runtime.daemon import Devices

REST_S = 1.2  # from an order until the camera stands still,
REST_UNMEASURED_S = 6.0  # and where nobody measures whether it still creeps
_ORDER_S = 0.025  # orders come as often as in flight
_HEARD_WITHIN_S = 5.0  # until autopilot and gimbal must have been heard


class Refused(Exception):
    """The calibration cannot be done like this; the text says why in one line."""


class Bench:
    """The devices of a vehicle on a bench, opened and listened to; the vehicle is disarmed.

    Attributes:
        states: of the gimbal, all that it told.
        orders: time (s), yaw and pitch (rad) of all that was ordered.
        attitude: the newest that the autopilot told; None: none yet.
    """

    def __init__(
        self,
        devices: Devices,
        *,
        with_autopilot: bool,
        heard: Callable[[GimbalState | Attitude], None] = lambda _: None,
    ) -> None:
        """Take the devices, closed.

        Args:
            devices: of the vehicle.
            with_autopilot: whether it has to be heard, disarmed; else the airframe stands level.
            heard: told of every message of gimbal and autopilot.
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
        """Open the devices and hear them; at the end the gimbal turns to where it was.

        Raises:
            DeviceLost: a device is gone.
            Refused: nothing is heard, or the vehicle is armed.
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
        """Order the gimbal to a target by time (s), again and again, until the context is left."""
        task = asyncio.create_task(self._order(target))
        try:
            yield
        finally:
            task.cancel()

    def check(self) -> None:
        """Raise what ended a task, or Refused if the vehicle is armed."""
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
        """Wait until gimbal and autopilot are heard."""
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
        while True:
            self.devices.autopilot.heartbeat()
            await asyncio.sleep(1.0)
