"""Raspberry Pi cameras at the CSI port, through libcamera and picamera2.

picamera2 is the system's (apt install python3-picamera2) and is imported when the camera is
opened. Untested on a Raspberry Pi.
"""

import sys
import time
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hw.cameras.newest import NewestFrame, unknown_exposure_sigma
from landerd.messages import ExposureOrder, Frame
from landerd.ports import DeviceLost, NotInstalled
from landerd.section import Section
from landerd.worker import in_thread


class Picamera2Options(Section):
    """A CSI camera of a Raspberry Pi."""

    number: Annotated[int, Field(ge=0, le=9)] = 0  # of the camera
    width: Annotated[int, Field(ge=16, le=8192)] = 640
    height: Annotated[int, Field(ge=16, le=8192)] = 480
    fps: Annotated[float, Field(gt=0, le=300)] = 30.0
    exposure_s: Annotated[float, Field(gt=0, le=0.1)] | None = None  # null: automatic
    gain: Annotated[float, Field(ge=1, le=64)] | None = None  # null: automatic
    focus_per_m: Annotated[float, Field(ge=0, le=20)] | None = None  # 1/distance; null: as it is
    time_offset_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0  # added to the frames' time


class Picamera2Camera:
    """A libcamera camera; a Camera."""

    def __init__(self, *, options: Picamera2Options) -> None:
        self._options = options
        self._camera: Any = None
        self._newest: NewestFrame | None = None
        self._order: ExposureOrder | None = None  # the newest order

    async def open(self) -> None:
        """Start the stream. Raises DeviceLost."""
        await self.close()
        # libcamera stamps with CLOCK_BOOTTIME, which also counts while the board is suspended.
        self._newest = NewestFrame(
            f"camera {self._options.number} (picamera2)",
            lambda: time.clock_gettime(time.CLOCK_BOOTTIME),
        )
        await in_thread(self._start, "camera")
        if self._order is not None:
            self.expose(self._order)  # a reopened camera starts with its configured exposure

    async def newest(self) -> Frame:
        """Wait for a picture newer than the last and return the newest. Raises DeviceLost."""
        if self._newest is None:
            raise DeviceLost("camera (picamera2) is closed")
        return await self._newest.get()

    def expose(self, order: ExposureOrder) -> None:
        """Set exposure and gain for the next pictures; libcamera takes the nearest values."""
        self._order = order
        if self._camera is not None:
            self._camera.set_controls(
                {
                    "AeEnable": False,
                    "ExposureTime": round(1e6 * order.time_s),
                    "AnalogueGain": order.gain,
                }
            )

    async def close(self) -> None:
        """Stop the stream; safe to call twice."""
        camera, self._camera, self._newest = self._camera, None, None
        if camera is not None:
            await in_thread(camera.close, "camera")

    def _start(self) -> None:
        try:
            from picamera2 import Picamera2
        except (ImportError, ValueError) as e:
            raise _not_loaded(e) from None
        o = self._options
        frame_us = round(1e6 / o.fps)
        controls: dict[str, Any] = {"FrameDurationLimits": (frame_us, frame_us)}
        if o.exposure_s is not None:
            controls |= {"AeEnable": o.gain is None, "ExposureTime": round(1e6 * o.exposure_s)}
        if o.gain is not None:
            controls["AnalogueGain"] = o.gain
        if o.focus_per_m is not None:
            controls |= {"AfMode": 0, "LensPosition": o.focus_per_m}  # 0: manual
        try:
            camera = Picamera2(o.number)
            self._camera = camera
            main = {"format": "YUV420", "size": (o.width, o.height)}
            camera.configure(camera.create_video_configuration(main=main, controls=controls))
            taken = tuple(camera.camera_configuration()["main"]["size"])
            if taken != (o.width, o.height):
                raise DeviceLost(
                    f"camera {o.number} (picamera2) has no {o.width}x{o.height}; "
                    f"nearest: {taken[0]}x{taken[1]}"
                )
            camera.pre_callback = self._on_request
            camera.start()
        except IndexError:
            raise DeviceLost(f"camera {o.number} (picamera2) is not there") from None
        except (RuntimeError, OSError) as e:
            raise DeviceLost(f"camera {o.number} (picamera2): {e}") from None

    def _on_request(self, request: Any) -> None:
        """Take a picture, on picamera2's thread."""
        newest, o = self._newest, self._options
        if newest is None:
            return
        planes = request.make_array("main")  # rows of brightness, then rows of colour
        image = np.ascontiguousarray(planes[: o.height, : o.width])
        metadata = request.get_metadata()
        # On a Raspberry Pi the stamp (ns) is that of the first line's arrival, which is the end of
        # its exposure (us), not the start as libcamera has it: raspberrypi/picamera2 issue 821.
        end_s = 1e-9 * metadata["SensorTimestamp"]
        exposure_us = metadata.get("ExposureTime")
        half_s = 0.5e-6 * (exposure_us or 0)
        sigma_t = 0.0 if exposure_us else unknown_exposure_sigma(o.fps)
        newest.put(image, end_s - half_s + o.time_offset_s, sigma_t)


def _not_loaded(e: ImportError | ValueError) -> NotInstalled:
    """Return the reason why picamera2 cannot be imported, and the remedy."""
    if isinstance(e, ValueError):
        # "numpy.dtype size changed": picamera2 imports simplejpeg, which Debian 12 builds for
        # numpy 1: raspberrypi/picamera2 issue 1211. pip would be content with that one.
        return NotInstalled(
            f"camera (picamera2) needs a simplejpeg for numpy 2 (python3-picamera2 says: {e})",
            f"sudo {sys.executable} -m pip install --ignore-installed --no-deps"
            " 'simplejpeg>=1.8.1'",
        )
    what = "camera (picamera2) needs the system's python3-picamera2"
    if e.name != "picamera2":  # it is installed, but one of its own imports is missing
        what += f", which says: {e}"
    return NotInstalled(what, "sudo apt install python3-picamera2")
