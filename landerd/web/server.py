"""Serves the page: reads only, a few connections at a time, in threads of its own.

What a stranger can make it do is bounded, as these threads share the interpreter with the control
task: connections, how fast they come, and requests on each.
"""

import http.server
import json
import logging
import socket
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from landerd.web.door import Door
from landerd.web.flights import Flights, NoReport

log = logging.getLogger("landerd")

MOST_CONNECTIONS = 12
CONNECTION_S = 0.05  # no more than 20 new connections a second,
REQUEST_S = 0.02  # and 50 requests on each
WRONG_TOKEN_S = 0.5
IDLE_S = 10.0  # a connection that says nothing for so long is closed
_COOKIE = "landerd"
_KEPT_S = 30 * 86400  # by the browser
_HTML, _JSON, _TEXT = "text/html; charset=utf-8", "application/json", "text/plain; charset=utf-8"
_ASK = b"""<!DOCTYPE html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>landerd</title>
<body style="font:20px/1.5 sans-serif;margin:1em"><h1>landerd</h1>
<form method="get" action="/"><label>Token: <input name="token" autocomplete="off"
style="font:inherit"></label> <button style="font:inherit">Open</button></form>
<p>It stands in the file that <code>web.token_file</code> of the configuration names.</p>"""


class Server(http.server.ThreadingHTTPServer):
    """The listening socket; `serve_forever` runs in a thread of the page's."""

    daemon_threads = True
    block_on_close = False

    def __init__(
        self,
        door: Door,
        flights: Flights,
        view: Callable[[int], bytes],
        is_armed: Callable[[], bool],
    ) -> None:
        """Listen.

        Args:
            door: where, and for whom.
            flights: that are shown.
            view: JSON of the newest view; without the picture, if that has this number.
            is_armed: then there is only the live view.

        Raises:
            OSError: the address cannot be had.
        """
        self.door, self.flights, self.view, self.is_armed = door, flights, view, is_armed
        self.page = files("landerd.web").joinpath("page.html").read_bytes()
        self._free = threading.Semaphore(MOST_CONNECTIONS)
        super().__init__((door.host, door.port), _Visitor, bind_and_activate=False)
        self.socket.close()
        self.socket = door.bound()
        self.server_activate()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Give a connection a thread, if there is one left."""
        time.sleep(CONNECTION_S)
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no thread to be had
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, and free its thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that breaks is nobody's fault."""
        log.debug("status page: a request failed", exc_info=True)


class _Visitor(http.server.BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "landerd", ""
    protocol_version = "HTTP/1.1"
    timeout = IDLE_S

    def setup(self) -> None:
        super().setup()
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, True)

    def log_message(self, format: str, *args: Any) -> None:
        log.debug("status page: %s " + format, self.client_address[0], *args)

    def do_GET(self) -> None:
        """Answer; whatever changes anything does not exist."""
        time.sleep(REQUEST_S)
        if self.headers.get("Content-Length") or self.headers.get("Transfer-Encoding"):
            self.close_connection = True  # nobody reads that
        address = urlsplit(self.path)
        query = parse_qs(address.query)
        if not self._is_let_in(query.get("token", [""])[-1], address.path):
            return
        if address.path == "/":
            self._send(_HTML, self.server.page)
        elif address.path == "/view":
            seen = query.get("seen", [""])[-1]
            number = int(seen) if seen.isascii() and seen.isdecimal() and len(seen) < 18 else -1
            self._send(_JSON, self.server.view(number))
        elif address.path == "/flights":
            self._send(_JSON, json.dumps(self.server.flights.listed()).encode())
        elif address.path.startswith("/flights/"):
            self._send_flight(unquote(address.path.removeprefix("/flights/")))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def _is_let_in(self, token: str, path: str) -> bool:
        door = self.server.door
        if door.token is None:
            if door.is_named_by(self.headers.get("Host", "")):
                return True
            self._refuse(HTTPStatus.FORBIDDEN, f"open {door.url}")
            return False
        if token and door.opens_to(token):
            self._send_on(
                path if path.startswith("/") and not path.startswith("//") else "/", token
            )
            return False
        if door.opens_to(self._own_token()):
            return True
        if token or self._own_token():
            time.sleep(WRONG_TOKEN_S)
        self._send(_HTML, _ASK, HTTPStatus.UNAUTHORIZED)
        return False

    def _own_token(self) -> str:
        kind, _, bearer = self.headers.get("Authorization", "").partition(" ")
        if kind == "Bearer":
            return bearer
        try:
            cookie = SimpleCookie(self.headers.get("Cookie", "")).get(_COOKIE)
        except CookieError:
            return ""
        return cookie.value if cookie is not None else ""

    def _send_on(self, path: str, token: str) -> None:
        """Have the browser keep the token, and take it out of its line of addresses."""
        self.send_response(HTTPStatus.SEE_OTHER)
        self.send_header("Location", path)
        cookie = f"{_COOKIE}={token}; Path=/; Max-Age={_KEPT_S}; HttpOnly; SameSite=Lax"
        self.send_header("Set-Cookie", cookie)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def _send_flight(self, name: str) -> None:
        if self.server.is_armed():
            text = "not while the vehicle is armed: the computer has to fly"
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, text)
            return
        is_report = name.endswith(".html")
        path = self.server.flights.file(f"{name[:-5]}.mcap" if is_report else name)
        try:
            if path is None:
                self._refuse(HTTPStatus.NOT_FOUND, "there is no such flight")
            elif is_report:
                self._send(_HTML, self.server.flights.report(path))
            else:
                with path.open("rb") as file:
                    self._send_file(path.name, file)
        except NoReport as e:
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, str(e))

    def _send_file(self, name: str, file: Any) -> None:
        """Send what there is of a file now; it may be still growing."""
        left = file.seek(0, 2)
        file.seek(0)
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "application/octet-stream")
        self.send_header("Content-Disposition", f'attachment; filename="{name}"')
        self.send_header("Content-Length", str(left))
        self.end_headers()
        while left > 0 and not self.server.is_armed():
            data = file.read(min(left, 1 << 18))
            if not data:
                break
            self.wfile.write(data)
            left -= len(data)
        self.close_connection = self.close_connection or left > 0

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        self._send(_TEXT, f"{text}\n".encode(), status)

    def _send(self, kind: str, data: bytes, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("X-Frame-Options", "DENY")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header(
            "Content-Security-Policy",
            "default-src 'none'; img-src 'self' data:; connect-src 'self'; form-action 'self'; "
            "style-src 'unsafe-inline'; script-src 'unsafe-inline'",
        )
        self.end_headers()
        self.wfile.write(data)
