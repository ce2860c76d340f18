"""The flight log's topics live, for Foxglove and Lichtblick, through Foxglove's SDK (an extra).

The control task only appends to a queue, of which the oldest is dropped, and only while somebody
looks. A thread makes JSON of the topics that are subscribed to; the SDK's own threads send it.
"""

import importlib.util
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from landerd.camera_model import CameraModel
from landerd.config.models import Config, WebSection, split_address
from landerd.flightlog.contents import Head, Searched, state_of
from landerd.flightlog.topics import TopicWriter
from landerd.lander import Lander
from landerd.messages import Command, Frame, Input, Prior, Sightings, Tick
from landerd.pad import PadLayout
from landerd.runtime.daemon import Daemon
from landerd.runtime.observer import Observer
from landerd.web.door import Door, DoorError, is_loopback, when_free, why

if TYPE_CHECKING:
    import foxglove

log = logging.getLogger("landerd")

PICTURE_S = 0.2  # as often as the status page has one
STATE_S = 0.1
POLL_S = 0.05
LOOK_S = 0.5  # how often it is asked whether somebody looks
FIXED_S = 1.0  # calibration, pad and vehicle again, for who came since
MOST_WAITING = 500  # about a second's
_END_S = 2.0


def foxglove_door(section: WebSection) -> Door | None:
    """Return where Foxglove is served; None: nowhere.

    Raises:
        DoorError: other computers would reach it, or the SDK is not installed.
    """
    if section.foxglove is None:
        return None
    host, port = split_address(section.foxglove)
    if not is_loopback(host):
        raise DoorError(
            f"web.foxglove: {section.foxglove} is reached from other computers, and Foxglove asks "
            "for no token: expected an address of this computer only, as 127.0.0.1:8765"
        )
    if importlib.util.find_spec("foxglove") is None:
        raise DoorError(
            "web.foxglove: foxglove-sdk is not installed; in the service's environment: "
            "sudo /opt/landerd/venv/bin/pip install foxglove-sdk"
        )
    return Door(host, port, None)


class FoxgloveServer(Observer):
    """Made before the daemon, shown it, and closed after it; never ends or delays the flight."""

    def __init__(self, door: Door, config: Config, camera: CameraModel, layout: PadLayout) -> None:
        """Prepare; it is served from the first step on."""
        self._door = door
        self._fixed = (config, layout, camera)
        self._lander: Lander | None = None
        self._now = self._pictured_t = self._state_t = 0.0
        self._is_watched = False
        self._queue: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque(maxlen=MOST_WAITING)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    @classmethod
    def of(cls, config: Config, camera: CameraModel, layout: PadLayout) -> "FoxgloveServer | None":
        """Return what a configuration asks for; None: nothing, or it may not be served."""
        try:
            door = foxglove_door(config.web)
        except DoorError as e:
            log.error("nothing for Foxglove: %s", e)
            return None
        return None if door is None else cls(door, config, camera, layout)

    def watch(self, daemon: Daemon) -> None:
        """Serve this daemon's flights; before it runs."""
        daemon.observe(self)

    def close(self) -> None:
        """Serve no more."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join(_END_S)

    # ---- seen by the control task: must not wait -----------------------------------------------

    def on_flight(self, lander: Lander) -> None:
        """A flight begins."""
        self._lander = lander

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Keep what was searched, and now and again the picture."""
        if not self._is_watched:
            return
        searched = Searched(frame.t, frame.seq, prior)
        self._queue.append((TopicWriter.searched, (self._now, searched)))
        if self._now - self._pictured_t >= PICTURE_S:
            self._pictured_t = self._now
            self._queue.append((TopicWriter.image, (self._now, frame, "jpeg")))

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Keep what the core took and gave."""
        self._now = now
        if self._thread is None:
            head = Head(*self._fixed, wall_offset_s=time.time() - now)
            self._thread = threading.Thread(
                target=self._serve, args=(head,), name="foxglove", daemon=True
            )
            self._thread.start()
        if not self._is_watched:
            return
        self._queue.append((TopicWriter.step, (0, now, message, commands)))
        self._queue.append((TopicWriter.events, (now, commands)))
        self._queue.append((TopicWriter.scene, (now, message)))
        is_due = isinstance(message, Tick) and now - self._state_t >= STATE_S
        if is_due and self._lander is not None:
            self._state_t = now
            self._queue.append((TopicWriter.state, (state_of(self._lander, now),)))

    # ---- the thread ----------------------------------------------------------------------------

    def _serve(self, head: Head) -> None:
        what = f"nothing for Foxglove at {self._door.address}"
        try:
            served = when_free(partial(_served, self._door, head), self._ended, (OSError,), what)
        except Exception as e:  # whatever the SDK says: it is an extra, and the flight goes on
            log.error("%s: %s", what, why(e))
            return
        if served is None:
            return
        topics, server = served
        log.info("for Foxglove: ws://%s", self._door.address)
        try:
            while not self._ended.wait(POLL_S if self._is_watched else LOOK_S):
                self._work(topics)
        except Exception:
            log.exception("nothing more for Foxglove")
        finally:
            self._is_watched = False
            server.stop()

    def _work(self, topics: "_Topics") -> None:
        self._is_watched = topics.are_watched()
        if not self._is_watched:
            self._queue.clear()
            return
        for _ in range(len(self._queue)):
            write, arguments = self._queue.popleft()
            write(topics, *arguments)
        topics.fixed(self._now)


class _Topics(TopicWriter):
    """The log's topics, as channels of Foxglove's SDK."""

    def __init__(self, head: Head, context: "foxglove.Context") -> None:
        self._context = context
        self._channels: dict[str, foxglove.Channel] = {}
        self._fixed_t = -math.inf
        super().__init__(head)

    def are_watched(self) -> bool:
        """Tell whether any is subscribed to."""
        return any(channel.has_sinks() for channel in self._channels.values())

    def wants(self, topic: str) -> bool:
        """Tell whether it is subscribed to."""
        return bool(self._channels[topic].has_sinks())

    def fixed(self, now: float) -> None:
        """Write what does not change, now and again."""
        if now - self._fixed_t >= FIXED_S:
            self._fixed_t = now
            self.calibration(now)

    def _open(self, topic: str, schema_name: str, schema: bytes) -> None:
        import foxglove

        described = foxglove.Schema(name=schema_name, encoding="jsonschema", data=schema)
        self._channels[topic] = foxglove.Channel(
            topic, schema=described, message_encoding="json", context=self._context
        )

    def _put(self, topic: str, ns: int, data: bytes, measured_ns: int, number: int) -> None:
        self._channels[topic].log(data, log_time=ns)


_Served = tuple[_Topics, "foxglove.websocket.WebSocketServer"]


def _served(door: Door, head: Head) -> _Served:
    """Return the topics, and the server that sends them: nothing can be sent to it."""
    import foxglove

    door.bound().close()  # who has the port is told in plainer words than the SDK's
    logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # clients break off: nobody's fault
    context = foxglove.Context()
    topics = _Topics(head, context)
    server = foxglove.start_server(
        name="landerd", host=door.host, port=door.port, capabilities=[], context=context
    )
    return topics, server
