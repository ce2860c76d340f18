"""The loop's gaps: counted where they arise, each once."""

import asyncio
import re
import time
from collections.abc import Callable

import pytest

from landerd.runtime.monitor import BUSY, GAP_S, LoopMonitor

LONG_S = 2.0 * GAP_S


def watch(scene: Callable[[LoopMonitor], None]) -> LoopMonitor:
    """Let a scene play between a task's being due and its turn."""

    async def main() -> LoopMonitor:
        monitor = LoopMonitor()
        due = asyncio.get_running_loop().time()
        scene(monitor)
        monitor.woke(due)
        return monitor

    return asyncio.run(main())


def test_a_gap_is_counted_once_at_the_place_that_made_it(caplog: pytest.LogCaptureFixture) -> None:
    def scene(monitor: LoopMonitor) -> None:
        with monitor.at("the log"):
            time.sleep(LONG_S)

    monitor = watch(scene)
    assert dict(monitor.gaps) == {"the log": 1}
    assert monitor.longest_s >= LONG_S
    (told_ms,) = re.findall(r"held up for (\d+) ms: the log \(1 so far\)", caplog.text)
    assert float(told_ms) == pytest.approx(1e3 * monitor.longest_s, abs=1.0)


def test_a_gap_outside_of_any_named_part_is_counted_as_elsewhere() -> None:
    monitor = watch(lambda monitor: time.sleep(LONG_S))
    assert dict(monitor.gaps) == {"elsewhere, or the computer was busy": 1}


def test_a_gap_in_a_part_that_raises_is_counted() -> None:
    def fails() -> None:
        time.sleep(LONG_S)
        raise OSError("full")

    def scene(monitor: LoopMonitor) -> None:
        with pytest.raises(OSError, match="full"), monitor.at("the log"):
            fails()

    assert dict(watch(scene).gaps) == {"the log": 1}


def test_it_is_logged_once_a_second_at_most(caplog: pytest.LogCaptureFixture) -> None:
    def scene(monitor: LoopMonitor) -> None:
        for _ in range(3):
            with monitor.at("the log"):
                time.sleep(1.1 * GAP_S)

    assert watch(scene).gaps["the log"] == 3
    assert caplog.text.count("the log") == 1


def test_a_loop_that_keeps_running_has_no_gaps() -> None:
    def scene(monitor: LoopMonitor) -> None:
        with monitor.at("the log"):
            pass

    assert not watch(scene).gaps


def test_the_line_of_code_that_held_the_loop_up_is_named(caplog: pytest.LogCaptureFixture) -> None:
    """In whatever code of landerd's it is, watched or not."""

    async def main() -> LoopMonitor:
        monitor = LoopMonitor()
        monitor.look_on()
        loop = asyncio.get_running_loop()
        due = loop.time()
        for held_up_s in (0.0, 6.0 * GAP_S, 0.0):
            monitor.woke(due)
            due = loop.time() + 0.01
            await asyncio.sleep(0.01)
            if held_up_s:
                hold_up(held_up_s)
        monitor.woke(due)
        monitor.close()
        return monitor

    def hold_up(duration_s: float) -> None:
        time.sleep(duration_s)

    monitor = asyncio.run(main())
    (place,) = [place for place in monitor.gaps if place.endswith(" hold_up")]
    assert place.startswith("tests/runtime/test_monitor.py:")
    assert place in caplog.text


def test_a_loop_that_waits_is_not_taken_for_one_that_works() -> None:
    async def main() -> LoopMonitor:
        monitor = LoopMonitor()
        monitor.look_on()
        due = asyncio.get_running_loop().time()
        monitor.woke(due)
        await asyncio.sleep(6.0 * GAP_S)
        monitor.woke(due + 0.01)
        monitor.close()
        return monitor

    assert list(asyncio.run(main()).gaps) == [BUSY]
