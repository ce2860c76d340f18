"""Sets exposure and gain by the controls of V4L2 cameras."""

import errno
import math
from typing import NamedTuple

from hw.cameras.v4l2_node import Range, VideoNode
from landerd.messages import ExposureOrder

# linux/v4l2-controls.h
AUTOGAIN, GAIN, ANALOGUE_GAIN = 0x00980912, 0x00980913, 0x009E0903
EXPOSURE_AUTO, EXPOSURE, EXPOSURE_PRIORITY = 0x009A0901, 0x009A0902, 0x009A0903
MANUAL_EXPOSURE = 1
EXPOSURE_UNIT_S = 1e-4


class Taken(NamedTuple):
    """The exposure and gain that a camera took after an order."""

    exposure_s: float
    remark: str | None  # text on the setting that it refused; None: it took both


def carry_out(node: VideoNode, order: ExposureOrder, gain_most: float, longest_s: float) -> Taken:
    """Set exposure and gain manually; return the values that the camera took.

    The exposure is rounded down to whole units, and the gain makes up for the difference. A camera
    that has no gain, or refuses it, exposes longer instead. Blocks for some tens of milliseconds.

    Args:
        node: the camera.
        order: exposure and gain ordered.
        gain_most: brightness at the highest gain divided by that at the lowest. The gain's steps
            are assumed to be equal in stops; if they are not, the next pictures correct that.
        longest_s: longest exposure that the picture rate allows, s.

    Raises:
        OSError: the kernel reports an error.
    """
    _range(node, EXPOSURE)  # a camera that lacks this control keeps its automatic exposure
    if node.range(EXPOSURE_AUTO) is not None:
        _set(node, EXPOSURE_AUTO, MANUAL_EXPOSURE)
    if node.range(AUTOGAIN) is not None:
        _set(node, AUTOGAIN, 0)
    amount = order.time_s * order.gain
    gain = GAIN if node.range(GAIN) is not None else ANALOGUE_GAIN
    limits = node.range(gain)
    if limits is None:
        return Taken(_expose(node, min(amount, longest_s)), None)
    taken_s = _expose(node, min(order.time_s, longest_s))
    left = min(max(amount / taken_s, 1.0), gain_most)
    share = math.log(left) / math.log(gain_most)
    try:
        _set(node, gain, round(limits.low + share * (limits.high - limits.low)))
    except OSError as e:
        if e.errno == errno.ENODEV:
            raise
        remark = f"gain: it takes no orders, so it is exposed longer: {e.strerror or e}"
        return Taken(_expose(node, min(amount, longest_s)), remark)
    return Taken(taken_s, None)


def _expose(node: VideoNode, wanted_s: float) -> float:
    """Set the exposure, rounded down to whole units; return the exposure taken, s."""
    units = max(1, math.floor(wanted_s / EXPOSURE_UNIT_S + 1e-6))
    return EXPOSURE_UNIT_S * max(1, _set(node, EXPOSURE, units))


def _set(node: VideoNode, control: int, value: int) -> int:
    """Set a control to the nearest value allowed; return the value taken."""
    limits = _range(node, control)
    return node.set_control(control, min(max(value, limits.low), limits.high))


def _range(node: VideoNode, control: int) -> Range:
    limits = node.range(control)
    if limits is None:
        raise OSError(errno.EINVAL, "it has no such control")
    return limits
