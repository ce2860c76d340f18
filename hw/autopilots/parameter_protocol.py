"""The server side of MAVLink's parameter protocol: landerd's own parameters for ground stations.

https://mavlink.io/en/services/parameter.html. All parameters are sent as REAL32: some ground
stations take whole numbers by value and some by bytes, and for REAL32 the two are the same.
"""

import asyncio
import logging
import struct
from collections import deque
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from landerd.messages import ParameterChange
from landerd.ports import ParameterRefused, Parameters

log = logging.getLogger(__name__)

# Interval between two entries of the list: sent at once, the list would hold up set-points by half
# a second on a slow telemetry port.
_LIST_INTERVAL_S = 0.02
_WRITE_PERSISTENT = 1.0  # PREFLIGHT_STORAGE_PARAMETER_ACTION


class ParameterProtocol:
    """Answers PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET and the order to save."""

    def __init__(
        self, parameters: Parameters, send: Callable[[Message], None], tell: Callable[[str], None]
    ) -> None:
        """Make a server; send: sends a message; tell: shows the pilot a line."""
        self._parameters = parameters
        self._send = send
        self._tell = tell
        self._listing: deque[str] = deque()  # names still to be sent

    def take(self, m: Message, now: float, *, disarmed: bool) -> ParameterChange | None:
        """Answer a ground station's message that arrived at now (s); return an accepted change."""
        kind = m.get_msgId()
        if kind == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            was_idle = not self._listing
            self._listing = deque(self._parameters.names)
            if was_idle:
                self._send_next()
        elif kind == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
            self._read(m)
        elif kind == mavlink.MAVLINK_MSG_ID_PARAM_SET:
            return self._set(m, now, disarmed=disarmed)
        return None

    def save(self, action: float) -> int:
        """Carry out MAV_CMD_PREFLIGHT_STORAGE and return its MAV_RESULT."""
        if action != _WRITE_PERSISTENT:
            return int(mavlink.MAV_RESULT_UNSUPPORTED)
        try:
            self._parameters.save()
        except ParameterRefused as e:
            self._tell(str(e))
            return int(mavlink.MAV_RESULT_FAILED)
        log.info("parameters saved")
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _send_next(self) -> None:
        if self._listing:
            self._send_value(self._listing.popleft())
            asyncio.get_running_loop().call_later(_LIST_INTERVAL_S, self._send_next)

    def _read(self, m: Message) -> None:
        names = self._parameters.names
        if m.param_index < 0:
            if m.param_id in names:
                self._send_value(m.param_id)
        elif m.param_index < len(names):
            self._send_value(names[m.param_index])

    def _set(self, m: Message, now: float, *, disarmed: bool) -> ParameterChange | None:
        name = m.param_id
        if name not in self._parameters.names:
            if m.target_component:  # a request to all components is answered only if we have it
                self._tell(f"no parameter {name}")
            return None
        change = None
        try:
            value = _shortest(m.param_value)
            key = self._parameters.change(name, value, disarmed=disarmed)
            change = ParameterChange(now, key, value)
            log.info("%s (%s) is %g now", name, key, value)
        except ParameterRefused as e:
            self._tell(str(e))
        self._send_value(name)  # the one in force, which also tells of a refusal
        return change

    def _send_value(self, name: str) -> None:
        names = self._parameters.names
        self._send(
            mavlink.MAVLink_param_value_message(
                name.encode("ascii"),
                self._parameters.value(name),
                mavlink.MAV_PARAM_TYPE_REAL32,
                len(names),
                names.index(name),
            )
        )


def _shortest(value: float) -> float:
    """Return the shortest decimal that has the same 32-bit float: 0.2, not 0.20000000298."""
    for digits in range(1, 9):
        short = float(f"{value:.{digits}g}")
        if abs(short) < 3e38 and struct.pack("<f", short) == struct.pack("<f", value):
            return short
    return value
