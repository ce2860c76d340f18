"""Others that send on the link: noise, a second autopilot, a false ground station."""

import asyncio
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.sim.faults.bench import Bench, Effect, goes_on

_EVERY_S = 0.05
_SYSTEM, _STATION = 7, 253  # system ids of which landerd's configuration has neither
PARAMETERS = (b"LIM_SPEED", b"DESC_COMMIT_HGT", b"TRK_KP", b"RC_GATE_CH")  # landerd's own


def _talking(say: Callable[[Bench, MavlinkCodec, float], bytes], system: int) -> Effect:
    """Return a fault that sends messages of another system to landerd while it lasts."""

    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        codec = MavlinkCodec(system, 1)

        async def talk() -> None:
            while True:
                bench.vehicle.far.write(say(bench, codec, severity))
                await asyncio.sleep(_EVERY_S)

        with goes_on(talk()):
            yield

    return effect


def _noise(bench: Bench, codec: MavlinkCodec, severity: float) -> bytes:
    return bench.rng.randbytes(1 + round(200.0 * severity))


def _autopilot(bench: Bench, codec: MavlinkCodec, severity: float) -> bytes:
    ms = 1000
    messages = (
        mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 3, 3
        ),
        mavlink.MAVLink_attitude_message(ms, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        mavlink.MAVLink_local_position_ned_message(ms, 500.0, 0.0, -30.0, 9.0, 0.0, 0.0),
        mavlink.MAVLink_rc_channels_message(ms, 16, *([1000] * 18), 255),
        mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND),
    )
    return b"".join(codec.encode(message) for message in messages)


def _flood(bench: Bench, codec: MavlinkCodec, severity: float) -> bytes:
    text = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, b"x" * 50)
    return codec.encode(text) * round(bench.between(25, 250, severity))


def _station(bench: Bench, codec: MavlinkCodec, severity: float) -> bytes:
    real = mavlink.MAV_PARAM_TYPE_REAL32
    messages = [
        mavlink.MAVLink_param_set_message(1, 191, name, bench.rng.uniform(0.0, 10.0), real)
        for name in PARAMETERS
    ]
    disarm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    messages.append(mavlink.MAVLink_command_long_message(1, 191, disarm, 0, *(0.0,) * 7))
    return b"".join(codec.encode(message) for message in messages)


FAULTS: Mapping[str, Effect] = {
    "stranger-noise": _talking(_noise, _SYSTEM),
    "stranger-autopilot": _talking(_autopilot, _SYSTEM),
    "stranger-flood": _talking(_flood, 1),
    "stranger-station": _talking(_station, _STATION),
}
