"""MAVLink messages from a stream of bytes and back.

pymavlink's generated dialect packs and unpacks the messages. Finding frames in the stream is done
here, because its own parser loses up to 280 good bytes after a damaged length byte, holds good
messages back meanwhile, and lets its buffer grow for as long as reads end inside a frame.
"""

import re
from collections import Counter
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.signing import LENGTH as _SIGNATURE
from landerd.ports import MessageSigning

Message = Any  # pymavlink's message classes carry no types

_MARKER = re.compile(rb"[\xfd\xfe]")
_V2 = 0xFD
_SIGNED = 0x01
# Frame bytes beside the payload: header and checksum.
_OVERHEAD_V1, _OVERHEAD_V2 = 8, 12


class MavlinkCodec:
    """Encodes MAVLink 2; decodes MAVLink 2 and 1, skipping damaged bytes.

    Attributes:
        counters: "garbled bytes": bytes skipped; "unknown": what in these looked like messages
            that the dialect does not have; "badly signed": messages with a wrong signature or,
            though it is required, without one; "messages lost": gaps in an autopilot's sequence
            numbers.
    """

    def __init__(self, system: int, component: int, signing: MessageSigning | None = None) -> None:
        """Make a codec whose messages are sent as from this system and component.

        With signing all messages sent are signed, and only signed ones are accepted.
        """
        self.counters: Counter[str] = Counter()
        self._mavlink = mavlink.MAVLink(None, system, component)
        self._parser = mavlink.MAVLink(None)  # without the key: `signing` checks what comes in
        self._signing = signing
        if signing is not None:
            self._mavlink.signing.secret_key = signing.key
            self._mavlink.signing.sign_outgoing = True
        self._buffer = bytearray()
        self._last_seq: dict[tuple[int, int], int] = {}

    def encode(self, message: Message, now: float = 0.0) -> bytes:
        """Return the frame of a message, with the next sequence number, sent at loop time now."""
        if self._signing is not None:
            self._mavlink.signing.timestamp = self._signing.stamp(now)
        frame: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) & 0xFF
        return frame

    def decode(self, data: bytes) -> list[Message]:
        """Take received bytes and return the messages they complete."""
        buffer = self._buffer
        buffer += data
        messages: list[Message] = []
        done = 0  # all bytes before this index are decoded or skipped
        unfinished: int | None = None  # start of the first frame that may still be completed
        at = 0
        while (found := _MARKER.search(buffer, at)) is not None:
            at = found.start()
            size = _frame_size(buffer, at)
            if size is None:  # not a frame
                at += 1
                continue
            if at + size > len(buffer):
                # Either a frame that is not complete yet, or a damaged length byte. Search on: a
                # good frame behind it shows that the length was damaged.
                unfinished = at if unfinished is None else unfinished
                at += 1
                continue
            message = self._decode_frame(buffer[at : at + size])
            if message is not None and message.get_msgId() < 0:
                # Not in the dialect: its checksum cannot be verified, nor its length trusted. It is
                # not counted inside a frame that may still be completed: it may be its payload.
                self.counters["unknown"] += unfinished is None
                message = None
            if message is None:
                at += 1
                continue
            if at > done:
                self.counters["garbled bytes"] += at - done
            at += size
            done, unfinished = at, None
            if self._signing is not None and not self._signing.accepts(
                bytes(message.get_msgbuf()), message.get_srcSystem(), message.get_srcComponent()
            ):
                self.counters["badly signed"] += 1
                continue
            self._note_sequence(message)
            messages.append(message)
        keep = len(buffer) if unfinished is None else unfinished
        if keep > done:
            self.counters["garbled bytes"] += keep - done
        del buffer[:keep]
        return messages

    @property
    def pending_bytes(self) -> int:
        """Number of bytes kept that may still become a frame, at most one frame's length."""
        return len(self._buffer)

    def reset(self) -> None:
        """Forget an unfinished frame and the sequence numbers: the link was opened again."""
        self._buffer.clear()
        self._last_seq.clear()

    def _decode_frame(self, frame: bytearray) -> Message | None:
        try:
            return self._parser.decode(frame)
        except mavlink.MAVError:
            return None

    def _note_sequence(self, message: Message) -> None:
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source[1] != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return  # the autopilot passes on only some messages of ground stations and others
        seq = message.get_seq()
        missed = (seq - self._last_seq.get(source, seq - 1) - 1) & 0xFF
        if missed < 128:  # otherwise it is an older message that was overtaken
            self._last_seq[source] = seq
            if missed:
                self.counters["messages lost"] += missed


def _frame_size(buffer: bytearray, at: int) -> int | None:
    """Return the size of a frame that may start here, bytes; None: no frame starts here."""
    header = buffer[at : at + 3]
    if len(header) < 3:
        return _OVERHEAD_V2
    if header[0] != _V2:
        return _OVERHEAD_V1 + header[1]
    if header[2] & ~_SIGNED:
        return None
    return _OVERHEAD_V2 + header[1] + (_SIGNATURE if header[2] & _SIGNED else 0)
