"""A fake ground station that brings the vehicle towards the pad, and then only listens."""

import asyncio
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import Mode
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from landerd.geometry import Vec3
from landerd.ports import ByteLink

_SYSTEM, _COMPONENT = 255, 190  # MAV_COMP_ID_MISSIONPLANNER
_AUTOPILOT_COMPONENT = 1
_POSITION_ONLY = 3576  # type_mask
_ACK_TIMEOUT_S = 1.0


@dataclass(frozen=True, slots=True)
class Text:
    """A STATUSTEXT as the pilot sees it."""

    t: float
    component: int  # 1 the autopilot, 191 landerd
    text: str


class GroundStation:
    """Sets GUIDED, takes off if asked to, sends one position target, then sends heartbeats only.

    Attributes:
        texts: all STATUSTEXTs of the vehicle, oldest first.
    """

    def __init__(
        self,
        link: ByteLink,
        *,
        destination: Vec3 | None = None,
        speed_mps: float | None = None,
        take_off_m: float | None = None,
        system_id: int = 1,
    ) -> None:
        """Destination: local NED, m; None: stay. take_off_m: None if the vehicle flies already.

        speed_mps: on the way; None: the autopilot's own.
        """
        self.texts: list[Text] = []
        self._link = link
        self._destination = destination
        self._speed_mps = speed_mps
        self._take_off_m = take_off_m
        self._vehicle = system_id
        self._codec = MavlinkCodec(_SYSTEM, _COMPONENT)
        self._acks: dict[int, asyncio.Future[int]] = {}  # by command
        self._in_air = asyncio.Event()

    async def run(self) -> None:
        """Serve the link, for ever. Raises DeviceLost (in an ExceptionGroup)."""
        await self._link.open()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._listen())
            tasks.create_task(self._live())
            tasks.create_task(self._send_off())

    async def _live(self) -> None:
        while True:
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS,
                    mavlink.MAV_AUTOPILOT_INVALID,
                    0,
                    0,
                    mavlink.MAV_STATE_ACTIVE,
                    3,
                )
            )
            await asyncio.sleep(1.0)

    async def _send_off(self) -> None:
        """Bring the vehicle on its way."""
        await self._command(
            mavlink.MAV_CMD_DO_SET_MODE,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            float(Mode.GUIDED),
        )
        if self._take_off_m is not None:
            extended = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
            await self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(extended), 2e5)
            await self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            await self._command(mavlink.MAV_CMD_NAV_TAKEOFF, *(0.0,) * 6, self._take_off_m)
            await self._in_air.wait()  # any set-point before would cancel the take-off
        if self._speed_mps is not None:
            await self._command(
                mavlink.MAV_CMD_DO_CHANGE_SPEED,
                float(mavlink.SPEED_TYPE_GROUNDSPEED),
                self._speed_mps,
                -1.0,  # the throttle stays
            )
        if self._destination is not None:
            self._send(
                mavlink.MAVLink_set_position_target_local_ned_message(
                    int(asyncio.get_running_loop().time() * 1e3),
                    self._vehicle,
                    _AUTOPILOT_COMPONENT,
                    mavlink.MAV_FRAME_LOCAL_NED,
                    _POSITION_ONLY,
                    *self._destination,
                    *(0.0,) * 6,
                    0.0,
                    0.0,
                )
            )

    async def _command(self, command: int, *params: float) -> None:
        """Send a command until it is accepted."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        while True:
            ack = self._acks[command] = asyncio.get_running_loop().create_future()
            self._send(
                mavlink.MAVLink_command_long_message(
                    self._vehicle, _AUTOPILOT_COMPONENT, command, 0, *padded
                )
            )
            try:
                result = await asyncio.wait_for(ack, _ACK_TIMEOUT_S)
            except TimeoutError:
                continue
            if result == mavlink.MAV_RESULT_ACCEPTED:
                return
            await asyncio.sleep(_ACK_TIMEOUT_S)

    async def _listen(self) -> None:
        while True:
            for message in self._codec.decode(await self._link.read()):
                if message.get_srcSystem() == self._vehicle:
                    self._take(message)

    def _take(self, message: Message) -> None:
        message_id = message.get_msgId()
        if message_id == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            t = asyncio.get_running_loop().time()
            self.texts.append(Text(t, message.get_srcComponent(), message.text))
        elif message_id == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            ack = self._acks.get(message.command)
            if ack is not None and not ack.done():
                ack.set_result(message.result)
        elif (
            message_id == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
            and message.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
        ):
            self._in_air.set()

    def _send(self, message: Message) -> None:
        self._link.write(self._codec.encode(message))
