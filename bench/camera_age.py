"""How old the picture is that the V4L2 driver hands over while vision is busy in a thread.

A model of the kernel's queue is filled at 30 and 100 pictures a second; the age counts from when
the picture was filled. Half a second of pause once: after it OpenCV's capture gives
pictures of that age.

Never older than a period and 5 ms means: never handed over more than 5 ms after a newer one was
there. That is printed too, since on a busy machine the model itself fills its pictures late.
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
    """Return of so many pictures the age on delivery and how long a newer one was there, s."""
    logging.disable(logging.WARNING)
    source = FakeCamera([Mode("YUYV", 640, 480, fps)])
    driver = V4l2Camera(options=V4l2Options(fps=fps), node=source.open)
    await driver.open()
    stop = threading.Event()
    filled: list[float] = []  # when, by number

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
    """Print a line for each rate."""
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
