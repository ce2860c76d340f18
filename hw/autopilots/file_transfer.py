"""MAVLink's file transfer protocol: landerd has no files, and refuses requests.

https://mavlink.io/en/services/ftp.html. Some ground stations first try to fetch the parameters as a
file. Refused, they use the parameter protocol at once; unanswered, they repeat the request for 10 s
and more.
"""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message

_HEADER = struct.Struct("<HBBBBBxI")  # sequence, session, opcode, size, asked, burst, offset
_PAYLOAD_BYTES = 251
_NAK = 129
_FIRST_REPLY = 128  # opcodes from here on are answers
_UNKNOWN_COMMAND = 7


def refusal(request: Message) -> Message | None:
    """Return the refusal of a FILE_TRANSFER_PROTOCOL request; None: the message is no request."""
    sequence, session, opcode, *_ = _HEADER.unpack_from(bytes(request.payload))
    if opcode >= _FIRST_REPLY:
        return None
    payload = bytearray(_PAYLOAD_BYTES)
    _HEADER.pack_into(payload, 0, (sequence + 1) & 0xFFFF, session, _NAK, 1, opcode, 0, 0)
    payload[_HEADER.size] = _UNKNOWN_COMMAND
    return mavlink.MAVLink_file_transfer_protocol_message(
        0, request.get_srcSystem(), request.get_srcComponent(), list(payload)
    )
