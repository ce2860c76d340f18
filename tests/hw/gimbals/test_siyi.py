"""SIYI: frames from the maker's "Gimbal Camera External SDK Protocol" and worked out from it."""

import asyncio
import math
import struct

import pytest

from hw.gimbals.siyi import SiyiGimbal, SiyiOptions, encode
from hw.links.memory import MemoryLink
from landerd.messages import GimbalCommand, Reference
from landerd.ports import Gimbal
from tests.hw.gimbals.talk import answered, run_with


@pytest.mark.parametrize(
    ("command", "data", "frame"),
    [  # chapter 4 of the document
        (0x07, b"\x64\x64", "55 66 01 02 00 00 00 07 64 64 3d cf"),
        (0x0C, b"\x04", "55 66 01 01 00 00 00 0c 04 b0 8e"),
        (0x0D, b"", "55 66 01 00 00 00 00 0d e8 05"),
    ],
)
def test_frames_are_those_of_the_document(command: int, data: bytes, frame: str) -> None:
    assert encode(1, 0, command, data) == bytes.fromhex(frame)


def attitude(yaw: int, pitch: int, roll: int = 0, rates: tuple[int, int, int] = (0, 0, 0)) -> bytes:
    return encode(2, 7, 0x0D, struct.pack("<6h", yaw, pitch, roll, *rates))


def sent(data: bytes) -> list[tuple[int, bytes]]:
    """Commands and data of frames that follow each other."""
    frames = []
    while data:
        assert data[:2] == b"\x55\x66"
        size = int.from_bytes(data[3:5], "little")
        frames.append((data[7], data[8 : 8 + size]))
        data = data[10 + size :]
    return frames


def test_asks_and_chooses_follow_mode_when_there_is_an_answer() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        await answered(gimbal, far, attitude(0, 0))
        assert sent(await far.read()) == [(0x0D, b""), (0x0C, b"\x04")]

    run_with(lambda link: SiyiGimbal(SiyiOptions(), link), scene)


def test_reads_angles_with_yaw_counted_left() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        # -300 tenths of yaw (D4 FE), -450 of pitch (3E FE)
        body = bytes.fromhex("5566 02 0C00 0000 0D D4FE 3EFE 0000 0000 0000 0000")
        crc = 0
        for byte in body:  # CRC-16/XMODEM bit by bit
            crc ^= byte << 8
            for _ in range(8):
                crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
        state = await answered(gimbal, far, body + bytes((crc & 0xFF, crc >> 8)))
        assert math.degrees(state.yaw) == pytest.approx(30.0)
        assert math.degrees(state.pitch) == pytest.approx(-45.0)
        assert state.reference is Reference.HORIZON

    run_with(lambda link: SiyiGimbal(SiyiOptions(), link), scene)


def test_turns_towards_the_target_with_speeds() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        await answered(gimbal, far, attitude(0, 0))
        assert all(command != 0x07 for command, _ in sent(await far.read()))  # no target yet
        gimbal.command(GimbalCommand(yaw=math.radians(9.0), pitch=math.radians(-80.0)))
        await answered(gimbal, far, attitude(0, 0))
        command, data = sent(await far.read())[-1]
        yaw, pitch = struct.unpack("2b", data)
        assert command == 0x07
        # 9 degrees times 5 per second, of 90 degrees/s: half speed and a little from the integral
        assert yaw == pytest.approx(50, abs=2)
        assert pitch == -100

    run_with(lambda link: SiyiGimbal(SiyiOptions(), link), scene)


def test_stops_the_motors_when_angles_stay_away_and_when_closed() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        gimbal.command(GimbalCommand(yaw=0.5, pitch=-0.5))
        await answered(gimbal, far, attitude(0, 0))
        await far.read()
        waiting = asyncio.create_task(gimbal.state())
        await asyncio.sleep(0.3)
        assert (0x07, b"\x00\x00") in sent(await far.read())
        waiting.cancel()
        await gimbal.close()
        assert sent(await far.read())[-1] == (0x07, b"\x00\x00")

    run_with(lambda link: SiyiGimbal(SiyiOptions(), link), scene)


def test_ignores_frames_that_are_no_answers() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        request = encode(1, 7, 0x0D, struct.pack("<6h", 100, 0, 0, 0, 0, 0))
        other = encode(2, 7, 0x0A, bytes(12))
        state = await answered(gimbal, far, request + other + attitude(-200, 0))
        assert math.degrees(state.yaw) == pytest.approx(20.0)

    run_with(lambda link: SiyiGimbal(SiyiOptions(), link), scene)
