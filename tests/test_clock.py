import asyncio
import time

import pytest

from landerd.clock import Deadlock, run_virtual


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


def test_waiting_for_what_nothing_can_make_is_an_error_and_not_a_hang() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(Deadlock):
        run_virtual(main())


def test_every_run_starts_at_zero() -> None:
    async def main() -> float:
        return asyncio.get_running_loop().time()

    assert run_virtual(main()) == 0.0
    assert run_virtual(main()) == 0.0
