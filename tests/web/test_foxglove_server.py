"""What Foxglove is sent, through its own SDK and over a real socket."""

import base64
import importlib.util
import json
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.config.models import Config, WebSection
from landerd.flightlog.reader import read_log
from landerd.preflight.status_page import foxglove_findings
from landerd.web.door import Door, DoorError
from landerd.web.foxglove_server import FoxgloveServer, foxglove_door
from tests.recorded_flight import CAMERA, recorder
from tests.scripted_flight import PAD
from tests.web.foxglove_client import FoxgloveClient
from tests.web.pages import ObservedFlight, free_port

needs_sdk = pytest.mark.skipif(
    importlib.util.find_spec("foxglove") is None, reason="foxglove-sdk is not installed"
)


@contextmanager
def served(log: Path) -> Iterator[tuple[ObservedFlight, int]]:
    """Serve a flight that is recorded too, until the block ends."""
    port = free_port()
    config = Config(web=WebSection(foxglove=f"127.0.0.1:{port}"))
    server = FoxgloveServer.of(config, CAMERA, PAD)
    assert server is not None
    flight, recording = ObservedFlight(), recorder(log)
    flight.observers = (recording, server)
    for observer in flight.observers:
        observer.on_flight(flight.lander)
    flight.run(0.1)
    try:
        yield flight, port
    finally:
        server.close()
        recording.close()


def connected(port: int) -> FoxgloveClient:
    for _ in range(200):
        try:
            return FoxgloveClient(port)
        except ConnectionRefusedError:
            time.sleep(0.05)
    raise AssertionError("nothing is served")


@needs_sdk
def test_the_logs_own_messages_come_live(tmp_path: Path) -> None:
    found: dict[str, list[tuple[int, bytes]]] = {}
    with served(tmp_path / "a.mcap") as (flight, port), connected(port) as client:
        assert client.info["capabilities"] == []  # nothing can be sent to landerd
        assert client.schemas["/camera/image"] == "foxglove.CompressedImage"
        client.subscribe()
        flight.engaged()
        until = time.monotonic() + 20.0
        wanted = {"/in/Attitude", "/out/Setpoint", "/camera/image", "/tf", "/scene", "/core/state"}
        while not wanted <= found.keys() and time.monotonic() < until:
            flight.run(0.1)
            time.sleep(0.1)
            topic, ns, data = client.message()
            found.setdefault(topic, []).append((ns, data))
        assert wanted <= found.keys()
    recorded = {data for ns, data in found["/in/Attitude"]}
    assert recorded <= set(_logged(tmp_path / "a.mcap", "/in/Attitude"))
    ns, data = found["/camera/image"][0]
    sent = np.frombuffer(base64.b64decode(json.loads(data)["data"]), np.uint8)
    image = cv2.imdecode(sent, cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape == (48, 64)
    assert abs(ns * 1e-9 - time.time()) < 600.0  # Unix time


def _logged(log: Path, topic: str) -> Iterator[bytes]:
    from mcap.reader import make_reader

    with log.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages([topic]):
            yield message.data


@needs_sdk
def test_without_a_viewer_no_messages_are_queued(tmp_path: Path) -> None:
    with served(tmp_path / "a.mcap") as (flight, port):
        server = flight.observers[1]
        assert isinstance(server, FoxgloveServer)
        connected(port).__exit__(None, None, None)
        flight.engaged().run(3.0)
        assert not server._queue
    assert read_log(tmp_path / "a.mcap").config is not None


@needs_sdk
def test_a_port_that_is_taken_is_told_in_one_line_and_tried_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("landerd.web.door.AGAIN_S", 0.02)
    port = free_port()
    section = WebSection(foxglove=f"127.0.0.1:{port}")
    with Door("127.0.0.1", port, None).bound() as taken:
        taken.listen()
        (found,) = foxglove_findings(section)
        assert (found.level, found.mend) == ("warn", "otherwise set another port in web.foxglove")
        server = FoxgloveServer.of(Config(web=section), CAMERA, PAD)
        assert server is not None
        flight = ObservedFlight()
        flight.observers = (server,)
        caplog.set_level(logging.INFO, logger="landerd")
        flight.run(0.1)
        until = time.monotonic() + 20.0
        while not caplog.records and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(0.2)
        flight.run(1.0)  # and the flight goes on
    with connected(port):
        pass
    server.close()
    assert [r.getMessage() for r in caplog.records] == [
        f"nothing for Foxglove at 127.0.0.1:{port} yet: Address already in use",
        f"for Foxglove: ws://127.0.0.1:{port}",
    ]


def test_there_is_no_server_for_foxglove_by_default() -> None:
    assert foxglove_door(WebSection()) is None
    assert foxglove_findings(WebSection()) == []
    assert FoxgloveServer.of(Config(), CAMERA, PAD) is None


@pytest.mark.parametrize("address", ["0.0.0.0:8765", "192.168.4.1:8765", "[::]:8765"])
def test_only_on_this_computer_as_there_is_no_token(address: str) -> None:
    section = WebSection(foxglove=address)
    with pytest.raises(DoorError, match=r"reached from other computers.* expected an address"):
        foxglove_door(section)
    (found,) = foxglove_findings(section)
    assert found.level == "warn"


def test_a_missing_foxglove_sdk_is_named(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    config = Config(web=WebSection(foxglove="127.0.0.1:8765"))
    assert FoxgloveServer.of(config, CAMERA, PAD) is None
    (said,) = caplog.records
    assert "foxglove-sdk is not installed" in said.getMessage()
    assert "\n" not in said.getMessage()
    (found,) = foxglove_findings(config.web)
    assert "pip install foxglove-sdk" in found.what
