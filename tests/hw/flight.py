"""What the MAVLink tests share: a plain airframe, the stand-in, a client of raw messages."""

import asyncio
import random
from collections.abc import Coroutine, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import MemoryLink, memory_pair
from hw.sim.options import AutopilotOptions
from hw.sim.physics.battery import Battery
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.ekf import Estimate
from landerd.geometry import Vec3
from landerd.messages import AutopilotMessage
from landerd.ports import ByteLink


class PlainAirframe:
    """An airframe that obeys every order at once; the ground is at z = 0."""

    def __init__(self, position: Vec3 = (0.0, 0.0, -10.0), yaw: float = 0.0) -> None:
        self.position, self.yaw = position, yaw
        self.velocity: Vec3 = (0.0, 0.0, 0.0)
        self.yaw_rate = 0.0
        self.motors = False
        self.battery = Battery()
        self._t = 0.0
        self._contact: float | None = 0.0 if position[2] >= 0.0 else None

    @property
    def vehicle(self) -> "PlainAirframe":
        return self

    def order(
        self, velocity: Vec3, yaw_rate: float, *, level: bool = False, landing: bool = False
    ) -> None:
        self.velocity, self.yaw_rate = velocity, yaw_rate

    def motors_on(self) -> None:
        self.motors = True

    def motors_off(self) -> None:
        self.motors = False

    @property
    def landed_detected(self) -> bool:
        """Tell whether landing is detected: 2 s after contact, and from the start on the ground."""
        return self._contact is not None and (self._contact == 0.0 or self._t - self._contact > 2.0)

    def advance(self, t: float) -> None:
        dt, self._t = t - self._t, t
        (x, y, z), (vx, vy, vz) = self.position, self.velocity
        z = min(z + vz * dt, 0.0)
        if z < 0.0:
            self._contact = None
        elif self._contact is None and vz > 0.0:
            self._contact = t
        self.position = (x + vx * dt, y + vy * dt, z)
        self.yaw += self.yaw_rate * dt
        if self.motors:
            self.battery.energy_j += 354.0 * dt

    def estimate(self, t: float) -> Estimate:
        return Estimate(
            t, self.position, self.velocity, 0.0, 0.0, self.yaw, (0.0, 0.0, self.yaw_rate)
        )


def plain_autopilot(
    airframe: PlainAirframe,
    links: Sequence[ByteLink],
    *,
    flying: bool = False,
    boot_age_s: float = 60.0,
) -> SimAutopilot:
    """Return the stand-in in an airframe."""
    return SimAutopilot(
        airframe,
        links,
        ekf=airframe,
        rng=random.Random(1),
        flying=flying,
        options=AutopilotOptions(boot_age_s=boot_age_s),
    )


class Client:
    """A MAVLink peer that keeps all messages it receives, as (loop time, message)."""

    def __init__(self, link: MemoryLink, system: int = 255, component: int = 190) -> None:
        self.link = link
        self.heard: list[tuple[float, Message]] = []
        self._codec = MavlinkCodec(system, component)

    async def run(self) -> None:
        await self.link.open()
        while True:
            for message in self._codec.decode(await self.link.read()):
                self.heard.append((asyncio.get_running_loop().time(), message))

    def send(self, message: Message) -> None:
        self.link.write(self._codec.encode(message))

    def command(self, command: int, *params: float) -> None:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded))

    def stream(self, message_id: int, rate_hz: float) -> None:
        self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), 1e6 / rate_hz)

    async def do(self, command: int, *params: float) -> int:
        """Send a command and return the result of its acknowledgement."""
        start = len(self.heard)
        self.command(command, *params)
        while True:
            await asyncio.sleep(0.001)
            for _, m in self.heard[start:]:
                if m.get_type() == "COMMAND_ACK" and m.command == command:
                    return int(m.result)

    async def mode(self, number: int) -> int:
        return await self.do(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(number))

    def fly(
        self,
        x: float,
        y: float,
        z: float,
        *,
        mask: int = 1479,
        frame: int = 1,
        yaw_rate: float = 0.0,
    ) -> None:
        """Send x, y, z as velocity and as position; the mask selects."""
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, x, y, z, x, y, z, 0.0, 0.0, 0.0, 0.0, yaw_rate
            )
        )

    def of(self, kind: str) -> list[tuple[float, Message]]:
        return [(t, m) for t, m in self.heard if m.get_type() == kind]

    @property
    def texts(self) -> list[str]:
        return [m.text for _, m in self.of("STATUSTEXT")]


class Flight:
    """The stand-in, a raw client on one link, landerd's driver on another; used as a context."""

    def __init__(
        self, airframe: PlainAirframe | None = None, *, flying: bool = True, **options: Any
    ) -> None:
        self.airframe = airframe or PlainAirframe()
        near, far = memory_pair()
        self.driver_link, self.autopilot_link = memory_pair()
        self.autopilot = plain_autopilot(self.airframe, [far, self.autopilot_link], flying=flying)
        self.client = Client(near)
        self.driver = MavlinkAutopilot(self.driver_link, **options)
        self.messages: list[AutopilotMessage] = []
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> "Flight":
        self._start(self.autopilot.run(), self.client.run())
        await asyncio.sleep(0.05)
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def connect(self) -> None:
        """Start the driver, and wait until its streams run."""
        await self.driver.open()
        self._start(self._receive())
        await asyncio.sleep(2.5)

    def got(self, kind: type[Any]) -> list[Any]:
        return [m for m in self.messages if isinstance(m, kind)]

    async def _receive(self) -> None:
        while True:
            self.messages.append(await self.driver.receive())

    def _start(self, *jobs: Coroutine[Any, Any, None]) -> None:
        self._tasks += [asyncio.create_task(job) for job in jobs]


def frame_of(message_id: int, payload: bytes, *, system: int, component: int) -> bytes:
    """The frame of any message of the dialect with any payload, its checksum right."""
    kind = mavlink.mavlink_map[message_id]
    size = kind.unpacker.size
    message = mavlink.MAVLink_message(message_id, kind.msgname)
    body = payload[:size].ljust(size, b"\0")
    frame: bytes = message._pack(mavlink.MAVLink(None, system, component), kind.crc_extra, body)
    return frame
