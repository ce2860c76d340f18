"""A scripted flight whose log is written as it flies."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from landerd.camera_model import CameraModel
from landerd.config.models import Config, LogSection
from landerd.flightlog.contents import Head
from landerd.flightlog.recorder import Recorder
from landerd.messages import Command, Frame, Input, Prior, Sightings
from tests.scripted_flight import PAD, Flight

CAMERA = CameraModel(64, 48, 40.0, 40.0, 31.5, 23.5)
PLENTY = LogSection(keep_free_mb=0.0)


def recorder(
    target: Path, options: LogSection = PLENTY, *, background: bool = False, **more: Any
) -> Recorder:
    return Recorder(Head(Config(), PAD, CAMERA), options, target, background=background, **more)


class RecordedFlight(Flight):
    """A scripted flight that calls the recorder as the daemon would, a picture per sighting."""

    def __init__(self, recorder: Recorder, image: np.ndarray[Any, Any] | None = None) -> None:
        super().__init__(position=(-0.8, 0.3, -2.0))
        self.recorder = recorder
        self.after_step: Callable[[], None] = lambda: None
        self._image = np.zeros((48, 64), np.uint8) if image is None else image
        recorder.on_flight(self.lander)

    def sighting(self) -> Sightings:
        seen = super().sighting()
        corners = ((20.0, 14.0), (40.0, 14.0), (40.0, 34.0), (20.0, 34.0))
        markers = tuple(replace(m, outline_px=corners) for m in seen.markers)
        return replace(seen, markers=markers, arrived_t=seen.t + 0.038)

    def give(self, message: Input) -> list[Command]:
        if type(message) in self.silent:
            return []
        if isinstance(message, Sightings):
            frame = Frame(message.t, message.seq, self._image)
            self.recorder.on_frame(frame, Prior(), message)
        commands = super().give(message)
        self.recorder.on_step(self.t, message, commands)
        self.after_step()
        return commands
