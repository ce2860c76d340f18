"""Measures the age of pictures from the V4L2 driver while vision is busy in a thread.

A model of the kernel's queue is filled with 30 or 100 pictures per second; the age is counted from
the time at which a picture was filled. Once there is a pause of half a second, after which OpenCV's
capture would return pictures of that age.

A picture must not be older than a period plus 5 ms, that is, not be delivered more than 5 ms after
a newer one was filled. That delay is printed as well, as on a busy machine the model itself fills
pictures late.
"""

import asyncio
import logging
import statistics
import threading
import time

from hw.cameras.v4l2 import V4l2Camera, V4l2Options
from hw.cameras.v4l2_node import Mode
from tests.hw.cameras.fake_v4l2 import FakeCamera


async def ages(fps: float, search_s: float, count: int) -> tuple[list[float], list[float]]:
    """Return ages on delivery, s, and how long a newer picture had been there, s, for each picture.

    Args:
        fps: rate at which pictures are filled.
        search_s: time for which vision is busy with each.
        count: number of pictures.
    """
    logging.disable(logging.WARNING)
    source = FakeCamera([Mode("YUYV", 640, 480, fps)])
    driver = V4l2Camera(options=V4l2Options(fps=fps), node=source.open)
    await driver.open()
    stop = threading.Event()
    filled: list[float] = []  # time at which each picture was filled, by its number

    def shoot() -> None:
        due = time.monotonic()
        while not stop.is_set():
            due += 1.0 / fps
            time.sleep(max(0.0, due - time.monotonic()))
            filled.append(time.monotonic())
            source.shoot(t=filled[-1])

    shooting = threading.Thread(target=shoot)
    shooting.start()
    got, outdated = [], []
    try:
        for i in range(count):
            frame = await driver.newest()
            now = time.monotonic()
            got.append(now - filled[frame.seq - 1])
            newer = filled[frame.seq : frame.seq + 1]
            outdated.append(now - newer[0] if newer else 0.0)
            await asyncio.to_thread(time.sleep, 0.5 if i == count // 2 else search_s)
    finally:
        stop.set()
        await asyncio.to_thread(shooting.join)
        await driver.close()
    return got, outdated


def main() -> None:
    """Print a line for each rate and duration of searches."""
    for fps, search_s in ((30.0, 0.02), (30.0, 0.05), (100.0, 0.025)):
        got, outdated = asyncio.run(ages(fps, search_s, 100))
        median, worst, after = statistics.median(got), max(got), got[len(got) // 2 + 1]
        print(
            f"{fps:.0f}/s, searches of {1e3 * search_s:.0f} ms: median {1e3 * median:.1f} ms, "
            f"worst {1e3 * worst:.1f} ms, after the pause {1e3 * after:.1f} ms; "
            f"a newer one was there for {1e3 * max(outdated):.1f} ms at most (allowed: 5)"
        )


if __name__ == "__main__":
    main()
