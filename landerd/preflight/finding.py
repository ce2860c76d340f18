"""One line of the check, and a helper that receives from a device for it."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Finding:
    """One line of the check: the fact, why it matters, and the remedy."""

    level: Literal["ok", "warn", "fail"]
    item: str
    what: str
    mend: str = ""


async def gather(receive: Callable[[], Awaitable[T]], seconds: float) -> list[tuple[float, T]]:
    """Return all that is received in this time, each with its time of arrival, s.

    Raises DeviceLost.
    """
    loop = asyncio.get_running_loop()
    got: list[tuple[float, T]] = []
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            while True:
                message = await receive()
                got.append((loop.time(), message))
    return got
