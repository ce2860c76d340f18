"""Gimbal angles on their way from the autopilot's link to `Gimbal.state`."""

import asyncio
from collections import deque

from landerd.messages import GimbalState

_MOST = 50  # a reader that has stopped must not fill the memory


class Reports:
    """Keeps the newest reports; one reader waits for them."""

    def __init__(self) -> None:
        self._states: deque[GimbalState] = deque(maxlen=_MOST)
        self._waiter: asyncio.Future[None] | None = None

    def put(self, state: GimbalState) -> None:
        """Add a report."""
        self._states.append(state)
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def clear(self) -> None:
        """Forget all."""
        self._states.clear()

    async def next(self) -> GimbalState:
        """Wait for a report and return the oldest there is."""
        while not self._states:
            self._waiter = asyncio.get_running_loop().create_future()
            await self._waiter
        return self._states.popleft()
