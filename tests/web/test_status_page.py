"""The page over its own socket: what it shows, to whom, and what it never does."""

import base64
import json
import socket
import struct
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.messages import Phase
from landerd.web import StatusPage
from tests.recorded_flight import CAMERA
from tests.scripted_flight import PAD
from tests.web.pages import TOKEN, shown_page


def test_it_shows_the_flight_while_somebody_looks() -> None:
    with shown_page() as shown:
        assert shown.view() == {"waits": True}
        shown.flight.run(0.5)
        view = shown.view()
        assert (view["flies"], view["vehicle"]["armed"]) == (False, True)
        assert {c["name"] for c in view["conditions"] if not c["ok"]} == {"switch"}
        assert view["reason"] == "RC 11 is low"
        shown.flight.engaged()
        shown.view()
        shown.flight.run(1.0)
        view = shown.view()
        assert view["flies"]
        assert all(c["ok"] for c in view["conditions"])
        feet, pad = shown.flight.feet, shown.flight.pad
        assert view["pad"]["north"] == pytest.approx(pad[0] - feet[0], abs=0.1)
        assert view["pad"]["height"] == pytest.approx(shown.flight.height, abs=0.1)
        assert view["rates"]["Tick"] == pytest.approx(40.0, abs=1.0)
        assert view["latency_ms"]["median"] == pytest.approx(50.0, abs=1.0)
        assert view["computer"]["temperature_c"] == 41


def test_the_picture_comes_with_what_was_seen_in_it_and_only_once() -> None:
    with shown_page() as shown:
        shown.flight.engaged()
        shown.view()
        shown.flight.run(0.5)
        sent = shown.view()["picture"]
        data = np.frombuffer(base64.b64decode(sent["jpeg"]), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert image.shape == (sent["height"], sent["width"]) == (48, 64)
        assert abs(float(image.mean()) - 90.0) < 2.0
        assert [m["name"] for m in sent["markers"]] == ["apriltag"]
        # It looks straight at the pad.
        assert sent["point"] == pytest.approx([31.5, 23.5], abs=12.0)
        assert shown.view(seen=sent["seq"])["picture"] is None


def test_without_a_viewer_nothing_is_computed_for_the_page() -> None:
    with shown_page() as shown:
        live = shown.page._live
        assert live is not None
        shown.flight.engaged().run(3.0)
        assert live.newest is None
        shown.view()
        shown.flight.run(0.5)
        assert live.newest is not None
        shown.flight.run(3.0)  # and who looked has gone
        assert live.newest is None


def test_after_the_flight_the_page_shows_its_end() -> None:
    with shown_page() as shown:
        shown.flight.engaged().until(Phase.LANDED)
        shown.flight.until_contact().run(6.0)
        shown.page.flight_is_over()
        view = shown.view()
        assert (view["outcome"], view["over"]) == ("landed", True)
        armed = next(c for c in view["conditions"] if c["name"] == "armed")
        assert (armed["ok"], armed["is"]) == (True, "no longer")  # nothing is wrong with that
        assert "landed and disarmed" in [line["text"] for line in view["lines"]]


def test_with_a_token_configured_the_page_opens_only_with_it() -> None:
    with shown_page(host="127.0.0.2", token=TOKEN) as shown:
        for path in ("/", "/view", "/flights", "/flights/a.mcap"):
            status, _, body = shown.get(path)
            assert status == 401
            assert b"Token" in body
        assert shown.get("/view", Cookie=f"landerd={TOKEN}x")[0] == 401
        status, headers, _ = shown.get(f"/?token={TOKEN}")
        assert (status, headers["Location"]) == (303, "/")
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert shown.get("/view", Cookie=cookie)[0] == 200
        assert shown.get("/view", Authorization=f"Bearer {TOKEN}")[0] == 200


def test_without_a_token_it_answers_to_this_computers_own_name_only() -> None:
    with shown_page() as shown:
        assert shown.get("/view", Host=f"localhost:{shown.door.port}")[0] == 200
        assert shown.get("/view", Host="somebody.example")[0] == 403


def test_the_page_takes_no_input_and_serves_no_other_files(tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("no")
    with shown_page(tmp_path / "logs") as shown:
        shown.flight.armed = False
        shown.flight.run(1.5)
        for path in ("/x", "/flights/../secret.txt", "/flights/%2e%2e%2fsecret.txt"):
            assert shown.get(path)[0] == 404
        with socket.create_connection((shown.door.host, shown.door.port), 5.0) as s:
            s.sendall(b"POST /view HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n")
            assert s.recv(100).startswith(b"HTTP/1.1 501")


def test_logs_can_be_fetched_once_disarmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    niceness: list[int] = []  # of a report; given to it, other tests would hold it up
    monkeypatch.setattr("os.setpriority", lambda which, who, nice: niceness.append(nice))
    log = tmp_path / "00001-20260101-120000.mcap"
    log.write_bytes(b"12345")
    log.with_suffix(".tlog").write_bytes(b"123")
    with shown_page(tmp_path) as shown:
        shown.flight.run(1.5)
        (flight,) = json.loads(shown.get("/flights")[2])
        assert flight["name"] == log.stem
        assert shown.get(f"/flights/{log.name}")[0] == 503  # armed: the computer has to fly
        shown.flight.armed = False
        shown.flight.run(1.5)
        status, headers, body = shown.get(f"/flights/{log.name}")
        assert (status, body) == (200, b"12345")
        assert headers["Content-Disposition"] == f'attachment; filename="{log.name}"'
        assert shown.get(f"/flights/{log.stem}.tlog")[2] == b"123"
        # Its report is made by a process of its own, which says what is wrong with the log.
        status, _, body = shown.get(f"/flights/{log.stem}.html")
        assert status == 503
        assert b"expected" in body
        assert niceness == [19]


def test_many_connections_and_silent_ones_are_turned_away() -> None:
    with shown_page() as shown:
        address = (shown.door.host, shown.door.port)
        held = [socket.create_connection(address, 5.0) for _ in range(15)]
        turned_away = 0
        until = time.monotonic() + 1.5
        for s in held:
            s.settimeout(max(0.05, until - time.monotonic()))
            try:
                turned_away += s.recv(1) == b""
            except TimeoutError:
                continue
            except ConnectionResetError:
                turned_away += 1
        assert turned_away >= 3
        for s in held:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            s.close()
        time.sleep(0.3)
        assert shown.view() == {"waits": True}


def test_it_ends_at_once_although_its_address_never_came() -> None:
    with shown_page() as shown:
        page = StatusPage(shown.door, CAMERA, PAD, None, lambda: None)  # its port is taken
        page.watch(shown.daemon)
        began = time.monotonic()
        page.close()
        assert time.monotonic() - began < 1.0
