"""The autopilot's boot time on the event loop's clock."""

import math
from collections import deque
from dataclasses import dataclass

_WINDOW_S = 10.0  # the quickest exchange of this long counts: clocks drift
_LONGEST_ROUND_TRIP_S = 1.0  # slower exchanges say too little
_OFFSET_TOLERANCE_S = 0.003  # resolution of the stamps and drift within the window


@dataclass(frozen=True, slots=True)
class _Exchange:
    received: float
    round_trip: float
    offset: float  # loop time minus boot time, within +- round_trip / 2


class BootClock:
    """Finds loop time minus boot time from TIMESYNC exchanges, the quickest one counting.

    Until the first exchange the earliest arrival of a stamped message stands in: it is late by
    the link's shortest delay.
    """

    def __init__(self) -> None:
        self._exchanges: deque[_Exchange] = deque()
        self._earliest_arrival = math.inf
        self._offset: float | None = None

    def place(self, boot_s: float, now: float) -> float:
        """Return the loop time of a message stamped with this boot time that arrives now."""
        self._earliest_arrival = min(self._earliest_arrival, now - boot_s)
        offset = self._earliest_arrival if self._offset is None else self._offset
        return min(boot_s + offset, now)

    def exchanged(self, sent: float, boot_s: float, received: float) -> None:
        """Note an exchange: request sent, the autopilot's boot time in its reply, reply here."""
        round_trip = received - sent
        if not 0.0 <= round_trip <= _LONGEST_ROUND_TRIP_S:
            return
        new = _Exchange(received, round_trip, 0.5 * (sent + received) - boot_s)
        exchanges = self._exchanges
        if exchanges:
            best = min(exchanges, key=lambda e: e.round_trip)
            bound = 0.5 * (best.round_trip + round_trip) + _OFFSET_TOLERANCE_S
            if abs(new.offset - best.offset) > bound:  # cannot both be true: a clock was stepped
                exchanges.clear()
        exchanges.append(new)
        while received - exchanges[0].received > _WINDOW_S:
            exchanges.popleft()
        self._offset = min(exchanges, key=lambda e: e.round_trip).offset
