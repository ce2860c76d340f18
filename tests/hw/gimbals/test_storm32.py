"""STorM32: bytes worked out by hand from its wiki's "Serial Communication - RC Commands"."""

import math
import struct

import pytest

from hw.gimbals.storm32 import Storm32Gimbal, Storm32Options, encode
from hw.links.memory import MemoryLink
from landerd.messages import GimbalCommand, Reference
from landerd.ports import Gimbal
from tests.hw.gimbals.talk import answered, run_with


def x25(data: bytes) -> int:
    """CRC-16/MCRF4XX bit by bit: polynomial 0x1021 reflected, from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc


def test_checksum_is_that_of_the_crc_catalogue() -> None:
    # CRC-16/MCRF4XX of "123456789" is 0x6F91.
    assert x25(b"123456789") == 0x6F91


def test_orders_pitch_down_and_yaw_left_as_positive_and_wants_no_answer() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        gimbal.command(GimbalCommand(yaw=math.radians(32.0), pitch=math.radians(-64.0)))
        # F9, 14 bytes, 17; floats 64, 0, -32; flags; type
        body = bytes.fromhex("0E 11 00008042 00000000 000000C2 00 00")
        crc = x25(body)
        assert await far.read() == b"\xf9" + body + bytes((crc & 0xFF, crc >> 8))

    run_with(lambda link: Storm32Gimbal(Storm32Options(), link), scene)


def test_asks_for_the_attitude_against_the_airframe_and_reads_it() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        payload = bytes.fromhex("0010 10270000") + struct.pack("<3f", 64.0, 0.0, -32.0)
        answer = b"\xfb\x12\x06" + payload
        crc = x25(answer[1:])
        state = await answered(gimbal, far, answer + bytes((crc & 0xFF, crc >> 8)))
        crc = x25(b"\x02\x06\x00\x10")
        assert await far.read() == b"\xfa\x02\x06\x00\x10" + bytes((crc & 0xFF, crc >> 8))
        assert math.degrees(state.pitch) == pytest.approx(-64.0)
        assert math.degrees(state.yaw) == pytest.approx(32.0)
        assert state.reference is Reference.HORIZON

    run_with(lambda link: Storm32Gimbal(Storm32Options(), link), scene)


def test_passes_over_acknowledgements_other_fields_and_numbers_that_are_none() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        def attitude(fields: int, pitch: float) -> bytes:
            return encode(b"\xfb", 6, struct.pack("<HI3f", fields, 0, pitch, 0.0, 0.0))

        state = await answered(
            gimbal,
            far,
            encode(b"\xfb", 150, b"\x00")
            + attitude(0x0020, 11.0)
            + attitude(0x1000, math.nan)
            + attitude(0x1000, 1e30)
            + attitude(0x1000, 12.0),
        )
        assert math.degrees(state.pitch) == pytest.approx(-12.0)

    run_with(lambda link: Storm32Gimbal(Storm32Options(), link), scene)
