"""A simulated world whose vehicle is flown, and its true state given, by ArduCopter in SITL.

SIM_STATE has the true state, but no time, and its position is in steps of 1 cm. The SYSTEM_TIME
sent with it gives the time, and integrating its exact velocity smooths the position's steps.
"""

import asyncio
import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import Mode
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.sim.options import SimOptions
from hw.sim.physics.contact import feet_of
from hw.sim.physics.pad_motion import PadState
from hw.sim.physics.vehicle import Touchdown
from hw.sim.physics.world import HISTORY_S, Airframe, Sample, World, interpolated
from hw.sim.stand_in.ground_station import GroundStation
from landerd.geometry import Vec3, add, rot_zyx, rotate, sub, wrap
from landerd.pad import Plate
from landerd.ports import ByteLink

_SYSTEM, _COMPONENT = 255, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER  # ids that request the truth
TRUTH_HZ = 100.0
_EXTRAPOLATION_S = 0.1  # longest extrapolation of the true state beyond the last report
_POSITION_LAG_S = 2.0  # time constant of the filter that smooths the steps of the position
_JUMP_M = 1.0  # at a position farther than this from the integrated one it was relocated
_M_PER_UNIT = 0.011131884502145034  # 1e-7 degrees of latitude, as ArduPilot counts
_FRAME_HEIGHT_M = 0.1  # from SITL's ground to the vehicle's origin where it stands
_CONTACT_M = 0.02  # height below which a foot touches: heights are reported in centimetres
_CLEAR_M = 0.3  # height of the feet above which the vehicle flies again


@dataclass(frozen=True, slots=True)
class State:
    """The true state at one time, local NED."""

    t: float  # loop's clock, s
    position: Vec3  # of the body frame's origin; SITL's ground is 0, m
    velocity: Vec3
    roll: float
    pitch: float
    yaw: float
    rates: Vec3  # body, rad/s


class Truth:
    """Collects what the autopilot and its simulation say; `take` gets every message.

    Attributes:
        armed: as the last HEARTBEAT said.
        energy_j: energy drawn from the battery, as the autopilot counts it.
        version: version of the autopilot's software; empty until it is reported.
        received: number of true states received.
        texts: the autopilot's texts for the pilot.
    """

    def __init__(self, link: ByteLink, system_id: int, place: Callable[[float], float]) -> None:
        """Make one; place: reports the autopilot's boot time (s), and returns the loop's time."""
        self.armed = False
        self.energy_j = 0.0
        self.version = ""
        self.received = 0
        self.texts: list[str] = []
        self._link = link
        self._vehicle = system_id
        self._place = place
        self._codec = MavlinkCodec(_SYSTEM, _COMPONENT)
        self._origin: tuple[int, int, float] | None = None  # 1e-7 degrees, m
        self._boot_s: float | None = None  # said by a SYSTEM_TIME, for the SIM_STATE behind it
        self._states: deque[State] = deque(maxlen=round(2.0 * HISTORY_S * TRUTH_HZ))

    @property
    def ready(self) -> bool:
        """Whether the autopilot has a local origin and its simulation reports."""
        return bool(self._states)

    def ask(self) -> None:
        """Request the messages that are missing; to be called repeatedly."""
        interval_us = 1e6 / TRUTH_HZ
        for message_id in (mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, mavlink.MAVLINK_MSG_ID_SIM_STATE):
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), interval_us)
        battery = float(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
        self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, battery, 5e5)
        wanted = []
        if self._origin is None:
            wanted.append(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
        if not self.version:
            wanted.append(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        for message_id in wanted:
            self._command(mavlink.MAV_CMD_REQUEST_MESSAGE, float(message_id), 0.0)

    def _command(self, command: int, param1: float, param2: float) -> None:
        message = mavlink.MAVLink_command_long_message(
            self._vehicle, mavlink.MAV_COMP_ID_AUTOPILOT1, command, 0, param1, param2, 0, 0, 0, 0, 0
        )
        self._link.write(self._codec.encode(message))

    def take(self, message: Message) -> None:
        """Take a message that arrived on the link."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source != (self._vehicle, mavlink.MAV_COMP_ID_AUTOPILOT1):
            return
        kind = message.get_msgId()
        if kind == mavlink.MAVLINK_MSG_ID_SYSTEM_TIME:
            self._boot_s = 1e-3 * message.time_boot_ms
        elif kind == mavlink.MAVLINK_MSG_ID_SIM_STATE:
            if self._boot_s is not None and self._origin is not None:
                self._on_state(message, self._place(self._boot_s), self._origin)
            self._boot_s = None
        elif kind == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            self._origin = (message.latitude, message.longitude, 1e-3 * message.altitude)
        elif kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == mavlink.MAVLINK_MSG_ID_BATTERY_STATUS:
            self.energy_j = 100.0 * message.energy_consumed
        elif kind == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            self.texts.append(message.text)
        elif kind == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            v = message.flight_sw_version
            self.version = f"ArduCopter {v >> 24}.{v >> 16 & 0xFF}.{v >> 8 & 0xFF}"

    def _on_state(self, m: Message, t: float, origin: tuple[int, int, float]) -> None:
        velocity = (m.vn, m.ve, m.vd)
        latitude, longitude, altitude = origin
        middle = math.radians(0.5e-7 * (m.lat_int + latitude))
        position = (
            (m.lat_int - latitude) * _M_PER_UNIT,
            (m.lon_int - longitude) * _M_PER_UNIT * math.cos(middle),
            altitude - m.alt,
        )
        if self._states:
            last = self._states[-1]
            dt = t - last.t
            if dt <= 0.0:
                return
            carried: Vec3 = (
                last.position[0] + 0.5 * dt * (last.velocity[0] + velocity[0]),
                last.position[1] + 0.5 * dt * (last.velocity[1] + velocity[1]),
                last.position[2] + 0.5 * dt * (last.velocity[2] + velocity[2]),
            )
            if math.dist(carried, position) < _JUMP_M:
                k = 1.0 - math.exp(-dt / _POSITION_LAG_S)
                position = (
                    carried[0] + k * (position[0] - carried[0]),
                    carried[1] + k * (position[1] - carried[1]),
                    carried[2] + k * (position[2] - carried[2]),
                )
        self.received += 1
        self._states.append(
            State(t, position, velocity, m.roll, m.pitch, m.yaw, (m.xgyro, m.ygyro, m.zgyro))
        )

    def at(self, t: float) -> State:
        """Return the state at loop time t (s), interpolated or briefly extrapolated."""
        states = self._states
        i = bisect_left(states, t, key=lambda s: s.t)
        if i == 0:
            return states[0]
        if i == len(states):
            return _extrapolated(states[-1], t)
        a, b = states[i - 1], states[i]
        k = (t - a.t) / (b.t - a.t)
        return State(
            t,
            interpolated(a.position, b.position, k),
            interpolated(a.velocity, b.velocity, k),
            a.roll + k * wrap(b.roll - a.roll),
            a.pitch + k * (b.pitch - a.pitch),
            wrap(a.yaw + k * wrap(b.yaw - a.yaw)),
            interpolated(a.rates, b.rates, k),
        )


class SitlPilot:
    """The pilot in SITL, who acts through a ground station; a hw.sim.stand_in.switch.Pilot."""

    def __init__(self, station: GroundStation) -> None:
        self._station = station
        self._selecting: asyncio.Task[None] | None = None

    def select(self, mode: Mode) -> None:
        """Select a mode of the autopilot."""
        self._selecting = asyncio.create_task(self._station.set_mode(mode))

    def lose_radio(self) -> None:
        """Switch the transmitter off, and with it the overrides that replace its switches."""
        self._station.overrides = False
        self._station.set_parameter("SIM_RC_FAIL", 1.0)

    def restore_radio(self) -> None:
        """Switch the transmitter on again."""
        self._station.overrides = True
        self._station.set_parameter("SIM_RC_FAIL", 0.0)


def _extrapolated(s: State, t: float) -> State:
    dt = min(t - s.t, _EXTRAPOLATION_S)
    p, q, r = s.rates
    return replace(
        s,
        t=t,
        position=interpolated(s.position, add(s.position, s.velocity), dt),
        roll=s.roll + p * dt,
        pitch=s.pitch + q * dt,
        yaw=wrap(s.yaw + r * dt),
    )


class SitlWorld(World):
    """The simulated world with the vehicle where SITL has it; wind and dynamics are SITL's.

    SITL's level ground is taken for the pad's mean height. It stands still: on a moving pad only
    the contact is true. Of the parent's vehicle only the state is used.
    """

    def __init__(
        self,
        options: SimOptions,
        airframe: Airframe,
        plate: Plate,
        seed: int,
        truth: Truth,
    ) -> None:
        """Until `begin` the pad stands at its start."""
        super().__init__(options, airframe, plate, seed)
        self._truth = truth
        self._lift = (0.0, 0.0, _FRAME_HEIGHT_M - airframe.gear_height_m - self._motion.mean_height)
        self._feet = feet_of(airframe.footprint_m, airframe.gear_height_m)
        self._plate = plate
        self._flying = True

    def begin(self, t: float) -> None:
        """Start the world's time now, t on the loop's clock: the pad moves from here on."""
        self._t0 = t
        self._move(None)
        self._history.clear()
        self._record()

    def _move(self, pad: PadState | None) -> None:
        state, vehicle = self._truth.at(self.t), self.vehicle
        vehicle.position = add(state.position, self._lift)
        vehicle.velocity = state.velocity
        vehicle.roll, vehicle.pitch, vehicle.yaw = state.roll, state.pitch, state.yaw
        vehicle.rates = state.rates
        vehicle.motors = self._truth.armed
        self.battery.energy_j = self._truth.energy_j
        if pad is not None:
            self._touch(pad)

    def _touch(self, pad: PadState) -> None:
        """Determine which feet touch, and whether they touch the pad."""
        vehicle = self.vehicle
        R_local_body = rot_zyx(vehicle.yaw, vehicle.pitch, vehicle.roll)
        feet = [pad.in_pad(add(vehicle.position, rotate(R_local_body, f))) for f in self._feet]
        a, b, c, d = (-foot[2] < _CONTACT_M for foot in feet)
        vehicle.feet = (a, b, c, d)
        touching = [foot for foot, is_down in zip(feet, vehicle.feet, strict=True) if is_down]
        down = [self._plate.holds(north, east) for north, east, _ in touching]
        vehicle.on_pad = bool(down) and all(down)
        if min(-foot[2] for foot in feet) > _CLEAR_M:
            self._flying = True
        elif self._flying and down:
            self._flying = False
            relative = sub(vehicle.velocity, pad.velocity_at(self.footprint_centre))
            vehicle.touchdown = Touchdown(self.t, on_pad=vehicle.on_pad, velocity=relative)

    def state_at(self, t: float) -> Sample:
        """Return the state at time t: the vehicle's is SITL's, the gimbal's the world's own."""
        sample, state = super().state_at(t), self._truth.at(t)
        return sample._replace(
            position=add(state.position, self._lift),
            velocity=state.velocity,
            roll=state.roll,
            pitch=state.pitch,
            yaw=state.yaw,
            rates=state.rates,
        )
