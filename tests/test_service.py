"""What the journal is told."""

import logging

import pytest

from landerd.service import JournalFormatter


@pytest.mark.parametrize(
    ("level", "priority"),
    [(logging.INFO, 6), (logging.WARNING, 4), (logging.ERROR, 3), (logging.CRITICAL, 2)],
)
def test_every_line_carries_its_priority(level: int, priority: int) -> None:
    record = logging.LogRecord("landerd", level, "", 0, "camera lost\n%s", ("unplugged",), None)
    assert JournalFormatter().format(record) == f"<{priority}>camera lost\n<{priority}>unplugged"
