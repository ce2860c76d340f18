"""What passes on the link, as the judge reads it."""

import struct
from collections import OrderedDict
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_HEADER = 10  # bytes of a MAVLink 2 header
_CHECKSUM, _SIGNATURE = 2, 13  # bytes
_KEPT = 4096  # frames under way
GIMBAL_REPORTS = (
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
    mavlink.MAVLINK_MSG_ID_MOUNT_ORIENTATION,
    mavlink.MAVLINK_MSG_ID_MOUNT_STATUS,
)
_JUDGED = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    mavlink.MAVLINK_MSG_ID_ATTITUDE,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_PARAM_SET,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    *GIMBAL_REPORTS,
}


class Wire:
    """Finds the messages that the rules are about in bytes of whole frames."""

    def __init__(self) -> None:
        self._codec = mavlink.MAVLink(None)

    def messages(self, data: bytes) -> list[mavlink.MAVLink_message]:
        """Return them, oldest first; a damaged one is none, for landerd as for the judge."""
        out = []
        for kind, frame in frames(data):
            if kind in _JUDGED:
                try:
                    out.append(self._codec.decode(bytearray(frame)))
                except mavlink.MAVError:
                    continue
        return out


def frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield each MAVLink 2 frame with the id of its message; -1 and the rest if there is none."""
    at = 0
    while at < len(data):
        if data[at] != mavlink.PROTOCOL_MARKER_V2 or at + _HEADER >= len(data):
            yield -1, data[at:]
            return
        signature = _SIGNATURE if data[at + 2] & mavlink.MAVLINK_IFLAG_SIGNED else 0
        end = at + _HEADER + data[at + 1] + _CHECKSUM + signature
        (kind,) = struct.unpack("<I", data[at + 7 : at + 10] + b"\0")
        yield kind, data[at:end]
        at = end


class Departures:
    """Times at which frames still under way left: the age of their data counts from then.

    Where nobody listens at the far end, at a real autopilot, it counts from arrival.
    """

    def __init__(self) -> None:
        self._left: OrderedDict[bytes, float] = OrderedDict()

    def sent(self, t: float, data: bytes) -> None:
        """Bytes of whole frames leave at t (s)."""
        for _, frame in frames(data):
            self._left.pop(frame, None)
            self._left[frame] = t
        while len(self._left) > _KEPT:
            self._left.popitem(last=False)

    def left(self, frame: bytes, arrived_t: float) -> float:
        """Return when a frame left that arrives now, s."""
        return self._left.get(frame, arrived_t)
