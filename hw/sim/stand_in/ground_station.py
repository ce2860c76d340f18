"""A simulated ground station that sends the vehicle towards the pad, and then only listens."""

import asyncio
import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import FORCE_DISARM, Mode
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from landerd.geometry import Vec3, norm, sub, wrap
from landerd.ports import ByteLink

_SYSTEM, _COMPONENT = 255, mavlink.MAV_COMP_ID_MISSIONPLANNER
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
_POSITION_ONLY = 3576  # type_mask
_POSITION_AND_YAW = 2552
_ACK_TIMEOUT_S = 1.0
_RC_PERIOD_S = 0.5  # interval of overrides: ArduPilot drops one after 3 s
_FIRST_LATE_CHANNEL = 9  # from this channel on 0 means "no change", below it 65535 does
_LAST_CHANNEL = 18
# The vehicle hovers at a place if distance, speed and heading error (rad) are less than these.
_ARRIVED_M, _STANDSTILL_MPS, _ALIGNED = 0.5, 0.1, math.radians(3.0)
_STUCK_S = 10.0  # a vehicle that has stood armed in LAND for this long is disarmed by force


@dataclass(frozen=True, slots=True)
class Text:
    """A STATUSTEXT as the pilot sees it."""

    t: float
    component: int  # MAVLink component: 1 is the autopilot, 191 is landerd
    text: str


class GroundStation:
    """Sets GUIDED, sends one position target, then sends heartbeats only.

    Attributes:
        texts: all STATUSTEXTs of the vehicle, oldest first.
        overrides: whether it repeats the overrides of channels.
    """

    def __init__(
        self,
        link: ByteLink,
        *,
        destination: Vec3 | None = None,
        speed_mps: float | None = None,
        system_id: int = 1,
    ) -> None:
        """Make one; destination: local NED, m; None: stay. Speed: None: the autopilot's own."""
        self.texts: list[Text] = []
        self.overrides = True
        self._link = link
        self._destination = destination
        self._speed_mps = speed_mps
        self._vehicle = system_id
        self._codec = MavlinkCodec(_SYSTEM, _COMPONENT)
        self._acks: dict[int, asyncio.Future[int]] = {}  # by command
        self._in_air = asyncio.Event()
        self._armed = False
        self._rc: dict[int, int] = {}  # overridden channels, us
        self._position: Vec3 | None = None
        self._velocity: Vec3 = (0.0, 0.0, 0.0)
        self._yaw = 0.0

    async def run(self) -> None:
        """Serve the link until cancelled. Raises DeviceLost (in an ExceptionGroup)."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.serve())
            tasks.create_task(self._send_off())

    async def serve(self) -> None:
        """Serve the link until cancelled, without orders. Raises DeviceLost (in a group)."""
        await self._link.open()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._listen())
            tasks.create_task(self._live())
            tasks.create_task(self._hold_rc())

    # ---- orders --------------------------------------------------------------------------------

    def set_rc(self, channel: int, us: int) -> None:
        """Override a channel of the pilot's radio from now on; channels count from 1."""
        self._rc[channel] = us
        self._send_rc()

    async def set_mode(self, mode: Mode) -> None:
        """Change the mode; returns when the autopilot has accepted."""
        await self._command(
            mavlink.MAV_CMD_DO_SET_MODE,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            float(mode),
        )

    async def set_speed(self, speed_mps: float) -> None:
        """Set the speed at which it flies to places."""
        await self._command(
            mavlink.MAV_CMD_DO_CHANGE_SPEED,
            float(mavlink.SPEED_TYPE_GROUNDSPEED),
            speed_mps,
            -1.0,  # throttle: no change
        )

    async def take_off(self, height_m: float) -> None:
        """Arm and take off in GUIDED; return in the air, as earlier set-points would cancel it."""
        self._in_air.clear()
        extended = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
        await self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(extended), 2e5)
        await self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        await self._command(mavlink.MAV_CMD_NAV_TAKEOFF, *(0.0,) * 6, height_m)
        await self._in_air.wait()

    async def bring_to(self, position: Vec3, heading: float) -> None:
        """Fly to a place (local NED, m; heading in rad); return when it hovers there."""
        for kind in (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE):
            await self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(kind), 2e4)
        while not self._hovers_at(position, heading):
            self._target(_POSITION_AND_YAW, position, heading)
            await asyncio.sleep(1.0)

    def send_to(self, destination: Vec3) -> None:
        """Send the vehicle to a place, local NED, m."""
        self._target(_POSITION_ONLY, destination, 0.0)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter of the autopilot, once."""
        real = mavlink.MAV_PARAM_TYPE_REAL32
        self._send(
            mavlink.MAVLink_param_set_message(self._vehicle, _AUTOPILOT, name.encode(), value, real)
        )

    async def put_down(self) -> None:
        """Land and disarm an armed vehicle, by force if necessary."""
        loop = asyncio.get_running_loop()
        if self._armed:
            await self.set_mode(Mode.LAND)
        moved_t = loop.time()
        while self._armed:
            if norm(self._velocity) > _STANDSTILL_MPS:
                moved_t = loop.time()
            if loop.time() > moved_t + _STUCK_S:
                await self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, FORCE_DISARM)
            await asyncio.sleep(0.5)

    def _hovers_at(self, position: Vec3, heading: float) -> bool:
        return (
            self._position is not None
            and norm(sub(self._position, position)) < _ARRIVED_M
            and norm(self._velocity) < _STANDSTILL_MPS
            and abs(wrap(self._yaw - heading)) < _ALIGNED
        )

    def _target(self, type_mask: int, position: Vec3, yaw: float) -> None:
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                int(asyncio.get_running_loop().time() * 1e3),
                self._vehicle,
                _AUTOPILOT,
                mavlink.MAV_FRAME_LOCAL_NED,
                type_mask,
                *position,
                *(0.0,) * 6,
                yaw,
                0.0,
            )
        )

    # ---- tasks ---------------------------------------------------------------------------------

    async def _hold_rc(self) -> None:
        while True:
            if self._rc:
                self._send_rc()
            await asyncio.sleep(_RC_PERIOD_S)

    def _send_rc(self) -> None:
        if not self.overrides:
            return
        pulses = [
            self._rc.get(channel, 0xFFFF if channel < _FIRST_LATE_CHANNEL else 0)
            for channel in range(1, _LAST_CHANNEL + 1)
        ]
        self._send(mavlink.MAVLink_rc_channels_override_message(self._vehicle, _AUTOPILOT, *pulses))

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
        """Set GUIDED and the speed, and send the vehicle to its destination."""
        await self.set_mode(Mode.GUIDED)
        if self._speed_mps is not None:
            await self.set_speed(self._speed_mps)
        if self._destination is not None:
            self.send_to(self._destination)

    async def _command(self, command: int, *params: float) -> None:
        """Send a command until it is accepted."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        while True:
            ack = self._acks[command] = asyncio.get_running_loop().create_future()
            self._send(
                mavlink.MAVLink_command_long_message(self._vehicle, _AUTOPILOT, command, 0, *padded)
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
        elif message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            if message.get_srcComponent() == _AUTOPILOT:
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif message_id == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            self._position = (message.x, message.y, message.z)
            self._velocity = (message.vx, message.vy, message.vz)
        elif message_id == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            self._yaw = message.yaw
        elif (
            message_id == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
            and message.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
        ):
            self._in_air.set()

    def _send(self, message: Message) -> None:
        self._link.write(self._codec.encode(message))
