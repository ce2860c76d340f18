"""How old the picture is that the V4L2 driver hands over while vision is busy in a thread.

A model of the kernel's queue is filled at 30 and 100 pictures a second; the age counts from when
the picture was filled. Half a second of pause once: after it OpenCV's capture gives
pictures of that age.
"""

import asyncio
import logging
import statistics
import threading
import time

from hw.cameras.v4l2 import V4l2Camera, V4l2Options
from hw.cameras.v4l2_node import Mode
from tests.hw.fake_v4l2 import FakeCamera


async def ages(fps: float, search_s: float, count: int) -> list[float]:
    """Return the ages of so many pictures on delivery, s."""
    logging.disable(logging.WARNING)
    source = FakeCamera([Mode("YUYV", 640, 480, fps)])
    driver = V4l2Camera(options=V4l2Options(fps=fps), node=source.open)
    await driver.open()
    stop = threading.Event()

    def shoot() -> None:
        due = time.monotonic()
        while not stop.is_set():
            due += 1.0 / fps
            time.sleep(max(0.0, due - time.monotonic()))
            source.shoot()

    shooting = threading.Thread(target=shoot)
    shooting.start()
    loop, got = asyncio.get_running_loop(), []
    try:
        for i in range(count):
            frame = await driver.newest()
            got.append(loop.time() - frame.t)
            await asyncio.to_thread(time.sleep, 0.5 if i == count // 2 else search_s)
    finally:
        stop.set()
        await asyncio.to_thread(shooting.join)
        await driver.close()
    return got


def main() -> None:
    """Print a line for each rate."""
    for fps, search_s in ((30.0, 0.02), (30.0, 0.05), (100.0, 0.025)):
        got = asyncio.run(ages(fps, search_s, 100))
        count = len(got)
        limit_ms = 1e3 / fps + 5.0
        median, worst, after = statistics.median(got), max(got), got[count // 2 + 1]
        print(
            f"{fps:.0f}/s, searches of {1e3 * search_s:.0f} ms: median {1e3 * median:.1f} ms, "
            f"worst {1e3 * worst:.1f} ms, after the pause {1e3 * after:.1f} ms; "
            f"a period and 5 ms: {limit_ms:.1f} ms"
        )


if __name__ == "__main__":
    main()
