"""WhyCodes: rings whose inner edge tells a number and a direction.

A dark ring with a bright core is looked for as a plain ring is. Under both poses of its outline
the code band is read in the ring's own plane, so neither perspective nor lens distortion bends it;
what does not carry a code of the pad is none of its rings. Then the whole print, its turn now
known, is fitted to the pixels from both poses: the teeth, too long on one side and too short on the
other under the wrong one, tell which is true.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.pad import PadLayout, WhyCode, rotated
from landerd.vision.expected import Expected
from landerd.vision.pose import (
    EQUAL_NORMALS_COS,
    MIN_DEPTH_M,
    SAME_SOLUTION_COS,
    Pose,
    rotation_from,
    turned_about_normal,
)
from landerd.vision.print_fit import MIN_EXPLAINED, Fit
from landerd.vision.pyramid import SMALL_PX, levels
from landerd.vision.ring_pose import mirrored, poses_through
from landerd.vision.ring_segment import Look, dark_by_mean, ring_candidates
from landerd.vision.whycode_print import WhyCodePrint

Image = NDArray[np.uint8]

_PLAIN_RATIO = 0.4685  # of a plain ring whose black has the same second moments over its area
_SEGMENTATIONS = (dark_by_mean(0.65), dark_by_mean(0.88))
_CLEAR_SHARE = 0.9  # of a ring's spokes from which it is read at once: plain ones gave 1.0
_MAX_LATER = 8  # of the others that are read, of a whole image
_SAMPLES_PER_BIT = 16  # samples of the band along a cell
_BAND_RADII = (0.40, 0.4715, 0.543)  # of the circles on which the band is read, in outer radii
_SINE = np.sin((np.arange(_SAMPLES_PER_BIT) + 0.5) * (2.0 * math.pi / _SAMPLES_PER_BIT))
_HALVES = _SINE * (2.0 / float(np.abs(_SINE).sum()))  # weights: first half of a cell less second
# Limits by trial on the images of `bench.vision_whycode`.
_MIN_CONTRAST = 12.0  # along the band, grey levels
_MIN_MEAN_DIFFERENCE = 0.4  # between a bit's halves, over the contrast along the band
_MIN_DECISION_MARGIN = 0.45  # a code read under the mirrored pose gave 0.5 to 0.6, the true one 0.9
_LARGE_CODE_PX = 60.0  # across: a code this large tells all that smaller ones could
_MIN_CODE_PX = 9.0  # across; smaller rings have no teeth to be seen


@dataclass(frozen=True)
class FoundCode:
    """A WhyCode of the pad seen in an image."""

    code: WhyCode
    poses: tuple[Pose, ...]  # one or two, best first; the print's top is their x axis


@dataclass(frozen=True)
class Reading:
    """What a code band says, read in the frame of some pose."""

    word: int
    first_bit_angle: float  # where it begins, anticlockwise from the frame's east, rad
    decision_margin: float  # of the least clear bit: the difference of its halves, over the mean


class WhyCodeFinder:
    """Finds the WhyCodes of one pad in the images of one camera; other numbers are not reported."""

    def __init__(self, layout: PadLayout, camera: CameraModel) -> None:
        """Prepare the prints of a pad's codes."""
        self._camera = camera
        self._focal = 0.5 * (camera.fx + camera.fy)
        codes = sorted(layout.whycodes, key=lambda c: -c.outer_diameter_m)
        self._prints = {code: WhyCodePrint(code) for code in codes}

    def find(
        self,
        image: Image,
        expected: Expected | None,
        last_normal: Vec3 | None,
    ) -> list[FoundCode]:
        """Return the pad's codes: first where they are expected, then anywhere.

        Args:
            image: grey image (height, width).
            expected: where the pad should be.
            last_normal: into the pad as the frame before told it, camera frame; a pose that agrees
                needs no second one beside it.
        """
        if not self._prints:
            return []
        found: list[FoundCode] = []
        if expected is not None and expected.north is not None:
            for code in self._prints:
                size = self._size_px(code, _as_expected(code, expected))
                if size < _MIN_CODE_PX:
                    continue
                starts = (_as_expected(code, e) for e in expected.starts(code))
                tried = (self._poses(image, code, start, last_normal) for start in starts)
                poses = next((p for p in tried if p), None)
                if poses:
                    found.append(FoundCode(code, poses))
                    if size > _LARGE_CODE_PX:
                        break
        return found or self._anywhere(image, last_normal)

    def _anywhere(self, image: Image, last_normal: Vec3 | None) -> list[FoundCode]:
        """Look in ever larger images; return the codes of the first that shows any.

        What is not clearly bright, dark and bright comes last, the likeliest first and only so
        much of it, whatever there is in the image.
        """
        later: list[tuple[float, float, F64]] = []
        parts = list(levels(image, self._camera, None, None))
        fine = [level for level in parts if level.largest_px <= SMALL_PX]
        coarse = [level for level in parts if level.largest_px > SMALL_PX]
        # The largest image takes most of the time, and the higher threshold shows more.
        first, second = _SEGMENTATIONS
        for some, segment in ((coarse, first), (coarse, second), (fine, second)):
            looks = [Look(level.image, segment(level.image), level.largest_px) for level in some]
            of_looks = ring_candidates(looks, _PLAIN_RATIO)
            for level, candidates in zip(some, of_looks, strict=True):
                clear = []
                for c in candidates:
                    outline = (c.outline.points() + 0.5) * level.reduction - 0.5
                    if c.share >= _CLEAR_SHARE:
                        clear.append(outline)
                    else:
                        later.append((-c.share, -c.score, outline))
                found = self._among(image, clear, last_normal)
                if found:
                    return found
        later.sort(key=lambda one: one[:2])
        return self._among(image, [outline for *_, outline in later[:_MAX_LATER]], last_normal)

    def _among(
        self, image: Image, outlines: list[F64], last_normal: Vec3 | None
    ) -> list[FoundCode]:
        """Return the pad's codes among outlines (16, 2), px."""
        found: dict[WhyCode, tuple[Pose, ...]] = {}
        for outline in outlines:
            start = self._recognised(image, outline)
            if start is not None and start[0] not in found:
                poses = self._poses(image, *start, last_normal)
                if poses:
                    found[start[0]] = poses
        return [FoundCode(code, poses) for code, poses in found.items()]

    def _recognised(self, image: Image, outline: F64) -> tuple[WhyCode, Pose] | None:
        """Return the code that an outline carries, and its pose; None if it carries none."""
        poses = poses_through(self._camera.rays(outline), 1.0)
        best: tuple[float, WhyCode, Pose] | None = None
        for bits in {c.bits for c in self._prints}:
            # Under the wrong one of the two poses another number may be read, less clearly.
            readings = []
            for position, normal in poses or ():
                R = rotation_from(normal, np.array([0.0, -1.0, 0.0]))
                pose = Pose(R, position, np.zeros((6, 6)), 0.0)
                reading = read(image, self._camera, pose, 1.0, bits)
                if reading is not None:
                    readings.append((reading, pose))
            if not readings:
                continue
            reading, pose = max(readings, key=lambda r: r[0].decision_margin)
            for code in self._prints:
                turn = _top_angle(reading, code)
                if (
                    code.bits == bits
                    and turn is not None
                    and (best is None or reading.decision_margin > best[0])
                ):
                    t = code.radius_m * pose.t
                    start = Pose(turned_about_normal(pose.R, turn), t, pose.information, 0.0)
                    best = reading.decision_margin, code, start
        return best[1:] if best else None

    def _poses(
        self,
        image: Image,
        code: WhyCode,
        start: Pose,
        last_normal: Vec3 | None,
    ) -> tuple[Pose, ...]:
        """Return the poses of a code near a start, best first; empty if it is not there."""
        printed, camera = self._prints[code], self._camera
        fits = [f for f in [printed.fit(image, camera, start)] if f is not None]
        if not fits or fits[0].explained < MIN_EXPLAINED:
            return ()
        if last_normal is None or fits[0].pose.normal @ np.array(last_normal) < SAME_SOLUTION_COS:
            other = mirrored_pose(fits[0].pose, code.radius_m)
            fit = None if other is None else printed.fit(image, camera, other)
            if fit is not None and fit.pose.normal @ fits[0].pose.normal < EQUAL_NORMALS_COS:
                fits.append(fit)
        printed.remember(min(fits, key=lambda f: f.variance))
        poses = _ranked(fits)
        return poses if self._carries(image, code, poses[0]) else ()

    def _carries(self, image: Image, code: WhyCode, pose: Pose) -> bool:
        """Tell whether the band under a pose reads as the code, not turned."""
        reading = read(image, self._camera, pose, code.radius_m, code.bits)
        turn = None if reading is None else _top_angle(reading, code)
        return turn is not None and abs(turn) < math.pi / (2 * code.bits)

    def _size_px(self, code: WhyCode, pose: Pose) -> float:
        """Return a code's diameter in the image."""
        return self._focal * code.outer_diameter_m / max(float(pose.t[2]), MIN_DEPTH_M)


def read(image: Image, camera: CameraModel, pose: Pose, radius: float, bits: int) -> Reading | None:
    """Return what the code band of a ring at a pose says; None if it says nothing clear.

    Each bit is the difference of its cell's halves. A wrong beginning is half a cell off: then
    cells of two unlike neighbours have halves alike, so the sum of all differences is less.

    Args:
        image: grey image (height, width).
        camera: the lens.
        pose: of the ring; its x axis is the north that angles count from.
        radius: of the ring's outer edge, m.
        bits: cells in the band.
    """
    level = _band(image, camera, pose, radius, bits * _SAMPLES_PER_BIT)
    contrast = 0.0 if level is None else float(np.ptp(level))
    if level is None or contrast < _MIN_CONTRAST:
        return None
    turned = np.stack([np.roll(level, -s) for s in range(_SAMPLES_PER_BIT)])
    cells = turned.reshape(_SAMPLES_PER_BIT, bits, _SAMPLES_PER_BIT)
    differences = -(cells @ _HALVES)  # bright after dark: a 0
    total = np.abs(differences).sum(axis=1)
    best = int(np.argmax(total))
    mean = float(total[best]) / bits
    least = float(np.abs(differences[best]).min()) / max(mean, 1e-9)
    if mean < _MIN_MEAN_DIFFERENCE * contrast or least < _MIN_DECISION_MARGIN:
        return None
    word = 0
    for difference in differences[best]:
        word = word * 2 + int(difference < 0.0)
    return Reading(word, best * 2.0 * math.pi / len(level), least)


def _band(
    image: Image, camera: CameraModel, pose: Pose, radius: float, samples: int
) -> NDArray[np.floating] | None:
    """Return the grey level along a code band (samples,); None if not all of it is in the image.

    From the east of the pose's frame, anticlockwise.
    """
    a = (np.arange(samples) + 0.5) * (2.0 * math.pi / samples)
    directions = np.column_stack([np.sin(a), np.cos(a)]) @ pose.R[:, :2].T
    points = pose.t + (radius * np.array(_BAND_RADII))[:, None, None] * directions
    if points[..., 2].min() < 0.02 * radius:
        return None
    px = camera.pixels(points.reshape(-1, 3)).astype(np.float32)
    if not (px.min() >= 0.0 and (px <= (camera.width - 1, camera.height - 1)).all()):
        return None
    grey = cv2.remap(image, px[None, :, 0], px[None, :, 1], cv2.INTER_LINEAR)
    level: NDArray[np.floating] = grey.reshape(len(_BAND_RADII), samples).mean(axis=0)
    return level


def _top_angle(reading: Reading, code: WhyCode) -> float | None:
    """Return the angle of the code's top, clockwise from the frame's north; None: another code."""
    for n in range(code.bits):
        if rotated(reading.word, code.bits, n) == code.id:
            turn = -(reading.first_bit_angle + n * 2.0 * math.pi / code.bits)
            return math.remainder(turn, 2.0 * math.pi)
    return None


def _ranked(fits: list[Fit]) -> tuple[Pose, ...]:
    """Return the poses, best first; its cost is 0, another's how much worse it explains a pixel.

    The fits are of pixels that differ a little, so their sums cannot be compared.
    """
    fits = sorted(fits, key=lambda f: f.variance)
    pixels = fits[0].squares / fits[0].variance
    return tuple(
        Pose(
            f.pose.R,
            f.pose.t,
            f.pose.information,
            pixels * (f.variance / fits[0].variance - 1.0),
        )
        for f in fits
    )


def mirrored_pose(pose: Pose, radius: float) -> Pose | None:
    """Return the other pose whose outline is the same ellipse, its top at the same pixel."""
    other = mirrored(pose.t, pose.normal, radius)
    if other is None:
        return None
    t, normal = other
    sight = pose.t + radius * pose.R[:, 0]
    top = sight * (float(normal @ t) / float(normal @ sight))
    return Pose(rotation_from(normal, top - t), t, pose.information, 0.0)


def _as_expected(code: WhyCode, expected: Expected) -> Pose:
    """Return the pose of a code on a pad whose heading is known."""
    assert expected.north is not None
    R = rotation_from(expected.normal, expected.north)
    t = expected.position + R[:, :2] @ np.array(code.position_m)
    return Pose(turned_about_normal(R, math.radians(code.heading_deg)), t, np.zeros((6, 6)), 0.0)
