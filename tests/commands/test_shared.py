from pathlib import Path

import pytest

from landerd.commands.shared import InputError, check_folder, check_output, refusing


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
