"""Writes a link's bytes as a telemetry log (.tlog)."""

import struct

from hw.autopilots.mavlink_codec import MavlinkCodec


class TlogEncoder:
    """Encodes a telemetry log as ground stations do: Unix time in us, then the frame."""

    def __init__(self) -> None:
        self._codecs = {outgoing: MavlinkCodec(0, 0) for outgoing in (False, True)}

    def encode(self, epoch_us: int, data: bytes, *, outgoing: bool) -> bytes:
        """Return the log entries of the frames that these bytes complete, without damaged ones."""
        messages = self._codecs[outgoing].decode(data)
        return b"".join(struct.pack(">Q", epoch_us) + bytes(m.get_msgbuf()) for m in messages)
