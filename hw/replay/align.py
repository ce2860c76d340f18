"""Finds when a video began by what its pictures do when the vehicle turns."""

import math
from collections.abc import Callable, Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.geometry import Mat3, rotate, transpose
from landerd.messages import Frame

RATE_HZ = 20.0
WIDTH = 160  # px that pictures are compared at
SURE = 0.4  # correlation below this is none
F64 = NDArray[np.float64]


def picture_motion(frames: Iterable[Frame], focal_px: float) -> tuple[F64, F64]:
    """Return times (n,) and the scene's apparent motion (n, 2), rad/s right and down in the image.

    Args:
        frames: a video's, in order.
        focal_px: of the camera at the frames' size.
    """
    times, motion = [], []
    last: tuple[float, F64] | None = None
    window: F64 | None = None
    for frame in frames:
        height, width = frame.image.shape
        size = (WIDTH, max(2, round(height * WIDTH / width)))
        small = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA).astype(np.float64)
        if window is None:
            window = np.asarray(cv2.createHanningWindow(size, cv2.CV_64F))
        if last is not None and frame.t > last[0]:
            (dx, dy), _ = cv2.phaseCorrelate(last[1], small, window)
            dt, k = frame.t - last[0], width / WIDTH / focal_px
            times.append(0.5 * (frame.t + last[0]))
            motion.append((k * dx / dt, k * dy / dt))
        last = (frame.t, small)
    return np.array(times), np.array(motion).reshape(-1, 2)


def turning_motion(look: Callable[[float], Mat3 | None], start: float, end: float) -> F64:
    """Return how a distant scene moves in the image (n, 2), rad/s, at RATE_HZ from start to end.

    Args:
        look: R_local_camera at a time; None where it is not known.
        start: s.
        end: s.
    """
    step = 1.0 / RATE_HZ
    motion = np.zeros((max(1, int((end - start) * RATE_HZ)), 2))
    for i in range(len(motion)):
        a, b = look(start + i * step), look(start + (i + 1) * step)
        if a is not None and b is not None:
            x, y, z = rotate(transpose(b), rotate(a, (0.0, 0.0, 1.0)))
            motion[i] = (math.atan2(x, z) / step, math.atan2(y, z) / step)
    return motion


def find_offset(times: F64, seen: F64, turned: F64) -> tuple[float, float]:
    """Return when the video begins, s after the log's beginning, and how well they correlate.

    At least half of the shorter one must overlap.

    Args:
        times: of the motion seen, s from the video's beginning.
        seen: motion in the pictures, rad/s.
        turned: motion expected from the log, at RATE_HZ from its beginning.
    """
    grid = np.arange(0.0, float(times[-1]), 1.0 / RATE_HZ)
    video = np.stack([np.interp(grid, times, seen[:, i]) for i in (0, 1)], axis=1)
    video, log = _steady(video), _steady(turned)
    least = min(len(video), len(log)) // 2
    cross = sum(np.correlate(log[:, i], video[:, i], "full") for i in (0, 1))
    overlap = np.correlate(np.ones(len(log)), np.ones(len(video)), "full")
    log_energy = np.correlate((log**2).sum(axis=1), np.ones(len(video)), "full")
    video_energy = np.correlate(np.ones(len(log)), (video**2).sum(axis=1), "full")
    norm = np.sqrt(np.maximum(log_energy * video_energy, 1e-12))
    score = np.where(overlap >= least, cross / norm, -1.0)
    best = int(np.argmax(score))
    part = 0.0
    if 0 < best < len(score) - 1:  # the parabola through the three highest
        a, b, c = score[best - 1 : best + 2]
        bend = a - 2.0 * b + c
        part = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
    lag = best + part - (len(video) - 1)
    return lag / RATE_HZ, float(score[best])


def _steady(motion: F64) -> F64:
    """Take slow motion out, which is the vehicle's way and not its turning; limit the largest."""
    length = int(2.0 * RATE_HZ)
    kernel = np.ones(length) / length
    slow = np.stack([np.convolve(motion[:, i], kernel, "same") for i in (0, 1)], axis=1)
    fast = motion[: len(slow)] - slow[: len(motion)]
    limit = 4.0 * float(np.median(np.abs(fast))) + 1e-3
    return np.asarray(np.clip(fast, -limit, limit))
