import asyncio
import threading
import time
from pathlib import Path

import pytest

from landerd.commands.shared import InputError, ask, check_folder, check_output, refusing


def test_only_the_errors_that_were_named_become_wrong_input() -> None:
    with pytest.raises(InputError, match="no such key"), refusing(KeyError, ValueError):
        raise ValueError("no such key")
    with pytest.raises(OSError, match="disk full"), refusing(KeyError, ValueError):
        raise OSError("disk full")


def test_wrong_input_passes_unchanged() -> None:
    with pytest.raises(InputError) as told, refusing(KeyError, ValueError):
        raise InputError("read already", is_told=True)
    assert told.value.is_told


def test_files_that_cannot_be_written_are_refused_with_the_flag(tmp_path: Path) -> None:
    check_output(None, ".png", "--picture")
    check_output(tmp_path / "a.png", ".png", "--picture")
    for path in (tmp_path / "a.jpg", tmp_path / "none" / "a.png"):
        with pytest.raises(InputError) as refused:
            check_output(path, ".png", "--picture")
        text = f"--picture {path}: expected a .png in a folder that exists"
        assert str(refused.value) == text
        with pytest.raises(InputError) as refused:
            check_output(path, ".png")
        assert str(refused.value) == text.removeprefix("--picture ")
    check_folder(tmp_path / "a.yaml")
    with pytest.raises(InputError, match=r"^-o .*none/a.yaml: its folder does not exist$"):
        check_folder(tmp_path / "none" / "a.yaml")


def test_a_cancelled_question_does_not_wait_for_its_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Once, a command ended after Ctrl-C only when Enter was pressed, too."""
    pressed = threading.Event()
    monkeypatch.setattr("builtins.input", lambda _: str(pressed.wait(5.0)))
    began = time.monotonic()
    with pytest.raises(TimeoutError):
        asyncio.run(asyncio.wait_for(ask("Lay the pad down."), 0.1))
    took_s = time.monotonic() - began
    pressed.set()
    assert took_s < 2.0


def test_a_question_without_standard_input_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(_: str) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", ended)
    with pytest.raises(InputError, match="nobody can press Enter"):
        asyncio.run(ask("Lay the pad down."))
