"""Log lines of the service in the journal."""

import asyncio
import logging

import pytest

from landerd.runtime.service import JournalFormatter
from landerd.simulation.flight import Simulation
from tests.simulated import fly


@pytest.mark.parametrize(
    ("level", "priority"),
    [(logging.INFO, 6), (logging.WARNING, 4), (logging.ERROR, 3), (logging.CRITICAL, 2)],
)
def test_every_line_carries_its_priority(level: int, priority: int) -> None:
    record = logging.LogRecord("landerd", level, "", 0, "camera lost\n%s", ("unplugged",), None)
    assert JournalFormatter().format(record) == f"<{priority}>camera lost\n<{priority}>unplugged"


def test_a_lost_device_is_told_once_and_so_is_its_return(caplog: pytest.LogCaptureFixture) -> None:
    async def script(simulation: Simulation) -> None:
        faults = simulation.camera.faults
        await asyncio.sleep(0.5)
        faults.disconnected = True
        await asyncio.sleep(4.0)
        faults.disconnected = False

    caplog.set_level(logging.INFO, "landerd")
    simulation = fly(script, longest_s=5.5)
    told = [r.getMessage() for r in caplog.records if r.getMessage().startswith("camera ")]
    assert told == ["camera lost: simulated camera is unplugged", "camera is back"]
    assert simulation.daemon.faults["camera lost"] > 5
