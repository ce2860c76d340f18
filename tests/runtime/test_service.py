"""What the service tells systemd, and its log lines in the journal."""

import asyncio
import logging
import socket
from itertools import pairwise
from pathlib import Path

import pytest

from landerd.messages import Phase, PhaseChange, Tick
from landerd.runtime.service import JournalFormatter, ServiceNotifier
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


def test_systemd_is_told_ready_once_and_alive_for_as_long_as_the_control_task_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also after a gap, and no more often than needed: each takes a system call in flight."""
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    told: list[tuple[float, bytes]] = []
    notifier = ServiceNotifier()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        for t in [*(0.025 * k for k in range(200)), *(8.0 + 0.025 * k for k in range(200))]:
            notifier.on_step(t, Tick(t), [])
            while True:
                try:
                    told.append((t, systemd.recv(4096)))
                except BlockingIOError:
                    break
        notifier.on_step(13.0, Tick(13.0), [PhaseChange(Phase.DESCENT, "0.1 m away")])
        assert systemd.recv(4096) == b"STATUS=DESCENT: 0.1 m away"
    assert [text for _, text in told].count(b"READY=1") == 1
    alive = [t for t, text in told if text == b"WATCHDOG=1"]
    gaps = [after - before for before, after in pairwise(alive)]
    assert 8.0 in alive  # at the first tick after the gap
    assert sorted(gaps)[-2] < 1.0  # but for the gap itself; WatchdogSec is 2 s
    assert len(alive) < 25
