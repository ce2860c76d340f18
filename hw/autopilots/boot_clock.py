"""The autopilot's boot time on the event loop's clock."""

import math
from collections import deque

_WINDOW_S = 10.0  # the quickest round trip is the quickest of this window
_LONGEST_ROUND_TRIP_S = 1.0  # slower exchanges are too uncertain to be used
_SIGMA_STAMP_S = 0.001  # resolution of the stamps, and the autopilot's main loop
# Crystals are off by up to 50e-6 and drift with temperature by 1e-6 in some seconds.
_SIGMA_DRIFT, _DRIFT_RANDOM_WALK = 100e-6, 1e-6  # s/s; s/s per sqrt(s)
_OFFSET_RANDOM_WALK = 50e-6  # s per sqrt(s): slewing of the loop's own clock
_TOLERANCE_S = 0.003  # beyond their round trips, from which on two exchanges contradict each other
WRAP_S = 2.0**32 / 1e3  # period of time_boot_ms
_WRAP_TOLERANCE_S = 60.0  # a stamp this close to the expected one is of the same boot


class BootClock:
    """Finds loop time minus boot time from TIMESYNC exchanges.

    A Kalman filter of offset and drift (as in chrony, after Mills' NTP). The noise of an exchange
    is half of what it took longer than the quickest one: by so much its middle may be wrong. How
    the quickest round trip divides into there and back cannot be known: half of it remains as
    uncertainty.

    Until the first exchange the earliest arrival of a stamped message is used; that is late by the
    link's shortest delay.
    """

    def __init__(self) -> None:
        self._earliest_arrival = math.inf  # least loop time of arrival minus boot time, s
        self._round_trips: deque[tuple[float, float]] = deque()  # received, round trip; s
        self._t: float | None = None  # of the state; None: no exchange yet
        self._offset = self._drift = 0.0  # s, s/s
        self._P = (0.0, 0.0, 0.0)  # covariance: of offset, offset with drift, drift
        self._boot: tuple[float, float] | None = None  # newest boot time, when it was received; s

    @property
    def uncertainty_s(self) -> float | None:
        """Half the quickest round trip plus the filter's sigma, s; None before any exchange."""
        if self._t is None:
            return None
        return 0.5 * self._quickest + math.sqrt(self._P[0])

    @property
    def _quickest(self) -> float:
        return min(round_trip for _, round_trip in self._round_trips)

    def unwrapped(self, boot_ms: int, now: float) -> float:
        """Return the boot time (s) of a stamp of 32 bits, which wraps after 49.7 days."""
        boot_s = 1e-3 * boot_ms
        if self._boot is None:
            return boot_s
        expected = self._boot[0] + now - self._boot[1]
        same_boot = boot_s + WRAP_S * round((expected - boot_s) / WRAP_S)
        # No boot time is negative: a stamp just below the wrap is ahead, not back.
        is_same = same_boot >= 0.0 and abs(same_boot - expected) < _WRAP_TOLERANCE_S
        return same_boot if is_same else boot_s

    def heard(self, boot_s: float, now: float) -> None:
        """Note a boot time (s), by which `unwrapped` counts wraps."""
        if self._boot is None or boot_s > self._boot[0]:
            self._boot = (boot_s, now)

    def place(self, boot_s: float, now: float) -> float:
        """Return the loop time (s) of a message stamped with this boot time that arrives now."""
        self._earliest_arrival = min(self._earliest_arrival, now - boot_s)
        offset = self._earliest_arrival
        if self._t is not None:
            offset = self._offset + self._drift * min(now - self._t, _WINDOW_S)
        return min(boot_s + offset, now)

    def exchanged(self, sent: float, boot_s: float, received: float) -> None:
        """Take an exchange: loop times of request and reply, the boot time in the reply; s."""
        round_trip = received - sent
        if not 0.0 <= round_trip <= _LONGEST_ROUND_TRIP_S:
            return
        offset = 0.5 * (sent + received) - boot_s
        if self._t is None or self._is_stepped(received, offset, round_trip):
            self._round_trips.clear()
            self._start(received, offset, round_trip)
        elif round_trip < self._quickest:  # earlier exchanges were less certain than assumed
            a, b, c = self._P
            self._P = (a + (0.5 * (self._quickest - round_trip)) ** 2, b, c)
        self._round_trips.append((received, round_trip))
        while received - self._round_trips[0][0] > _WINDOW_S:
            self._round_trips.popleft()
        self._correct(received, offset, 0.5 * (round_trip - self._quickest))

    def _is_stepped(self, t: float, offset: float, round_trip: float) -> bool:
        """Tell whether this exchange contradicts those before."""
        assert self._t is not None
        bound = 0.5 * (self._quickest + round_trip) + _TOLERANCE_S
        return abs(offset - self._offset - self._drift * (t - self._t)) > bound

    def _start(self, t: float, offset: float, round_trip: float) -> None:
        self._t, self._offset, self._drift = t, offset, 0.0
        self._P = ((0.5 * round_trip) ** 2 + _SIGMA_STAMP_S**2, 0.0, _SIGMA_DRIFT**2)

    def _correct(self, t: float, offset: float, sigma: float) -> None:
        """Predict to time t and correct by an offset and its sigma; s."""
        assert self._t is not None
        dt, self._t = t - self._t, t
        a, b, c = self._P
        a += dt * (2.0 * b + dt * c) + _OFFSET_RANDOM_WALK**2 * dt
        b += dt * c
        c += _DRIFT_RANDOM_WALK**2 * dt
        predicted = self._offset + self._drift * dt
        s = a + sigma * sigma + _SIGMA_STAMP_S**2
        k, k_drift = a / s, b / s
        self._offset = predicted + k * (offset - predicted)
        self._drift += k_drift * (offset - predicted)
        self._P = (a - k * a, b - k * b, c - k_drift * b)
