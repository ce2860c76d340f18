"""What the tests of the stand-in share: a flight with it, in virtual time."""

from collections.abc import Awaitable, Callable

from landerd.runtime.clock import run_virtual
from tests.hw.flight import Flight, PlainAirframe

STABILIZE, GUIDED, LOITER, RTL, LAND = 0, 4, 5, 6, 9
ACCEPTED, DENIED, FAILED = 0, 2, 4
ON_GROUND: tuple[float, float, float] = (0.0, 0.0, 0.0)


def fly(scene: Callable[[Flight], Awaitable[None]], flight: Callable[[], Flight] = Flight) -> None:
    async def main() -> None:
        async with flight() as f:
            await scene(f)

    run_virtual(main())


def grounded() -> Flight:
    return Flight(PlainAirframe(ON_GROUND), flying=False)


async def guided(f: Flight) -> None:
    assert await f.client.mode(GUIDED) == ACCEPTED
