"""What passes on the link, as the judge reads it."""

import contextlib
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_HEADER = 10  # bytes of a MAVLink 2 header
_CHECKSUM, _SIGNATURE = 2, 13  # bytes
_JUDGED = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    mavlink.MAVLINK_MSG_ID_ATTITUDE,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
}


class Wire:
    """Finds the messages that the rules are about in bytes of whole frames."""

    def __init__(self) -> None:
        self._codec = mavlink.MAVLink(None)

    def messages(self, data: bytes) -> list[mavlink.MAVLink_message]:
        """Return them, oldest first; a damaged one is none, for landerd as for the judge."""
        out = []
        at = 0
        while at + _HEADER < len(data) and data[at] == mavlink.PROTOCOL_MARKER_V2:
            signature = _SIGNATURE if data[at + 2] & mavlink.MAVLINK_IFLAG_SIGNED else 0
            end = at + _HEADER + data[at + 1] + _CHECKSUM + signature
            (kind,) = struct.unpack("<I", data[at + 7 : at + 10] + b"\0")
            if kind in _JUDGED:
                with contextlib.suppress(mavlink.MAVError):
                    out.append(self._codec.decode(bytearray(data[at:end])))
            at = end
        return out
