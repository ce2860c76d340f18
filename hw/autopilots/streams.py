"""The message streams asked of the autopilot, and whether they come at the rates asked for."""

import logging
import math
from collections import Counter
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

log = logging.getLogger(__name__)

# Asked of the autopilot, Hz.
STREAMS_HZ = {
    # The only message that tells armed and mode: at its usual 1 Hz, three lost ones in a row would
    # make it stale.
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 4.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 20.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
}
_WINDOW_S = 1.0  # rates are measured over this long
# A first request that is lost is noticed after this long, s: until RC is heard, no switch can be
# seen to be low, and a pilot who raises it meanwhile has to lower it again.
_FIRST_LOOK_S = 0.25
_LEAST_SHARE = 0.75  # share of its rate below which a stream is asked for again


class Streams:
    """Asks for the streams, measures them, and asks again for those that are too slow."""

    def __init__(self, ask: Callable[[int, float], None]) -> None:
        """Make one; ask: requests a message, by its id, at a rate in Hz."""
        self._ask = ask
        self._wanted = dict(STREAMS_HZ)
        self._received: Counter[int] = Counter()  # in this window, by message id
        self._slow: set[int] = set()
        self.restart()

    def add(self, message_id: int, rate_hz: float) -> None:
        """Ask for one more message."""
        self._wanted[message_id] = rate_hz

    def restart(self) -> None:
        """Ask for all streams again: the link or the autopilot is new."""
        self._window_start = -math.inf
        self._first_look = math.inf  # when to see whether anything of them has come, s

    def received(self, message_id: int) -> None:
        """Count a message."""
        self._received[message_id] += 1

    def request_missing(self, now: float) -> None:
        """Ask again for streams that are too slow; called often."""
        window = now - self._window_start
        if window < _WINDOW_S:
            self._look_first(now)
            return
        if math.isinf(window):
            self._first_look = now + _FIRST_LOOK_S
        for message_id, wanted in self._wanted.items():
            # One message may have come just before or after the window.
            if self._received[message_id] + 1 < _LEAST_SHARE * wanted * window:
                self._ask(message_id, wanted)
                self._tell(message_id, self._received[message_id] / window, wanted)
            else:
                self._slow.discard(message_id)
        self._received.clear()
        self._window_start = now

    def _look_first(self, now: float) -> None:
        """Ask once more for streams of which nothing has come since all were asked for."""
        if now < self._first_look:
            return
        self._first_look = math.inf
        for message_id, wanted in self._wanted.items():
            if not self._received[message_id]:
                self._ask(message_id, wanted)

    def _tell(self, message_id: int, rate: float, wanted: float) -> None:
        if math.isfinite(self._window_start) and message_id not in self._slow:
            self._slow.add(message_id)
            name = mavlink.mavlink_map[message_id].msgname
            log.warning("%s comes at %.0f Hz, %.0f Hz are needed", name, rate, wanted)
