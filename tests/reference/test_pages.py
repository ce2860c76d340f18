from pathlib import Path

import pytest

from landerd.reference.pages import pages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", pages())
def test_generated_pages_and_files_are_current(name: str) -> None:
    assert (ROOT / name).read_text("utf-8") == pages()[name], "run: make reference"
