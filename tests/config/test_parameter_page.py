from pathlib import Path

from landerd.config.parameter_page import markdown

ROOT = Path(__file__).parents[2]


def test_the_table_in_docs_is_current() -> None:
    text = (ROOT / "docs" / "parameters.md").read_text("utf-8")
    assert text == markdown(), "run: python -m landerd.config.parameter_page > docs/parameters.md"
