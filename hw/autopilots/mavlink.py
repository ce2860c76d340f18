"""ArduCopter over MAVLink: telemetry in, velocity set-points out."""

import asyncio
import logging
import math
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots import core_parameters, file_transfer, orders, telemetry
from hw.autopilots.boot_clock import BootClock
from hw.autopilots.heading import Heading
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.autopilots.orders import SetpointFrame
from hw.autopilots.parameter_protocol import ParameterProtocol
from hw.autopilots.refusals import Refusals
from hw.autopilots.restart_detector import Boot, RestartDetector
from hw.autopilots.streams import Streams
from landerd.geometry import euler_rates
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    AutopilotRestarted,
    ClockSync,
    LandingTarget,
    PressDown,
    Setpoint,
    Severity,
    StatusText,
)
from landerd.ports import ByteLink, MessageSigning, Parameters

log = logging.getLogger(__name__)

COMPONENT: int = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1

_TIMESYNC_PERIOD_S = 0.2
_HEARTBEAT_S = 3.0  # by an older heartbeat it is not known whether the vehicle is armed
_STATUSTEXT_LENGTH = 50
_ASK_S = 5.0  # interval at which a parameter that the core needs is requested until it is reported
# Status texts that may be sent in one burst, and their rate after it, 1/s: a slow telemetry port
# has more important messages to carry.
_TEXTS_AT_ONCE, _TEXTS_PER_S = 6.0, 2.0

_GROUND_STATION_MESSAGES = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_PARAM_SET,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
        mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
    }
)
_READERS: Mapping[int, Callable[[Message, float], AutopilotMessage | None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: telemetry.heartbeat,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: telemetry.attitude,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: telemetry.local_position,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: telemetry.rc_channels,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: telemetry.landed_state,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: telemetry.battery,
}
_STAMPED = frozenset(  # with time_boot_ms; the others count as of their arrival
    {
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    }
)


class _Subscriber(NamedTuple):
    take: Callable[[Message, float], None]  # the message and its loop time, s
    counts: Callable[[Message], bool]


class MavlinkAutopilot:
    """An ArduCopter behind a byte stream; an Autopilot.

    landerd is an onboard computer (component 191) of the vehicle's own MAVLink system. It accepts
    telemetry from that system's autopilot (component 1) only, and parameter messages and commands
    from the configured ground stations only; all other messages are counted and ignored. TIMESYNC
    converts time_boot_ms stamps to the event loop's clock; messages without that stamp get their
    time of arrival. A message that is not newer than the last one of its kind is dropped (RC
    channels: by the autopilot's clock, which may be found to have been set back).

    Attributes:
        counters: number of messages dropped, lost on the way or refused, by kind.
        vehicle_parameters: the autopilot's parameters that it has reported on request.
    """

    def __init__(
        self,
        link: ByteLink,
        *,
        system_id: int = 1,
        setpoint_frame: SetpointFrame = "local_ned",
        ground_stations: Collection[int] = (255,),
        parameters: Parameters | None = None,
        signing: MessageSigning | None = None,
    ) -> None:
        """Make a driver; `open` opens its link.

        Args:
            link: byte stream to the autopilot.
            system_id: MAVLink system id of the vehicle.
            setpoint_frame: frame of the velocities sent.
            ground_stations: system ids whose parameter messages and commands are accepted.
            parameters: landerd's parameters that these may read and change; None: none.
            signing: key for signed messages; None: messages are not signed.
        """
        self.counters: Counter[str] = Counter()
        self.vehicle_parameters: dict[str, float] = {}
        self._link = link
        self._system = system_id
        self._frame = setpoint_frame
        self._ground_stations = frozenset(ground_stations)
        self._signing = signing
        self._codec = MavlinkCodec(system_id, COMPONENT, signing)
        self._parameters: ParameterProtocol | None = None
        if parameters is not None:
            self._parameters = ParameterProtocol(parameters, self.send, self._warn)
        self._streams = Streams(self._ask_stream)
        self._subscribers: dict[int, _Subscriber] = {}  # by message id
        self._pending: deque[AutopilotMessage] = deque()
        self._logged: dict[str, float] = {}
        self._refusals = Refusals()
        self._texts_left, self._texts_t = _TEXTS_AT_ONCE, 0.0
        self._heading = Heading()
        self._disarmed_until = -math.inf
        self._clock = BootClock()
        self._restarts = RestartDetector()
        # Boot time and loop time of the newest stamped message, s, by message id.
        self._newest: dict[int, tuple[float, float]] = {}
        self._timesync_sent: deque[int] = deque(maxlen=10)  # ns, the newest requests
        self._timesync_due = self._ask_due = 0.0

    async def open(self) -> None:
        """Open the link. Raises DeviceLost."""
        if self._signing is not None:
            self._signing.open()
        await self._link.open()
        self._codec.reset()
        self._streams.restart()
        self._refusals.restart()

    async def close(self) -> None:
        """Close the link; safe to call twice."""
        await self._link.close()

    # ---- what else is behind the same link ----

    @property
    def system_id(self) -> int:
        """The vehicle's system id."""
        return self._system

    def subscribe(
        self,
        message_id: int,
        rate_hz: float,
        take: Callable[[Message, float], None],
        counts: Callable[[Message], bool],
    ) -> None:
        """Ask the autopilot for one more kind of message, such as reports of a gimbal it drives.

        Args:
            message_id: id of a message that this driver does not read itself.
            rate_hz: rate to request, Hz.
            take: called with each message and its loop time (s), from its time_boot_ms if it has
                one, else of its arrival. One that is not newer than the last is dropped.
            counts: tells whether a message is for the subscriber; others, say of another device,
                are ignored.
        """
        self._subscribers[message_id] = _Subscriber(take, counts)
        self._streams.add(message_id, rate_hz)

    def send(self, message: Message) -> None:
        """Send any message; a lost link drops it silently."""
        self._link.write(self._codec.encode(message, asyncio.get_running_loop().time()))

    def command(self, command: int, *params: float) -> None:
        """Send the autopilot a COMMAND_LONG; missing parameters are 0.

        The pilot is told of a refusal, once.
        """
        values = (*params, *(0.0,) * (7 - len(params)))
        self.send(
            mavlink.MAVLink_command_long_message(self._system, _AUTOPILOT, command, 0, *values)
        )

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
        kind = message.get_msgId()
        if source == (self._system, _AUTOPILOT):
            self._take_autopilots(message, kind, now)
            self._request_missing(now)
        elif source[0] in self._ground_stations and kind in _GROUND_STATION_MESSAGES:
            self._take_ground_stations(message, kind, now)
        else:
            self.counters["foreign"] += 1

    def _take_autopilots(self, m: Message, kind: int, now: float) -> None:
        self._streams.received(kind)
        try:
            self._pass_on(m, kind, now)
        except telemetry.BadMessage as e:
            self._drop(str(e), now)
        else:
            self._note(m, kind, now)

    def _pass_on(self, m: Message, kind: int, now: float) -> None:
        """Give a message to the core and to its subscriber. Raises BadMessage.

        Only attitudes that are accepted count for turning set-points into the vehicle's frame.
        """
        read = _READERS.get(kind)
        message = read(m, now) if read is not None else None
        subscriber = self._subscribers.get(kind)
        if subscriber is not None and not subscriber.counts(m):
            return
        is_stamped = kind in _STAMPED or (subscriber and "time_boot_ms" in m.fieldnames)
        t = self._place(m, now) if is_stamped else now
        if subscriber is not None and t is not None:
            try:
                subscriber.take(m, t)
            except (ArithmeticError, ValueError) as e:
                # Say, an infinite angle: one bad message is no reason to give up the link.
                raise telemetry.BadMessage(f"bad {m.get_type()}") from e
        if message is not None and t is not None:
            self._pending.append(replace(message, t=t))
            if isinstance(message, Attitude):
                yaw_rate = euler_rates(message.roll, message.pitch, message.rates)[2]
                self._heading.measured(t, message.yaw, yaw_rate)

    def _note(self, m: Message, kind: int, now: float) -> None:
        """Take from a message what this driver itself needs."""
        if kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            is_armed = m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            self._disarmed_until = -math.inf if is_armed else now + _HEARTBEAT_S
        elif kind == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            self._on_timesync(m, now)
        elif kind == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            log.info("autopilot says: %s", m.text)
        elif kind == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            self._on_command_ack(m)
        elif kind == mavlink.MAVLINK_MSG_ID_PARAM_VALUE and math.isfinite(m.param_value):
            self._on_parameter(m.param_id, m.param_value, now)

    def _on_timesync(self, m: Message, now: float) -> None:
        if m.tc1 == 0:  # the autopilot asks for our time
            self.send(mavlink.MAVLink_timesync_message(_nanoseconds(now), m.ts1))
        elif m.ts1 in self._timesync_sent:  # the answer to our own request, not to another's
            boot_s = 1e-9 * m.tc1
            if not self._note_boot(boot_s, now, is_answer=True):
                return
            self._clock.exchanged(1e-9 * m.ts1, boot_s, now)
            uncertainty_s = self._clock.uncertainty_s
            if uncertainty_s is not None:
                self._pending.append(ClockSync(now, uncertainty_s))

    def _on_parameter(self, name: str, value: float, now: float) -> None:
        """Keep one of the autopilot's parameters; pass on those that the core uses."""
        if value != self.vehicle_parameters.get(name):
            change = core_parameters.change_of(name, value, now)
            if change is not None:
                self._pending.append(change)
        self.vehicle_parameters[name] = value

    def _on_command_ack(self, m: Message) -> None:
        """Tell the pilot once of a command that the autopilot refuses."""
        addressee = (m.target_system, m.target_component)
        if addressee not in ((self._system, COMPONENT), (0, 0)):
            return
        if m.result in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS):
            return
        self.counters["command refused"] += 1
        text = self._refusals.tell(m.command, m.result)
        if text is not None:
            self._warn(text)

    def _take_ground_stations(self, m: Message, kind: int, now: float) -> None:
        if m.target_system != self._system or m.target_component not in (0, COMPONENT):
            return  # addressed to the autopilot, or to another vehicle
        if kind in (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT):
            if m.target_component == COMPONENT:  # addressed to landerd, not to every component
                self._on_command(m, disarmed=now < self._disarmed_until)
        elif kind == mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL:
            answer = file_transfer.refusal(m) if m.target_component == COMPONENT else None
            if answer is not None:
                self.send(answer)
        elif self._parameters is not None:
            disarmed = now < self._disarmed_until
            change = self._parameters.take(m, now, disarmed=disarmed)
            if change is not None:
                self._pending.append(change)

    def _on_command(self, m: Message, *, disarmed: bool) -> None:
        result: int = mavlink.MAV_RESULT_UNSUPPORTED
        if m.command == mavlink.MAV_CMD_PREFLIGHT_STORAGE and self._parameters is not None:
            # Not in flight: writing to a slow disk would hold up the set-points.
            result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            if disarmed:
                result = self._parameters.save(m.param1)
        self.send(
            mavlink.MAVLink_command_ack_message(
                m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
            )
        )

    # ---- time ----

    def _place(self, m: Message, now: float) -> float | None:
        """Return the loop time (s) of a stamped message; None: it is to be dropped.

        That is, its stamp is not believed, or it is not newer than the last one of its kind.
        """
        boot_s = self._clock.unwrapped(m.time_boot_ms, now)
        if not self._note_boot(boot_s, now):
            return None
        t = self._clock.place(boot_s, now)
        kind = m.get_msgId()
        last_boot_s, last_t = self._newest.get(kind, (-math.inf, -math.inf))
        if kind == mavlink.MAVLINK_MSG_ID_RC_CHANNELS and boot_s > last_boot_s:
            t = max(t, last_t)  # a clock that was set back must not keep the pilot's switch away
        elif t <= last_t:
            self._drop("out of order", now)
            return None
        self._newest[kind] = boot_s, t
        return t

    def _note_boot(self, boot_s: float, now: float, *, is_answer: bool = False) -> bool:
        """Note a time since boot (s) and tell whether it is believed; reset after a restart."""
        boot = self._restarts.hear(boot_s, now, is_answer=is_answer)
        if boot is Boot.UNKNOWN:
            self._drop("a boot time that does not fit", now)
            return False
        if boot is not Boot.SAME:
            self._clock = BootClock()
        if boot is Boot.NEW:
            log.warning("the autopilot has restarted")
            self._pending.append(AutopilotRestarted(now))
            self._streams.restart()
            self._refusals.restart()
            self.vehicle_parameters.clear()
        self._clock.heard(boot_s, now)
        return True

    def _request_missing(self, now: float) -> None:
        """Send a TIMESYNC request when it is due, and ask again for streams that are missing."""
        if now >= self._timesync_due:
            self._timesync_due = now + _TIMESYNC_PERIOD_S
            stamp = _nanoseconds(now)
            self._timesync_sent.append(stamp)
            self.send(mavlink.MAVLink_timesync_message(0, stamp))
        self._streams.request_missing(now)
        if now >= self._ask_due:
            self._ask_due = now + _ASK_S
            for name in core_parameters.untold(self.vehicle_parameters):
                self.ask_parameter(name)

    def _ask_stream(self, message_id: int, rate_hz: float) -> None:
        self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), 1e6 / rate_hz)

    # ---- out ----

    def heartbeat(self) -> None:
        """Send landerd's HEARTBEAT; the control task calls this once a second."""
        self.send(
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
        self._order(
            lambda now: orders.velocity_target(
                setpoint, self._system, now, self._frame, self._heading.at(now)
            )
        )

    def press_down(self, order: PressDown) -> None:
        """Order a level attitude with thrust 0."""
        self._order(lambda now: orders.level_target(order, self._system, now))

    def show_target(self, target: LandingTarget) -> None:
        """Send LANDING_TARGET, the pad's position, to the autopilot."""
        self._order(lambda now: orders.landing_target(target))

    def _order(self, make: Callable[[float], Message]) -> None:
        now = asyncio.get_running_loop().time()
        try:
            self.send(make(now))
        except orders.Refused as e:
            self._drop(str(e), now)

    def plot(self, values: Mapping[str, float]) -> None:
        """Send values by name as NAMED_VALUE_FLOAT, for plots in the ground station."""
        boot_ms = int(asyncio.get_running_loop().time() * 1e3) & 0xFFFFFFFF
        for name, value in values.items():
            self.send(
                mavlink.MAVLink_named_value_float_message(boot_ms, name.encode("ascii"), value)
            )

    def tell(self, text: StatusText) -> None:
        """Show the pilot a line, cut to 50 characters.

        Beyond a burst and a rate (_TEXTS_AT_ONCE, _TEXTS_PER_S) only critical ones are sent.
        """
        now = asyncio.get_running_loop().time()
        left = self._texts_left + _TEXTS_PER_S * (now - self._texts_t)
        self._texts_left, self._texts_t = min(left, _TEXTS_AT_ONCE), now
        if self._texts_left < 1.0 and text.severity > Severity.CRITICAL:
            self._drop("texts held back", now)
            return
        self._texts_left -= 1.0
        line = text.text.encode("ascii", "replace")[:_STATUSTEXT_LENGTH]
        self.send(mavlink.MAVLink_statustext_message(int(text.severity), line))

    def _warn(self, text: str) -> None:
        log.warning("%s", text)
        self.tell(StatusText(Severity.WARNING, f"landerd: {text}"))

    def ask_parameter(self, name: str) -> None:
        """Request one of the autopilot's parameters; `receive` takes the answer."""
        self.send(
            mavlink.MAVLink_param_request_read_message(
                self._system, _AUTOPILOT, name.encode("ascii"), -1
            )
        )

    def disarm(self) -> None:
        """Order the autopilot to disarm, which it refuses in the air."""
        self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)

    def _drop(self, kind: str, now: float, count: int = 1) -> None:
        """Count messages dropped or refused; log each kind at most once a second."""
        self.counters[kind] += count
        if now - self._logged.get(kind, -math.inf) >= 1.0:
            self._logged[kind] = now
            log.warning("%s (%d so far)", kind, self.counters[kind])


def _nanoseconds(t: float) -> int:
    return int(t * 1e9)
