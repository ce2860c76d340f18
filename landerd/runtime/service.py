"""Tells systemd that the daemon is ready, alive, and what it is doing (sd_notify(3))."""

import logging
import os
import socket

from landerd.messages import Command, Input, PhaseChange, Tick
from landerd.runtime.observer import Observer

ALIVE_EVERY_S = 0.5  # interval of the watchdog's messages, well below the unit's WatchdogSec


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
    """Formats log lines with a leading priority, as journald reads them (sd-daemon(3))."""

    _PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4))

    def format(self, record: logging.LogRecord) -> str:
        """Return the record's text, each line of it as "<4>text"."""
        level = next((p for limit, p in self._PRIORITIES if record.levelno >= limit), 6)
        return "\n".join(f"<{level}>{line}" for line in super().format(record).splitlines())


def log_to_stderr() -> None:
    """Log to stderr from INFO on: with priorities if it is the journal, else with level names."""
    handler = logging.StreamHandler()
    if os.environ.get("JOURNAL_STREAM"):
        handler.setFormatter(JournalFormatter())
    else:
        handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


class ServiceNotifier(Observer):
    """Feeds systemd's watchdog from the control task, so that it fires if that task hangs.

    Frames do not count: a daemon without a camera is alive.
    """

    def __init__(self) -> None:
        self._fed_t: float | None = None

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Report changes of phase to systemd, and feed the watchdog at ticks."""
        for command in commands:
            if isinstance(command, PhaseChange):
                notify(f"STATUS={command.phase.value}: {command.reason}")
        if not isinstance(message, Tick):
            return
        if self._fed_t is None:
            notify("READY=1")
        self._feed(now)

    def on_last_orders(self, now: float) -> None:
        """Feed the watchdog, which otherwise would cut the stop orders short."""
        self._feed(now)

    def _feed(self, now: float) -> None:
        if self._fed_t is None or now - self._fed_t >= ALIVE_EVERY_S:
            self._fed_t = now
            notify("WATCHDOG=1")
