"""Cameras behind GStreamer: a Jetson's CSI port (nvarguscamerasrc), or any other live source.

GStreamer and its Python binding are the system's (python3-gi, gir1.2-gst-plugins-base-1.0) and are
imported when the camera is opened. Untested on a Jetson.
"""

import time
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hw.cameras.newest import NewestFrame, unknown_exposure_sigma
from landerd.messages import Frame
from landerd.ports import DeviceLost, NotInstalled
from landerd.section import Section
from landerd.worker import in_thread


class GstreamerOptions(Section):
    """A camera behind a GStreamer source, as the Jetson's CSI cameras are."""

    source: str = "nvarguscamerasrc sensor-id=0"  # with its own settings of exposure and gain
    convert: str = "nvvidconv"  # what makes grey of its pictures; elsewhere: videoconvert
    width: Annotated[int, Field(ge=16, le=8192)] = 1280
    height: Annotated[int, Field(ge=16, le=8192)] = 720
    fps: Annotated[float, Field(gt=0, le=300)] = 30.0
    # As source sets it; the stamp is of its start, the frame's time its middle. null: automatic
    exposure_s: Annotated[float, Field(gt=0, le=0.1)] | None = None
    time_offset_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0  # added to the frames' time


class GstreamerCamera:
    """A GStreamer pipeline that ends in grey pictures; a Camera."""

    def __init__(self, *, options: GstreamerOptions) -> None:
        self._options = options
        self._pipeline: Any = None
        self._gst: Any = None
        self._newest: NewestFrame | None = None

    async def open(self) -> None:
        """Start the pipeline. Raises DeviceLost."""
        await self.close()
        self._newest = NewestFrame("camera (gstreamer)", time.monotonic)
        await in_thread(self._start, "camera")

    async def newest(self) -> Frame:
        """Wait for a picture newer than the last and return the newest. Raises DeviceLost."""
        if self._newest is None:
            raise DeviceLost("camera (gstreamer) is closed")
        return await self._newest.get()

    async def close(self) -> None:
        """Stop the pipeline; safe to call twice."""
        pipeline, self._pipeline, self._newest = self._pipeline, None, None
        if pipeline is not None:
            await in_thread(partial(pipeline.set_state, self._gst.State.NULL), "camera")

    def _start(self) -> None:
        try:
            import gi

            gi.require_version("Gst", "1.0")
            from gi.repository import Gst
        except (ImportError, ValueError):
            raise NotInstalled(
                "camera (gstreamer) needs the system's python3-gi and GStreamer",
                "sudo apt install python3-gi gir1.2-gst-plugins-base-1.0",
            ) from None
        self._gst = Gst
        Gst.init(None)
        o = self._options
        size = f"width={o.width},height={o.height}"
        rate = f"framerate={round(1000 * o.fps)}/1000"
        memory = "video/x-raw(memory:NVMM)" if o.source.startswith("nvargus") else "video/x-raw"
        try:
            self._pipeline = Gst.parse_launch(
                f"{o.source} ! {memory},{size},{rate} ! {o.convert} ! "
                f"video/x-raw,format=GRAY8,{size} ! "
                "appsink name=out max-buffers=1 drop=true sync=false emit-signals=true"
            )
        except Exception as e:  # GLib.Error, a class of the imported binding
            raise DeviceLost(f"camera (gstreamer): {e}") from None
        self._pipeline.get_by_name("out").connect("new-sample", self._on_sample)
        bus = self._pipeline.get_bus()
        bus.enable_sync_message_emission()
        bus.connect("sync-message::error", self._on_error)
        # The system's clock is the monotonic one.
        self._pipeline.use_clock(Gst.SystemClock.obtain())
        if self._pipeline.set_state(Gst.State.PLAYING) == Gst.StateChangeReturn.FAILURE:
            raise DeviceLost("camera (gstreamer) does not start: is it plugged in and free?")

    def _on_error(self, _: Any, message: Any) -> None:
        """Take an error of the pipeline as the loss of the camera, on a thread of GStreamer's."""
        if self._newest is not None:
            self._newest.lose(message.parse_error()[0].message)

    def _on_sample(self, sink: Any) -> Any:
        """Take a picture, on a thread of GStreamer's."""
        newest, pipeline = self._newest, self._pipeline
        buffer = sink.emit("pull-sample").get_buffer()
        if newest is None or pipeline is None:
            return self._gst.FlowReturn.OK
        o = self._options
        ok, mapped = buffer.map(self._gst.MapFlags.READ)
        if ok:
            try:
                stride = len(mapped.data) // o.height
                lines = np.frombuffer(mapped.data, np.uint8, stride * o.height)
                image = lines.reshape(o.height, stride)[:, : o.width].copy()
            finally:
                buffer.unmap(mapped)
            start_s = 1e-9 * (pipeline.get_base_time() + buffer.pts)
            half_s = 0.5 * (o.exposure_s or 0.0)
            sigma_t = 0.0 if o.exposure_s else unknown_exposure_sigma(o.fps)
            newest.put(image, start_s + half_s + o.time_offset_s, sigma_t)
        return self._gst.FlowReturn.OK
