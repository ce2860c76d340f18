"""Finds the frames in a stream of bytes, for the serial gimbal protocols."""

from collections import Counter
from collections.abc import Callable


class FrameScanner:
    """Finds frames by their first byte, size and checksum; damaged ones are skipped byte by byte.

    Attributes:
        counters: "garbled bytes": number of bytes that belong to no valid frame.
    """

    def __init__(
        self,
        starts: bytes,
        header: int,
        size: Callable[[bytes], int | None],
        is_sound: Callable[[bytes], bool],
    ) -> None:
        """Make a scanner for frames of one protocol.

        Args:
            starts: the values that a frame's first byte may have.
            header: number of bytes at its start from which a frame's size follows.
            size: returns a whole frame's size from these bytes; None: no frame begins like this.
            is_sound: tells whether a whole frame's checksum is right.
        """
        self.counters: Counter[str] = Counter()
        self._starts, self._header = starts, header
        self._size, self._is_sound = size, is_sound
        self._buffer = bytearray()

    def reset(self) -> None:
        """Forget an unfinished frame."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[bytes]:
        """Take received bytes and return the whole frames they complete."""
        self._buffer += data
        frames: list[bytes] = []
        while self._seek():
            size = None
            if len(self._buffer) >= self._header:
                size = self._size(bytes(self._buffer[: self._header]))
                if size is None:
                    self._skip(1)
                    continue
            if size is None or len(self._buffer) < size:
                break
            frame = bytes(self._buffer[:size])
            if self._is_sound(frame):
                frames.append(frame)
                del self._buffer[:size]
            else:
                self._skip(1)
        return frames

    def _seek(self) -> bool:
        """Drop all bytes before the next possible start; return False if there is none."""
        at = next((i for i, byte in enumerate(self._buffer) if byte in self._starts), None)
        self._skip(len(self._buffer) if at is None else at)
        return at is not None

    def _skip(self, count: int) -> None:
        if count:
            self.counters["garbled bytes"] += count
            del self._buffer[:count]
