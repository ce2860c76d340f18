"""Tells systemd that the daemon is ready, alive, and what it is doing (sd_notify(3))."""

import logging
import os
import socket

from landerd.messages import Command, Input, PhaseChange, Tick
from landerd.runtime.observer import Observer

ALIVE_EVERY_S = 0.5  # well inside the unit's WatchdogSec


def notify(text: str) -> None:
    """Send a line such as READY=1 to systemd; does nothing outside a notify service."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as s:
        s.sendto(text.encode(), address)


class JournalFormatter(logging.Formatter):
    """Lines with the priority that journald reads off their start (sd-daemon(3))."""

    _PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4))

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, or each of its lines, as "<4>text"."""
        level = next((p for limit, p in self._PRIORITIES if record.levelno >= limit), 6)
        return "\n".join(f"<{level}>{line}" for line in super().format(record).splitlines())


def log_to_stderr() -> None:
    """Log from INFO on: with priorities to the journal, with the level's name elsewhere."""
    handler = logging.StreamHandler()
    if os.environ.get("JOURNAL_STREAM"):
        handler.setFormatter(JournalFormatter())
    else:
        handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


class ServiceNotifier(Observer):
    """Feeds systemd's watchdog from the control task, so that it fires when that hangs.

    Frames do not matter here: a daemon without a camera is alive.
    """

    def __init__(self) -> None:
        self._fed_t: float | None = None

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Pass changes of phase on, and feed the watchdog with ticks."""
        for command in commands:
            if isinstance(command, PhaseChange):
                notify(f"STATUS={command.phase.value}: {command.reason}")
        if not isinstance(message, Tick):
            return
        if self._fed_t is None:
            notify("READY=1")
        self._feed(now)

    def on_last_orders(self, now: float) -> None:
        """Feed the watchdog: it would cut the stop orders short."""
        self._feed(now)

    def _feed(self, now: float) -> None:
        if self._fed_t is None or now - self._fed_t >= ALIVE_EVERY_S:
            self._fed_t = now
            notify("WATCHDOG=1")
