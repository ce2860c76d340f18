"""A status page over a daemon whose core is fed by the test, on a port of the machine's choice."""

import http.client
import json
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from landerd.messages import Command, Frame, Input, Prior, Sightings
from landerd.runtime.daemon import Daemon, Devices
from landerd.runtime.observer import Observer
from landerd.web.door import Door
from landerd.web.status_page import StatusPage
from tests.hw.idle import Idle
from tests.recorded_flight import CAMERA
from tests.scripted_flight import PAD, Flight

TOKEN = "correct-horse-battery"


def free_port(host: str = "127.0.0.1") -> int:
    with socket.socket() as s:
        s.bind((host, 0))
        port: int = s.getsockname()[1]
        return port


class ObservedFlight(Flight):
    """Shows observers what the daemon would."""

    def __init__(self) -> None:
        super().__init__(position=(-0.8, 0.3, -2.0))
        self.observers: tuple[Observer, ...] = ()
        self._image = np.full((CAMERA.height, CAMERA.width), 90, np.uint8)

    def give(self, message: Input) -> list[Command]:
        commands = super().give(message)
        for observer in self.observers:
            if isinstance(message, Sightings):
                frame = Frame(message.t, message.seq, self._image)
                observer.on_frame(frame, Prior(), message)
            observer.on_step(self.t, message, commands)
        return commands


class Shown:
    """A page, and the flight that it shows."""

    def __init__(self, page: StatusPage, flight: Flight, daemon: Daemon, door: Door) -> None:
        self.page, self.flight, self.daemon, self.door = page, flight, daemon, door

    def get(self, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
        longest_s = 300.0  # a report yields to all else that runs
        connection = http.client.HTTPConnection(self.door.host, self.door.port, timeout=longest_s)
        try:
            connection.request("GET", path, headers=headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

    def view(self, seen: int = -1) -> dict[str, Any]:
        status, _, body = self.get(f"/view?seen={seen}")
        assert status == 200
        found: dict[str, Any] = json.loads(body)
        return found


@contextmanager
def shown_page(
    folder: Path | None = None, *, host: str = "127.0.0.1", token: str | None = None
) -> Iterator[Shown]:
    """Serve a page until the block ends."""
    flight = ObservedFlight()
    devices = Devices(Idle(), Idle(), Idle())  # type: ignore[arg-type]
    daemon = Daemon(flight.lander.config, PAD, CAMERA, devices)
    daemon.lander = flight.lander
    door = Door(host, free_port(host), token)
    page = StatusPage(door, CAMERA, PAD, folder, lambda: 41.0)
    page.watch(daemon)
    flight.observers = daemon._observers
    shown = Shown(page, flight, daemon, door)
    _until_served(shown)
    try:
        yield shown
    finally:
        page.close()


def _until_served(shown: Shown) -> None:
    for _ in range(200):
        try:
            socket.create_connection((shown.door.host, shown.door.port), 1.0).close()
            return
        except ConnectionRefusedError:
            time.sleep(0.02)
    raise AssertionError("the page is not served")
