"""The clocks that a simulation runs on: a virtual one that jumps to the next timer, the wall's.

The daemon reads time from its event loop only, so the very tasks that fly the aircraft run as
fast as the machine allows and in the same order every time. Only in-memory links work on it:
nothing outside the process can make an event.
"""

import asyncio
import selectors
import time
from collections.abc import Coroutine, Mapping
from typing import Any, TypeVar

T = TypeVar("T")


class Deadlock(RuntimeError):
    """No timer is set and no task can run: virtual time would stand still for ever."""


class _JumpingSelector(selectors.BaseSelector):
    """Instead of waiting for a file, moves the loop's time on by the wait asked for."""

    def __init__(self) -> None:
        self.now = 0.0
        self._inner = selectors.SelectSelector()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            raise Deadlock("every task waits for an event that nothing will make")
        if timeout > 0:
            self.now += timeout
        return []

    def register(
        self, fileobj: Any, events: int, data: Any = None
    ) -> selectors.SelectorKey:  # the loop registers its own wake-up pipe
        return self._inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._inner.unregister(fileobj)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._inner.get_map()

    def close(self) -> None:
        self._inner.close()


class VirtualLoop(asyncio.SelectorEventLoop):
    """Event loop on virtual time, which starts at 0 s."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)
        # Timers closer together than this run in one go; far below any period used here.
        self._clock_resolution = 1e-9

    def time(self) -> float:
        """Return virtual seconds since the loop was made."""
        return self._jumping.now


class WallLoop(asyncio.SelectorEventLoop):
    """Event loop on the wall's clock, counted from 0 s at its making as a simulation's is."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        super().__init__()

    def time(self) -> float:
        """Return seconds since the loop was made."""
        return time.monotonic() - self._start


def run_realtime(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the wall's clock, starting at 0 s."""
    with asyncio.Runner(loop_factory=WallLoop) as runner:
        return runner.run(main)


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on a fresh virtual clock, as asyncio.run does on the wall's.

    Raises:
        Deadlock: nothing is left that could ever happen.
    """
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
