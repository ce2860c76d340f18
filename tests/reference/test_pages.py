from pathlib import Path

import pytest

from landerd.reference.pages import pages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", pages())
def test_what_is_made_of_the_code_is_current(name: str) -> None:
    assert (ROOT / name).read_text("utf-8") == pages()[name], "run: make reference"
