"""Runs tasks on a pool of processes that survives the death of any of them.

concurrent.futures abandons all its work when one process dies. In this pool a worker that dies is
one failed run, and another worker takes its place.
"""

import contextlib
import multiprocessing
import signal
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

RunOne = Callable[[str, int], dict[str, Any]]  # runs a task; returns what `sim --json` prints
Task = tuple[str, int]  # name of a row (its scenario, with settings of its own), and seed

_CONTEXT = multiprocessing.get_context("spawn")  # a forked process would lack OpenCV's threads


@dataclass(frozen=True)
class Run:
    """The outcome of one run: a result, or an error in one line."""

    scenario: str  # with the row's own settings, as `landerd sim` takes them
    seed: int
    result: dict[str, Any] | None
    error: str | None = None


# Runs all tasks somewhere, and yields their runs as they end.
Executor = Callable[[RunOne, Iterable[Task]], Generator[Run]]


class _Worker:
    """A process that runs one task at a time."""

    def __init__(self, run_one: RunOne) -> None:
        self.connection, far = _CONTEXT.Pipe()
        self.task: Task | None = None
        self._process = _CONTEXT.Process(target=_work, args=(run_one, far), daemon=True)
        # Ctrl-C reaches the whole process group; what it means is the parent's to decide. The
        # child keeps the mask.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        far.close()  # the child then has the only one, so that its death is noticed

    def give(self, task: Task) -> None:
        self.task = task
        self.connection.send(task)

    def finished(self) -> tuple[Run, bool]:
        """Return the run that has ended, and whether the worker still lives."""
        assert self.task is not None
        try:
            result, error = self.connection.recv()
        except (EOFError, OSError):
            self._process.join()
            died = f"the process ended with exit code {self._process.exitcode}"
            return Run(*self.task, None, died), False
        return Run(*self.task, result, error), True

    def stop(self) -> None:
        self._process.terminate()
        self._process.join()
        self.connection.close()


def run_all(run_one: RunOne, tasks: Iterable[Task], jobs: int) -> Generator[Run]:
    """Run every task (scenario, seed) and yield the runs as they end.

    Args:
        run_one: can be pickled; runs in other processes.
        tasks: in the order in which they are begun.
        jobs: processes, one task each at a time.
    """
    waiting = iter(tasks)
    workers: list[_Worker] = []
    try:
        for task in _first(waiting, jobs):
            workers.append(_Worker(run_one))
            workers[-1].give(task)
        while workers:
            ready = wait([worker.connection for worker in workers])
            for worker in [w for w in workers if w.connection in ready]:
                run, alive = worker.finished()
                following = next(waiting, None)
                if following is None or not alive:
                    workers.remove(worker)
                    worker.stop()
                if following is not None:
                    if not alive:
                        worker = _Worker(run_one)  # noqa: PLW2901
                        workers.append(worker)
                    worker.give(following)
                yield run
    finally:
        for worker in workers:
            worker.stop()


def _first(tasks: Iterator[Task], count: int) -> Iterator[Task]:
    for _, task in zip(range(count), tasks, strict=False):
        yield task


def _work(run_one: RunOne, connection: Connection) -> None:
    """Run tasks in a child process until the parent ends."""
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            task: Task = connection.recv()
            result, error = None, None
            try:
                result = run_one(*task)
            except Exception as e:
                error = error_line(e)
            connection.send((result, error))


def error_line(error: BaseException) -> str:
    """Return a line on an exception and where it was raised."""
    while isinstance(error, BaseExceptionGroup):  # task groups wrap the one that matters
        error = error.exceptions[0]
    text = f"{type(error).__name__}: {' '.join(str(error).split())}"
    for place in traceback.extract_tb(error.__traceback__)[-1:]:
        text += f" ({Path(place.filename).name}:{place.lineno})"
    return text
