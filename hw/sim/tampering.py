"""Lets faults change, delay or drop the autopilot's messages on their way to landerd."""

from collections.abc import Callable
from functools import partial

from hw.autopilots.mavlink_codec import Message

Send = Callable[[Message], None]
Tamper = Callable[[Message, Send], None]  # called with a message and what sends it, now or later


class Tampering:
    """The active changes by message id; they may end in any order."""

    def __init__(self) -> None:
        self._tampers: dict[int, list[Tamper]] = {}

    def begin(self, message_id: int, tamper: Tamper) -> None:
        """Let this be done to such messages before what is done to them already."""
        self._tampers.setdefault(message_id, []).append(tamper)

    def end(self, message_id: int, tamper: Tamper) -> None:
        """Let it be done no more."""
        self._tampers[message_id].remove(tamper)

    def pass_on(self, message: Message, send: Send) -> None:
        """Send a message as it is, or what is made of it."""
        for tamper in self._tampers.get(message.get_msgId(), ()):
            send = partial(_through, tamper, send)
        send(message)


def _through(tamper: Tamper, send: Send, message: Message) -> None:
    tamper(message, send)
