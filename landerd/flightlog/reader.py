"""Reads flight logs, even those that end in the middle of a record.

The file is read from front to back; neither its index nor its end is needed. A part that is
damaged is left out and noted; reading ends when the beginning of the next part is unknown.
"""

import json
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from pydantic import ValidationError
from zstandard import ZstdError

from landerd.camera_model import CameraModel
from landerd.flightlog import codec, contents, foxglove
from landerd.flightlog.contents import Dropped, Searched, State
from landerd.flightlog.disk import part, part_number
from landerd.messages import Command, Frame, Input
from landerd.pad import PadLayout

_MAGIC = b"\x89MCAP0\r\n"
_MOST_BYTES = 1 << 28  # most bytes of one record: a larger length means damage
# Exceptions that the library raises on damaged bytes, besides its own.
_DAMAGE = (
    McapError,
    ZstdError,
    struct.error,
    ValueError,
    OverflowError,
    EOFError,
    MemoryError,
    RuntimeError,
)


class LogError(Exception):
    """A log cannot be used; the text names the file, the place and what is missing."""


@dataclass
class Step:
    """One step of the core as logged."""

    number: int
    now: float  # time of the step on the event loop's clock, s
    message: Input
    commands: list[Command] = field(default_factory=list)
    json: list[tuple[str, bytes]] = field(default_factory=list)  # the commands' type and bytes


@dataclass
class FlightLog:
    """The readable part of one flight's log."""

    path: Path
    config: dict[str, Any]  # plain; landerd.config.files.from_record makes a Config of it
    layout: PadLayout
    camera: CameraModel
    versions: dict[str, str]
    wall_offset_s: float
    is_dry: bool  # its orders were not flown
    steps: list[Step] = field(default_factory=list)
    replayable: int = 0  # number of steps from the first on without a gap
    searched: list[Searched] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    dropped: Dropped | None = None
    images: int = 0
    notes: list[str] = field(default_factory=list)  # damage of the file, one line each


def read_log(path: Path) -> FlightLog:
    """Read a flight log as far as it goes.

    Raises:
        LogError: the file is missing, is not a log, or lacks what a replay needs.
    """
    notes: list[str] = []
    head: dict[str, bytes] = {}
    versions: dict[str, str] = {}
    log: FlightLog | None = None
    for topic, record in records(path, notes):
        if isinstance(record, Metadata) and record.name == contents.VERSIONS:
            versions = dict(record.metadata)
        elif isinstance(record, Attachment):
            head[record.name] = record.data
        elif isinstance(record, Message):
            if log is None:
                log = _with_head(path, head, versions)
            try:
                _take(log, topic, record)
            except codec.CodecError as e:
                notes.append(f"{path}: {topic}, message {record.sequence}: {e}")
    if log is None:
        log = _with_head(path, head, versions)
    log.notes = notes
    if not log.steps:
        raise LogError("; ".join([f"{path}: no message of the core in it", *notes]))
    if log.replayable < len(log.steps):
        t = log.steps[log.replayable].now
        notes.append(f"{path}: steps of the core are missing before {t:.2f} s; it replays to there")
    return log


def read_images(path: Path) -> Iterator[tuple[Frame, str]]:
    """Yield the recorded frames and their format, in order; times to the nanosecond only."""
    for topic, record in records(path, []):
        if topic != contents.IMAGE or not isinstance(record, Message):
            continue
        message = json.loads(record.data)
        stamp = message["timestamp"]
        data = np.frombuffer(foxglove.image_bytes(message), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        if image is not None:
            t = stamp["sec"] + 1e-9 * stamp["nsec"]
            yield Frame(t, record.sequence, np.asarray(image, dtype=np.uint8)), message["format"]


def records(path: Path, notes: list[str]) -> Iterator[tuple[str, McapRecord]]:
    """Yield the records of a file, and of those in which its flight goes on.

    Args:
        path: of a flight's first file, or a later one.
        notes: damage is added to it.

    Yields:
        A record and its topic, "" without one.

    Raises:
        LogError: a file cannot be read, or is no MCAP file.
    """
    yield from _records_of(path, notes)
    number = part_number(path)
    while (more := part(path, number := number + 1)).exists():
        yield from _records_of(more, notes)


def _records_of(path: Path, notes: list[str]) -> Iterator[tuple[str, McapRecord]]:
    stream, size = _opened(path)
    with stream:
        topics: dict[int, str] = {}
        for part in _parts(path, stream, size, notes):
            if isinstance(part, Channel):
                topics[part.id] = part.topic
            elif isinstance(part, Message):
                if part.channel_id in topics:
                    yield topics[part.channel_id], part
            elif not isinstance(part, Schema):
                yield "", part


def _opened(path: Path) -> tuple[BinaryIO, int]:
    """Return an MCAP file behind its magic bytes, and its size. Raises LogError."""
    try:
        stream = path.open("rb")
    except OSError as e:
        raise LogError(f"{path}: cannot be read: {e.strerror}") from None
    try:
        size = path.stat().st_size
        magic = stream.read(len(_MAGIC))
    except OSError as e:
        stream.close()
        raise LogError(f"{path}: cannot be read: {e.strerror}") from None
    if magic != _MAGIC:
        stream.close()
        what = "empty" if not magic else "not an MCAP file"
        raise LogError(f"{path}: {what}, expected a flight log")
    return stream, size


def _parts(path: Path, stream: BinaryIO, size: int, notes: list[str]) -> Iterator[McapRecord]:
    """Yield the records, those of chunks one by one; damage is left out and added to notes."""
    reader = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=_MOST_BYTES)
    at = stream.tell()
    chunks = reader.records
    while True:
        try:
            record = next(chunks)
            # The library takes fewer bytes than asked for at the end of a file.
            inner = _inner(record)
        except StopIteration:
            return
        except _DAMAGE as e:
            if _is_lost(e, stream.tell(), size):
                stream.seek(-len(_MAGIC), os.SEEK_END)
                is_finished = stream.read() == _MAGIC
                what = "damaged" if is_finished else "recording was cut off"
                left = f"the last {size - at} of {size} bytes are left out"
                notes.append(f"{path}: {what}; {left}")
                return
            notes.append(f"{path}: damaged, bytes {at} to {stream.tell()} are left out")
            at = stream.tell()
            chunks = reader.records
            continue
        at = stream.tell()
        yield from inner


def _inner(record: McapRecord) -> list[McapRecord]:
    return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]


def _is_lost(error: Exception, at: int, size: int) -> bool:
    """Tell whether the beginning of the next part is unknown after an error."""
    return isinstance(error, McapError) or at >= size


def _with_head(path: Path, head: dict[str, bytes], versions: dict[str, str]) -> FlightLog:
    for name in (contents.CONFIG_JSON, contents.PAD_JSON, contents.CAMERA_JSON):
        if name not in head:
            raise LogError(f"{path}: the attachment {name} is missing, expected a log of landerd's")
    try:
        config = json.loads(head[contents.CONFIG_JSON])
        layout = PadLayout.model_validate_json(head[contents.PAD_JSON])
        camera = codec.decode(CameraModel, head[contents.CAMERA_JSON])
        offset = float(versions.get(contents.WALL_OFFSET, "0.0"))
    except (ValueError, ValidationError) as e:
        reason = str(e).splitlines()[0]
        raise LogError(f"{path}: configuration, pad or camera is damaged: {reason}") from None
    is_dry = contents.DRY in versions
    return FlightLog(path, config, layout, camera, versions, offset, is_dry)


def _take(log: FlightLog, topic: str, record: Message) -> None:
    kind = topic.rpartition("/")[2]
    steps = log.steps
    if topic.startswith(contents.IN):
        if kind not in contents.INPUTS:
            raise codec.CodecError(f"a {kind} is not known to this version")
        now = 1e-9 * record.log_time - log.wall_offset_s
        steps.append(Step(record.sequence, now, codec.decode(contents.INPUTS[kind], record.data)))
        if record.sequence == log.replayable == len(steps) - 1:
            log.replayable += 1
    elif topic.startswith(contents.OUT):
        if kind not in contents.COMMANDS:
            raise codec.CodecError(f"a {kind} is not known to this version")
        if steps and steps[-1].number == record.sequence:
            steps[-1].commands.append(codec.decode(contents.COMMANDS[kind], record.data))
            steps[-1].json.append((kind, record.data))
    elif topic == contents.SEARCHED:
        log.searched.append(codec.decode(Searched, record.data))
    elif topic == contents.STATE:
        log.states.append(codec.decode(State, record.data))
    elif topic == contents.DROPPED:
        log.dropped = codec.decode(Dropped, record.data)
    elif topic == contents.IMAGE:
        log.images += 1
