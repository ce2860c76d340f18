"""Event loops for simulations, on three clocks: virtual time, the wall's clock, an autopilot's.

The daemon reads time from its event loop only. On virtual time, which jumps to the next timer, the
tasks that fly the aircraft therefore run as fast as the machine allows, and in the same order every
time. Only in-memory links work on it, as nothing outside the process can cause an event.
"""

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine, Mapping
from contextvars import Context, ContextVar
from typing import Any, TypeVar, TypeVarTuple

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")


class Deadlock(RuntimeError):
    """No timer is set and no task can run: virtual time would never advance again."""


class _JumpingSelector(selectors.BaseSelector):
    """Advances the loop's time by the timeout asked for, instead of waiting for files."""

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


# Set in the context of the simulated computer's tasks, which `VirtualLoop.stall` holds up.
STALLS: ContextVar[bool] = ContextVar("STALLS", default=False)


class VirtualLoop(asyncio.SelectorEventLoop):
    """Event loop on virtual time, which starts at 0 s."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        self._stalled_until = 0.0
        self._held_up: list[asyncio.Handle] = []
        super().__init__(self._jumping)
        # Timers closer together than this run in one turn; it is far below any period used here.
        self._clock_resolution = 1e-9

    def time(self) -> float:
        """Return virtual seconds since the loop was made."""
        return self._jumping.now

    def stall(self, duration_s: float) -> None:
        """Hold up every task whose context has STALLS set; all others continue."""
        self._stalled_until = max(self._stalled_until, self.time() + duration_s)
        self.call_at(self._stalled_until, self._go_on)

    def call_soon(
        self,
        callback: Callable[[*Arguments], object],
        *args: *Arguments,
        context: Context | None = None,
    ) -> asyncio.Handle:
        """Schedule a callback; one whose context has STALLS set runs after the stall."""
        if self._jumping.now < self._stalled_until:
            stalls = STALLS.get() if context is None else context.get(STALLS, False)
            if stalls:
                handle = asyncio.Handle(callback, args, self, context)
                self._held_up.append(handle)
                return handle
        return super().call_soon(callback, *args, context=context)

    def _go_on(self) -> None:
        # A timer may be early by the clock's resolution.
        if self._jumping.now < self._stalled_until - self._clock_resolution:
            return  # another stall has begun meanwhile
        self._stalled_until = self._jumping.now
        held_up, self._held_up = self._held_up, []
        for handle in held_up:
            if not handle.cancelled():
                self.call_soon(handle._run)


class WallLoop(asyncio.SelectorEventLoop):
    """Event loop on the wall's clock, whose time starts at 0 s like that of a simulation."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        super().__init__()

    def time(self) -> float:
        """Return seconds since the loop was made."""
        return time.monotonic() - self._start


class _PacedSelector(selectors.DefaultSelector):
    """Waits as long on the wall's clock as the loop's clock takes for the timeout asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.rate = 1.0  # seconds of the loop's clock per second of the wall's

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout > 0.0:
            timeout = max(timeout / self.rate, _SHORTEST_WAIT_S)
        return super().select(timeout)


_SHORTEST_WAIT_S = 2e-4  # so that the loop does not spin while its clock stands still
_WINDOW_S = 0.5  # of the times reported in this window the least delayed is used; wall's clock
_AHEAD_S = 0.25  # farthest that the loop's clock may run ahead of the last time reported
_GONE_S = 2.0  # without reports for this long (wall's clock) it keeps its last rate
_RATES = (0.02, 1000.0)


class SlavedLoop(asyncio.SelectorEventLoop):
    """Event loop that follows another clock of any rate, say a simulated autopilot's.

    It starts at 0 s on the wall's clock, and follows the other clock from the first `place` on. It
    is never behind the last time reported and never goes back; when it is ahead it runs slower.
    """

    def __init__(self) -> None:
        self._paced = _PacedSelector()
        self._anchor_t, self._anchor_wall = 0.0, time.monotonic()
        self._offset: float | None = None  # the loop's clock minus the other one, s
        self._told_wall = 0.0
        self._latest = float("inf")  # limit of the loop's time, s
        self._window_wall = 0.0  # when the window began, wall's clock, s
        # The least delayed report of this window: its lead over the loop's clock, the wall's time
        # of its arrival, the loop's time that it corresponds to; s. Then the last two of the window
        # before.
        self._best: tuple[float, float, float] | None = None
        self._before = (0.0, 0.0)
        super().__init__(self._paced)

    @property
    def rate(self) -> float:
        """Seconds of its clock per second of the wall's."""
        return self._paced.rate

    def time(self) -> float:
        """Return seconds since the loop was made, at the other clock's rate."""
        wall = time.monotonic()
        t = self._anchor_t + self.rate * (wall - self._anchor_wall)
        if t <= self._latest:
            return t
        return self._latest + max(0.0, wall - self._told_wall - _GONE_S)

    def place(self, other_s: float) -> float:
        """Report that the other clock shows this time (s) now, or showed it a moment ago.

        Returns:
            The loop's time that corresponds to it, s.
        """
        wall, now = time.monotonic(), self.time()
        if self._offset is None:
            self._offset = now - other_s
            self._window_wall = wall
            self._before = (wall, now)
        told = other_s + self._offset
        if told > now or now > self._latest:  # the loop's clock is behind, or stood still
            now = max(told, now)
            self._anchor_t, self._anchor_wall = now, wall
        self._told_wall, self._latest = wall, max(now, told + _AHEAD_S)
        if self._best is None or told - now >= self._best[0]:
            self._best = (told - now, wall, told)
        if wall - self._window_wall >= _WINDOW_S:
            self._steer(wall, now, told)
        return told

    def _steer(self, wall: float, now: float, told: float) -> None:
        """Choose the rate at which the two clocks agree at the end of the next window."""
        assert self._best is not None
        _, best_wall, best_t = self._best
        before_wall, before_t = self._before
        if best_wall - before_wall < 0.5 * _WINDOW_S:  # too close together to find a rate
            best_wall, best_t = wall, told
        rate = max(0.0, best_t - before_t) / (best_wall - before_wall)
        meets = best_t + rate * (wall + _WINDOW_S - best_wall)
        self._anchor_t, self._anchor_wall = now, wall
        self._paced.rate = min(max((meets - now) / _WINDOW_S, _RATES[0]), _RATES[1])
        self._before, self._best = (best_wall, best_t), None
        self._window_wall = wall


def run_slaved(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on a `SlavedLoop`."""
    with asyncio.Runner(loop_factory=SlavedLoop) as runner:
        return runner.run(main)


def run_realtime(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on the wall's clock, starting at 0 s."""
    with asyncio.Runner(loop_factory=WallLoop) as runner:
        return runner.run(main)


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end on a fresh virtual clock, as asyncio.run does on the wall's.

    Raises:
        Deadlock: no timer is set and no task can run.
    """
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
