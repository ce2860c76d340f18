"""Worker threads beside the event loop, which are abandoned when a job hangs."""

import asyncio
import contextlib
import logging
import os
import sys
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")

_threads: set[threading.Thread] = set()

# Threads of one worker that hang, before it does no more: each takes its turn at the interpreter.
# With 3 that spin the control loop came to 24 set-points a second, 0.15 s late at worst.
MOST_HUNG = 2


class JobHangs(Exception):
    """A job did not end in its time; its thread was given up."""


class Worker:
    """Does one job after the other in a thread that the process's end does not wait for."""

    def __init__(self, name: str) -> None:
        """Make it; the thread begins with the first job. Name: of the thread."""
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None] | None] | None = None
        self._thread: threading.Thread | None = None
        self._hung: list[threading.Thread] = []

    @property
    def is_stuck(self) -> bool:
        """Whether so many jobs still hang that another one must not begin."""
        self._hung = [thread for thread in self._hung if thread.is_alive()]
        return len(self._hung) >= MOST_HUNG

    async def run(self, call: Callable[[], T], deadline_s: float) -> T:
        """Return what the call returns, or raise what it raises.

        Raises:
            JobHangs: it takes longer than the deadline; the next job gets a new thread. Or too
                many hang already, and it was not begun.
        """
        if self.is_stuck:
            raise JobHangs
        if self._jobs is None:
            self._jobs = SimpleQueue()
            self._thread = _start(self._jobs, self._name)
        loop = asyncio.get_running_loop()
        future: asyncio.Future[T] = loop.create_future()
        self._jobs.put(_Job(call, loop, future).do)
        done, _ = await asyncio.wait({future}, timeout=deadline_s)
        if not done:
            future.cancel()
            if self._thread is not None:
                self._hung.append(self._thread)
            self.close()
            raise JobHangs
        return future.result()

    def close(self) -> None:
        """Let the thread end after its job, without waiting for it."""
        jobs, self._jobs = self._jobs, None
        if jobs is not None:
            jobs.put(None)


def in_thread(call: Callable[[], T], name: str) -> "asyncio.Future[T]":
    """Begin a call in a thread of its own; return the future that gets what comes of it.

    asyncio's own threads are waited for at the end of `asyncio.run`, however long they hang; for
    this one the process's end does not wait. Name: of the thread.
    """
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()
    jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
    jobs.put(_Job(call, loop, future).do)
    jobs.put(None)
    _start(jobs, name)
    return future


class _Job(Generic[T]):
    def __init__(
        self, call: Callable[[], T], loop: asyncio.AbstractEventLoop, future: asyncio.Future[T]
    ) -> None:
        self._call, self._loop, self._future = call, loop, future

    def do(self) -> None:
        """Do it, and hand the result over to the loop."""
        try:
            result = self._call()
        except Exception as e:
            self._hand_over(self._fail, e)
        else:
            self._hand_over(self._succeed, result)

    def _hand_over(self, settle: Callable[..., None], what: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
            self._loop.call_soon_threadsafe(settle, what)

    def _succeed(self, result: T) -> None:
        if not self._future.done():
            self._future.set_result(result)

    def _fail(self, e: Exception) -> None:
        if not self._future.done():
            self._future.set_exception(e)


def _start(jobs: "SimpleQueue[Callable[[], None] | None]", name: str) -> threading.Thread:
    thread = threading.Thread(target=_work, args=(jobs,), name=name, daemon=True)
    _threads.add(thread)
    thread.start()
    return thread


def _work(jobs: "SimpleQueue[Callable[[], None] | None]") -> None:
    while (do := jobs.get()) is not None:
        do()
    _threads.discard(threading.current_thread())


def exit_without_waiting(code: int) -> None:
    """End the process now if a job still hangs; else do nothing, and it may end as usual.

    Python stops a thread that comes back from OpenCV while the interpreter is torn down by an
    exception that C++ answers with abort(): systemd would take that for a crash.
    """
    if _threads:
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
