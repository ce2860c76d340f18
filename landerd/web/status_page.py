"""The page as a whole: gathers beside the flight, serves in threads, never ends or delays it."""

import json
import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from landerd.camera_model import CameraModel
from landerd.config.models import Config
from landerd.flightlog.disk import free_bytes
from landerd.pad import PadLayout
from landerd.runtime.daemon import Daemon
from landerd.web.door import Door, DoorError, door_of, when_free
from landerd.web.flights import Flights
from landerd.web.live import LiveView, View
from landerd.web.server import Server
from landerd.web.shown import Fixed, picture, shown

log = logging.getLogger("landerd")

COMPUTER_S = 5.0  # how often temperature and disk are looked at
_END_S = 2.0


class StatusPage:
    """Made before the daemon, shown it, and closed after it."""

    def __init__(
        self,
        door: Door,
        camera: CameraModel,
        layout: PadLayout,
        folder: Path | None,
        temperature_c: Callable[[], float | None],
    ) -> None:
        """Prepare; nothing is served yet.

        Args:
            door: where it is served, and who may see it.
            camera: intrinsics of the pictures.
            layout: the pad.
            folder: where flights are recorded; None: nowhere.
            temperature_c: of the computer; None: it does not tell.
        """
        self._temperature_c = temperature_c
        self._door = door
        self._fixed = Fixed(camera, layout)
        self._folder = folder
        self._live: LiveView | None = None
        self._flights = Flights(folder, may_work=lambda: not self._is_busy())
        self._making = threading.Lock()  # of texts and pictures: none twice, none at the end
        self._made: tuple[View, dict[str, Any], dict[str, Any] | None] | None = None
        self._computer: dict[str, Any] = {}
        self._computer_t = 0.0
        self._is_over = False
        self._ended = threading.Event()
        self._server: Server | None = None
        self._thread = threading.Thread(target=self._serve, name="status page", daemon=True)

    @classmethod
    def of(
        cls,
        config: Config,
        camera: CameraModel,
        layout: PadLayout,
        folder: Path | None,
        temperature_c: Callable[[], float | None],
    ) -> "StatusPage | None":
        """Return the page that a configuration asks for; None: none, or it may not be served."""
        try:
            door = door_of(config.web)
        except DoorError as e:
            log.error("no status page: %s", e)
            return None
        return None if door is None else cls(door, camera, layout, folder, temperature_c)

    @property
    def url(self) -> str:
        """What is typed into a browser."""
        return self._door.url

    def watch(self, daemon: Daemon) -> None:
        """Show this daemon from now on; before it runs."""
        self._live = LiveView(daemon)
        daemon.observe(self._live)
        try:
            self._thread.start()
        except RuntimeError as e:
            log.error("no status page: %s", e)

    def flight_is_over(self) -> None:
        """Show the end: the daemon runs no more, and there is time for reports."""
        self._is_over = True
        if self._live is not None:
            self._live.finish()

    def close(self) -> None:
        """Serve no more; what is just being sent is broken off."""
        self._ended.set()
        if self._server is not None:
            self._server.shutdown()
        if self._thread.is_alive():
            self._thread.join(_END_S)
        # From here on no thread is inside OpenCV, which must not be when the process ends.
        self._making.acquire(timeout=_END_S)

    def _is_busy(self) -> bool:
        if self._ended.is_set():
            return True
        return self._live is not None and self._live.armed and not self._is_over

    # ---- the server's threads ------------------------------------------------------------------

    def _serve(self) -> None:
        serve = partial(Server, self._door, self._flights, self._view, self._is_busy)
        what = f"no status page at {self._door.url}"
        self._server = when_free(serve, self._ended, (OSError, UnicodeError), what)
        if self._server is None:
            return
        log.info("status page: %s", self._door.url)
        with self._server as server:
            server.serve_forever()

    def _view(self, seen: int) -> bytes:
        """Return JSON of the newest view; without its picture if the browser has that already."""
        live = self._live
        view = live.look() if live is not None else None
        if view is None:
            return json.dumps({"waits": True}).encode()
        with self._making:
            if self._made is None or self._made[0] is not view:
                self._made = self._make(view)
            _, says, image = self._made
        is_new = image is not None and image["seq"] != seen
        says = {**says, "over": self._is_over, "picture": image if is_new else None}
        return json.dumps(says, allow_nan=False).encode()

    def _make(self, view: View) -> tuple[View, dict[str, Any], dict[str, Any] | None]:
        image = self._made[2] if self._made is not None else None
        if view.frame is None or view.sightings is None:
            image = None
        elif image is None or image["seq"] != view.frame.seq:
            image = picture(view.frame, view.sightings, self._fixed)
        says = {**shown(view, self._fixed), "computer": self._look_at_computer()}
        return view, says, image

    def _look_at_computer(self) -> dict[str, Any]:
        now = time.monotonic()
        if not self._computer or now - self._computer_t >= COMPUTER_S:
            self._computer_t = now
            try:
                free = None if self._folder is None else free_bytes(self._folder) / 1e9
            except OSError:
                free = None
            temperature = self._temperature_c()
            self._computer = {
                "free_gb": None if free is None else round(free, 1),
                "temperature_c": None if temperature is None else round(temperature),
            }
        return self._computer
