"""SimpleBGC: bytes worked out by hand from BaseCam's "SimpleBGC32 Serial API" specification."""

import asyncio
import math
import struct

import pytest

from hw.gimbals.simplebgc import SimpleBgcGimbal, SimpleBgcOptions, crc16, encode
from hw.links.memory import MemoryLink
from landerd.messages import GimbalCommand, Reference
from landerd.ports import DeviceLost, Gimbal
from tests.hw.gimbals.talk import answered, run_with


def test_crc_is_that_of_a_published_frame() -> None:
    # The same CRC is that of Microchip's ATECC508A; its well-known "get info" has this one.
    assert crc16(bytes.fromhex("0730000000")) == 0x5D03


def test_crc_is_that_computed_by_hand() -> None:
    # One bit set, shifted in first: 0x8005 after one step, then fifteen of x^16 + x^15 + x^2 + 1.
    assert crc16(b"\x80") == 0x8005
    assert crc16(b"\x40") == 0x800F  # 0x8005 << 1 = 0x1000A: ^ 0x18005


def test_asks_for_angles_and_switches_motors_on_when_there_is_an_answer() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        await answered(gimbal, far, angles(0, 0, 0))
        # '$', command, no data, (command + 0) % 256, CRC of the last three, low byte first
        ask, on = crc16(b"\x3d\x00\x3d"), crc16(b"\x4d\x00\x4d")
        assert await far.read() == (
            b"\x24\x3d\x00\x3d"
            + bytes((ask & 0xFF, ask >> 8))
            + b"\x24\x4d\x00\x4d"
            + bytes((on & 0xFF, on >> 8))
        )

    run_with(lambda link: SimpleBgcGimbal(SimpleBgcOptions(), link), scene)


def test_orders_pitch_down_as_positive_and_yaw_from_the_frame() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        gimbal.command(GimbalCommand(yaw=math.radians(45.0), pitch=math.radians(-90.0)))
        frame = await far.read()
        # 67, 15 bytes, (67 + 15) % 256 = 82; modes 2, 2, 5; speed 120 / 0.1220740379 = 983 = 0x3D7;
        # 90 degrees = 4096 = 0x1000, 45 degrees = 2048 = 0x0800
        body = bytes.fromhex("43 0F 52 02 02 05 D7 03 00 00 D7 03 00 10 D7 03 00 08")
        assert frame[:-2] == b"\x24" + body
        assert int.from_bytes(frame[-2:], "little") == crc16(body)

    run_with(lambda link: SimpleBgcGimbal(SimpleBgcOptions(), link), scene)


def angles(roll: int, pitch: int, yaw: int, *, heading: int = 0) -> bytes:
    """An answer to CMD_GET_ANGLES_EXT: IMU angle, target, joint's angle, ten reserved bytes."""
    axes = ((roll, 0), (pitch, 0), (heading, yaw))
    return encode(61, b"".join(struct.pack("<hhi", imu, 0, j) + bytes(10) for imu, j in axes))


def test_reads_pitch_from_the_imu_and_yaw_from_the_joint() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        state = await answered(gimbal, far, angles(0, 2048, -1024, heading=555))
        assert math.degrees(state.pitch) == pytest.approx(-45.0)
        assert math.degrees(state.yaw) == pytest.approx(-22.5)
        assert state.roll == 0.0
        assert state.reference is Reference.HORIZON
        assert state.pitch_measured
        assert state.t == pytest.approx(asyncio.get_running_loop().time() - 0.005)
        # An encoder that has gone round once too often.
        state = await answered(gimbal, far, angles(0, 0, 16384 + 1024))
        assert math.degrees(state.yaw) == pytest.approx(22.5)

    run_with(lambda link: SimpleBgcGimbal(SimpleBgcOptions(), link), scene)


def test_a_silent_board_is_lost_after_a_second() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        start = asyncio.get_running_loop().time()
        with pytest.raises(DeviceLost, match="SimpleBGC: no answer"):
            await gimbal.state()
        assert asyncio.get_running_loop().time() - start == pytest.approx(1.0, abs=0.05)

    run_with(lambda link: SimpleBgcGimbal(SimpleBgcOptions(), link), scene)


def test_a_board_that_says_other_things_only_is_lost_too() -> None:
    async def scene(gimbal: Gimbal, far: MemoryLink) -> None:
        async def chatter() -> None:
            while True:
                far.write(encode(67, b"\x43"))
                far.write(encode(61, b"too short"))
                await asyncio.sleep(0.02)

        task = asyncio.create_task(chatter())
        with pytest.raises(DeviceLost):
            await gimbal.state()
        task.cancel()

    run_with(lambda link: SimpleBgcGimbal(SimpleBgcOptions(), link), scene)
