import multiprocessing
from contextlib import closing

import pytest

from landerd.campaigns.pool import Run, run_all
from tests.campaigns.landings import fly


def test_every_task_is_run_once() -> None:
    tasks = [("radial", seed) for seed in range(1, 8)]
    runs = list(run_all(fly, tasks, jobs=2))
    assert sorted((run.scenario, run.seed) for run in runs) == tasks
    assert all(run.result is not None and run.result["seed"] == run.seed for run in runs)


@pytest.mark.parametrize(
    ("scenario", "error"),
    [
        ("raises", "Misfortune: the pad is gone (landings.py:"),
        ("dies", "the process ended with exit code 9"),
    ],
)
def test_a_run_that_raises_or_dies_is_one_failed_run(scenario: str, error: str) -> None:
    runs = {run.seed: run for run in run_all(fly, [(scenario, n) for n in range(1, 5)], jobs=1)}
    assert sorted(runs) == [1, 2, 3, 4]
    assert runs[2].result is None
    assert (runs[2].error or "").startswith(error)
    assert all(runs[seed].error is None for seed in (1, 3, 4))


def test_closing_the_series_ends_its_processes() -> None:
    with closing(run_all(fly, [("radial", 1), *[("waits", n) for n in range(4)]], jobs=2)) as runs:
        assert next(runs) == Run("radial", 1, fly("radial", 1))
        assert multiprocessing.active_children()
    assert not multiprocessing.active_children()
