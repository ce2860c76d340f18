"""The thread that searches: it may hang, the process may not."""

import subprocess
import sys

# What OpenCV does for some seconds while the interpreter is torn down ends in abort() otherwise.
HANGING = """
import asyncio
import cv2
import numpy as np
from landerd.runtime.worker import JobHangs, Worker, exit_without_waiting

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
