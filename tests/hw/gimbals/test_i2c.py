"""An I2C bus that hangs, as Linux lets it for a second: the loop goes on, the gimbal is lost."""

import asyncio
import math
import threading
from collections.abc import Awaitable, Callable

import pytest

from hw.gimbals.i2c import DEADLINE_S, I2c, I2cDevice
from hw.gimbals.servo import ServoGimbal
from hw.gimbals.servo_pca9685 import ServoPca9685Gimbal, ServoPca9685Options
from landerd.messages import GimbalCommand
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_realtime
from tests.hw.gimbals.test_imu import G, mpu

HANGS_S = 1.03  # as measured of a bus whose clock is held down


class Bus:
    """A PCA9685 and an MPU-6050 that lies flat; each call waits while it hangs."""

    def __init__(self) -> None:
        self.hangs = False
        self.opened = self.closed = 0
        self.pulses: list[list[int]] = []
        self._freed = threading.Event()

    def open(self, number: int) -> "Bus":
        self.opened += 1
        return self

    def free(self) -> None:
        self.hangs = False
        self._freed.set()

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        self._wait()
        return 0x68

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        self._wait()
        return mpu(0, 0, G)

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        self._wait()

    def write_i2c_block_data(self, i2c_addr: int, register: int, data: list[int]) -> None:
        self._wait()
        self.pulses.append(data)

    def close(self) -> None:
        self.closed += 1

    def _wait(self) -> None:
        if self.hangs and not self._freed.wait(HANGS_S):
            raise TimeoutError(110, "Connection timed out")


def gimbal_on(bus: Bus, *, imu: bool) -> ServoPca9685Gimbal:
    options = {"imu": {"kind": "mpu6050"}} if imu else {}
    i2c = I2c(bus.open, in_thread=True)
    return ServoPca9685Gimbal(ServoPca9685Options.model_validate(options), i2c, i2c)


async def longest_gap_during(work: Awaitable[None]) -> float:
    """Return the longest time for which the loop stood still during an action, s."""
    loop, gap = asyncio.get_running_loop(), 0.0
    doing = asyncio.ensure_future(work)
    while not doing.done():
        before = loop.time()
        await asyncio.sleep(0.005)
        gap = max(gap, loop.time() - before - 0.005)
    await doing
    return gap


async def lost(gimbal: ServoGimbal) -> str:
    """Aim as the core does until the gimbal is lost; return why."""
    async with asyncio.timeout(2.0):
        while True:
            gimbal.command(GimbalCommand(0.0, -1.0))
            try:
                await gimbal.state()
            except DeviceLost as e:
                return str(e)


@pytest.mark.parametrize("imu", [False, True])
def test_a_bus_that_hangs_loses_the_gimbal_and_not_the_loop(imu: bool) -> None:
    bus = Bus()
    gimbal = gimbal_on(bus, imu=imu)

    async def hang() -> None:
        bus.hangs = True
        loop = asyncio.get_running_loop()
        began = loop.time()
        assert f"no answer for {DEADLINE_S:g} s" in await lost(gimbal)
        assert loop.time() - began < 3 * DEADLINE_S
        await gimbal.close()

    async def main() -> None:
        await gimbal.open()
        await gimbal.state()
        assert await longest_gap_during(hang()) < 0.5 * HANGS_S
        # Taken up again when the bus works, and not before: no thread after the other hangs.
        with pytest.raises(DeviceLost, match="still hangs"):
            await gimbal.open()
        bus.free()
        await asyncio.sleep(0.1)
        await gimbal.open()
        assert math.isfinite((await gimbal.state()).pitch)
        gimbal.command(GimbalCommand(0.0, -1.0))
        before = len(bus.pulses)
        await asyncio.sleep(0.1)
        assert len(bus.pulses) > before
        await gimbal.close()
        await asyncio.sleep(0.1)
        assert bus.closed == bus.opened

    run_realtime(main())


def test_an_exchange_whose_turn_comes_too_late_is_not_made_any_more() -> None:
    bus = Bus()
    device: I2cDevice[Bus] = I2cDevice("chip", 1, I2c(bus.open, in_thread=True))
    put: Callable[[Bus], None] = lambda b: b.write_i2c_block_data(0, 0, [1])  # noqa: E731

    async def main() -> None:
        await device.open(lambda b: None)
        bus.hangs = True
        first = asyncio.create_task(device.do(put))
        await asyncio.sleep(0.05)
        second = asyncio.create_task(device.do(lambda b: b.write_i2c_block_data(0, 0, [2])))
        for exchange in (first, second):
            with pytest.raises(DeviceLost):
                await exchange
        bus.free()
        await asyncio.sleep(0.1)
        assert bus.pulses == [[1]]

    run_realtime(main())
