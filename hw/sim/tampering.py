"""Lets faults change, delay or drop the autopilot's messages on their way to landerd."""

from collections.abc import Callable
from functools import partial

from hw.autopilots.mavlink_codec import Message

Send = Callable[[Message], None]
Tamper = Callable[[Message, Send], None]  # a message, and the function to send it now or later


class Tampering:
    """The active changes of messages, by message id; they may end in any order."""

    def __init__(self) -> None:
        self._tampers: dict[int, list[Tamper]] = {}

    def begin(self, message_id: int, tamper: Tamper) -> None:
        """Start a change of messages with this id; it is made before those already active."""
        self._tampers.setdefault(message_id, []).append(tamper)

    def end(self, message_id: int, tamper: Tamper) -> None:
        """End a change."""
        self._tampers[message_id].remove(tamper)

    def pass_on(self, message: Message, send: Send) -> None:
        """Send a message with all active changes of its id made."""
        for tamper in self._tampers.get(message.get_msgId(), ()):
            send = partial(_through, tamper, send)
        send(message)


def _through(tamper: Tamper, send: Send, message: Message) -> None:
    tamper(message, send)
