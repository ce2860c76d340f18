"""The thread that searches: it may hang, the process may not."""

import asyncio
import subprocess
import sys
import threading

import pytest

from landerd.worker import MOST_HUNG, JobHangs, Worker

# What OpenCV does for some seconds while the interpreter is torn down ends in abort() otherwise.
HANGING = """
import asyncio
import cv2
import numpy as np
from landerd.worker import JobHangs, Worker, exit_without_waiting

image = np.zeros((1500, 1500), np.uint8)

def search():
    while True:
        cv2.medianBlur(image, 99)

async def main():
    worker = Worker("vision")
    for _ in range(3):
        try:
            await worker.run(search, 0.05)
        except JobHangs:
            print("hangs")
    worker.close()

asyncio.run(main())
exit_without_waiting(3)
print("not reached")
"""


def test_the_process_ends_with_its_own_exit_code_while_searches_hang() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", HANGING], capture_output=True, text=True, timeout=20, check=False
    )

    assert ended.returncode == 3, ended.stderr
    assert ended.stdout.split() == ["hangs"] * 3
    assert ended.stderr == ""


def test_a_job_that_hangs_is_given_up_and_the_next_has_another_thread() -> None:
    let_go = threading.Event()

    async def main() -> None:
        worker = Worker("test")
        first = await worker.run(threading.get_ident, 5.0)
        assert first != threading.get_ident()
        assert await worker.run(threading.get_ident, 5.0) == first
        with pytest.raises(JobHangs):
            await worker.run(let_go.wait, 0.05)
        second = await worker.run(threading.get_ident, 5.0)
        assert second not in (first, threading.get_ident())
        let_go.set()
        worker.close()

    asyncio.run(main())


def test_jobs_that_hang_one_after_the_other_do_not_pile_up() -> None:
    """Once, a scene in which every search hung cost a thread per second, and slowed the loop."""
    let_go = threading.Event()

    async def main() -> None:
        worker = Worker("piles up")
        for _ in range(5):
            with pytest.raises(JobHangs):
                await worker.run(let_go.wait, 0.02)
        hung = [thread for thread in threading.enumerate() if thread.name == "piles up"]
        assert len(hung) == MOST_HUNG
        assert worker.is_stuck
        let_go.set()
        while worker.is_stuck:
            await asyncio.sleep(0.01)
        await worker.run(threading.get_ident, 5.0)
        worker.close()

    asyncio.run(asyncio.wait_for(main(), 10.0))


def test_an_exception_of_a_job_is_raised_where_its_result_is_awaited() -> None:
    def fails() -> None:
        raise KeyError("in a job")

    async def main() -> None:
        worker = Worker("test")
        with pytest.raises(KeyError, match="in a job"):
            await worker.run(fails, 5.0)
        worker.close()

    asyncio.run(main())
