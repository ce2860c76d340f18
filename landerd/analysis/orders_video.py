"""Writes a video of a flight's pictures, with sightings and orders drawn into them.

`landerd dry-run` writes one to show what landerd would have done.
"""

import math
from pathlib import Path

import cv2

from landerd.camera_model import CameraModel
from landerd.lander import Lander
from landerd.messages import Command, Frame, Input, Prior, Setpoint, Sightings, Tick
from landerd.opencv_files import opencv_name, quiet
from landerd.pad import PadLayout
from landerd.runtime.observer import Observer
from landerd.vision.draw import draw, write


class VideoNotWritten(Exception):
    """The video cannot be made; the text names the file."""


class OrdersVideo(Observer):
    """An observer that writes the video of one flight."""

    def __init__(self, path: Path, camera: CameraModel, layout: PadLayout, fps: float) -> None:
        """Make the file: .webm in VP8, which browsers play, or .mp4 in MPEG-4 Part 2.

        Args:
            path: of the file.
            camera: of the pictures.
            layout: of the pad.
            fps: rate of the pictures.

        Raises:
            VideoNotWritten: the file cannot be made.
        """
        self._camera, self._layout = camera, layout
        self._frames = 0
        size = (camera.width, camera.height)
        code = cv2.VideoWriter.fourcc(*("VP80" if path.suffix == ".webm" else "mp4v"))
        self._name = opencv_name(path)
        with quiet():
            self._writer = cv2.VideoWriter(self._name, code, fps, size)
        if not self._writer.isOpened():
            raise VideoNotWritten(f"{path}: this video cannot be written")
        self._lander: Lander | None = None
        self._setpoint: Setpoint | None = None  # of the last control step; None: there was none

    def on_flight(self, lander: Lander) -> None:
        """Show phase and reason of this core from now on."""
        self._lander = lander

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Write one picture with what was seen, the phase and the last set-point."""
        picture = draw(frame.image, sightings, self._camera, self._layout)
        assert self._lander is not None
        lines = [f"{self._lander.phase.value}: {self._lander.reason}"]
        order = self._setpoint
        if order is not None:
            north, east, down = order.velocity
            turn = math.degrees(order.yaw_rate)
            lines.append(
                f"would send north {north:+.2f} east {east:+.2f} down {down:+.2f} m/s, "
                f"turn {turn:+.1f} deg/s"
            )
        for i, line in enumerate(lines):
            y = picture.shape[0] - 12 - 20 * (len(lines) - 1 - i)
            write(picture, (8, y), line, (255, 255, 255), 0.45)
        with quiet():
            self._writer.write(picture)  # does not tell whether it could
        self._frames += 1

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Note the set-point that the next picture shows."""
        if isinstance(message, Tick):
            self._setpoint = None
        for command in commands:
            if isinstance(command, Setpoint):
                self._setpoint = command

    def close(self) -> bool:
        """Finish the file; return whether it plays with all pictures.

        Nothing else tells that the disk was full: a .webm also plays when its end is missing.
        """
        played = 0
        with quiet():
            self._writer.release()
            capture = cv2.VideoCapture(self._name)
            while capture.grab():
                played += 1
            capture.release()
        return played == self._frames
