"""Detects pictures with time stamps that cannot be true (rule 5)."""

import math
from collections import deque

FUTURE_S = 0.05  # a time stamp farther ahead of the loop's clock than this is false
OLDEST_FRAME_S = 1.0  # a frame exposed longer ago is not searched: its sighting would be of no use
# A frame that arrives this much sooner after its exposure than any before, s, is stamped too late.
# What arrived within the second, s, is not compared with. If frames arrive as soon as that for as
# long as the third, s, the camera has become quicker, as where more light makes its frames shorter.
# In pictures stamped 0.06 to 0.1 s late, which passed for new, the pad was sunk towards and turned
# to for that much longer than it was seen.
SOONER_S, LATELY_S, QUICKER_S = 0.05, 1.0, 3.0


class FrameTimes:
    """Compares the times of frames with those of their arrival, and with one another."""

    def __init__(self) -> None:
        self._last_t = -math.inf  # exposure of the last frame that was used
        self._least_age_s = math.inf  # of those that arrived more than LATELY_S ago
        self._lately: deque[tuple[float, float]] = deque()  # arrival and age of the others, s
        self._sooner_since = math.inf  # since when frames have arrived sooner than any before, s

    def why_false(self, t: float, now: float) -> tuple[str, str] | None:
        """Return what is wrong with a frame's time, and how far; None: the frame can be used.

        Args:
            t: stated time of exposure, s.
            now: at which it arrived, s.
        """
        age_s = now - t
        if not math.isfinite(t) or age_s < -FUTURE_S:
            return "frame from the future", f"{-age_s:.3f} s ahead"
        if age_s > OLDEST_FRAME_S or t <= self._last_t:
            return "frame too old or out of order", f"{age_s:.3f} s old"
        if self._comes_too_soon(age_s, now):
            text = f"{age_s:.3f} s after its exposure, before {self._least_age_s:.3f} s at least"
            return "frame stamped too late", text
        self._last_t = t
        self._lately.append((now, age_s))
        return None

    def _comes_too_soon(self, age_s: float, now: float) -> bool:
        while self._lately and now - self._lately[0][0] > LATELY_S:
            self._least_age_s = min(self._least_age_s, self._lately.popleft()[1])
        is_sooner = self._least_age_s < math.inf and age_s < self._least_age_s - SOONER_S
        self._sooner_since = min(self._sooner_since, now) if is_sooner else math.inf
        if now - self._sooner_since >= QUICKER_S:
            self._least_age_s = age_s
            return False
        return is_sooner
