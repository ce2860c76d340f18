"""A WebSocket client of Foxglove's protocol (foxglove.sdk.v1), with a socket of the test's own."""

import base64
import json
import os
import socket
import struct
from types import TracebackType
from typing import Any, Self

_TEXT, _BINARY = 1, 2
_MESSAGE_DATA = 1
_LONGEST_S = 20.0


class FoxgloveClient:
    """Connected; `topics` are those that the server tells of."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), _LONGEST_S)
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: Upgrade\r\n"
            "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self._stream = self._socket.makefile("rb")
        assert self._stream.readline().startswith(b"HTTP/1.1 101")
        while self._stream.readline().strip():
            pass
        self.info: dict[str, Any] = self._told("serverInfo")
        channels = self._told("advertise")["channels"]
        self.topics: dict[int, str] = {c["id"]: c["topic"] for c in channels}
        self.schemas: dict[str, str] = {c["topic"]: c["schemaName"] for c in channels}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, e: BaseException | None, tb: TracebackType | None
    ) -> None:
        self._stream.close()
        self._socket.close()

    def subscribe(self) -> None:
        """Ask for all topics."""
        asked = [{"id": number, "channelId": number} for number in self.topics]
        text = json.dumps({"op": "subscribe", "subscriptions": asked}).encode()
        key = os.urandom(4)
        masked = bytes(byte ^ key[i % 4] for i, byte in enumerate(text))
        self._socket.sendall(
            struct.pack(">BBH", 0x80 | _TEXT, 0x80 | 126, len(text)) + key + masked
        )

    def message(self) -> tuple[str, int, bytes]:
        """Return the next message: topic, time (ns), data."""
        while True:
            kind, data = self._frame()
            if kind == _BINARY and data[0] == _MESSAGE_DATA:
                number, ns = struct.unpack("<IQ", data[1:13])
                return self.topics[number], ns, data[13:]

    def _told(self, operation: str) -> dict[str, Any]:
        while True:
            kind, data = self._frame()
            if kind == _TEXT:
                said: dict[str, Any] = json.loads(data)
                if said["op"] == operation:
                    return said

    def _frame(self) -> tuple[int, bytes]:
        first, length = self._stream.read(2)
        if length == 126:
            (length,) = struct.unpack(">H", self._stream.read(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self._stream.read(8))
        return first & 15, self._stream.read(length)
