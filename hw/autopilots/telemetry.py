"""Turns ArduCopter's telemetry into the core's messages; impossible values are refused."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.arducopter import VEHICLE_TYPES, Mode, mode_name
from hw.autopilots.mavlink_codec import Message
from landerd.messages import (
    Attitude,
    Battery,
    Heartbeat,
    Landed,
    LandedState,
    LocalPosition,
    RcChannels,
)

# Limits beyond which a field is damaged: no vehicle flies so far or so fast.
FARTHEST_M = 1e5
FASTEST_MPS = 100.0
FASTEST_TURN_RADPS = 35.0
_PULSE_US = (900, 2200)  # least and greatest pulse width of an RC channel that has a signal
_CHANNELS = 18


class BadMessage(Exception):
    """A message has an impossible value; the text names the kind of fault."""


def heartbeat(m: Message, t: float) -> Heartbeat:
    """Convert HEARTBEAT; refuse other autopilots and vehicle types, whose modes differ."""
    if m.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA or m.type not in VEHICLE_TYPES:
        raise BadMessage("not ArduCopter")
    has_mode = m.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    return Heartbeat(
        t,
        armed=bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
        guided=bool(has_mode) and m.custom_mode == Mode.GUIDED,
        mode=mode_name(m.custom_mode) if has_mode else "unknown",
    )


def attitude(m: Message, t: float) -> Attitude:
    """Convert ATTITUDE."""
    rates = (m.rollspeed, m.pitchspeed, m.yawspeed)
    if not (
        within(math.pi + 1e-3, m.roll, m.yaw)
        and within(math.pi / 2 + 1e-3, m.pitch)
        and within(FASTEST_TURN_RADPS, *rates)
    ):
        raise BadMessage("bad attitude")
    return Attitude(t, m.roll, m.pitch, m.yaw, rates)


def local_position(m: Message, t: float) -> LocalPosition:
    """Convert LOCAL_POSITION_NED."""
    position, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
    if not (within(FARTHEST_M, *position) and within(FASTEST_MPS, *velocity)):
        raise BadMessage("bad position")
    return LocalPosition(t, position, velocity)


def rc_channels(m: Message, t: float) -> RcChannels:
    """Convert RC_CHANNELS; a channel without a valid pulse reads 0.

    `chancount` is ignored: it is the receiver's number of channels, but channels beyond it carry
    pulses, too, when they are overridden over MAVLink.
    """
    raw = [getattr(m, f"chan{i}_raw") for i in range(1, _CHANNELS + 1)]
    low, high = _PULSE_US
    return RcChannels(t, tuple(us if low <= us <= high else 0 for us in raw))


def landed_state(m: Message, t: float) -> LandedState:
    """Convert EXTENDED_SYS_STATE."""
    try:
        return LandedState(t, Landed(m.landed_state))
    except ValueError:
        raise BadMessage("bad landed state") from None


def battery(m: Message, t: float) -> Battery | None:
    """Convert BATTERY_STATUS of the first battery; None for other batteries.

    Each entry of `voltages` is one cell's, or the first one is the whole battery's; 65535 means
    that there is no cell.
    """
    if m.id != 0:
        return None
    cells_mv = [mv for mv in m.voltages if mv != 0xFFFF]
    return Battery(
        t,
        voltage_v=1e-3 * sum(cells_mv) if cells_mv else None,
        energy_consumed_j=100.0 * m.energy_consumed if m.energy_consumed >= 0 else None,
    )


def within(limit: float, *values: float) -> bool:
    """Tell whether the magnitude of every value is at most limit; that of NaN is not."""
    return all(-limit <= v <= limit for v in values)


def gimbal_yaw_is_from_north(m: Message) -> bool:
    """Tell whether GIMBAL_DEVICE_ATTITUDE_STATUS has yaw from north, not from the airframe."""
    if m.flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME:
        return True
    is_vehicles = m.flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    return bool(m.flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK and not is_vehicles)
