"""Campaigns on a real cluster on this machine: processes of a scheduler and two workers."""

import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from landerd.campaigns import cluster
from landerd.campaigns.cluster import ClusterError, run_on_cluster
from landerd.campaigns.plan import Campaign, Row
from landerd.campaigns.pool import Run, run_all
from landerd.campaigns.table import make_row
from landerd.cli import main
from landerd.commands.flying import SimulatedLanding
from tests.campaigns.landings import fly

# Dask warns of deprecated parts of the packages that it brings along.
pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("default")]
distributed = pytest.importorskip("distributed", reason="needs dask: landerd[cluster]")


@contextmanager
def a_cluster(folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Run a scheduler and two workers; yield its address and the workers."""
    dask = [sys.executable, "-W", "ignore", "-m", "dask"]
    where = folder / "scheduler.json"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    common = ["--scheduler-file", str(where), "--no-dashboard"]
    started = [
        subprocess.Popen(
            [*dask, "scheduler", "--port", "0", "--host", "127.0.0.1", *common], **quiet
        )
    ]
    try:
        worker = [*dask, "worker", "--no-nanny", "--nthreads", "1", *common]
        local = ["--local-directory", str(folder)]
        workers = [subprocess.Popen([*worker, *local], **quiet) for _ in range(2)]
        started += workers
        until = time.monotonic() + 60.0
        while not where.exists():
            assert time.monotonic() < until, "no scheduler"
            time.sleep(0.1)
        with distributed.Client(scheduler_file=str(where)) as client:
            client.wait_for_workers(2, timeout=60)
            address = client.scheduler.address
        yield address, workers
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def running(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    with a_cluster(tmp_path_factory.mktemp("cluster")) as found:
        yield found


@pytest.fixture
def address(running: tuple[str, list[subprocess.Popen[bytes]]]) -> str:
    return running[0]


def test_every_task_is_run_once_and_one_that_raises_is_one_failed_run(address: str) -> None:
    tasks = [("raises", seed) for seed in range(1, 8)]
    runs = sorted(run_on_cluster(address, fly, tasks), key=lambda run: run.seed)
    here = sorted(run_all(fly, tasks, jobs=1), key=lambda run: run.seed)
    assert runs == here
    assert [run.seed for run in runs if run.error] == [2]


def test_a_worker_with_another_landerd_flies_nothing(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "program", lambda: "of yesterday")
    with pytest.raises(ClusterError, match=r"worker tcp://.* has another landerd"):
        list(run_on_cluster(address, fly, [("radial", 1)]))


@pytest.mark.parametrize("nobody", ["tcp://127.0.0.1:9", "tcp://127.0.0.1", "nobody"])
def test_an_address_without_a_scheduler_is_refused_in_one_line(
    nobody: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    assert main(["campaign", "stationary", "--runs", "1", "--scheduler", nobody]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"--scheduler {nobody}: no Dask scheduler answers")
    assert err.count("\n") == 1


def test_rows_are_those_of_a_local_campaign_although_a_worker_was_killed(
    running: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    """The last test of the module, as it leaves one worker less."""
    row = Row(scenario="hover", settings=("sim.sight=modelled", "sim.camera.fps=15"))
    landing = SimulatedLanding(Campaign(rows=(row,), longest_s=1.5), None, ())
    tasks = [(row.name, seed) for seed in range(1, 5)]
    flown: list[Run] = []
    address, workers = running
    for run in run_on_cluster(address, landing, tasks):
        flown.append(run)
        if len(flown) == 1:
            workers[0].send_signal(signal.SIGKILL)
    there = sorted(flown, key=lambda run: run.seed)
    here = sorted(run_all(landing, tasks, jobs=1), key=lambda run: run.seed)
    assert [without_clock(run) for run in there] == [without_clock(run) for run in here]
    assert make_row(row, there) == make_row(row, here)
    assert len(there) == len(tasks)


def without_clock(run: Run) -> Run:
    """Return a run without its wall-clock times."""
    result = {k: v for k, v in (run.result or {}).items() if k != "wall_s"}
    return dataclasses.replace(run, result=result)
