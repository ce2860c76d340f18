"""Sound frames with any content, and any bytes at all, into each driver on a byte link."""

import asyncio
import contextlib
import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.gimbals import simplebgc, siyi, storm32
from hw.links.memory import MemoryLink
from landerd.messages import GimbalCommand
from landerd.ports import ByteLink, DeviceLost, Gimbal
from tests.fuzz.budget import examples
from tests.hw.gimbals.talk import run_with

Make = Callable[[ByteLink], Gimbal]
Encode = Callable[[int, bytes], bytes]
DRIVERS: dict[str, tuple[Make, Encode, int, int]] = {  # with its answer's command and size
    "simplebgc": (
        lambda link: simplebgc.SimpleBgcGimbal(simplebgc.SimpleBgcOptions(), link),
        simplebgc.encode,
        61,
        54,
    ),
    "siyi": (
        lambda link: siyi.SiyiGimbal(siyi.SiyiOptions(), link),
        lambda command, data: siyi.encode(2, 0, command, data),
        0x0D,
        12,
    ),
    "storm32": (
        lambda link: storm32.Storm32Gimbal(storm32.Storm32Options(), link),
        lambda command, data: storm32.encode(b"\xfb", command, data),
        6,
        18,
    ),
}


@pytest.mark.parametrize("driver", DRIVERS)
@examples(60)
@given(data=st.data())
def test_no_content_gets_anything_but_angles_out_of_a_driver(
    driver: str, data: st.DataObject
) -> None:
    make, encode, command, size = DRIVERS[driver]
    answer = st.binary(min_size=size, max_size=size).map(lambda b: encode(command, b))
    if driver == "storm32":  # with the fields that were asked for, and any floats
        answer = st.binary(min_size=16, max_size=16).map(lambda b: encode(command, b"\x00\x10" + b))
    anything = st.tuples(st.integers(0, 255), st.binary(max_size=60)).map(lambda c: encode(*c))
    pieces = data.draw(st.lists(answer | anything | st.binary(max_size=80), max_size=20))

    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        async def feed() -> None:
            for piece in pieces:
                far.write(piece)
                await asyncio.sleep(0.02)

        feeding = asyncio.create_task(feed())
        gimbal.command(GimbalCommand(0.3, -1.0))
        with contextlib.suppress(DeviceLost):  # silence at the end
            while True:
                state = await gimbal.state()
                for angle in (state.yaw, state.pitch, state.roll):
                    assert -math.pi <= angle <= math.pi
        await feeding

    run_with(make, scene)
