"""Bytes to messages: nothing damaged comes through, nothing sound is lost behind it."""

import random

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from tests.fuzz.budget import examples


def attitude(i: int) -> Message:
    return mavlink.MAVLink_attitude_message(i, 0.1, -0.2, 0.3, 0.01, 0.02, 0.03)


def frames(count: int) -> list[bytes]:
    codec = MavlinkCodec(1, 1)
    return [codec.encode(attitude(i)) for i in range(count)]


def boot_times(messages: list[Message]) -> list[int]:
    return [m.time_boot_ms for m in messages]


@settings(deadline=None)
@given(st.lists(st.integers(1, 60), max_size=50))
def test_frames_may_be_cut_anywhere(cuts: list[int]) -> None:
    stream = b"".join(frames(10))
    codec = MavlinkCodec(255, 190)
    messages: list[Message] = []
    for cut in cuts:
        messages += codec.decode(stream[:cut])
        stream = stream[cut:]
    messages += codec.decode(stream)
    assert boot_times(messages) == list(range(10))
    assert codec.counters["garbled bytes"] == codec.counters["messages lost"] == 0


def test_mavlink_1_is_understood() -> None:
    frame = attitude(7).pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)
    assert frame[0] == 0xFE
    assert boot_times(MavlinkCodec(255, 190).decode(frame)) == [7]


@settings(deadline=None)
@given(st.integers(0, 39), st.integers(1, 255))
def test_a_damaged_byte_costs_its_own_message_only(at: int, flip: int) -> None:
    first, second, *rest = frames(4)
    damaged = bytearray(second)
    damaged[at % len(damaged)] ^= flip
    codec = MavlinkCodec(255, 190)
    messages = codec.decode(first + bytes(damaged) + b"".join(rest))
    assert boot_times(messages) == [0, 2, 3]
    assert codec.counters["messages lost"] == 1
    assert codec.counters["garbled bytes"] == len(second)


def test_a_false_start_byte_does_not_delay_messages() -> None:
    codec = MavlinkCodec(255, 190)
    # A marker and a length of 255: looks like a frame of 267 bytes that is still on its way.
    assert boot_times(codec.decode(b"\xfd\xff\x00" + frames(1)[0])) == [0]


def test_bytes_like_a_message_inside_an_incomplete_message_are_not_taken_for_one() -> None:
    # A text whose letters begin a frame of an unknown message, and that comes in two reads.
    inner = bytes((0xFD, 3, 0, 0, 0, 1, 1, 0xFE, 0xFF, 0xFF)) + b"abcde"
    text = mavlink.MAVLink_statustext_message(6, inner + b"." * 30)
    frame = MavlinkCodec(1, 1).encode(text)
    codec = MavlinkCodec(255, 190)
    assert codec.decode(frame[:-3]) == []
    assert len(codec.decode(frame[-3:])) == 1
    assert codec.counters["unknown"] == codec.counters["garbled bytes"] == 0


def test_unknown_messages_are_skipped_and_counted() -> None:
    unknown = bytearray(frames(1)[0])
    unknown[7:10] = (0xFFFFFE).to_bytes(3, "little")
    codec = MavlinkCodec(255, 190)
    assert boot_times(codec.decode(bytes(unknown) + frames(1)[0])) == [0]
    assert codec.counters["unknown"] == 1


def test_lost_messages_are_counted_across_the_wrap_of_the_sequence() -> None:
    sent = frames(600)
    codec = MavlinkCodec(255, 190)
    codec.decode(b"".join(sent[:250] + sent[260:400] + sent[401:]))
    assert codec.counters["messages lost"] == 11


def test_messages_that_a_ground_station_sends_to_the_autopilot_alone_are_not_lost() -> None:
    station, codec = MavlinkCodec(255, 190), MavlinkCodec(1, 191)
    sent = [station.encode(attitude(n)) for n in range(40)]
    # The autopilot passes on broadcasts, as each tenth may be, and keeps what is for itself.
    assert boot_times(codec.decode(b"".join(sent[::10]))) == [0, 10, 20, 30]
    assert codec.counters["messages lost"] == 0


def test_what_was_sent_while_the_link_was_closed_is_not_called_lost() -> None:
    codec, sent = MavlinkCodec(255, 190), frames(40)
    codec.decode(sent[0] + sent[1][:5])
    codec.reset()
    assert boot_times(codec.decode(sent[30] + sent[31])) == [30, 31]
    assert codec.counters["messages lost"] == codec.counters["garbled bytes"] == 0


@examples(300)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_random_bytes_never_raise(chunks: list[bytes]) -> None:
    codec = MavlinkCodec(255, 190)
    for chunk in chunks:
        codec.decode(chunk)
    # and the next sound message comes through at once
    assert boot_times(codec.decode(frames(1)[0]))[-1:] == [0]


def test_mutated_streams_never_raise_nor_pile_up() -> None:
    rng = random.Random(5)
    sound = b"".join(frames(256))
    codec = MavlinkCodec(255, 190)
    good = 0
    for _ in range(40):
        stream = bytearray(sound)
        for _ in range(len(stream) // 20):
            stream[rng.randrange(len(stream))] = rng.choice((0xFD, 0xFE, rng.randrange(256)))
        for start in range(0, len(stream), 97):
            for m in codec.decode(bytes(stream[start : start + 97])):
                good += 1
                assert (m.roll, m.pitch, m.yaw) == attitude_fields
        assert codec.pending_bytes <= 300
    assert 0 < good < 40 * 256


attitude_fields = tuple(
    getattr(MavlinkCodec(255, 190).decode(frames(1)[0])[0], name)
    for name in ("roll", "pitch", "yaw")
)
