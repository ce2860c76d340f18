from pathlib import Path

import pytest
from pydantic import ValidationError

from landerd.config.models import WebSection
from landerd.preflight.status_page import page_findings
from landerd.web.door import Door, DoorError, door_of
from tests.web.pages import TOKEN, free_port


def token_file(folder: Path, text: str) -> Path:
    path = folder / "token"
    path.write_text(text)
    return path


def test_there_is_no_status_page_by_default() -> None:
    assert door_of(WebSection()) is None
    assert page_findings(WebSection()) == []


@pytest.mark.parametrize("listen", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
def test_this_computer_needs_no_token(listen: str) -> None:
    door = door_of(WebSection(listen=listen))
    assert door is not None
    assert door.url == f"http://{listen}/"


@pytest.mark.parametrize(
    "listen", ["0.0.0.0:8080", "192.168.4.1:8080", "drone.local:80", "[::]:80"]
)
def test_others_need_a_token(listen: str, tmp_path: Path) -> None:
    with pytest.raises(DoorError, match="token_file is not set"):
        door_of(WebSection(listen=listen))
    door = door_of(WebSection(listen=listen, token_file=token_file(tmp_path, f"{TOKEN}\n")))
    assert door is not None
    assert door.opens_to(TOKEN)
    assert not door.opens_to(TOKEN[:-1])
    assert not door.opens_to("é")


@pytest.mark.parametrize("text", ["", "short", "with a space in it, and long enough", "ä" * 20])
def test_an_unusable_token_is_refused_with_its_file(text: str, tmp_path: Path) -> None:
    with pytest.raises(DoorError, match=f"{tmp_path}/token: expected one word of 16"):
        door_of(WebSection(listen="0.0.0.0:8080", token_file=token_file(tmp_path, text)))
    with pytest.raises(DoorError, match="missing: cannot be read: No such file"):
        door_of(WebSection(listen="0.0.0.0:8080", token_file=tmp_path / "missing"))


@pytest.mark.parametrize("listen", ["8080", "127.0.0.1", "127.0.0.1:0", "::1:8080", "a b:80"])
def test_addresses_without_host_or_port_are_refused(listen: str) -> None:
    with pytest.raises(ValidationError, match="expected ADDRESS:PORT, as 127"):
        WebSection(listen=listen)
    with pytest.raises(ValidationError, match="expected ADDRESS:PORT, as 127"):
        WebSection.model_validate({"foxglove": 8765})


def test_the_check_says_whether_there_will_be_a_page() -> None:
    port = free_port()
    section = WebSection(listen=f"127.0.0.1:{port}")
    (found,) = page_findings(section)
    assert (found.level, found.what) == ("ok", f"http://127.0.0.1:{port}/, on this computer")
    with Door("127.0.0.1", port, None).bound() as taken:
        taken.listen()
        (found,) = page_findings(section)
        assert found.level == "warn"
        assert found.what.startswith(f"port {port} is in use")
    (found,) = page_findings(WebSection(listen="0.0.0.0:8080"))
    assert found.level == "warn"
    assert "is reached from other computers" in found.what
