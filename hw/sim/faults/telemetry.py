"""Faults of telemetry: messages lost, late, frozen, biased, jumping; the autopilot's clock."""

import asyncio
import copy
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.sim.faults.bench import Bench, Effect, goes_on, stand_in
from hw.sim.tampering import Send, Tamper
from landerd.geometry import wrap

_WRAP_S = 2.0**32 / 1e3
_WRAPS_AFTER_S = 0.3
_DRIFTS_EVERY_S = 0.1
_NO_PULSE = 0xFFFF  # value of a channel that the receiver does not have

_ATTITUDE: int = mavlink.MAVLINK_MSG_ID_ATTITUDE
_POSITION: int = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
_HEARTBEAT: int = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_RC: int = mavlink.MAVLINK_MSG_ID_RC_CHANNELS
_LANDED: int = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
_TIMESYNC: int = mavlink.MAVLINK_MSG_ID_TIMESYNC


def _tampered(kind: int, tamper: Callable[[Bench, float], Tamper]) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        does = tamper(bench, severity)
        bench.vehicle.tampering.begin(kind, does)
        yield
        bench.vehicle.tampering.end(kind, does)

    return effect


def _lost(kind: int) -> Effect:
    return _tampered(kind, lambda bench, severity: lambda message, send: None)


def _late(kind: int, least_s: float, most_s: float) -> Effect:
    def tamper(bench: Bench, severity: float) -> Tamper:
        late_s = bench.between(least_s, most_s, severity)
        loop = asyncio.get_running_loop()
        return lambda message, send: (loop.call_later(late_s, send, message), None)[1]

    return _tampered(kind, tamper)


def _frozen(kind: int) -> Effect:
    def tamper(bench: Bench, severity: float) -> Tamper:
        first: list[Message] = []

        def repeat(message: Message, send: Send) -> None:
            first.append(message)
            again = copy.copy(first[0])
            again.time_boot_ms = message.time_boot_ms
            del first[1:]
            send(again)

        return repeat

    return _tampered(kind, tamper)


def _changed(kind: int, change: Callable[[Bench, float, Message], None]) -> Effect:
    """Return a fault that changes each message of a kind."""

    def tamper(bench: Bench, severity: float) -> Tamper:
        def send_changed(message: Message, send: Send) -> None:
            message = copy.copy(message)
            change(bench, severity, message)
            send(message)

        return send_changed

    return _tampered(kind, tamper)


def _lean(bench: Bench, severity: float, m: Message) -> None:
    bias = math.radians(bench.between(1.0, 10.0, severity))
    m.roll, m.pitch = m.roll + bias, m.pitch + bias


def _swing(bench: Bench, severity: float, m: Message) -> None:
    most = math.radians(bench.between(3.0, 30.0, severity))
    m.yaw = wrap(m.yaw + bench.rng.uniform(-most, most))


def _drift(bench: Bench, severity: float, m: Message) -> None:
    bias = bench.between(0.2, 2.0, severity)
    m.vx, m.vy, m.vz = m.vx + bias, m.vy + bias, m.vz + bias


def _jump(bench: Bench, severity: float, m: Message) -> None:
    most = bench.between(0.5, 20.0, severity)
    m.x, m.y = m.x + bench.rng.uniform(-most, most), m.y + bench.rng.uniform(-most, most)


def _no_number(bench: Bench, severity: float, m: Message) -> None:
    m.x = m.y = m.z = math.nan


def _spike(bench: Bench, severity: float, m: Message) -> None:
    if bench.rng.random() < bench.between(0.02, 0.3, severity):
        m.vx, m.vy, m.vz = (v + bench.rng.uniform(-20.0, 20.0) for v in (m.vx, m.vy, m.vz))


def _no_signal(bench: Bench, severity: float, m: Message) -> None:
    for channel in range(1, 19):
        setattr(m, f"chan{channel}_raw", 0 if severity < 0.5 else _NO_PULSE)


def _elsewhere(bench: Bench, severity: float, m: Message) -> None:
    m.custom_mode = mavlink.COPTER_MODE_LOITER


def _now_and_then(bench: Bench, severity: float, m: Message) -> None:
    if bench.rng.random() < bench.between(0.1, 0.9, severity):
        m.landed_state = mavlink.MAV_LANDED_STATE_ON_GROUND


def _wrong_stamp(bench: Bench, severity: float, m: Message) -> None:
    if bench.rng.random() < bench.between(0.02, 0.3, severity):
        m.time_boot_ms = bench.rng.randrange(2**32)


def _wrong_answer(bench: Bench, severity: float, m: Message) -> None:
    most_s = bench.between(0.01, 0.5, severity)
    if m.tc1:
        m.tc1 = max(1, m.tc1 + round(1e9 * bench.rng.uniform(-most_s, most_s)))


def _disarmed(bench: Bench, severity: float, m: Message) -> None:
    m.base_mode &= ~mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def _says(landed_state: int) -> Effect:
    def change(bench: Bench, severity: float, m: Message) -> None:
        m.landed_state = landed_state

    return _changed(_LANDED, change)


def _clock(ahead_s: Callable[[Bench, float], float]) -> Effect:
    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        stand_in(bench).shift_clock(ahead_s(bench, severity))
        yield

    return effect


@contextmanager
def _drifts(bench: Bench, severity: float) -> Iterator[None]:
    rate = bench.between(1e-3, 2e-2, severity) * bench.rng.choice((-1.0, 1.0))

    async def drift() -> None:
        while True:
            await asyncio.sleep(_DRIFTS_EVERY_S)
            stand_in(bench).shift_clock(rate * _DRIFTS_EVERY_S)

    with goes_on(drift()):
        yield


@contextmanager
def _stamps_wrong(bench: Bench, severity: float) -> Iterator[None]:
    kinds = (_ATTITUDE, _POSITION, _RC)
    with ExitStack() as effects:
        for kind in kinds:
            effects.enter_context(_changed(kind, _wrong_stamp)(bench, severity))
        yield


def _reset(kind: int, name: str, least: float, most: float) -> Effect:
    """Return a fault that shifts fields of a message by a constant until the flight ends."""

    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        off = bench.between(least, most, severity) * bench.rng.choice((-1.0, 1.0))

        def send_off(message: Message, send: Send) -> None:
            message = copy.copy(message)
            for field in name.split():
                value = getattr(message, field) + off
                setattr(message, field, wrap(value) if field == "yaw" else value)
            send(message)

        bench.vehicle.tampering.begin(kind, send_off)
        yield

    return effect


def _until_wrap(bench: Bench, severity: float) -> float:
    # 0 if the clock has wrapped already: setting it back would look like a restart.
    return max(0.0, _WRAP_S - _WRAPS_AFTER_S - stand_in(bench).boot_s)


FAULTS: Mapping[str, Effect] = {
    "attitude-lost": _lost(_ATTITUDE),
    "attitude-late": _late(_ATTITUDE, 0.05, 0.5),
    "attitude-frozen": _frozen(_ATTITUDE),
    "attitude-biased": _changed(_ATTITUDE, _lean),
    "attitude-jumping": _changed(_ATTITUDE, _swing),
    "position-lost": _lost(_POSITION),
    "position-late": _late(_POSITION, 0.05, 0.5),
    "position-frozen": _frozen(_POSITION),
    "position-biased": _changed(_POSITION, _drift),
    "position-jumping": _changed(_POSITION, _jump),
    "position-nan": _changed(_POSITION, _no_number),
    "position-reset": _reset(_POSITION, "x y", 0.3, 7.0),
    "height-reset": _reset(_POSITION, "z", 0.1, 2.0),
    "heading-reset": _reset(_ATTITUDE, "yaw", math.radians(3.0), math.radians(45.0)),
    "velocity-spikes": _changed(_POSITION, _spike),
    "heartbeat-lost": _lost(_HEARTBEAT),
    "heartbeat-late": _late(_HEARTBEAT, 0.3, 3.0),
    "heartbeat-disarmed": _changed(_HEARTBEAT, _disarmed),
    "heartbeat-wrong-mode": _changed(_HEARTBEAT, _elsewhere),
    "rc-missing": _lost(_RC),
    "rc-late": _late(_RC, 0.1, 1.0),
    "rc-frozen": _frozen(_RC),
    "rc-no-signal": _changed(_RC, _no_signal),
    "landed-missing": _lost(_LANDED),
    "landed-late": _late(_LANDED, 0.2, 2.0),
    "landed-false": _says(mavlink.MAV_LANDED_STATE_ON_GROUND),
    "landed-never": _says(mavlink.MAV_LANDED_STATE_IN_AIR),
    "landed-flickers": _changed(_LANDED, _now_and_then),
    "clock-back": _clock(lambda bench, s: -bench.between(0.1, 20.0, s)),
    "clock-ahead": _clock(lambda bench, s: bench.between(0.1, 20.0, s)),
    "clock-wrapped": _clock(_until_wrap),
    "clock-drifts": _drifts,
    "clock-outliers": _stamps_wrong,
    "timesync-lost": _lost(_TIMESYNC),
    "timesync-jumping": _changed(_TIMESYNC, _wrong_answer),
    "timesync-late": _late(_TIMESYNC, 0.02, 0.4),
}
