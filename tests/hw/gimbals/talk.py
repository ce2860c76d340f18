"""A driver with the test at the other end of its link, in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable

from hw.links.memory import MemoryLink, memory_pair
from landerd.messages import GimbalState
from landerd.ports import ByteLink, Gimbal
from landerd.runtime.clock import run_virtual


def run_with(
    make: Callable[[ByteLink], Gimbal], scene: Callable[[Gimbal, MemoryLink], Awaitable[None]]
) -> None:
    """Run a scene with an open driver and the device's end of its link, open too."""

    async def main() -> None:
        near, far = memory_pair()
        driver = make(near)
        await far.open()
        await driver.open()
        await scene(driver, far)
        await driver.close()

    run_virtual(main())


async def answered(driver: Gimbal, far: MemoryLink, answer: bytes) -> GimbalState:
    """Return the driver's state after one answer."""
    waiting = asyncio.create_task(driver.state())
    await asyncio.sleep(0.001)
    far.write(answer)
    return await asyncio.wait_for(waiting, 1.0)
