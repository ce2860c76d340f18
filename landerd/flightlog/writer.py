"""Writes one flight's MCAP file, message by message (mcap.dev/spec)."""

import json
import platform
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer
from pydantic import BaseModel

from landerd import __version__
from landerd.flightlog import codec, contents
from landerd.flightlog.contents import Head
from landerd.flightlog.disk import SyncedFile
from landerd.flightlog.topics import TopicWriter


class LogWriter(TopicWriter):
    """One MCAP file; bytes reach the disk by `flush` followed by the file's own `sync`."""

    def __init__(self, file: SyncedFile, head: Head) -> None:
        """Write the head: configuration, pad, calibration, versions."""
        self._mcap = Writer(file, chunk_size=1 << 30, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._channels: dict[str, int] = {}
        self._mcap.start(profile="", library=f"landerd {__version__}")
        self._mcap.add_metadata(contents.VERSIONS, versions() | _more(head))
        for name, data in (
            (contents.CONFIG_JSON, config_json(head.config)),
            (contents.PAD_JSON, head.layout.model_dump_json().encode()),
            (contents.CAMERA_JSON, codec.encode(head.camera)),
        ):
            self._mcap.add_attachment(0, 0, name, "application/json", data)
        super().__init__(head)

    def flush(self) -> None:
        """Complete the chunk begun, so that it can be read even if nothing follows."""
        self._mcap.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the index."""
        self._mcap.finish()  # type: ignore[no-untyped-call]

    def _open(self, topic: str, schema_name: str, schema: bytes) -> None:
        schema_id = self._mcap.register_schema(schema_name, "jsonschema", schema)
        self._channels[topic] = self._mcap.register_channel(topic, "json", schema_id)

    def _put(self, topic: str, ns: int, data: bytes, measured_ns: int, number: int) -> None:
        channel = self._channels[topic]
        self._mcap.add_message(channel, ns, data, measured_ns, number & 0xFFFFFFFF)


def versions() -> dict[str, str]:
    """Return the versions of software on which the results of a replay depend."""
    return {
        "landerd": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "system": sys.platform,
        "libc": " ".join(platform.libc_ver()),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
    }


def config_json(config: BaseModel) -> bytes:
    """Return the configuration as JSON, with files by name only, as their contents are attached."""
    return json.dumps(_named(config.model_dump()), indent=1, allow_nan=False).encode()


def _named(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _named(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_named(inner) for inner in value]
    return value.name if isinstance(value, Path) else value


def _more(head: Head) -> dict[str, str]:
    """Return the metadata besides versions of software; only a dry run says what it is."""
    clock = {contents.WALL_OFFSET: repr(head.wall_offset_s)}
    return clock | {contents.DRY: "yes"} if head.is_dry else clock
