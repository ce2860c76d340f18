"""A V4L2 video node (/dev/video0) by ioctl and mmap: the kernel's structures and nothing more.

Layouts are those of linux/videodev2.h on 64-bit machines. `hw.cameras.v4l2` is the driver; its
tests put another node in this one's place.
"""

import ctypes
import errno
import fcntl
import mmap
import os
import time
from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

_U32, _S32 = ctypes.c_uint32, ctypes.c_int32
_CAPTURE, _MMAP = 1, 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE, V4L2_MEMORY_MMAP
_CAP_VIDEO_CAPTURE, _CAP_STREAMING = 0x1, 0x0400_0000
_DISCRETE = 1  # frame sizes and intervals: 1 discrete, 2 continuous, 3 stepwise
_CTRL_DISABLED = 0x1
_FLAG_ERROR = 0x40
_STAMP_MASK, _STAMP_MONOTONIC = 0xE000, 0x2000
_SOURCE_MASK, _SOURCE_START_OF_EXPOSURE = 0x7_0000, 0x1_0000


class _Capability(ctypes.Structure):
    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        ("version", _U32),
        ("capabilities", _U32),
        ("device_caps", _U32),
        ("reserved", _U32 * 3),
    )


class _FormatDescription(ctypes.Structure):
    _fields_ = (
        ("index", _U32),
        ("type", _U32),
        ("flags", _U32),
        ("description", ctypes.c_char * 32),
        ("pixelformat", _U32),
        ("mbus_code", _U32),
        ("reserved", _U32 * 3),
    )


class _FrameSize(ctypes.Structure):
    _fields_ = (
        ("index", _U32),
        ("pixel_format", _U32),
        ("type", _U32),
        ("size", _U32 * 6),  # discrete: width, height; else min, max, step of both
        ("reserved", _U32 * 2),
    )


class _FrameInterval(ctypes.Structure):
    _fields_ = (
        ("index", _U32),
        ("pixel_format", _U32),
        ("width", _U32),
        ("height", _U32),
        ("type", _U32),
        ("interval", _U32 * 6),  # discrete: numerator, denominator; else the shortest first
        ("reserved", _U32 * 2),
    )


class _PixFormat(ctypes.Structure):
    _fields_ = tuple(
        (name, _U32)
        for name in [
            "width",
            "height",
            "pixelformat",
            "field",
            "bytesperline",
            "sizeimage",
            "colorspace",
            "priv",
            "flags",
            "encoding",
            "quantization",
            "xfer_func",
        ]
    )


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", _PixFormat), ("raw", ctypes.c_uint8 * 200), ("align", ctypes.c_ulong))


class _Format(ctypes.Structure):
    _fields_ = (("type", _U32), ("fmt", _FormatUnion))


class _StreamParameters(ctypes.Structure):
    _fields_ = (
        ("type", _U32),
        ("capability", _U32),
        ("capturemode", _U32),
        ("numerator", _U32),  # of the time a frame
        ("denominator", _U32),
        ("rest", ctypes.c_uint8 * 184),
    )


class _RequestBuffers(ctypes.Structure):
    _fields_ = (
        ("count", _U32),
        ("type", _U32),
        ("memory", _U32),
        ("capabilities", _U32),
        ("flags", ctypes.c_uint8),
        ("reserved", ctypes.c_uint8 * 3),
    )


class _Timeval(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("microseconds", ctypes.c_long))


class _Buffer(ctypes.Structure):
    _fields_ = (
        ("index", _U32),
        ("type", _U32),
        ("bytesused", _U32),
        ("flags", _U32),
        ("field", _U32),
        ("timestamp", _Timeval),
        ("timecode", _U32 * 4),
        ("sequence", _U32),
        ("memory", _U32),
        ("offset", ctypes.c_ulong),
        ("length", _U32),
        ("reserved", _U32),
        ("request_fd", _S32),
    )


class _ControlQuery(ctypes.Structure):
    _fields_ = (
        ("id", _U32),
        ("type", _U32),
        ("name", ctypes.c_char * 32),
        ("minimum", _S32),
        ("maximum", _S32),
        ("step", _S32),
        ("default_value", _S32),
        ("flags", _U32),
        ("reserved", _U32 * 2),
    )


class _Control(ctypes.Structure):
    _fields_ = (("id", _U32), ("value", _S32))


def _ioc(direction: int, number: int, argument: type) -> int:
    size = ctypes.sizeof(argument)
    return direction << 30 | size << 16 | ord("V") << 8 | number


_QUERYCAP = _ioc(2, 0, _Capability)
_ENUM_FMT = _ioc(3, 2, _FormatDescription)
_S_FMT = _ioc(3, 5, _Format)
_REQBUFS = _ioc(3, 8, _RequestBuffers)
_QUERYBUF = _ioc(3, 9, _Buffer)
_QBUF = _ioc(3, 15, _Buffer)
_DQBUF = _ioc(3, 17, _Buffer)
_STREAMON = _ioc(1, 18, ctypes.c_int)
_STREAMOFF = _ioc(1, 19, ctypes.c_int)
_S_PARM = _ioc(3, 22, _StreamParameters)
_G_CTRL = _ioc(3, 27, _Control)
_S_CTRL = _ioc(3, 28, _Control)
_QUERYCTRL = _ioc(3, 36, _ControlQuery)
_ENUM_FRAMESIZES = _ioc(3, 74, _FrameSize)
_ENUM_FRAMEINTERVALS = _ioc(3, 75, _FrameInterval)


class Stamp(Enum):
    """What a buffer's time means."""

    START = "start of exposure"
    END = "end of frame"
    NONE = "nothing that is known"  # it is not a time of the monotonic clock


class Mode(NamedTuple):
    """One way in which a camera can send pictures."""

    format: str  # four characters, as "YUYV"
    width: int
    height: int
    fps: float  # highest picture rate, 1/s; 0: the driver does not tell


class Layout(NamedTuple):
    """How pictures lie in the buffers."""

    format: str
    width: int
    height: int
    stride: int  # bytes a line of the first plane


class Range(NamedTuple):
    """What values a control takes."""

    low: int
    high: int


class Filled(NamedTuple):
    """A buffer that the kernel has filled."""

    buffer: int
    size: int  # bytes
    sequence: int
    t: float  # on the clock of `VideoNode.now`, s
    stamp: Stamp
    damaged: bool


class VideoNode:
    """An open video node. Every method may raise OSError as the kernel gives it."""

    def __init__(self, path: str) -> None:
        """Open the node without waiting. Raises OSError; ENODEV: not a capture device."""
        self._maps: list[mmap.mmap] = []
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            capability = _Capability()
            fcntl.ioctl(self._fd, _QUERYCAP, capability)
            can = capability.device_caps or capability.capabilities
            if not (can & _CAP_VIDEO_CAPTURE and can & _CAP_STREAMING):
                raise OSError(errno.ENODEV, "not a camera that streams single-plane pictures")
        except OSError:
            os.close(self._fd)
            raise
        self.name = capability.card.decode(errors="replace")

    def fileno(self) -> int:
        """Return the file descriptor, which becomes readable when a buffer is filled."""
        return self._fd

    def now(self) -> float:
        """Return the time on the clock that buffers are stamped with, s."""
        return time.clock_gettime(time.CLOCK_MONOTONIC)

    # ---- what it can do ----

    def modes(self) -> list[Mode]:
        """Return all modes with discrete sizes; ranges of sizes are left out."""
        return [
            Mode(name, width, height, self._fps(name, width, height))
            for name in self._formats()
            for width, height in self._sizes(name)
        ]

    def _formats(self) -> Iterator[str]:
        query = _FormatDescription(type=_CAPTURE)
        while self._answers(_ENUM_FMT, query):
            yield int(query.pixelformat).to_bytes(4, "little").decode("latin-1")
            query.index += 1

    def _sizes(self, name: str) -> Iterator[tuple[int, int]]:
        query = _FrameSize(pixel_format=_code(name))
        while self._answers(_ENUM_FRAMESIZES, query) and query.type == _DISCRETE:
            yield query.size[0], query.size[1]
            query.index += 1

    def _fps(self, name: str, width: int, height: int) -> float:
        query = _FrameInterval(pixel_format=_code(name), width=width, height=height)
        fastest = 0.0
        while self._answers(_ENUM_FRAMEINTERVALS, query) and query.interval[0]:
            fastest = max(fastest, query.interval[1] / query.interval[0])
            if query.type != _DISCRETE:
                break
            query.index += 1
        return fastest

    def _answers(self, request: int, argument: ctypes.Structure) -> bool:
        """Make an ioctl request; return False if there is no such entry or no enumeration."""
        try:
            fcntl.ioctl(self._fd, request, argument)
        except OSError as e:
            if e.errno in (errno.EINVAL, errno.ENOTTY):
                return False
            raise
        return True

    # ---- set-up ----

    def set_format(self, name: str, width: int, height: int) -> Layout:
        """Ask for a format and return the one the driver has chosen."""
        asked = _Format(type=_CAPTURE)
        asked.fmt.pix = _PixFormat(width=width, height=height, pixelformat=_code(name))
        fcntl.ioctl(self._fd, _S_FMT, asked)
        pix = asked.fmt.pix
        chosen = int(pix.pixelformat).to_bytes(4, "little").decode("latin-1")
        return Layout(chosen, pix.width, pix.height, pix.bytesperline)

    def set_rate(self, fps: float) -> float:
        """Ask for a rate and return the one chosen; 0: the driver does not tell."""
        asked = _StreamParameters(type=_CAPTURE, numerator=1000, denominator=round(1000 * fps))
        if not self._answers(_S_PARM, asked) or asked.numerator == 0:
            return 0.0
        return float(asked.denominator / asked.numerator)

    def range(self, control: int) -> Range | None:
        """Return the range of a control; None: there is none."""
        query = _ControlQuery(id=control)
        if not self._answers(_QUERYCTRL, query) or query.flags & _CTRL_DISABLED:
            return None
        return Range(query.minimum, query.maximum)

    def set_control(self, control: int, value: int) -> int:
        """Set a control and return the value read back."""
        fcntl.ioctl(self._fd, _S_CTRL, _Control(control, value))
        return self.control(control)

    def control(self, control: int) -> int:
        """Return a control's value."""
        read = _Control(control)
        fcntl.ioctl(self._fd, _G_CTRL, read)
        return int(read.value)

    # ---- pictures ----

    def start(self, count: int) -> int:
        """Map buffers, give all to the driver, start the stream; return how many it took."""
        asked = _RequestBuffers(count=count, type=_CAPTURE, memory=_MMAP)
        fcntl.ioctl(self._fd, _REQBUFS, asked)
        for index in range(asked.count):
            buffer = _Buffer(index=index, type=_CAPTURE, memory=_MMAP)
            fcntl.ioctl(self._fd, _QUERYBUF, buffer)
            self._maps.append(mmap.mmap(self._fd, buffer.length, offset=buffer.offset))
            self.queue(index)
        fcntl.ioctl(self._fd, _STREAMON, ctypes.c_int(_CAPTURE))
        return len(self._maps)

    def dequeue(self) -> Filled | None:
        """Take the oldest filled buffer; None: none is filled."""
        buffer = _Buffer(type=_CAPTURE, memory=_MMAP)
        try:
            fcntl.ioctl(self._fd, _DQBUF, buffer)
        except BlockingIOError:
            return None
        stamp = Stamp.NONE
        if buffer.flags & _STAMP_MASK == _STAMP_MONOTONIC:
            starts = buffer.flags & _SOURCE_MASK == _SOURCE_START_OF_EXPOSURE
            stamp = Stamp.START if starts else Stamp.END
        return Filled(
            buffer.index,
            buffer.bytesused,
            buffer.sequence,
            buffer.timestamp.seconds + 1e-6 * buffer.timestamp.microseconds,
            stamp,
            bool(buffer.flags & _FLAG_ERROR),
        )

    def queue(self, index: int) -> None:
        """Give a buffer back to the driver, which may overwrite its picture."""
        fcntl.ioctl(self._fd, _QBUF, _Buffer(index=index, type=_CAPTURE, memory=_MMAP))

    def copy(self, filled: Filled) -> bytes:
        """Return a copy of the bytes of a dequeued buffer."""
        return self._maps[filled.buffer][: filled.size]

    def close(self) -> None:
        """Stop the stream and close the node."""
        try:
            fcntl.ioctl(self._fd, _STREAMOFF, ctypes.c_int(_CAPTURE))
        except OSError:
            pass  # the device has gone, and its stream with it
        finally:
            for mapped in self._maps:
                mapped.close()
            os.close(self._fd)


def _code(name: str) -> int:
    return int.from_bytes(name.encode("latin-1"), "little")
