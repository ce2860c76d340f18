"""Runs a campaign's tasks on the workers of a Dask cluster, instead of on the pool of processes.

Dask distributes the tasks and repeats them elsewhere when a worker dies. Needs `dask.distributed`
(`pip install distributed`), here and on every worker the same landerd.
"""

import hashlib
import threading
from collections.abc import Generator, Iterable
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from landerd.campaigns.pool import Run, RunOne, Task, error_line
from landerd.config.files import config_dir

IN_FLIGHT = 1000  # tasks that the scheduler knows of at a time: enough for some hundred cores
CONNECT_S = 10.0
PROGRAM = ("landerd", "hw")

_one_at_a_time = threading.Lock()  # a flight has the process for itself, as in the pool


class ClusterError(Exception):
    """The cluster cannot be used; the text is one line for the user."""


class OtherProgram(Exception):
    """A worker has another version of landerd, whose flights would differ."""


@cache
def program() -> str:
    """Return a hash of this landerd's code and configuration files."""
    package = Path(__file__).parents[1]
    files = [f for name in PROGRAM for f in (package.parent / name).rglob("*.py")]
    digest = hashlib.sha256()
    for root, paths in ((package.parent, files), (config_dir(), config_dir().rglob("*.yaml"))):
        for path in sorted(paths):
            digest.update(f"{path.relative_to(root)} ".encode() + path.read_bytes())
    return digest.hexdigest()


def run_on_cluster(address: str, run_one: RunOne, tasks: Iterable[Task]) -> Generator[Run]:
    """Run every task (scenario, seed) on a cluster and yield the runs as they end.

    A task whose workers died three times (Dask's `allowed-failures`) is a failed run.

    Args:
        address: of the scheduler, as "tcp://10.0.0.1:8786".
        run_one: can be pickled; files that it reads are read on the workers.
        tasks: in the order in which they are begun.

    Raises:
        ClusterError: dask is not installed, nobody answers there, or a worker has another landerd.
    """
    try:
        from distributed import Client, as_completed
        from distributed.comm import get_address_host_port, normalize_address
    except ImportError:
        raise ClusterError("--scheduler needs dask: pip install distributed") from None
    try:
        # An address that a client cannot parse would make it hang when it is closed.
        get_address_host_port(normalize_address(address), strict=True)
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as e:
        raise ClusterError(f"--scheduler {address}: no Dask scheduler answers ({e})") from None
    with client:
        # As the result of a task: Dask sends it to each worker once, and recomputes it if lost.
        shared = client.submit(_same, run_one, pure=False)
        waiting, running = iter(tasks), {}

        def begin(count: int) -> list[Any]:
            begun = {
                client.submit(_run, shared, program(), *task, pure=False, priority=-task[1]): task
                for task in islice(waiting, count)
            }
            running.update(begun)
            return list(begun)

        ended = as_completed(begin(IN_FLIGHT), loop=client.loop)
        for future in ended:
            yield _run_of(future, running.pop(future), address)
            for following in begin(1):
                ended.add(following)


def _run_of(future: Any, task: Task, address: str) -> Run:
    """Return the run of a finished task. Raises ClusterError."""
    error = future.exception()
    if isinstance(error, OtherProgram):
        raise ClusterError(f"--scheduler {address}: {error}")
    if error is not None:  # its workers died, or cannot import what they were sent
        return Run(*task, None, error_line(error))
    return Run(*task, *future.result())


def _same(run_one: RunOne) -> RunOne:
    return run_one


def _run(
    run_one: RunOne, expected: str, scenario: str, seed: int
) -> tuple[dict[str, Any] | None, str | None]:
    """Run a task on a worker; return its result, or the error in one line. Raises OtherProgram."""
    if program() != expected:
        from distributed import get_worker

        raise OtherProgram(f"worker {get_worker().address} has another landerd")
    with _one_at_a_time:
        try:
            return run_one(scenario, seed), None
        except Exception as e:
            return None, error_line(e)
