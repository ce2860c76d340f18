"""WhyCodes: rings whose toothed inner edge encodes a number and a direction.

The marker is that of Krajnik et al. (see `pad.WhyCode`). Its search is not under `search_policy`:

1. Where the pad and its heading are known, each code is fitted where it is expected.
2. Else outlines of dark rings with a bright core are found as those of plain rings are
   (`ring_segment`). Under both poses of an outline the code band is read in the ring's own plane,
   where neither perspective nor lens distortion bends it. Outlines without a code of the pad are
   dropped.
3. The whole print (`whycode_print`), whose heading is now known, is fitted to the pixels from both
   poses. Under the wrong one teeth are too long on one side and too short on the other: that tells
   which is true.
4. If the pixels are not as even light would make them, the edges of teeth and outline
   (`whycode_edges`) are fitted instead.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.messages import EDGES, GREY
from landerd.pad import PadLayout, WhyCode, rotated, whycode_ids
from landerd.vision.arrays import Image
from landerd.vision.expected import Expected
from landerd.vision.patch import levels_at
from landerd.vision.pose import (
    MIN_DEPTH_M,
    SAME_SOLUTION_COS,
    Pose,
    rotation_from,
    turned_about_normal,
)
from landerd.vision.print_edges import best_supported, ranked_by_edges
from landerd.vision.print_fit import MIN_EXPLAINED, Fit, per_pixel, ranked
from landerd.vision.pyramid import levels
from landerd.vision.ring_pose import mirrored, poses_through
from landerd.vision.ring_segment import (
    LARGE_STROKE_PX,
    STROKE_PX,
    Candidate,
    Look,
    dark_between,
    dark_by_mean,
    ring_candidates,
)
from landerd.vision.whycode_edges import whycode_edges
from landerd.vision.whycode_print import WhyCodePrint, bits_of

# ---- outlines ----------------------------------------------------------------------------------
# Ratio of the plain ring whose black has the same second moments over its area as a WhyCode's.
_PLAIN_RATIO = 0.4685
_LARGE, _OTHERS = dark_between(LARGE_STROKE_PX), dark_between(STROKE_PX)
_WIDE = dark_by_mean(0.88)
# Share of a ring's spokes that are bright, dark and bright from which on it is read at once: plain
# rings gave 1.0.
_CLEAR_SHARE = 0.9
_MAX_LATER = 8  # how many of the other outlines of a whole image are read
_MAX_UNCLEAR = 2  # how many rings that are like a code, but not readable, are fitted
_LARGE_CODE_PX = 60.0  # diameter: a code this large tells all that smaller ones could
_MIN_CODE_PX = 9.0  # diameter: teeth of smaller codes cannot be seen

# ---- reading the band --------------------------------------------------------------------------
_SAMPLES_PER_BIT = 16  # samples of the band along the cell of one bit
_BAND_RADII = (0.40, 0.4715, 0.543)  # of the circles on which the band is read, in outer radii
_SINE = np.sin((np.arange(_SAMPLES_PER_BIT) + 0.5) * (2.0 * math.pi / _SAMPLES_PER_BIT))
_HALVES = _SINE * (2.0 / float(np.abs(_SINE).sum()))  # weights: first half of a cell less second
# Limits by trial on the images of `bench.vision_whycode`.
_MIN_CONTRAST = 12.0  # along the band, grey levels
_MIN_MEAN_DIFFERENCE = 0.4  # mean difference of the bits' halves, over the contrast along the band
# Least difference of a bit's halves over the mean: a code read under the mirrored pose gave 0.5 to
# 0.6, under the true one 0.9.
_MIN_DECISION_MARGIN = 0.45
_CLEAR_MARGIN = 0.7  # the same of codes that are not the pad's, which nothing else confirms
# A code of which dirt, a leg or blur hides a bit cannot be read, but it may agree with a number of
# the pad. Agreement is how much the halves of a bit differ in the right sense, over the contrast
# along the band; limits of its mean over all bits, of the least bit of a code that was found, and
# of the least bit of one that is known to be there. A ring without code has a mean of 0, one of
# another number has a bit at -0.6; blurred codes of 25 to 30 px had means of 0.4 to 0.5 and a least
# bit of -0.04, where one in ten could be read. It is computed from logarithms of the levels plus
# the last, so that shade does not matter.
_MIN_AGREEMENT, _MIN_BIT_FOUND, _MIN_BIT_KNOWN, _DARK = 0.35, 0.05, -0.15, 10.0
# Share of a bit's cell that must be in the image, and share of such bits of a code known to be
# there: just over the pad the image cuts the band.
_MIN_IN_VIEW = 0.5

# ---- fits --------------------------------------------------------------------------------------
# Share of the pixels' variance that the fit of a code known to be there must explain: small and
# dim, more of it is noise. Of 61 pictures of a code at 9 to 16 m 46 were found (28 with
# `MIN_EXPLAINED`), off by 1.8 % of the range at most; of 295 other places in them none.
_MIN_KNOWN_EXPLAINED = 0.7
# The same for any code if the residuals are noise: neighbours correlate by less than the second.
# Dim codes of 24 to 30 px, at 14 to 17 m, gave 0.63 to 0.78 and 0.0.
_MIN_NOISY_EXPLAINED, _NOISE_CORRELATION = 0.6, 0.15


@dataclass(frozen=True)
class FoundCode:
    """A WhyCode of the pad seen in an image."""

    code: WhyCode
    poses: tuple[Pose, ...]  # one or two, best first; the print's top is their x axis
    stage: str = GREY  # or by what else it was fitted


@dataclass(frozen=True)
class Reading:
    """A code band as read in the frame of a pose."""

    word: int  # bits in the order read, the first one highest
    first_bit_angle: float  # where the word begins, anticlockwise from the frame's east, rad
    decision_margin: float  # of the least clear bit: difference of its halves, over the mean


@dataclass(frozen=True)
class _Start:
    """A code and a pose to start its fit from."""

    clarity: float  # decision margin of its reading, or else mean agreement (`_alike`)
    code: WhyCode
    pose: Pose


class WhyCodeFinder:
    """Finds the WhyCodes of one pad in the images of one camera; other numbers are not reported."""

    def __init__(self, layout: PadLayout, camera: CameraModel) -> None:
        """Prepare the prints of a pad's codes."""
        self._camera = camera
        codes = sorted(layout.whycodes, key=lambda c: -c.outer_diameter_m)
        self._prints = {code: WhyCodePrint(code) for code in codes}
        self._edges = {code: whycode_edges(code) for code in codes}

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
                tried = (
                    self._fitted(image, code, start, last_normal, is_known=True) for start in starts
                )
                one = next((f for f in tried if f is not None), None)
                if one is not None:
                    found.append(one)
                    if size > _LARGE_CODE_PX:
                        break
        return found or self._anywhere(image, last_normal)

    def _anywhere(self, image: Image, last_normal: Vec3 | None) -> list[FoundCode]:
        """Search ever larger levels of the image; return the codes of the first that shows any.

        Outlines that are not clear come last, the likeliest first, and only a fixed number of them,
        whatever is in the image.
        """
        later: list[tuple[float, float, F64]] = []
        unclear: list[_Start] = []
        for of_level in _outlines(image, self._camera):
            clear = [outline for c, outline in of_level if c.share >= _CLEAR_SHARE]
            later += [
                (-c.share, -c.score, outline) for c, outline in of_level if c.share < _CLEAR_SHARE
            ]
            found = self._among(image, clear, last_normal, unclear)
            if found:
                return found
        later.sort(key=lambda one: one[:2])
        rest = [outline for *_, outline in later[:_MAX_LATER]]
        found = self._among(image, rest, last_normal, unclear)
        return found or self._of_unclear(image, unclear, last_normal)

    def _among(
        self, image: Image, outlines: list[F64], last_normal: Vec3 | None, unclear: list[_Start]
    ) -> list[FoundCode]:
        """Return the pad's codes that are read in outlines (16, 2), px.

        Of outlines that cannot be read, those that are like a code are added to `unclear`.
        """
        found: dict[WhyCode, FoundCode] = {}
        for outline in outlines:
            rings = _rings(outline, self._camera)
            start = self._read(image, rings)
            if start is None:
                unclear += self._likest(image, rings)
            elif start.code not in found:
                one = self._fitted(image, start.code, start.pose, last_normal)
                if one is not None:
                    found[one.code] = one
        return list(found.values())

    def _of_unclear(
        self, image: Image, unclear: list[_Start], last_normal: Vec3 | None
    ) -> list[FoundCode]:
        """Return the first of the unclear starts, most alike first, that is a code of the pad."""
        tried: list[Pose] = []
        for start in sorted(unclear, key=lambda one: -one.clarity):
            reach = start.code.radius_m
            # The same ring may be seen at several sizes.
            if any(np.linalg.norm(start.pose.t - pose.t) < reach for pose in tried):
                continue
            if len(tried) == _MAX_UNCLEAR:
                break
            tried.append(start.pose)
            found = self._fitted(image, start.code, start.pose, last_normal)
            if found is not None:
                return [found]
        return []

    def _read(self, image: Image, rings: list[Pose]) -> _Start | None:
        """Return the clearest reading under poses of a ring; None: it is no code of the pad."""
        best: _Start | None = None
        for bits in {c.bits for c in self._prints}:
            # Under the wrong one of the two poses another number may be read, less clearly.
            readings = [(read(image, self._camera, pose, 1.0, bits), pose) for pose in rings]
            told = [(reading, pose) for reading, pose in readings if reading is not None]
            if not told:
                continue
            reading, pose = max(told, key=lambda r: r[0].decision_margin)
            for code in self._prints:
                turn = _top_angle(reading, code)
                if code.bits != bits or turn is None:
                    continue
                if best is None or reading.decision_margin > best.clarity:
                    best = _start(reading.decision_margin, code, pose, turn)
        return best

    def _likest(self, image: Image, rings: list[Pose]) -> list[_Start]:
        """Return the code that a ring is most like under its poses, one at most; empty: none."""
        best: _Start | None = None
        for code in self._prints:
            for pose in rings:
                alike = _alike(image, self._camera, pose, 1.0, code)
                if alike is not None and (best is None or alike[0] > best.clarity):
                    best = _start(alike[0], code, pose, alike[1])
        return [] if best is None else [best]

    def _fitted(
        self,
        image: Image,
        code: WhyCode,
        start: Pose,
        last_normal: Vec3 | None,
        *,
        is_known: bool = False,
    ) -> FoundCode | None:
        """Return a code fitted from a start near it; None: it is not there.

        If it is known to be there, it need not be read again.
        """
        by_grey = self._prints[code].fit(image, self._camera, start)
        starts = [start] if by_grey is None else [start, by_grey.pose]
        if by_grey is not None and not _explains(by_grey, is_known=is_known):
            by_grey = None
        if by_grey is None or by_grey.is_shaded:
            if not is_known:  # texture must cost no more than this
                starts = starts[:1] if by_grey is None else starts[1:]
            poses = self._by_edges(image, code, starts, last_normal)
            if poses and (is_known or self._agrees(image, code, poses[0])):
                return FoundCode(code, poses, EDGES)
        if by_grey is not None:
            poses = self._by_grey(image, code, by_grey, last_normal)
            if self._is_its(image, code, poses[0], is_known=is_known):
                return FoundCode(code, poses)
        return None

    def _by_grey(
        self, image: Image, code: WhyCode, first: Fit, last_normal: Vec3 | None
    ) -> tuple[Pose, ...]:
        """Return the poses that explain the pixels, best first: of a first fit and its rival."""
        printed, fits = self._prints[code], [first]
        other = self._rival(code, first.pose, last_normal)
        fit = None if other is None else printed.fit_rival(image, self._camera, other, first)
        if fit is not None:
            fits.append(fit)
        printed.remember(min(fits, key=per_pixel))
        return tuple(ranked(fits))

    def _by_edges(
        self, image: Image, code: WhyCode, starts: Sequence[Pose], last_normal: Vec3 | None
    ) -> tuple[Pose, ...]:
        """Return the poses that explain the edges of the print, best first; empty if none does."""
        edges, camera = self._edges[code], self._camera
        first = best_supported(edges.fit_hidden(image, camera, start) for start in starts)
        if first is None:
            return ()
        other = self._rival(code, first.pose, last_normal)
        fit = None if other is None else edges.fit(image, camera, other)
        return tuple(ranked_by_edges([first] if fit is None else [first, fit]))

    def _rival(self, code: WhyCode, pose: Pose, last_normal: Vec3 | None) -> Pose | None:
        """Return the start for the mirrored pose; None: the last normal rules that out."""
        if last_normal is not None and pose.normal @ np.array(last_normal) > SAME_SOLUTION_COS:
            return None
        return mirrored_pose(pose, code.radius_m)

    def _is_its(self, image: Image, code: WhyCode, pose: Pose, *, is_known: bool) -> bool:
        """Tell whether a code is seen under a pose.

        It is if its number can be read, or if it agrees and is either known to be there or shows no
        edges but its own.
        """
        if self._carries(image, code, pose):
            return True
        if is_known:
            return _agrees_in_view(image, self._camera, pose, code)
        if not self._agrees(image, code, pose):
            return False
        return self._edges[code].fit_hidden(image, self._camera, pose) is not None

    def _carries(self, image: Image, code: WhyCode, pose: Pose) -> bool:
        """Tell whether the band under a pose reads as the code, not turned."""
        reading = read(image, self._camera, pose, code.radius_m, code.bits)
        turn = None if reading is None else _top_angle(reading, code)
        return turn is not None and abs(turn) < math.pi / (2 * code.bits)

    def _agrees(self, image: Image, code: WhyCode, pose: Pose) -> bool:
        """Tell whether the band under a pose agrees with the code, though it may be unreadable."""
        alike = _alike(image, self._camera, pose, code.radius_m, code)
        return alike is not None and abs(alike[1]) < math.pi / (2 * code.bits)

    def _size_px(self, code: WhyCode, pose: Pose) -> float:
        """Return a code's diameter in the image."""
        return self._camera.focal * code.outer_diameter_m / max(float(pose.t[2]), MIN_DEPTH_M)


def _outlines(image: Image, camera: CameraModel) -> Iterator[list[tuple[Candidate, F64]]]:
    """Yield what may be rings in ever larger levels of an image: their outlines (16, 2), px."""
    parts = list(levels(image, camera, None, None))
    coarse, fine = parts[:-1] or parts, parts[-1:]
    # The largest image takes most of the time.
    for some, segment in ((coarse, None), (coarse, _WIDE), (fine, None)):
        looks = []
        for level in some:
            way = segment or (_LARGE if math.isinf(level.largest_px) else _OTHERS)
            looks.append(Look(level.image, way(level.image), level.largest_px))
        for level, candidates in zip(some, ring_candidates(looks, _PLAIN_RATIO), strict=True):
            yield [(c, (c.outline.points() + 0.5) * level.reduction - 0.5) for c in candidates]


def _rings(outline: F64, camera: CameraModel) -> list[Pose]:
    """Return the poses of a ring of radius 1 with an outline (16, 2), px; their north is up."""
    rings = []
    for position, normal in poses_through(camera.rays(outline), 1.0) or ():
        R = rotation_from(normal, np.array([0.0, -1.0, 0.0]))
        rings.append(Pose(R, position, np.zeros((6, 6)), 0.0))
    return rings


def codes_read(image: Image, camera: CameraModel, bits: Collection[int]) -> dict[WhyCode, F64]:
    """Return the codes of any number that are clear to read in an image, and their outlines, px.

    They are read only, not fitted; their diameter is given as 1 m.

    Args:
        image: grey image (height, width).
        camera: the lens.
        bits: numbers of cells that a band may have.
    """
    found: dict[WhyCode, F64] = {}
    for of_level in _outlines(image, camera):
        for candidate, outline in of_level:
            if candidate.share < _CLEAR_SHARE:
                continue
            readings = [
                (reading.decision_margin, reading.word, n)
                for pose in _rings(outline, camera)
                for n in bits
                if (reading := read(image, camera, pose, 1.0, n)) is not None
                and reading.decision_margin > _CLEAR_MARGIN
            ]
            if not readings:
                continue
            _, word, n = max(readings)
            number = min(rotated(word, n, by) for by in range(n))
            if number in whycode_ids(n):
                code = WhyCode(kind="whycode", outer_diameter_m=1.0, bits=n, id=number)
                found.setdefault(code, outline)
    return found


def read(image: Image, camera: CameraModel, pose: Pose, radius: float, bits: int) -> Reading | None:
    """Return the reading of a ring's code band under a pose; None: it is not clear.

    Args:
        image: grey image (height, width).
        camera: the lens.
        pose: of the ring; its x axis is the north that angles count from.
        radius: of the ring's outer edge, m.
        bits: cells in the band.
    """
    level = _whole_band(image, camera, pose, radius, bits * _SAMPLES_PER_BIT)
    if level is None:
        return None
    differences, first = _differences(level)
    mean = float(np.abs(differences).mean())
    least = float(np.abs(differences).min()) / max(mean, 1e-9)
    if mean < _MIN_MEAN_DIFFERENCE * float(np.ptp(level)) or least < _MIN_DECISION_MARGIN:
        return None
    word = 0
    for difference in differences:
        word = word * 2 + int(difference < 0.0)  # bright after dark: a 0
    return Reading(word, first * 2.0 * math.pi / len(level), least)


def _start(clarity: float, code: WhyCode, ring: Pose, turn: float) -> _Start:
    """Return the start for a code on a ring of radius 1, turned (rad) to the code's top."""
    R, t = turned_about_normal(ring.R, turn), code.radius_m * ring.t
    return _Start(clarity, code, Pose(R, t, ring.information, 0.0))


def _alike(
    image: Image, camera: CameraModel, pose: Pose, radius: float, code: WhyCode
) -> tuple[float, float] | None:
    """Return how well a ring's band agrees with a code, and the angle of the code's top, rad.

    The angle is clockwise from the frame's north. None: the band is not like the code.

    Args:
        image: grey image (height, width).
        camera: the lens.
        pose: of the ring; its x axis is the north that angles count from.
        radius: of the ring's outer edge, m.
        code: that may be there.
    """
    level = _whole_band(image, camera, pose, radius, code.bits * _SAMPLES_PER_BIT)
    if level is None:
        return None
    light = np.log(level + _DARK)
    differences, first = _differences(light)
    turned = _turned(differences, code.bits)
    agreement = np.where(bits_of(code), -turned, turned) / float(np.ptp(light))
    mean = agreement.mean(axis=1)
    n = int(np.argmax(mean))
    if mean[n] < _MIN_AGREEMENT or agreement[n].min() < _MIN_BIT_FOUND:
        return None
    turn = -2.0 * math.pi * (first / len(level) + n / code.bits)
    return float(mean[n]), math.remainder(turn, 2.0 * math.pi)


def _agrees_in_view(image: Image, camera: CameraModel, pose: Pose, code: WhyCode) -> bool:
    """Tell whether those bits of a code that are in the image agree with it under its pose."""
    levels = _band(image, camera, pose, code.radius_m, code.bits * _SAMPLES_PER_BIT)
    if levels is None:
        return False
    # The mean of those circles that are in the image, NaN where none is.
    count = (~np.isnan(levels)).sum(axis=0)
    level = np.where(count, np.nansum(levels, axis=0) / np.maximum(count, 1), np.nan)
    if not _has_contrast(level[count > 0]):
        return False
    light = np.log(level + _DARK).reshape(code.bits, _SAMPLES_PER_BIT)
    half = _SAMPLES_PER_BIT // 2
    # Samples of a cell's first half less those as far from its middle in the second.
    steps = light[:, :half] - light[:, : -half - 1 : -1]
    is_in = ~np.isnan(steps)
    share = is_in @ _HALVES[:half]
    is_told = share > _MIN_IN_VIEW
    if np.mean(is_told) < _MIN_IN_VIEW:
        return False
    mean = (np.where(is_in, steps, 0.0) @ _HALVES[:half])[is_told] / share[is_told]
    agreement = np.where(bits_of(code)[is_told], mean, -mean) / np.ptp(light[~np.isnan(light)])
    return bool(agreement.mean() >= _MIN_AGREEMENT and agreement.min() >= _MIN_BIT_KNOWN)


def _differences(level: NDArray[np.floating]) -> tuple[F64, int]:
    """Return by how much the second half of each bit is brighter, (bits,), and where bits begin.

    Each bit is the difference of its cell's halves. If the beginning is off by half a cell, cells
    between unlike neighbours have equal halves: the sum of all differences is smaller then.

    Args:
        level: along the band, (bits * _SAMPLES_PER_BIT,).
    """
    turned = _turned(level, _SAMPLES_PER_BIT)
    differences: F64 = -(turned.reshape(_SAMPLES_PER_BIT, -1, _SAMPLES_PER_BIT) @ _HALVES)
    first = int(np.argmax(np.abs(differences).sum(axis=1)))
    return differences[first], first


def _turned(values: NDArray[np.floating], turns: int) -> NDArray[np.floating]:
    """Return values (n,) round a circle as they begin at the first, second, ... one, (turns, n)."""
    n = len(values)
    turned: NDArray[np.floating] = values[(np.arange(turns)[:, None] + np.arange(n)) % n]
    return turned


def _whole_band(
    image: Image, camera: CameraModel, pose: Pose, radius: float, samples: int
) -> NDArray[np.floating] | None:
    """Return the mean grey level along a code band (samples,), see `_band`.

    None: it is not wholly in the image, or too even to be one.
    """
    levels = _band(image, camera, pose, radius, samples)
    if levels is None or np.isnan(levels).any():
        return None
    level: NDArray[np.floating] = levels.mean(axis=0)
    return level if _has_contrast(level) else None


def _has_contrast(levels: NDArray[np.floating]) -> bool:
    """Tell whether grey levels differ enough to be those of a code band."""
    return levels.size > 0 and float(np.ptp(levels)) >= _MIN_CONTRAST


def _band(
    image: Image, camera: CameraModel, pose: Pose, radius: float, samples: int
) -> NDArray[np.floating] | None:
    """Return grey levels on circles along a code band (circles, samples), NaN out of the image.

    Samples go anticlockwise from the frame's east. None: the band reaches behind the lens.
    """
    a = (np.arange(samples) + 0.5) * (2.0 * math.pi / samples)
    directions = np.column_stack([np.sin(a), np.cos(a)]) @ pose.R[:, :2].T
    points = pose.t + (radius * np.array(_BAND_RADII))[:, None, None] * directions
    if points[..., 2].min() < 0.02 * radius:
        return None
    levels: NDArray[np.floating] = levels_at(image, camera, points.reshape(-1, 3))
    return levels.reshape(len(_BAND_RADII), samples)


def _top_angle(reading: Reading, code: WhyCode) -> float | None:
    """Return the angle of the code's top, clockwise from the frame's north; None: another code."""
    for n in range(code.bits):
        if rotated(reading.word, code.bits, n) == code.id:
            turn = -(reading.first_bit_angle + n * 2.0 * math.pi / code.bits)
            return math.remainder(turn, 2.0 * math.pi)
    return None


def _explains(fit: Fit, *, is_known: bool) -> bool:
    """Tell whether a fit explains as much of the pixels' variance as noise and light allow."""
    if fit.correlation < _NOISE_CORRELATION and fit.explained > _MIN_NOISY_EXPLAINED:
        return True
    is_known = is_known and not fit.darkens  # else dirt is taken for the code
    return fit.explained >= (_MIN_KNOWN_EXPLAINED if is_known else MIN_EXPLAINED)


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
    """Return the pose of a code on an expected pad whose heading is known."""
    assert expected.north is not None
    R = rotation_from(expected.normal, expected.north)
    t = expected.position + R[:, :2] @ np.array(code.position_m)
    return Pose(turned_about_normal(R, math.radians(code.heading_deg)), t, np.zeros((6, 6)), 0.0)
