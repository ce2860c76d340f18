"""The simulated autopilot: MAVLink 2 around `hw.sim.stand_in.copter`, on any number of links.

Streams, acknowledgements and refusals are as measured with ArduCopter 4.5. Messages that are not
addressed to the autopilot alone are forwarded to the other links, as ArduPilot does.
"""

import asyncio
import math
import random
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import FORCE_DISARM, Mode
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.sim.options import AutopilotOptions
from hw.sim.physics.battery import Battery
from hw.sim.stand_in.copter import (
    ARDUPILOT_DEFAULTS,
    Copter,
    CopterParameters,
    Vehicle,
)
from hw.sim.stand_in.ekf import Estimate
from hw.sim.stand_in.pilot import PilotRadio
from hw.sim.stand_in.targets import take_attitude_target, take_position_target
from hw.sim.tampering import Tampering
from landerd.messages import Landed
from landerd.ports import ByteLink, DeviceLost

_COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
_GROUND_STATION = 255  # SYSID_MYGCS
_TICK_S = 0.01
_REOPEN_S = 0.1
_ACK_DELAY_S = (0.001, 0.006)
_LOOP_DELAY_S = (0.0, 0.0025)  # range of the delay until the 400 Hz main loop reads a message
_HEARTBEAT_PERIOD_S = 1.0  # until another rate is requested
_TIMESYNC_PERIOD_S = 10.0
_STATES = (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
DEFAULTS = AutopilotOptions()

_ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
_DENIED: int = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
_FAILED: int = mavlink.MAV_RESULT_FAILED


class World(Protocol):
    """The part of the simulated world that the autopilot uses."""

    @property
    def vehicle(self) -> Vehicle: ...  # noqa: D102
    @property
    def battery(self) -> Battery: ...  # noqa: D102

    def advance(self, t: float) -> None:
        """Advance the world to this time, s."""


class Estimator(Protocol):
    """The source of the autopilot's estimate of its own state."""

    def estimate(self, t: float) -> Estimate:
        """Return the estimated state at this time, s."""
        ...


class Mount(Protocol):
    """A gimbal or servos that the autopilot drives."""

    @property
    def streams(self) -> Mapping[int, Callable[[float, int], Message]]:
        """Makers of its messages by id, from loop time (s) and time since boot (ms)."""
        ...

    def command(self, command: Message, t: float) -> int | None:
        """Obey a COMMAND_LONG and return its MAV_RESULT; None: not for a mount."""
        ...

    def message(self, message: Message, t: float) -> None:
        """Take any message that is not a command."""


class _Channel:
    """One link, with the streams requested on it."""

    def __init__(self, link: ByteLink, system: int) -> None:
        self.link = link
        self.codec = MavlinkCodec(system, _COMPONENT)
        self.streams: dict[int, tuple[float, float]] = {}  # message id: interval, due; s

    def send(self, message: Message) -> None:
        self.link.write(self.codec.encode(message))


class SimAutopilot:
    """The stand-in. `run` serves its links until it is cancelled.

    Attributes:
        copter: the flight code.
        pilot: the pilot's radio.
        mute: ids of messages that it does not send; a fault.
        tampering: changes messages before they are sent; a fault.
        parameters: values of its parameters by name, for requests.
    """

    def __init__(
        self,
        world: World,
        links: Sequence[ByteLink],
        *,
        ekf: Estimator,
        rng: random.Random,
        parameters: CopterParameters = ARDUPILOT_DEFAULTS,
        flying: bool = False,
        options: AutopilotOptions = DEFAULTS,
        system_id: int = 1,
    ) -> None:
        """Make one; flying: it starts armed, in LOITER."""
        self.mute: set[int] = set()
        self.tampering = Tampering()
        self.parameters = {  # only those that landerd requests
            "GUID_TIMEOUT": parameters.guid_timeout_s,
            "WPNAV_ACCEL": 100.0 * parameters.wpnav_accel_mps2,
            "WPNAV_ACCEL_Z": 100.0 * parameters.wpnav_accel_z_mps2,
            "PSC_JERK_XY": parameters.psc_jerk_xy_mps3,
            "PSC_JERK_Z": parameters.psc_jerk_z_mps3,
            "ATC_INPUT_TC": parameters.atc_input_tc_s,
        }
        self._mount: Mount | None = None
        self.pilot = PilotRadio(options.rc_channels)
        self.copter = Copter(world.vehicle, self.pilot, parameters, self._say, flying=flying)
        self._world = world
        self._ekf = ekf
        self._rng = rng
        self._system = system_id
        self._heartbeat_s, self._heartbeat_due = _HEARTBEAT_PERIOD_S, 0.0
        self._options = options
        self._channels = [_Channel(link, system_id) for link in links]
        self._streams: dict[int, Callable[[float], Message]] = {
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
        }
        self._takers: dict[int, Callable[[_Channel, Message, float], None]] = {
            mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._on_position_target,
            mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: self._on_attitude_target,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: self._on_command_long,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self._on_set_mode,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._on_parameter_request,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._on_rc_override,
        }

    def attach(self, mount: Mount) -> None:
        """Connect a gimbal that the autopilot drives."""
        self._mount = mount
        for message_id, make in mount.streams.items():
            self._streams[message_id] = partial(self._of_mount, make)

    async def run(self) -> None:
        """Fly and serve the links until cancelled."""
        t = asyncio.get_running_loop().time()
        self._booted_at = t - self._options.boot_age_s
        self._estimate = self._ekf.estimate(t)
        async with asyncio.TaskGroup() as tasks:
            for channel in self._channels:
                tasks.create_task(self._serve(channel))
            tasks.create_task(self._tick())

    def reboot(self) -> None:
        """Restart as after a watchdog reset in flight: boot time 0, no streams requested."""
        self._booted_at = asyncio.get_running_loop().time()
        for channel in self._channels:
            channel.streams.clear()

    @property
    def boot_s(self) -> float:
        """Its time since boot, s."""
        return asyncio.get_running_loop().time() - self._booted_at

    def shift_clock(self, ahead_s: float) -> None:
        """Add ahead_s to its time since boot."""
        self._booted_at -= ahead_s

    async def _serve(self, channel: _Channel) -> None:
        while True:
            try:
                await channel.link.open()
                while True:
                    for message in channel.codec.decode(await channel.link.read()):
                        self._take(channel, message)
            except DeviceLost:
                await asyncio.sleep(_REOPEN_S)

    async def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        self._heartbeat_due = timesync_due = due
        mode = self.copter.mode
        while True:
            t = loop.time()
            self._step(t)
            if t >= self._heartbeat_due:
                self._heartbeat_due += self._heartbeat_s
                self._send_all(self._heartbeat())
            elif self.copter.mode != mode:
                self._send_all(self._heartbeat())
            mode = self.copter.mode
            if t >= timesync_due:
                timesync_due += _TIMESYNC_PERIOD_S
                self._send_all(mavlink.MAVLink_timesync_message(0, self._boot_ns(t)))
            for channel in self._channels:
                self._send_streams(channel, t)
            due = max(due + _TICK_S, t)
            await asyncio.sleep(due - t)

    def _step(self, t: float) -> None:
        self._world.advance(t)
        self._estimate = self._ekf.estimate(t)
        self.copter.step(self._estimate, t)

    # ---- out ----

    def _send_streams(self, channel: _Channel, t: float) -> None:
        for message_id, (interval, due) in channel.streams.items():
            if t >= due - 1e-6:
                channel.streams[message_id] = (interval, max(due + interval, t))
                if message_id not in self.mute:
                    self._send_by(channel, self._streams[message_id](t))

    def _send_all(self, message: Message) -> None:
        if message.get_msgId() not in self.mute:
            for channel in self._channels:
                self._send_by(channel, message)

    def _send_by(self, channel: _Channel, message: Message) -> None:
        self.tampering.pass_on(message, channel.send)

    def _say(self, text: str) -> None:
        self._send_all(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, text.encode()))

    def _later(self, delay_s: tuple[float, float], call: Callable[[], None]) -> None:
        asyncio.get_running_loop().call_later(self._rng.uniform(*delay_s), call)

    def _boot_ns(self, t: float) -> int:
        return int((t - self._booted_at) * 1e9)

    def _boot_ms(self, t: float) -> int:
        return self._boot_ns(t) // 1_000_000 % 2**32  # as time_boot_ms has it

    def _heartbeat(self) -> Message:
        copter = self.copter
        base_mode = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        if copter.mode in (Mode.GUIDED, Mode.LOITER, Mode.RTL):
            base_mode |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if copter.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        status = mavlink.MAV_STATE_STANDBY
        if copter.failsafe:
            status = mavlink.MAV_STATE_CRITICAL
        elif copter.armed and copter.landed_state >= Landed.IN_AIR:
            status = mavlink.MAV_STATE_ACTIVE
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            copter.mode,
            status,
            3,
        )

    def _attitude(self, t: float) -> Message:
        r = self._estimate
        return mavlink.MAVLink_attitude_message(self._boot_ms(t), r.roll, r.pitch, r.yaw, *r.rates)

    def _local_position(self, t: float) -> Message:
        r = self._estimate
        return mavlink.MAVLink_local_position_ned_message(
            self._boot_ms(t), *r.position, *r.velocity
        )

    def _rc_channels(self, t: float) -> Message:
        return mavlink.MAVLink_rc_channels_message(
            self._boot_ms(t), self._options.rc_channels, *self.pilot.channels(t), 255
        )

    def _of_mount(self, make: Callable[[float, int], Message], t: float) -> Message:
        return make(t, self._boot_ms(t))

    def _extended_sys_state(self, t: float) -> Message:
        return mavlink.MAVLink_extended_sys_state_message(0, self.copter.landed_state)

    def _battery_status(self, t: float) -> Message:
        no_cell = [0xFFFF] * 9
        return mavlink.MAVLink_battery_status_message(
            *(0, 0, 0, 0x7FFF),
            [round(1e3 * self._world.battery.voltage_v), *no_cell],
            -1,
            -1,
            int(self._world.battery.energy_j / 100.0),
            -1,
        )

    # ---- in ----

    def _take(self, channel: _Channel, message: Message) -> None:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if not (system == self._system and component == _COMPONENT):
            for other in self._channels:
                if other is not channel:
                    other.link.write(bytes(message.get_msgbuf()))
        if system not in (0, self._system) or component not in (0, _COMPONENT):
            return
        take = self._takers.get(message.get_msgId(), self._on_other)
        take(channel, message, asyncio.get_running_loop().time())

    def _on_position_target(self, channel: _Channel, m: Message, t: float) -> None:
        take_position_target(self.copter, m, self._estimate, t)
        self._step(t)

    def _on_attitude_target(self, channel: _Channel, m: Message, t: float) -> None:
        take_attitude_target(self.copter, m, t)
        self._step(t)

    def _on_command_long(self, channel: _Channel, m: Message, t: float) -> None:
        self._acknowledge(channel, m, m.command, self._on_command(channel, m, t))

    def _on_set_mode(self, channel: _Channel, m: Message, t: float) -> None:
        self._acknowledge(channel, m, m.get_msgId(), self._set_mode(m.custom_mode))

    def _on_parameter_request(self, channel: _Channel, m: Message, t: float) -> None:
        value = self.parameters.get(m.param_id)
        if value is not None:
            real = mavlink.MAV_PARAM_TYPE_REAL32
            count = len(self.parameters)
            channel.send(
                mavlink.MAVLink_param_value_message(m.param_id.encode(), value, real, count, 0xFFFF)
            )

    def _on_timesync(self, channel: _Channel, m: Message, t: float) -> None:
        if m.tc1 == 0:
            least, most = _LOOP_DELAY_S
            late = self._options.timesync_delay_s
            self._later((least + late, most + late), lambda: self._answer_timesync(channel, m.ts1))

    def _on_rc_override(self, channel: _Channel, m: Message, t: float) -> None:
        if m.get_srcSystem() == _GROUND_STATION:
            raw = tuple(getattr(m, f"chan{i}_raw") for i in range(1, 17))
            self.pilot.override(raw, t)

    def _on_other(self, channel: _Channel, m: Message, t: float) -> None:
        if self._mount is not None:
            self._mount.message(m, t)

    def _answer_timesync(self, channel: _Channel, ts1: int) -> None:
        now = asyncio.get_running_loop().time()
        self._send_by(channel, mavlink.MAVLink_timesync_message(self._boot_ns(now), ts1))

    def _acknowledge(self, channel: _Channel, asked: Message, command: int, result: int) -> None:
        ack = mavlink.MAVLink_command_ack_message(
            command, result, 0, 0, asked.get_srcSystem(), asked.get_srcComponent()
        )
        self._later(_ACK_DELAY_S, lambda: channel.send(ack))

    def _on_command(self, channel: _Channel, m: Message, t: float) -> int:
        """Obey a command and return its MAV_RESULT."""
        if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(channel, _whole(m.param1), m.param2, t)
        if m.command == mavlink.MAV_CMD_DO_SET_MODE:
            return self._set_mode(_whole(m.param2))
        if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return self._arm_or_disarm(m)
        if m.command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            is_ground_speed = _whole(m.param1) == mavlink.SPEED_TYPE_GROUNDSPEED
            return _result(is_ground_speed and self.copter.set_speed(m.param2))
        if m.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            return _result(self.copter.take_off(m.param7, self._estimate, t))
        result = self._mount.command(m, t) if self._mount is not None else None
        return _UNSUPPORTED if result is None else result

    def _arm_or_disarm(self, m: Message) -> int:
        if m.param1 == 1.0:
            return _result(self.copter.arm())
        if m.param1 == 0.0:
            return _result(self.copter.disarm(forced=m.param2 == FORCE_DISARM))
        return _UNSUPPORTED

    def _set_interval(self, channel: _Channel, message_id: int, us: float, t: float) -> int:
        if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._heartbeat_s = 1e-6 * us if us > 0.0 else _HEARTBEAT_PERIOD_S
            self._heartbeat_due = t + self._heartbeat_s
            return _ACCEPTED
        if message_id not in self._streams:
            self._say(f"No ap_message for mavlink id ({message_id})")
            return _DENIED
        if us > 0.0:
            interval = max(1e-6 * us, _TICK_S)
            if self._options.telemetry_hz is not None and message_id in _STATES:
                interval = max(interval, 1.0 / self._options.telemetry_hz)
            channel.streams[message_id] = (interval, t + interval)
        else:  # the default is off, too
            channel.streams.pop(message_id, None)
        return _ACCEPTED

    def _set_mode(self, mode: int) -> int:
        return _result(self.copter.set_mode(mode))


def _result(accepted: bool) -> int:
    return _ACCEPTED if accepted else _FAILED


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) else -1
