"""USB and other V4L2 cameras: always the newest picture, with the time of its exposure.

The kernel's queue is emptied whenever a picture arrives, even if nobody waits for one, because a
full queue drops new pictures and keeps old ones. The newest buffer is kept until its picture is
asked for or a newer one arrives. If the event loop was so late that the queue was full, all its
pictures are dropped, as newer ones have been lost.
"""

import asyncio
import errno
import logging
import math
import re
import threading
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hw.cameras.newest import unknown_exposure_sigma
from hw.cameras.v4l2_exposure import (
    ANALOGUE_GAIN,
    AUTOGAIN,
    EXPOSURE,
    EXPOSURE_AUTO,
    EXPOSURE_PRIORITY,
    EXPOSURE_UNIT_S,
    GAIN,
    MANUAL_EXPOSURE,
    carry_out,
)
from hw.cameras.v4l2_node import Filled, Layout, Mode, Stamp, VideoNode
from landerd.messages import ExposureOrder, Frame
from landerd.ports import DeviceLost
from landerd.section import Section
from landerd.worker import JobHangs, Worker, in_thread

log = logging.getLogger(__name__)

FORMATS = ("GREY", "NV12", "YUYV", "MJPG")  # by increasing work and delay of decoding
_BUFFERS = 4  # one kept, one being filled, two in reserve for a late event loop
_FIRST_FRAME_S = 4.0  # longest wait for the first picture: USB cameras start slowly
_STALL_S = 1.0
_EMPTY_WAKE_UPS = 100  # the node readable this often in a row without a picture is an error state

_FOCUS, _FOCUS_AUTO = 0x009A090A, 0x009A090C  # linux/v4l2-controls.h
_AUTOMATIC_EXPOSURES = (3, 0)  # aperture priority, which UVC cameras have, and automatic

_REASONS = {
    errno.ENOENT: "is not there",
    errno.EBUSY: "is used by another program",
    errno.EACCES: "may not be opened: is the user in group video?",
    errno.ENODEV: "has gone, or is no camera",
    errno.ENXIO: "has gone, or is no camera",
    errno.ENOTTY: "is no camera",
    errno.ENOSPC: "needs more USB bandwidth than there is: lower size or rate, or use MJPG",
}


class V4l2Options(Section):
    """A camera of Linux's own, USB cameras most of all."""

    device: str = "/dev/video0"  # better a name of /dev/v4l/by-id, which stays the same
    width: Annotated[int, Field(ge=16, le=8192)] = 640
    height: Annotated[int, Field(ge=16, le=8192)] = 480
    fps: Annotated[float, Field(gt=0, le=300)] = 30.0
    format: Literal["auto", "GREY", "NV12", "YUYV", "MJPG"] = "auto"
    exposure_s: Annotated[float, Field(gt=0, le=0.1)] | None = None  # null: automatic
    gain: int | None = None  # in the camera's own units; null: left as it is
    # How many times brighter the highest gain is than the lowest; for camera.exposure: pad.
    gain_most: Annotated[float, Field(gt=1, le=1000)] = 16.0
    focus: int | None = None  # in the camera's own units; null: left as it is
    # Added to the middle of the exposure as the kernel's time stamp gives it.
    time_offset_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0


def _close_opened(opening: asyncio.Future[VideoNode]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


async def _release(node: VideoNode, ordering: asyncio.Task[None] | None) -> None:
    if ordering is not None:
        await ordering  # it uses the node, which therefore must not be closed before
    await in_thread(node.close, "camera")


class V4l2Camera:
    """A V4L2 camera; a Camera.

    Attributes:
        counters: numbers of damaged, unreadable and outdated pictures.
        remarks: settings that the camera did not take as configured; written by `open`.
    """

    def __init__(
        self, *, options: V4l2Options, node: Callable[[str], VideoNode] = VideoNode
    ) -> None:
        """Make a driver; `open` opens the device.

        Args:
            options: the camera's block of the configuration.
            node: function that opens a video node.
        """
        self.counters: Counter[str] = Counter()
        self.remarks: list[str] = []
        self._options = options
        self._open_node = node
        self._node: VideoNode | None = None
        self._layout = Layout("", 0, 0, 0)
        self._exposure_s = 0.0
        self._held: Filled | None = None  # the newest picture, not yet asked for
        self._arrived = asyncio.Event()
        self._lost: str | None = None
        self._has_sent = False
        self._empty_wake_ups = 0
        self._buffers = 0
        self._was_full = False
        self._decoder = Worker("camera")
        self._order: ExposureOrder | None = None  # the newest order
        self._is_new_order = False
        self._ordering: asyncio.Task[None] | None = None
        self._releasing: asyncio.Task[None] | None = None

    # ---- open and close ----

    async def open(self) -> None:
        """Set the camera up and start its stream. Raises DeviceLost."""
        await self.close()
        self._lost, self._has_sent, self._empty_wake_ups = None, False, 0
        self._was_full = False
        self._arrived.clear()
        # In a thread, as each control transfer over USB takes tens of milliseconds.
        unwanted = threading.Event()
        opening = in_thread(lambda: self._set_up_for(unwanted), "camera")
        try:
            self._node = await asyncio.shield(opening)
        except asyncio.CancelledError:
            # Cancelled: the thread cannot be stopped, and closes the node when it has set it up.
            unwanted.set()
            opening.add_done_callback(_close_opened)
            raise
        for remark in self.remarks:
            log.warning("camera %s: %s", self._options.device, remark)
        asyncio.get_running_loop().add_reader(self._node.fileno(), self._drain)
        if self._order is not None:
            self.expose(self._order)  # a reopened camera starts with its configured exposure

    async def close(self) -> None:
        """Stop the stream; safe to call twice. If cancelled, the node is closed all the same."""
        node, self._node = self._node, None
        ordering, self._ordering = self._ordering, None
        self._held = None
        if node is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(node.fileno())
            self._releasing = loop.create_task(_release(node, ordering))
        self._decoder.close()
        if self._releasing is not None and not self._releasing.done():
            await asyncio.shield(self._releasing)

    def _set_up_for(self, unwanted: threading.Event) -> VideoNode:
        """Set a node up; close it if it is not wanted any more when that is done."""
        node = self._set_up()
        if unwanted.is_set():
            node.close()
            raise DeviceLost(self._says("opened too late"))
        return node

    def _set_up(self) -> VideoNode:
        options = self._options
        self.remarks = []
        try:
            node = self._open_node(options.device)
        except OSError as e:
            raise DeviceLost(self._reason(e)) from None
        try:
            self._layout = self._choose_layout(node)
            fps = node.set_rate(options.fps)
            if fps and abs(fps - options.fps) > 0.05 * options.fps:
                self.remarks.append(f"fps: asked for {options.fps:g}, it gives {fps:g}")
            self._set_controls(node)
            self._buffers = node.start(_BUFFERS)
        except OSError as e:
            node.close()
            raise DeviceLost(self._reason(e)) from None
        except DeviceLost:
            node.close()
            raise
        return node

    def _choose_layout(self, node: VideoNode) -> Layout:
        options = self._options
        modes = node.modes()
        is_auto = options.format == "auto"
        name: str = _best_format(modes, options) if is_auto else options.format
        layout = node.set_format(name, options.width, options.height)
        if layout[:3] != (name, options.width, options.height):
            raise DeviceLost(
                f"camera {options.device} has no {options.width}x{options.height} in {name}; "
                f"it has {in_words(modes) or 'none that it lists'}"
            )
        return layout

    def _set_controls(self, node: VideoNode) -> None:
        options = self._options
        self._exposure_s = 0.0
        if node.range(EXPOSURE_PRIORITY) is not None:
            self._set(node, "constant rate", EXPOSURE_PRIORITY, 0)
        if options.exposure_s is None:
            if node.range(EXPOSURE_AUTO) is not None:
                self._set_automatic(node)
            self.remarks.append(
                "exposure is automatic, so its middle is not known: set camera.v4l2.exposure_s"
            )
        else:
            if node.range(EXPOSURE_AUTO) is not None:
                self._set(node, "manual exposure", EXPOSURE_AUTO, MANUAL_EXPOSURE)
            wanted = max(1, round(options.exposure_s / EXPOSURE_UNIT_S))
            taken = self._set(node, "exposure (0.1 ms)", EXPOSURE, wanted)
            self._exposure_s = EXPOSURE_UNIT_S * taken if taken else options.exposure_s
        if options.gain is not None:
            if node.range(AUTOGAIN) is not None:
                self._set(node, "manual gain", AUTOGAIN, 0)
            has_gain = node.range(GAIN) is not None
            self._set(node, "gain", GAIN if has_gain else ANALOGUE_GAIN, options.gain)
        if options.focus is not None:
            if node.range(_FOCUS_AUTO) is not None:
                self._set(node, "manual focus", _FOCUS_AUTO, 0)
            self._set(node, "focus", _FOCUS, options.focus)
        elif node.range(_FOCUS_AUTO) is not None and node.control(_FOCUS_AUTO):
            self.remarks.append(
                "autofocus is on and changes the calibration: set camera.v4l2.focus"
            )

    def _set(self, node: VideoNode, name: str, control: int, wanted: int) -> int | None:
        """Set a control; return the value read back, None if the camera lacks or refuses it."""
        limits = node.range(control)
        if limits is None:
            self.remarks.append(f"{name}: it has no such control")
            return None
        try:
            taken = node.set_control(control, min(max(wanted, limits.low), limits.high))
        except OSError as e:
            if e.errno == errno.ENODEV:
                raise
            self.remarks.append(f"{name}: it refuses {wanted}: {e.strerror}")
            return None
        if taken != wanted:
            self.remarks.append(
                f"{name}: asked for {wanted}, it took {taken} (from {limits.low} to {limits.high})"
            )
        return taken

    def _set_automatic(self, node: VideoNode) -> None:
        for value in _AUTOMATIC_EXPOSURES:
            try:
                node.set_control(EXPOSURE_AUTO, value)
            except OSError as e:
                if e.errno == errno.ENODEV:
                    raise
            else:
                return

    # ---- exposure ----

    def expose(self, order: ExposureOrder) -> None:
        """Set exposure and gain for the next pictures; a newer order replaces one not done yet."""
        self._order, self._is_new_order = order, True
        if self._node is not None and (self._ordering is None or self._ordering.done()):
            self._ordering = asyncio.get_running_loop().create_task(self._carry_out_orders())

    async def _carry_out_orders(self) -> None:
        options = self._options
        while self._is_new_order and self._order is not None and self._node is not None:
            self._is_new_order = False
            try:
                # In a thread, as each control transfer over USB takes tens of milliseconds.
                call = partial(
                    carry_out, self._node, self._order, options.gain_most, 0.9 / options.fps
                )
                self._exposure_s, remark = await in_thread(call, "camera")
            except OSError as e:
                remark = f"exposure: it does not take orders: {e.strerror or e}"
            if remark is not None and remark not in self.remarks:
                self.remarks.append(remark)
                log.warning("camera %s: %s", options.device, remark)

    # ---- pictures ----

    async def newest(self) -> Frame:
        """Wait for a picture newer than the last and return the newest there is.

        Its time is the middle of the exposure plus `time_offset_s`. The middle is half an exposure
        after the kernel's stamp if that is the start of the exposure, and half an exposure before
        it if that is the end of the frame. The frame also has this time's standard deviation.
        Raises DeviceLost.
        """
        loop = asyncio.get_running_loop()
        limit_s = _STALL_S if self._has_sent else _FIRST_FRAME_S
        until_t = loop.time() + limit_s
        came = f"sent no picture for {limit_s:g} s"
        while loop.time() < until_t:
            try:
                async with asyncio.timeout_at(until_t):
                    await self._arrived.wait()
            except TimeoutError:
                break
            if self._lost is None and self._node is not None:
                self._take_all(self._node)  # pictures that arrived since the loop's last turn
            if self._lost is not None or self._node is None:
                raise DeviceLost(self._lost or self._says("is closed"))
            if self._held is None:
                self._arrived.clear()
                continue
            filled, self._held = self._held, None
            self._arrived.clear()
            data = self._node.copy(filled)
            t = self._exposure_time(filled, self._node)
            self._give_back(filled)
            image = await self._grey(data)
            if image is not None:
                self._has_sent = True
                return Frame(t, filled.sequence, image, self._time_sigma(filled.stamp))
            self.counters["pictures that cannot be read"] += 1
            came = f"sent nothing that can be read for {limit_s:g} s"
        raise DeviceLost(self._says(came))

    def _drain(self) -> None:
        """Take the pictures that have arrived; called whenever the node is readable."""
        assert self._node is not None
        if self._take_all(self._node) == 0 and self._lost is None:
            self._empty_wake_ups += 1
            if self._empty_wake_ups > _EMPTY_WAKE_UPS:
                self._lose(self._says("reports an error"))

    def _take_all(self, node: VideoNode) -> int:
        """Take all filled buffers, keep the newest sound one, and return how many there were."""
        lent = self._buffers - (self._held is not None)  # number of buffers the kernel had to fill
        count = 0
        try:
            while (filled := node.dequeue()) is not None:
                count += 1
                if filled.damaged:
                    self.counters["damaged pictures"] += 1
                    node.queue(filled.buffer)
                    continue
                self._let_go(node)
                self._held = filled
                self._arrived.set()
            # With no buffer left to fill the kernel has dropped newer pictures. If this happens
            # twice in a row, the computer is too slow for the camera, and an old picture is better
            # than none.
            is_full = count >= lent and not self._was_full
            if is_full:
                self.counters["pictures that came too late"] += count
                self._let_go(node)
        except OSError as e:
            self._lose(self._reason(e))
            return count
        if count:
            self._was_full, self._empty_wake_ups = is_full, 0
        return count

    def _let_go(self, node: VideoNode) -> None:
        held, self._held = self._held, None
        if held is not None:
            node.queue(held.buffer)

    def _give_back(self, filled: Filled) -> None:
        assert self._node is not None
        try:
            self._node.queue(filled.buffer)
        except OSError as e:
            self._lose(self._reason(e))  # the loss is reported after this picture, which is valid

    def _lose(self, reason: str) -> None:
        assert self._node is not None
        asyncio.get_running_loop().remove_reader(self._node.fileno())
        self._lost = reason
        self._arrived.set()

    def _exposure_time(self, filled: Filled, node: VideoNode) -> float:
        """Return the middle of the exposure on the loop's clock."""
        now = asyncio.get_running_loop().time()
        half_s = 0.5 * self._exposure_s
        if filled.stamp is Stamp.NONE:
            age_s = half_s  # counted from the time at which the picture is dequeued
        elif filled.stamp is Stamp.END:
            age_s = node.now() - filled.t + half_s
        else:
            age_s = node.now() - filled.t - half_s
        return now - age_s + self._options.time_offset_s

    def _time_sigma(self, stamp: Stamp) -> float:
        """Return the standard deviation of the middle of the exposure, s."""
        fps = self._options.fps
        exposure = 0.0 if self._exposure_s > 0.0 else unknown_exposure_sigma(fps)
        # Without a stamp the time of arrival is used, which may be a period late: the read-out.
        return math.hypot(exposure, 1.0 / fps) if stamp is Stamp.NONE else exposure

    async def _grey(self, data: bytes) -> NDArray[np.uint8] | None:
        """Return the picture, (height, width); None if the bytes are not one."""
        name, width, height, stride = self._layout
        if name == "MJPG":
            # OpenCV 4 also decodes half a picture, and fills the rest with grey. A complete one has
            # its end marker (FF D9) after the last start of a scan (FF DA), whatever padding
            # follows; a thumbnail in the header has both markers, too.
            if data.rfind(b"\xff\xd9") <= data.rfind(b"\xff\xda"):
                return None
            try:
                return await self._decoder.run(
                    partial(_decode_jpeg, data, (height, width)), _STALL_S
                )
            except JobHangs:
                raise DeviceLost(self._says("sends what takes too long to decode")) from None
        if len(data) < stride * height:
            return None
        lines = np.frombuffer(data, np.uint8, stride * height).reshape(height, stride)
        # The first plane of NV12 and every other byte of YUYV are the brightness.
        grey = lines[:, : 2 * width : 2] if name == "YUYV" else lines[:, :width]
        return np.ascontiguousarray(grey)

    # ---- words ----

    def _reason(self, e: OSError) -> str:
        return self._says(_REASONS.get(e.errno or 0) or f"fails: {e.strerror or e}")

    def _says(self, what: str) -> str:
        return f"camera {self._options.device} {what}"


def _decode_jpeg(data: bytes, shape: tuple[int, int]) -> NDArray[np.uint8] | None:
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        return None
    return None if image is None or image.shape != shape else np.asarray(image, np.uint8)


# ---- what there is ----


def _best_format(modes: list[Mode], options: V4l2Options) -> str:
    """Return the format with the least work that has the configured size and is fast enough."""
    known = {
        m.format: m.fps
        for m in modes
        if (m.width, m.height) == (options.width, options.height) and m.format in FORMATS
    }
    names = [name for name in FORMATS if name in known] or list(FORMATS)
    for name in names:
        fps = known.get(name, 0.0)
        if fps == 0.0 or fps >= 0.95 * options.fps:
            return name
    return max(names, key=lambda name: known.get(name, 0.0))


def in_words(modes: list[Mode]) -> str:
    """Return the modes that landerd can use as one line: "640x480 YUYV 30/s, ..."."""
    return ", ".join(
        f"{m.width}x{m.height} {m.format}" + (f" {m.fps:.0f}/s" if m.fps else "")
        for m in modes
        if m.format in FORMATS
    )


def cameras() -> list[tuple[str, str, list[Mode]]]:
    """Return device, name and modes of every V4L2 camera that can be opened."""
    found = []
    paths = Path("/dev").glob("video*")
    for path in sorted(paths, key=lambda p: int(re.sub(r"\D", "", p.name) or "0")):
        try:
            node = VideoNode(str(path))
        except OSError:
            continue  # no capture device, or one that may not be opened
        try:
            found.append((str(path), node.name, node.modes()))
        except OSError:
            continue  # it was unplugged meanwhile
        finally:
            node.close()
    return found
