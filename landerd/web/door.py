"""Where the status page is served, and who may see it."""

import hmac
import ipaddress
import logging
import re
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from landerd.config.models import WebSection, split_address
from landerd.files import why_unread

log = logging.getLogger("landerd")

_T = TypeVar("_T")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,128}", re.ASCII)  # fits into addresses and cookies as it is

AGAIN_S = 5.0  # an address may come later than landerd, with its network, or be another's yet


class DoorError(Exception):
    """The page cannot be served; the text says why, in one line."""


@dataclass(frozen=True)
class Door:
    """The page's address, and the token that opens it (None: only for this computer)."""

    host: str
    port: int
    token: str | None

    @property
    def url(self) -> str:
        """What is typed into a browser, without the token."""
        return f"http://{self.address}/"

    @property
    def address(self) -> str:
        """Host and port, as in an URL."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    def opens_to(self, token: str) -> bool:
        """Tell whether this is the token; how long it takes tells nothing."""
        return self.token is not None and hmac.compare_digest(token.encode(), self.token.encode())

    def is_named_by(self, host: str) -> bool:
        """Tell whether a request's Host is this computer's own name for itself.

        Where there is no token, a page of somebody else's whose name is made to lead to this
        computer (DNS rebinding) must not be answered.
        """
        name = host.rsplit(":", 1)[0] if not host.endswith("]") else host
        return is_loopback(name.strip("[]"))

    def bound(self) -> socket.socket:
        """Return a socket that has the address, not listening yet.

        Raises:
            OSError: it cannot be had.
        """
        family, kind, protocol, _, address = socket.getaddrinfo(
            self.host, self.port, type=socket.SOCK_STREAM
        )[0]
        s = socket.socket(family, kind, protocol)
        try:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            s.bind(address)
        except OSError:
            s.close()
            raise
        return s


def why(e: Exception) -> str:
    """Return why an address cannot be had, without Python's own words."""
    return e.strerror if isinstance(e, OSError) and e.strerror else str(e)


def when_free(
    serve: Callable[[], _T],
    ended: threading.Event,
    fails: tuple[type[Exception], ...],
    what: str,
) -> _T | None:
    """Return a server as soon as its address is free; None: the end came first.

    Args:
        serve: begins to serve.
        ended: set when nothing is to be served any more.
        fails: what `serve` raises while the address cannot be had; all else ends the wait.
        what: is told not to be there yet, with each new reason once.
    """
    told = None
    while not ended.is_set():
        try:
            return serve()
        except fails as e:
            if why(e) != told:
                told = why(e)
                log.warning("%s yet: %s", what, told)
            ended.wait(AGAIN_S)
    return None


def is_loopback(host: str) -> bool:
    """Tell whether only this computer reaches a host of this name."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def door_of(section: WebSection) -> Door | None:
    """Return where the page is served; None: nowhere.

    Raises:
        DoorError: the token is missing where one is needed, or is none.
    """
    if section.listen is None:
        return None
    host, port = split_address(section.listen)
    if section.token_file is not None:
        return Door(host, port, _token(section.token_file))
    if not is_loopback(host):
        raise DoorError(
            f"web.listen: {section.listen} is reached from other computers, and web.token_file is "
            "not set"
        )
    return Door(host, port, None)


def _token(path: Path) -> str:
    try:
        token = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as e:
        raise DoorError(f"{path}: cannot be read: {why_unread(e)}") from None
    if _TOKEN.fullmatch(token) is None:
        raise DoorError(f"{path}: expected one word of 16 to 128 letters, digits, - and _")
    return token
