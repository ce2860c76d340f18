"""ArduCopter over MAVLink: telemetry in, velocity set-points out."""

import asyncio
import logging
import math
from collections import Counter, deque
from collections.abc import Callable
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import VEHICLE_TYPES, Mode, mode_name
from hw.autopilots.boot_clock import BootClock
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    AutopilotRestarted,
    Battery,
    Heartbeat,
    Landed,
    LandedState,
    LocalPosition,
    RcChannels,
    Setpoint,
    StatusText,
)
from landerd.ports import ByteLink

log = logging.getLogger(__name__)

COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
_AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
_VELOCITY_AND_YAW_RATE = 1479  # type_mask: ignore position, acceleration, yaw

# Asked of the autopilot, Hz.
STREAMS_HZ = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 20.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
}
_RATE_WINDOW_S = 2.0  # a stream slower than half its rate over this long is asked for again
_TIMESYNC_PERIOD_S = 0.2
_RESTART_S = 1.0  # boot time going back by more than this is a restart
_STATUSTEXT_LENGTH = 50

# Beyond these a field is damaged, not flown.
_FARTHEST_M = 1e5
_FASTEST_MPS = 100.0
_FASTEST_TURN_RADPS = 35.0
_PULSE_US = (800, 2200)  # ArduPilot's own limits of a valid pulse
_CHANNELS = 18


class MavlinkAutopilot:
    """An ArduCopter behind a byte stream; an Autopilot.

    landerd is an onboard computer (component 191) of the vehicle's own system. Only messages of
    that system's autopilot (component 1) are taken; all others are counted and ignored. Messages
    stamped with time_boot_ms are placed on the loop's clock by TIMESYNC; the others get their
    time of arrival. A message that is not newer than the last of its kind is dropped.

    Attributes:
        counters: what was dropped, lost on the way or refused, by kind.
    """

    def __init__(
        self,
        link: ByteLink,
        *,
        system_id: int = 1,
        setpoint_frame: Literal["local_ned", "body_ned"] = "local_ned",
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._link = link
        self._system = system_id
        self._frame = setpoint_frame
        self._codec = MavlinkCodec(system_id, COMPONENT)
        self._pending: deque[AutopilotMessage] = deque()
        self._logged: dict[str, float] = {}
        self._yaw: float | None = None
        self._clock = BootClock()
        self._last_boot_s = -math.inf
        self._last_t: dict[int, float] = {}  # by message id
        self._timesync_sent: deque[int] = deque(maxlen=10)  # ns, the newest requests
        self._timesync_due = 0.0
        self._received: Counter[int] = Counter()  # streams in this window, by message id
        self._window_start: float | None = None  # None: the streams were not asked for yet
        self._handlers: dict[int, Callable[[Message, float], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._on_attitude,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._on_local_position,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._on_rc_channels,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._on_extended_sys_state,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._on_battery_status,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._on_statustext,
            mavlink.MAVLINK_MSG_ID_COMMAND_ACK: self._on_command_ack,
        }

    async def open(self) -> None:
        """Open the link. Raises DeviceLost."""
        await self._link.open()
        self._codec.reset()
        self._window_start = None

    async def close(self) -> None:
        """Close the link; safe to call twice."""
        await self._link.close()

    # ---- in ----

    async def receive(self) -> AutopilotMessage:
        """Wait for the next message that concerns the core. Raises DeviceLost."""
        while not self._pending:
            data = await self._link.read()
            now = asyncio.get_running_loop().time()
            messages = self._codec.decode(data)
            for kind, count in self._codec.counters.items():
                if count > self.counters[kind]:
                    self._drop(kind, now, count - self.counters[kind])
            for message in messages:
                self._take(message, now)
        return self._pending.popleft()

    def _take(self, message: Message, now: float) -> None:
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source != (self._system, _AUTOPILOT_COMPONENT):
            self.counters["foreign"] += 1
            return
        message_id = message.get_msgId()
        if message_id in STREAMS_HZ:
            self._received[message_id] += 1
        handler = self._handlers.get(message_id)
        if handler is not None:
            handler(message, now)
        self._keep_streams(now)

    def _on_heartbeat(self, m: Message, now: float) -> None:
        if m.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA or m.type not in VEHICLE_TYPES:
            self._drop("not ArduCopter", now)
            return
        has_mode = m.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self._pending.append(
            Heartbeat(
                now,
                armed=bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
                guided=bool(has_mode) and m.custom_mode == Mode.GUIDED,
                mode=mode_name(m.custom_mode) if has_mode else "unknown",
            )
        )

    def _on_attitude(self, m: Message, now: float) -> None:
        rates = (m.rollspeed, m.pitchspeed, m.yawspeed)
        if not (
            _within(math.pi + 1e-3, m.roll, m.yaw)
            and _within(math.pi / 2 + 1e-3, m.pitch)
            and _within(_FASTEST_TURN_RADPS, *rates)
        ):
            self._drop("bad attitude", now)
            return
        t = self._place(m, now)
        if t is not None:
            self._yaw = m.yaw
            self._pending.append(Attitude(t, m.roll, m.pitch, m.yaw, rates))

    def _on_local_position(self, m: Message, now: float) -> None:
        position, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
        if not (_within(_FARTHEST_M, *position) and _within(_FASTEST_MPS, *velocity)):
            self._drop("bad position", now)
            return
        t = self._place(m, now)
        if t is not None:
            self._pending.append(LocalPosition(t, position, velocity))

    def _on_rc_channels(self, m: Message, now: float) -> None:
        raw = [getattr(m, f"chan{i}_raw") for i in range(1, _CHANNELS + 1)]
        low, high = _PULSE_US
        pulses = tuple(
            us if i < m.chancount and low <= us <= high else 0 for i, us in enumerate(raw)
        )
        t = self._place(m, now)
        if t is not None:
            self._pending.append(RcChannels(t, pulses))

    def _on_extended_sys_state(self, m: Message, now: float) -> None:
        try:
            state = Landed(m.landed_state)
        except ValueError:
            self._drop("bad landed state", now)
            return
        self._pending.append(LandedState(now, state))

    def _on_battery_status(self, m: Message, now: float) -> None:
        if m.id != 0:
            return
        # One entry a cell, or all in the first; 65535 is none.
        cells_mv = [mv for mv in m.voltages if mv != 0xFFFF]
        self._pending.append(
            Battery(
                now,
                voltage_v=1e-3 * sum(cells_mv) if cells_mv else None,
                energy_consumed_j=100.0 * m.energy_consumed if m.energy_consumed >= 0 else None,
            )
        )

    def _on_timesync(self, m: Message, now: float) -> None:
        if m.tc1 == 0:  # the autopilot asks for our time
            self._send(mavlink.MAVLink_timesync_message(_nanoseconds(now), m.ts1))
        elif m.ts1 in self._timesync_sent:  # not the answer to somebody else
            boot_s = 1e-9 * m.tc1
            self._watch_restart(boot_s, now)
            self._clock.exchanged(1e-9 * m.ts1, boot_s, now)

    def _on_statustext(self, m: Message, now: float) -> None:
        log.info("autopilot says: %s", m.text)

    def _on_command_ack(self, m: Message, now: float) -> None:
        if m.result not in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS):
            self._drop(f"command {m.command} refused, result {m.result}", now)

    # ---- time ----

    def _place(self, m: Message, now: float) -> float | None:
        """Return the loop time of a stamped message; None: not newer than the last of its kind."""
        boot_s = 1e-3 * m.time_boot_ms
        self._watch_restart(boot_s, now)
        t = self._clock.place(boot_s, now)
        if t <= self._last_t.get(m.get_msgId(), -math.inf):
            self._drop("out of order", now)
            return None
        self._last_t[m.get_msgId()] = t
        return t

    def _watch_restart(self, boot_s: float, now: float) -> None:
        if boot_s < self._last_boot_s - _RESTART_S:
            log.warning("the autopilot has restarted")
            self._pending.append(AutopilotRestarted(now))
            self._clock = BootClock()
            self._window_start = None
            self._last_boot_s = boot_s
        self._last_boot_s = max(self._last_boot_s, boot_s)

    def _keep_streams(self, now: float) -> None:
        """Ask for the time, and for the streams that are missing."""
        if now >= self._timesync_due:
            self._timesync_due = now + _TIMESYNC_PERIOD_S
            stamp = _nanoseconds(now)
            self._timesync_sent.append(stamp)
            self._send(mavlink.MAVLink_timesync_message(0, stamp))
        window = math.inf if self._window_start is None else now - self._window_start
        if window < _RATE_WINDOW_S:
            return
        for message_id, rate in STREAMS_HZ.items():
            if self._window_start is None or self._received[message_id] < 0.5 * rate * window:
                self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), 1e6 / rate)
        self._received.clear()
        self._window_start = now

    # ---- out ----

    def heartbeat(self) -> None:
        """Say that landerd lives; the control task calls this once a second."""
        self._send(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                mavlink.MAV_AUTOPILOT_INVALID,
                0,
                0,
                mavlink.MAV_STATE_ACTIVE,
                3,
            )
        )

    def fly(self, setpoint: Setpoint) -> None:
        """Send one velocity and yaw-rate set-point; one that is not finite is refused."""
        now = asyncio.get_running_loop().time()
        north, east, down = setpoint.velocity
        if not (
            _within(_FASTEST_MPS, north, east, down)
            and _within(_FASTEST_TURN_RADPS, setpoint.yaw_rate)
        ):
            self._drop("set-point refused: not finite or beyond any vehicle", now)
            return
        if self._frame == "local_ned":
            frame, x, y = mavlink.MAV_FRAME_LOCAL_NED, north, east
        elif self._yaw is None:
            self._drop("set-point refused: heading not known", now)
            return
        else:
            c, s = math.cos(self._yaw), math.sin(self._yaw)
            frame, x, y = mavlink.MAV_FRAME_BODY_NED, c * north + s * east, c * east - s * north
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                int(now * 1e3) & 0xFFFFFFFF,
                self._system,
                _AUTOPILOT_COMPONENT,
                frame,
                _VELOCITY_AND_YAW_RATE,
                *(0.0, 0.0, 0.0),
                *(x, y, down),
                *(0.0, 0.0, 0.0),
                0.0,
                setpoint.yaw_rate,
            )
        )

    def tell(self, text: StatusText) -> None:
        """Show the pilot a line, cut to 50 characters."""
        line = text.text.encode("ascii", "replace")[:_STATUSTEXT_LENGTH]
        self._send(mavlink.MAVLink_statustext_message(int(text.severity), line))

    def disarm(self) -> None:
        """Ask for disarming; the autopilot refuses in the air."""
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 0.0)

    def _command(self, command: int, param1: float, param2: float) -> None:
        self._send(
            mavlink.MAVLink_command_long_message(
                self._system, _AUTOPILOT_COMPONENT, command, 0, param1, param2, 0, 0, 0, 0, 0
            )
        )

    def _send(self, message: Message) -> None:
        self._link.write(self._codec.encode(message))

    def _drop(self, kind: str, now: float, count: int = 1) -> None:
        """Count what is dropped or refused, and log each kind once a second."""
        self.counters[kind] += count
        if now - self._logged.get(kind, -math.inf) >= 1.0:
            self._logged[kind] = now
            log.warning("%s (%d so far)", kind, self.counters[kind])


def _within(limit: float, *values: float) -> bool:
    """Tell whether all values are finite and at most limit in size; NaN is not."""
    return all(-limit <= v <= limit for v in values)


def _nanoseconds(t: float) -> int:
    return int(t * 1e9)
