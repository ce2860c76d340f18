"""Byte links, chosen by URL: serial, UDP, TCP; the in-memory pair is `hw.links.memory`."""

from collections.abc import Callable
from urllib.parse import parse_qsl, urlsplit

from hw.links.serial import SerialLink
from hw.links.tcp import TcpLink
from hw.links.udp import UdpLink
from landerd.ports import ByteLink

_DEFAULT_BAUD = 921600
_FORMS = (
    "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT "
    "or serial:/dev/NAME?baud=921600"
)


def open_link(url: str, is_peer: Callable[[bytes], bool] | None = None) -> ByteLink:
    """Return the link that a URL names; its own `open` connects it.

    Args:
        url: one of the forms above.
        is_peer: tells for `udpin` whether a datagram is the peer's; see UdpLink.

    `udpin` and `tcpin` listen, `udpout` and `tcp` call. Hosts are best given as numbers: the event
    loop looks a name up in a thread of its own.

    Raises:
        ValueError: the URL is not one of these; the text is one line.
    """
    kind, _, rest = url.partition(":")
    if kind == "serial":
        return _serial(url, rest)
    if kind in ("udpin", "udpout", "tcp", "tcpin"):
        host, port = _host_and_port(url, rest)
        listen = kind in ("udpin", "tcpin")
        if kind.startswith("udp"):
            return UdpLink(host, port, listen=listen, is_peer=is_peer)
        return TcpLink(host, port, listen=listen)
    if kind == "memory":
        raise ValueError("memory: is the simulator's own link and cannot be opened by its URL")
    raise ValueError(f"link {url!r}: expected {_FORMS}")


def _host_and_port(url: str, rest: str) -> tuple[str, int]:
    host, colon, digits = rest.removeprefix("//").rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    port = int(digits) if digits.isascii() and digits.isdecimal() else 0
    if not (colon and host and "\0" not in host and 0 < port < 65536):
        raise ValueError(f"link {url!r}: expected HOST:PORT with a port from 1 to 65535")
    try:
        host.encode("idna")  # as the look-up does
    except UnicodeError:
        raise ValueError(f"link {url!r}: {host!r} cannot be a host's name") from None
    return host, port


def _serial(url: str, rest: str) -> SerialLink:
    parts = urlsplit(rest)
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    baud = options.pop("baud", str(_DEFAULT_BAUD))
    if not parts.path.startswith("/"):
        raise ValueError(f"link {url!r}: expected a path, as in serial:/dev/serial0?baud=921600")
    if options:
        raise ValueError(f"link {url!r}: unknown option {next(iter(options))!r}; there is: baud")
    if not (baud.isascii() and baud.isdecimal() and 0 < int(baud) <= 4_000_000):
        raise ValueError(f"link {url!r}: baud {baud!r}: expected a whole number up to 4000000")
    return SerialLink(parts.path, int(baud))
