"""A link's bytes as a .tlog."""

import struct

from hw.autopilots.mavlink_codec import MavlinkCodec


class TlogEncoder:
    """Telemetry log as ground stations write it: each frame behind its Unix time in us."""

    def __init__(self) -> None:
        self._codecs = {outgoing: MavlinkCodec(0, 0) for outgoing in (False, True)}

    def encode(self, epoch_us: int, data: bytes, *, outgoing: bool) -> bytes:
        """Return the frames that these bytes complete; damaged ones are left out."""
        messages = self._codecs[outgoing].decode(data)
        return b"".join(struct.pack(">Q", epoch_us) + bytes(m.get_msgbuf()) for m in messages)
