"""The newest picture of a camera library that delivers pictures on a thread of its own."""

import asyncio
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from landerd.messages import Frame
from landerd.ports import DeviceLost

# Time without a picture after which the camera counts as lost: before the first one, while the
# source starts, and later.
_FIRST_FRAME_S, _STALL_S = 8.0, 1.0


def unknown_exposure_sigma(fps: float) -> float:
    """Return the standard error of an exposure's middle of which only the end or start is known, s.

    The middle is within half a picture period of it, uniformly distributed; this is the root mean
    square.
    """
    return 0.5 / fps / math.sqrt(3.0)


class NewestFrame:
    """Holds one frame; `put` may be called from any thread."""

    def __init__(self, name: str, clock: Callable[[], float]) -> None:
        """Make one for the running event loop.

        Args:
            name: name of the camera, for the text of DeviceLost.
            clock: clock with which exposures are stamped, s.
        """
        self._name, self._clock = name, clock
        self._loop = asyncio.get_running_loop()
        self._arrived = asyncio.Event()
        self._frame: Frame | None = None
        self._lost: str | None = None
        self._seq = 0
        self._has_sent = False

    def put(self, image: NDArray[np.uint8], exposed_t: float, sigma_t: float = 0.0) -> None:
        """Take a grey picture and the middle of its exposure on `clock`; any thread.

        Args:
            image: grey levels, (height, width).
            exposed_t: middle of the exposure on `clock`, s.
            sigma_t: standard deviation of exposed_t, s.
        """
        self._loop.call_soon_threadsafe(self._take, image, exposed_t, sigma_t)

    def lose(self, reason: str) -> None:
        """Make `get` raise DeviceLost with this reason; any thread."""
        self._loop.call_soon_threadsafe(self._end, reason)

    async def get(self) -> Frame:
        """Wait for a frame newer than the last; raises DeviceLost."""
        limit_s = _STALL_S if self._has_sent else _FIRST_FRAME_S
        try:
            async with asyncio.timeout(limit_s):
                await self._arrived.wait()
        except TimeoutError:
            raise DeviceLost(f"{self._name} sent no picture for {limit_s:g} s") from None
        if self._lost is not None or self._frame is None:
            raise DeviceLost(f"{self._name}: {self._lost}")
        frame, self._frame = self._frame, None
        self._arrived.clear()
        self._has_sent = True
        return frame

    def _take(self, image: NDArray[np.uint8], exposed_t: float, sigma_t: float) -> None:
        t = self._loop.time() - (self._clock() - exposed_t)
        self._seq += 1
        self._frame = Frame(t, self._seq, image, sigma_t)
        self._arrived.set()

    def _end(self, reason: str) -> None:
        self._lost = reason
        self._arrived.set()
