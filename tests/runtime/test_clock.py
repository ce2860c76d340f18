import asyncio
import itertools
import time
from collections.abc import Callable
from contextvars import copy_context

import pytest

from landerd.runtime.clock import (
    STALLS,
    Deadlock,
    SlavedLoop,
    VirtualLoop,
    run_slaved,
    run_virtual,
)


def test_an_hour_passes_at_once_and_ends_at_the_right_time() -> None:
    async def main() -> float:
        await asyncio.sleep(3600.0)
        return asyncio.get_running_loop().time()

    started = time.monotonic()
    assert run_virtual(main()) == pytest.approx(3600.0, abs=1e-6)
    assert time.monotonic() - started < 5.0


def test_timers_run_in_the_order_of_their_times() -> None:
    async def main() -> list[tuple[str, float]]:
        loop = asyncio.get_running_loop()
        seen: list[tuple[str, float]] = []

        async def every(name: str, period: float, times: int) -> None:
            for _ in range(times):
                await asyncio.sleep(period)
                seen.append((name, round(loop.time(), 6)))

        await asyncio.gather(every("slow", 0.25, 2), every("fast", 0.1, 5))
        return seen

    assert run_virtual(main()) == [
        ("fast", 0.1),
        ("fast", 0.2),
        ("slow", 0.25),
        ("fast", 0.3),
        ("fast", 0.4),
        ("slow", 0.5),
        ("fast", 0.5),
    ]


def test_a_timeout_fires_on_virtual_time() -> None:
    async def main() -> float:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(2.0):
                await asyncio.Event().wait()
        return asyncio.get_running_loop().time()

    assert run_virtual(main()) == pytest.approx(2.0, abs=1e-6)


def test_waiting_for_an_event_that_nothing_can_cause_is_an_error_and_not_a_hang() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(Deadlock):
        run_virtual(main())


def test_every_run_starts_at_zero() -> None:
    async def main() -> float:
        return asyncio.get_running_loop().time()

    assert run_virtual(main()) == 0.0
    assert run_virtual(main()) == 0.0


async def _follow(other: Callable[[float], float], until_s: float) -> list[tuple[float, float]]:
    """Tell the loop another clock, a function of wall seconds, until it shows until_s.

    Returns:
        Loop's time at which the other clock shows what it does, and what the loop's clock shows.
    """
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SlavedLoop)
    started = time.monotonic()
    seen = []
    while (shows := other(time.monotonic() - started)) < until_s:
        seen.append((loop.place(shows), loop.time()))
        await loop.run_in_executor(None, time.sleep, 0.005)  # not on the loop's own clock
    return seen


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_a_slaved_loop_takes_over_another_clocks_pace(rate: float) -> None:
    seen = run_slaved(_follow(lambda wall: 100.0 + rate * wall, 100.0 + 2.5 * rate))
    shown = [t for _, t in seen]
    assert shown == sorted(shown)
    late = seen[len(seen) * 3 // 4 :]
    errors = sorted(abs(told - t) for told, t in late)
    assert errors[len(errors) // 2] < 0.05 * rate


def test_a_slaved_loop_stands_still_while_the_other_clock_does() -> None:
    seen = run_slaved(_follow(lambda wall: min(wall, 0.7) + max(0.0, wall - 1.7), 1.2))
    assert max(t - told for told, t in seen) < 0.3
    shown = [t for _, t in seen]
    assert shown == sorted(shown)


def test_a_slaved_loop_goes_on_alone_when_the_other_clock_is_gone() -> None:
    async def main() -> None:
        await _follow(lambda wall: wall, 0.2)
        await asyncio.sleep(0.5)  # ends, though the other clock says nothing any more

    run_slaved(asyncio.wait_for(main(), 10.0))


def test_a_stalled_computer_stands_still_while_the_world_goes_on() -> None:
    async def main() -> tuple[list[float], list[float]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        inside: list[float] = []
        outside: list[float] = []

        async def every_10_ms(times: list[float]) -> None:
            for _ in range(30):
                await asyncio.sleep(0.01)
                times.append(loop.time())

        on_it = copy_context()
        on_it.run(STALLS.set, True)
        stalling = asyncio.create_task(every_10_ms(inside), context=on_it)
        going_on = asyncio.create_task(every_10_ms(outside))
        await asyncio.sleep(0.055)
        loop.stall(0.1)
        await asyncio.gather(stalling, going_on)
        return inside, outside

    inside, outside = run_virtual(main())
    assert max(b - a for a, b in itertools.pairwise(outside)) == pytest.approx(0.01)
    gaps = [b - a for a, b in itertools.pairwise(inside)]
    # Woken in the stall, it goes on at its end, 155 ms after the start.
    assert [t for t in inside if 0.055 < t < 0.15] == []
    assert max(gaps) == pytest.approx(0.105)
    assert sum(gap > 0.011 for gap in gaps) == 1


def test_a_stall_ends_with_another_timer_that_is_due_at_nearly_the_same_time() -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        woke = loop.create_future()

        async def wake() -> None:
            await asyncio.sleep(0.05)
            woke.set_result(loop.time())

        on_it = copy_context()
        on_it.run(STALLS.set, True)
        waking = asyncio.create_task(wake(), context=on_it)
        await asyncio.sleep(0.01)
        loop.stall(0.1)
        loop.call_later(0.1 - 5e-10, lambda: None)
        await asyncio.sleep(1.0)
        assert waking.done()
        return float(await woke)

    assert run_virtual(main()) == pytest.approx(0.11)
