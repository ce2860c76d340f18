from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.autopilots.signing import Signing
from hw.sim.judge.wire import Departures, Wire, frames


def attitude(ms: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_message(ms, *(0.0,) * 6)


def test_frames_in_one_piece_are_taken_apart_and_others_left_out() -> None:
    codec = MavlinkCodec(1, 1)
    battery = mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [0] * 10, -1, -1, -1, -1)
    data = b"".join(codec.encode(m) for m in (attitude(1), battery, attitude(2)))
    assert [m.time_boot_ms for m in Wire().messages(data)] == [1, 2]


def test_a_signed_frame_is_read(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("a pass phrase", encoding="utf-8")
    key.chmod(0o600)
    codec = MavlinkCodec(1, 1, Signing(key, tmp_path / "time"))
    data = codec.encode(attitude(1)) + codec.encode(attitude(2))
    assert [m.time_boot_ms for m in Wire().messages(data)] == [1, 2]


def test_a_damaged_message_is_none() -> None:
    codec = MavlinkCodec(1, 1)
    damaged = bytearray(codec.encode(attitude(1)))
    damaged[12] ^= 1
    data = bytes(damaged) + codec.encode(attitude(2))
    assert [m.time_boot_ms for m in Wire().messages(data)] == [2]
    assert Wire().messages(b"") == []


def test_bytes_that_are_no_frame_are_told() -> None:
    frame = MavlinkCodec(1, 1).encode(attitude(1))
    kinds = [kind for kind, _ in frames(frame + b"\xfe\x01")]
    assert kinds == [mavlink.MAVLINK_MSG_ID_ATTITUDE, -1]


def test_a_frame_is_as_old_as_its_departure() -> None:
    codec, departures = MavlinkCodec(1, 1), Departures()
    first, second = codec.encode(attitude(1)), codec.encode(attitude(2))
    departures.sent(1.0, first + second)
    assert departures.left(second, 1.3) == 1.0
    assert departures.left(codec.encode(attitude(3)), 1.3) == 1.3  # nobody saw it leave
    departures.sent(2.0, first)
    assert departures.left(first, 2.3) == 2.0
