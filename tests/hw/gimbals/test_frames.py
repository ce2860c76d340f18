"""Frames out of damaged streams, with each protocol's own frames."""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.gimbals import simplebgc, siyi, storm32
from hw.gimbals.frames import FrameScanner

PROTOCOLS: dict[str, tuple[Callable[[], FrameScanner], list[bytes]]] = {
    "simplebgc": (
        simplebgc.frame_scanner,
        [simplebgc.encode(61, bytes(54)), simplebgc.encode(67), simplebgc.encode(20, b"$" * 18)],
    ),
    "siyi": (
        siyi.frame_scanner,
        [siyi.encode(2, n, 0x0D, bytes(12)) for n in (0, 0x6655, 3)],
    ),
    "storm32": (
        lambda: storm32.frame_scanner(storm32.FROM_GIMBAL),
        [storm32.encode(b"\xfb", 6, bytes(18)), storm32.encode(b"\xfb", 150, b"\xfb")],
    ),
}
each_protocol = pytest.mark.parametrize("protocol", PROTOCOLS)


@each_protocol
def test_finds_frames_however_the_stream_is_cut(protocol: str) -> None:
    make, frames = PROTOCOLS[protocol]
    stream = b"".join(frames)
    for size in (1, 3, 7, len(stream)):
        scanner = make()
        found = [
            frame
            for at in range(0, len(stream), size)
            for frame in scanner.feed(stream[at : at + size])
        ]
        assert found == frames
        assert not scanner.counters


@each_protocol
def test_drops_a_frame_with_any_one_bit_wrong(protocol: str) -> None:
    make, (frame, after, *_) = PROTOCOLS[protocol]
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        # Frames behind it end any wait for bytes that a false length promises.
        found = make().feed(bytes(damaged) + after * 20)
        assert frame not in found
        assert after in found


@each_protocol
def test_finds_what_is_whole_between_garbage_and_counts_the_rest(protocol: str) -> None:
    make, frames = PROTOCOLS[protocol]
    rng = random.Random(4)
    scanner = make()
    found: list[bytes] = []
    garbage = 0
    for i in range(300):
        noise = rng.randbytes(rng.randrange(30))
        garbage += len(noise)
        found += scanner.feed(noise + frames[i % len(frames)])
    # A start byte within the noise may hide the frame behind it for some time, never all of them.
    assert len(found) > 250
    assert set(found) <= set(frames)
    assert scanner.counters["garbled bytes"] >= garbage - 100


@each_protocol
@given(pieces=st.lists(st.binary(max_size=60), max_size=30))
def test_survives_anything_and_keeps_little_of_it(protocol: str, pieces: list[bytes]) -> None:
    make, frames = PROTOCOLS[protocol]
    scanner = make()
    for piece in pieces:
        for frame in scanner.feed(piece):
            assert len(frame) <= 300
    scanner.reset()
    assert scanner.feed(frames[0]) == [frames[0]]
