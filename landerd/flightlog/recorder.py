"""Records a flight while it happens, without the control task waiting for it.

The control task only appends to a queue; a thread encodes the items and writes the bytes to the
disk twice a second. If thread or disk cannot keep up, images are dropped first, then detail that
only viewers need, and the core's messages last. Drops are counted, and nothing ever waits.
"""

import contextlib
import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from landerd.config.models import Config, LogSection
from landerd.flightlog.contents import Dropped, Head, Searched, State, state_of
from landerd.flightlog.disk import (
    SyncedFile,
    free_bytes,
    later_flight,
    next_number,
    part,
    part_number,
    rotate,
)
from landerd.flightlog.writer import LogWriter
from landerd.lander import Lander
from landerd.messages import (
    Command,
    Frame,
    Heartbeat,
    Input,
    PhaseChange,
    Prior,
    Sightings,
    Tick,
)

log = logging.getLogger("landerd")

SYNC_S = 0.5  # interval of syncs; unsynced data are lost in a power cut
POLL_S = 0.05
STATE_S = 0.1
MOST_IMAGES, MOST_DETAIL, MOST_MESSAGES = 8, 2000, 20000  # most items of a kind in the queue
NO_DETAIL = 0.25  # share of keep_free_mb below which only the core's messages are recorded
MOST_WAITING = 16 << 20  # most bytes that wait for the disk
_MB = 1_000_000


class MavlinkLog(Protocol):
    """Converts the link's bytes to those of a .tlog."""

    def encode(self, epoch_us: int, data: bytes, *, outgoing: bool) -> bytes:
        """Return the log entries of the complete frames, each its time and the frame."""
        ...


@dataclass
class _Files:
    """The files of one flight."""

    mcap: SyncedFile
    writer: LogWriter
    tlog: SyncedFile | None
    mavlink: MavlinkLog | None


class Recorder:
    """An observer of the daemon that writes the flight log; it never raises in flight.

    Attributes:
        logs: the flight logs begun, except those in which the vehicle only stood disarmed.
        failures: files that are missing or incomplete, and why; complete after `close`.
    """

    def __init__(
        self,
        head: Head,
        options: LogSection,
        target: Path,
        *,
        background: bool,
        mavlink: Callable[[], MavlinkLog] | None = None,
    ) -> None:
        """Make a recorder; the files are created when a flight begins.

        Args:
            head: configuration, pad and calibration.
            options: images, limits.
            target: a folder for numbered logs, or the file, FILE.mcap, of a single flight.
            background: write in a thread; otherwise at once, for a virtual clock.
            mavlink: makes the encoder for the bytes given to `raw`; None: no .tlog.
        """
        self._head = head
        self._options = options
        self._target = target
        self._mavlink = mavlink
        self._files: _Files | None = None
        self._queue: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque()
        self._images_put = self._images_done = 0  # counted on either side of the queue
        self._frames = 0
        self._anew = False
        self._armed = True  # as far as is known
        self._idle = True  # the vehicle was disarmed in all of this file so far
        self._idle_part: Path | None = None  # an earlier file of this flight, also idle
        self._number = 0
        self._flights = 0
        self._lander: Lander | None = None
        self._now = 0.0  # loop time of the newest step, s
        self._state_t = 0.0
        self._synced_t = 0.0
        self._low = 0  # 1: no room for images; 2: none for detail either, or the disk is full
        self._dropped: Counter[str] = Counter()
        self._dropped_written = Dropped(0, 0, 0, 0)
        self.logs: list[Path] = []
        self.failures: list[str] = []
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        if background:
            self._thread = threading.Thread(target=self._work, name="log", daemon=True)
            self._thread.start()

    # ---- seen by the control task: must not wait -----------------------------------------------

    def on_flight(self, lander: Lander) -> None:
        """Begin a new file: a new flight, with a new core, has begun."""
        self._lander = lander
        self._number = self._frames = 0
        self._anew = False
        self._put(self._begin, (lander.config,))

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Record a frame that was searched."""
        if self._takes_detail():
            searched = Searched(frame.t, frame.seq, prior, self._anew)
            self._put(self._searched, (self._now, searched))
            self._anew = False
        wanted = self._options.images != "none" and self._frames % self._options.every_nth == 0
        wanted = wanted and (self._armed or self._options.disarmed_images)
        self._frames += 1
        if not wanted:
            return
        if self._low or self._images_put - self._images_done >= MOST_IMAGES:
            self._dropped["images"] += 1
        else:
            self._images_put += 1
            self._put(self._image, (self._now, frame))

    def on_vision_reset(self) -> None:
        """Record with the next frame that vision was replaced."""
        self._anew = True

    def on_last_orders(self, now: float) -> None:
        """Write nothing: the core's last step is in the log, and a replay fails like it did."""

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Record a message that the core took, and its commands."""
        self._now = now
        if isinstance(message, Heartbeat):
            self._armed = message.armed
        number = self._number
        self._number += 1  # counts dropped steps, too, so that the gap shows
        if not self._takes_messages():
            self._dropped["messages"] += 1
        else:
            self._put(self._step, (number, now, message, commands, self._takes_detail()))
        # At a change of phase, too: the log may end there, and the last state tells the outcome.
        changed = any(isinstance(command, PhaseChange) for command in commands)
        if changed or (isinstance(message, Tick) and now - self._state_t >= STATE_S):
            self._state_t = now
            self._watch(now)
        if self._thread is None and now - self._synced_t >= SYNC_S:
            self._synced_t = now
            self._sync(now)

    def raw(self, now: float, data: bytes, *, outgoing: bool) -> None:
        """Record bytes of the MAVLink link."""
        if self._mavlink is None:
            return
        if self._takes_messages():
            self._put(self._raw, (now, data, outgoing))
        else:
            self._dropped["messages"] += 1

    def _watch(self, now: float) -> None:
        lander = self._lander
        if lander is None or not self._takes_detail():
            return
        self._put(self._state, (state_of(lander, now),))

    def _takes_detail(self) -> bool:
        takes = self._low < 2 and len(self._queue) < MOST_DETAIL
        if not takes:
            self._dropped["detail"] += 1
        return takes

    def _takes_messages(self) -> bool:
        files = self._files
        waiting = files.mcap.waiting if files is not None else 0
        return len(self._queue) < MOST_MESSAGES and waiting < MOST_WAITING

    def _put(self, write: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        self._queue.append((write, arguments))
        if self._thread is None:
            self._drain()

    # ---- the thread ----------------------------------------------------------------------------

    def close(self) -> None:
        """Write the rest of the queue, and the index."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        self._drain()
        self._end()

    def _work(self) -> None:
        synced = time.monotonic()
        while not self._ended.wait(POLL_S):
            self._drain()
            if time.monotonic() - synced >= SYNC_S:
                self._sync(self._now)
                synced = time.monotonic()

    def _drain(self) -> None:
        for _ in range(len(self._queue)):
            write, arguments = self._queue.popleft()
            try:
                write(*arguments)
            except OSError as e:
                self._give_up(e)
            except Exception:  # a message that cannot be written must not end the others' log
                if not self._dropped["errors"]:
                    log.exception("a message was not recorded")
                self._dropped["errors"] += 1

    def _begin(self, config: Config) -> None:
        self._end()
        self._head = replace(self._head, config=config)
        self._idle_part = None
        self._dropped.clear()
        self._dropped_written = Dropped(0, 0, 0, 0)
        path = self._path()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._files = self._new_files(path, self._mavlink() if self._mavlink is not None else None)
        self._sync(self._now)
        log.info("recording to %s", path)

    def _new_files(self, path: Path, mavlink: MavlinkLog | None) -> _Files:
        """Begin the files of a flight, or its next ones. Raises OSError."""
        mcap = SyncedFile(path)
        try:
            tlog = SyncedFile(path.with_suffix(".tlog")) if mavlink is not None else None
        except OSError:
            mcap.close()
            path.unlink()
            raise
        self.logs.append(path)
        self._idle = True
        writer = LogWriter(mcap, self._head)
        writer.calibration(self._now)
        return _Files(mcap, writer, tlog, mavlink)

    def _go_on_in_another(self, old: _Files) -> None:
        """Continue the flight in its next files.

        Of a vehicle that stands disarmed for days only the last two are kept: the flights before
        are worth more.
        """
        path, was_idle = old.mcap.path, self._idle
        try:
            new = self._new_files(part(path, part_number(path) + 1), old.mavlink)
        except OSError as e:
            log.warning("%s: goes on growing: %s", path, e.strerror)
            return
        self._end()
        self._files, self._dropped_written = new, Dropped(0, 0, 0, 0)
        idle, self._idle_part = self._idle_part, path if was_idle else None
        if idle is not None:
            self.logs.remove(idle)
            idle.unlink(missing_ok=True)
            idle.with_suffix(".tlog").unlink(missing_ok=True)

    def _path(self) -> Path:
        self._flights += 1
        if self._target.suffix == ".mcap":
            if self._flights == 1:
                return self._target
            return later_flight(self._target, self._flights)
        self._target.mkdir(parents=True, exist_ok=True)
        stamp = time.strftime("%Y%m%d-%H%M%S")
        return self._target / f"{next_number(self._target):05d}-{stamp}.mcap"

    def _end(self) -> None:
        files, self._files = self._files, None
        if files is None:
            return
        self._write_dropped(files, self._now)
        files.writer.finish()
        for file in (files.mcap, files.tlog):
            if file is not None:
                file.close()
                if file.error is not None:
                    self.failures.append(f"{file.path}: not wholly written: {file.error}")

    def _give_up(self, e: OSError) -> None:
        """Continue without files, as those of a flight cannot be created."""
        self._files = None
        self.failures.append(f"{e.filename}: cannot be written: {e.strerror}")
        log.error("this flight is not recorded: %s: %s", e.filename, e.strerror)

    def _sync(self, now: float) -> None:
        """Write all bytes to the disk, and check how much room is left."""
        files = self._files
        if files is None:
            return
        self._write_dropped(files, now)
        files.writer.flush()
        taken = files.mcap.sync() & (files.tlog is None or files.tlog.sync())
        folder = files.mcap.path.parent
        if folder == self._target:
            with contextlib.suppress(OSError):  # a log that stays uses room, which is checked next
                self._keep_in_bounds(files)
        try:
            free = free_bytes(folder)
        except OSError:
            free = 0
        keep = self._options.keep_free_mb * _MB
        low = 0 if free >= keep else 1 if free >= NO_DETAIL * keep else 2
        low = low if taken else 2
        if low > self._low:
            lost = "images are" if low == 1 else "images and detail are"
            log.warning("%s: %s, %s not recorded", folder, files.mcap.error or "nearly full", lost)
        self._low = low

    def _keep_in_bounds(self, files: _Files) -> None:
        """Begin another file when this one is large, and delete old ones. Raises OSError."""
        if files.mcap.tell() >= self._options.most_file_mb * _MB:
            self._go_on_in_another(files)
        running = self._files.mcap.path if self._files is not None else files.mcap.path
        for path in rotate(self._target, int(self._options.most_mb * _MB), running):
            log.info("deleted the old log %s", path.name)

    def _write_dropped(self, files: _Files, now: float) -> None:
        count = self._dropped
        dropped = Dropped(count["images"], count["detail"], count["messages"], count["errors"])
        if dropped != self._dropped_written:
            self._dropped_written = dropped
            files.writer.dropped(now, dropped)

    # ---- what is in the queue; without files it goes nowhere -----------------------------------

    def _step(
        self, number: int, now: float, message: Input, commands: list[Command], detail: bool
    ) -> None:
        if self._files is None:
            return
        self._idle = self._idle and not (isinstance(message, Heartbeat) and message.armed)
        self._files.writer.step(number, now, message, commands)
        if detail:
            self._files.writer.events(now, commands)
            self._files.writer.scene(now, message)

    def _searched(self, now: float, searched: Searched) -> None:
        if self._files is not None:
            self._files.writer.searched(now, searched)

    def _image(self, now: float, frame: Frame) -> None:
        self._images_done += 1
        if self._files is not None:
            self._files.writer.image(now, frame, self._options.images)

    def _state(self, state: State) -> None:
        if self._files is not None:
            self._files.writer.state(state)

    def _raw(self, now: float, data: bytes, outgoing: bool) -> None:
        files = self._files
        if files is None or files.tlog is None or files.mavlink is None:
            return
        epoch_us = max(0, round(1e6 * (now + self._head.wall_offset_s)))
        files.tlog.write(files.mavlink.encode(epoch_us, data, outgoing=outgoing))
