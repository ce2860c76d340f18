"""Where in an image a dark ring could be: the candidates that `ring_search` fits.

Four steps: a threshold tells what is dark, connected components are labelled (`ring_components`),
their second moments tell which have the shape of a ring, and grey levels along spokes tell which
are bright, dark and bright from the centre outwards.

Every test is invariant under affine maps of the image, so that oblique rings pass as well as those
seen from above. Tests of the largest rings are invariant under perspective, too: near the pad the
hole lies far from the centre of its ring. All components are tested at once, cheap tests first: a
search of grass or gravel meets thousands.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.vision.arrays import U8, Mask
from landerd.vision.ring_components import Components, Mosaic

Segmentation = Callable[[U8], U8]  # image (height, width) in, 255 where it is dark out

# ---- thresholds --------------------------------------------------------------------------------
# `dark_between`: a morphological closing fills strokes that are darker than both sides and leaves a
# shadow's edge where it is. A pixel is dark if its level is below a share of the way from the
# lowest level nearby to the closed level. That shows a stroke whatever the ground beyond the ring's
# white margin, and wherever a shadow ends on the ring.
STROKE_PX = 13  # side of the closing: fills the stroke of a ring of 40 px, 12 px wide
LARGE_STROKE_PX = 21  # the same in the coarsest level; a local mean shows the largest rings there
# Side of the surrounding whose lowest level counts, px. If it reaches ground beyond the plate's
# margin that is darker than a small ring's blurred stroke, the stroke does not show: of 1160 looks
# at rings of 12 to 60 px on 100 field days two pictures each show 893 with 7, 924 with 5, 896 with
# 3.
_NEAR_PX = 5
_NEAR_SHARE = 0.4  # share of the way from lowest to closed level; 0.5 loses leaf shade and legs
_NEAR_STEP = 19  # least difference of these two levels: below it, nothing is dark
# In deep shadow white is darker than that step, and noise smaller: there the least difference is
# this share of the closed level, but no less than the second, grey levels.
_NEAR_STEP_SHARE, _LEAST_NEAR_STEP = 0.6, 8
# `dark_by_mean`: side of the local mean, px: wider than the dark stroke of a ring of 85 px.
_LOCAL_MEAN_PX = 25
# `dark_in_small`: side of the mean about strokes of few px, and by how many grey levels they are
# darker.
_SMALL_MEAN_PX, _SMALL_STEP = 9, 3

# ---- components --------------------------------------------------------------------------------
# Where nothing else is said, limits were set by trial when the segmentation was written, on the
# images of `bench.vision_ring`. What true rings give was measured afterwards, on 400 of its images
# of 1.5 to 25 m at 0 to 60 degrees, at every level of the pyramid that shows them at 8 to 110 px,
# with both thresholds: 2100 components.
_MAX_COMPONENTS = 400  # whose spokes are looked at, largest first
_MAX_OUTLINES = 8  # that are returned for each image
_MIN_WIDTH_PX = 4.5  # of a ring's shorter axis: a narrower one's hole is less than a pixel
_MAX_ASPECT = 4.2  # longer over shorter axis: a ring at 76 degrees; true ones gave at most 2.8
_MAX_EXTENT = 0.9  # longer axis over the image's longer side: a ring that fills a level is cut
# Compactness: area over the root of the second moments' determinant, over the same of a ring. True
# rings gave at most 1.09; 2 % gave less than 0.7 with the lower threshold, those larger than the
# local mean or below 15 px.
_MIN_COMPACTNESS, _MAX_COMPACTNESS = 0.7, 1.3
# The same for what may be a hole, over that of a disc; and the hole's shorter axis, px.
_MIN_DISC_COMPACTNESS, _MAX_DISC_COMPACTNESS = 0.85, 1.15
_MIN_HOLE_PX = 3.0
# Least share of spokes and least score (`Candidate`) of a hole; a pebble in a dark rim scored 1.8.
_MIN_HOLE_SHARE, _MIN_HOLE_SCORE = 0.7, 2.2
# Clipped white spreads into the black from both sides and leaves a thinner stroke along the same
# circle. Least compactness of such rings, which is a ratio of 0.85; and the grey level from which
# on white counts as clipped.
_MIN_BLOOMED_COMPACTNESS, _CLIPPED = 0.16, 240.0
# Area from which on a component's hole is looked for, px, to allow for perspective. Of 106 rings at
# 0.9 to 1.5 m and 45 to 70 degrees 103 are found with it, 45 without.
_HOLED_AREA_PX = 200.0

# ---- spokes ------------------------------------------------------------------------------------
# Grey levels are compared along spokes at three scales of the outline: inside the hole (in radii of
# the hole), in the middle of the stroke, and around, three quarters across the thesis's margin.
_HOLE_SCALE, _AROUND_SCALE = 0.4, 1.18
_SPOKES = 16
_MIN_SPOKES = 10  # that must be in the image
# Quantiles of the stroke's levels whose difference is its spread: a fifth of it may be hidden.
_DARK_QUANTILE, _BRIGHT_QUANTILE = 0.8, 0.2
# Least step from black to white on a spoke, grey levels: 2.7 sigma of those images' noise; true
# rings gave at least 38. And the share of the step of all spokes that each must show.
_MIN_STEP = 8.0
_STEP_SHARE = 0.3
_SPREAD_FLOOR = 10.0  # grey levels, added to the stroke's spread: less is noise
# Least share of the spokes that are bright, dark and bright. 280 true rings, from the plain to
# those in leaf shade, gave 1.0, with a shadow's edge across them 0.56 to 0.94. Of the 35 components
# that a photograph of the ground has on average, 8 reach 0.5 and 0.1 reach 0.9.
_MIN_SHARE = 0.5
# Besides, a candidate needs this share, or else this score. Of 800 rings in all kinds of light all
# but two, behind strong motion or shadow, had one of both; eight tenths of textures' outlines have
# neither.
_CLEAR_SHARE, _MIN_SCORE = 0.85, 0.95
# Roughness: how much the stroke's level changes from spoke to spoke, rms, over the step to white.
# Ink is even except where something lies across it, so the largest changes are left out: a fifth.
# Of 700 pictures of rings in all kinds of light none gave more than 0.11, but small rings in blur
# and noise do: of the 1160 looks 934 show theirs with this limit, 924 with 0.15. Of other things
# that pass all limits above, in photographs of the ground, four fifths give more than 0.15.
_SMOOTH_QUANTILE, _MAX_ROUGHNESS = 0.8, 0.18
# A rougher one may be a ring of which glare has left only a part: its hull tells the outline, its
# moments do not. How many such are looked at again at a time, the likeliest first; up to which
# roughness; and what share and roughness they must have by their hull.
_MOST_BROKEN, _BROKEN_ROUGHNESS = 4, 0.35
_MENDED_SHARE, _MENDED_ROUGHNESS = 0.7, 0.22

_ANGLES = np.linspace(0.0, 2.0 * math.pi, _SPOKES, endpoint=False)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_BEFORE = np.arange(-1, _SPOKES - 1)  # index of each spoke's predecessor


@dataclass(frozen=True)
class Ellipse:
    """Outer edge of a ring in pixels: points centre + axes (cos a, sin a)."""

    centre: F64  # (2,)
    axes: F64  # (2, 2), columns are conjugate semi-diameters

    def points(self, scale: float = 1.0) -> F64:
        """Return 16 pixels (16, 2) on the ellipse scaled about its centre."""
        p: F64 = self.centre[:, None] + scale * (self.axes @ _CIRCLE)
        return p.T


@dataclass(frozen=True)
class Candidate:
    """An outline that could be a ring's, and the evidence for it."""

    outline: Ellipse
    share: float  # of its spokes that are bright, dark and bright
    score: float  # step from the stroke to hole and surroundings, over the stroke's spread
    # White is clipped and has spread into the black; the outline is that of the print.
    is_bloomed: bool = False


def dark_between(stroke_px: int) -> Segmentation:
    """Return the segmentation that finds strokes narrower than this, darker than both sides."""
    stroke, near = (np.ones((side, side), np.uint8) for side in (stroke_px, _NEAR_PX))
    # Least difference for each closed level.
    most = np.clip(_NEAR_STEP_SHARE * np.arange(256), _LEAST_NEAR_STEP, _NEAR_STEP).astype(np.uint8)

    def segment(image: U8) -> U8:
        smooth = cv2.blur(image, (3, 3))
        beside = cv2.morphologyEx(smooth, cv2.MORPH_CLOSE, stroke, borderType=cv2.BORDER_REPLICATE)
        least = cv2.erode(smooth, near, borderType=cv2.BORDER_REPLICATE)
        between = cv2.addWeighted(beside, _NEAR_SHARE, least, 1.0 - _NEAR_SHARE, 0.0)
        dark = cv2.compare(image, between, cv2.CMP_LT)
        steep = cv2.compare(cv2.subtract(beside, least), cv2.LUT(beside, most), cv2.CMP_GT)
        return np.asarray(cv2.bitwise_and(dark, steep), dtype=np.uint8)

    return segment


def dark_by_mean(share: float) -> Segmentation:
    """Return the segmentation that finds the pixels below a share of the local mean.

    A low share separates a ring from dark surroundings and shadow, a high one shows weak contrast.
    """

    def segment(image: U8) -> U8:
        size = (_LOCAL_MEAN_PX, _LOCAL_MEAN_PX)
        mean = cv2.blur(image, size, borderType=cv2.BORDER_REPLICATE)
        dark = cv2.compare(image, cv2.convertScaleAbs(mean, alpha=share), cv2.CMP_LT)
        return np.asarray(dark, dtype=np.uint8)

    return segment


def dark_in_small(image: U8) -> U8:
    """Find pixels that are slightly darker than their surroundings, as blurred narrow strokes are.

    Of 1160 looks at rings on 100 field days six pictures each show 956 without it, 974 with it.
    """
    smooth = cv2.blur(image, (3, 3), borderType=cv2.BORDER_REPLICATE)
    mean = cv2.blur(image, (_SMALL_MEAN_PX, _SMALL_MEAN_PX), borderType=cv2.BORDER_REPLICATE)
    _, dark = cv2.threshold(cv2.subtract(mean, smooth), _SMALL_STEP, 255, cv2.THRESH_BINARY)
    return np.asarray(dark, dtype=np.uint8)


@dataclass(frozen=True)
class Look:
    """An image with one segmentation of it, and the sizes of rings wanted there."""

    image: U8  # grey, (height, width)
    dark: U8  # (height, width), 255 where it is dark, else 0
    # Diameter of the largest ring wanted; infinity: no limit, as just over the pad.
    largest_px: float = math.inf
    smallest_px: float = 0.0  # longer diameter of the smallest ring wanted


def ring_candidates(looks: Sequence[Look], inner_ratio: float) -> list[list[Candidate]]:
    """Return for each look the outlines like a dark ring's of 6 to about 120 px, likeliest first.

    Args:
        looks: together they take less time than one by one.
        inner_ratio: the ring's inner over outer diameter.
    """
    if not looks:
        return []
    is_near = np.array([math.isinf(k.largest_px) for k in looks])
    holed_px = np.where(is_near, _HOLED_AREA_PX, math.inf)
    mosaic = Mosaic([k.image for k in looks], [k.dark for k in looks])
    sizes_px = _sizes_px(looks)
    c = _ring_like(mosaic, mosaic.components(sizes_px[1].max(), holed_px), inner_ratio, sizes_px)
    ratio = _ratios(c, inner_ratio)
    c, aside = _in_perspective(mosaic, c, ratio, holed_px)
    axes = _axes(c, ratio)
    return _likeliest(mosaic, c, aside, axes, ratio, inner_ratio)


def hole_candidates(looks: Sequence[Look], inner_ratio: float) -> list[list[Candidate]]:
    """Return for each look the outlines of rings by what looks like their holes, likeliest first.

    Dirt, a leg or a shadow that crosses the outer edge joins a ring to dark surroundings, so that
    it is no component of its own any more. Its hole still is one.

    Args:
        looks: as in `ring_candidates`.
        inner_ratio: the ring's inner over outer diameter.
    """
    if not looks:
        return []
    mosaic = Mosaic([k.image for k in looks], [~k.dark for k in looks])
    sizes_px = inner_ratio * _sizes_px(looks)
    anywhere = np.zeros(len(looks))
    c = _disc_like(mosaic.components(sizes_px[1].max(), anywhere), sizes_px)
    ratio = np.full(len(c.area), inner_ratio)
    axes = _axes(c, np.zeros(len(c.area))) / inner_ratio
    aside = np.zeros((len(c.area), 2))
    found = _likeliest(mosaic, c, aside, axes, ratio, inner_ratio)
    return [
        [k for k in of if k.share >= _MIN_HOLE_SHARE and k.score >= _MIN_HOLE_SCORE] for of in found
    ]


def _sizes_px(looks: Sequence[Look]) -> F64:
    """Return the longer diameters of the smallest and the largest ring wanted, (2, looks)."""
    largest = [min(k.largest_px, _MAX_EXTENT * max(k.image.shape)) for k in looks]
    return np.array([[k.smallest_px for k in looks], largest])


def _likeliest(
    mosaic: Mosaic, c: Components, aside: F64, axes: F64, ratio: F64, inner_ratio: float
) -> list[list[Candidate]]:
    """Return for each image the outlines that pass the tests by spokes, the likeliest first.

    Args:
        mosaic: the images.
        c: components, as `_in_perspective` returns them.
        aside: as `_in_perspective` returns it.
        axes: of the outlines, (n, 2, 2).
        ratio: inner over outer diameter, (n,): larger than `inner_ratio` where clipped white has
            spread.
        inner_ratio: that of the print.
    """
    found: list[list[Candidate]] = [[] for _ in mosaic.heights]
    if not len(c.area):
        return found
    is_bloomed = ratio != inner_ratio
    share, score, white, roughness = _spokes(mosaic, c, aside, axes, ratio)
    centre = np.array([c.x, c.y]).T + aside
    outer = axes * ((1.0 + ratio) / (1.0 + inner_ratio))[:, None, None]
    is_shown = (share >= _MIN_SHARE) & ((share >= _CLEAR_SHARE) | (score >= _MIN_SCORE))
    is_shown &= ~is_bloomed | (white > _CLIPPED)
    picked = np.flatnonzero(is_shown & (roughness < _MAX_ROUGHNESS))
    shown = [
        (int(c.part[i]), _candidate(centre[i], outer[i], share[i], score[i], is_bloomed[i]))
        for i in picked
    ]
    is_rough = (roughness >= _MAX_ROUGHNESS) & (roughness < _BROKEN_ROUGHNESS)
    broken = np.flatnonzero(is_shown & is_rough & (share < _CLEAR_SHARE) & ~is_bloomed)
    if len(broken):
        likeliest = broken[np.argsort(-score[broken], kind="stable")][:_MOST_BROKEN]
        shown += _mended(mosaic, c.at(likeliest), inner_ratio)
    for part, candidate in sorted(shown, key=lambda k: (-k[1].share, -k[1].score)):
        if len(found[part]) < _MAX_OUTLINES:
            found[part].append(candidate)
    return found


def _candidate(centre: F64, axes: F64, share: float, score: float, bloomed: bool) -> Candidate:
    return Candidate(Ellipse(centre, axes), float(share), float(score), bool(bloomed))


def _mended(mosaic: Mosaic, c: Components, ratio: float) -> list[tuple[int, Candidate]]:
    """Return image number and candidate for each component that is what is left of a ring.

    The outline is that of the component's hull.
    """
    edges = {i: edge for i in range(len(c.area)) if (edge := mosaic.outer_edge(c, i))}
    if not edges:
        return []
    centre, axes = (np.array(values) for values in zip(*edges.values(), strict=True))
    c = replace(c.at(np.array(list(edges))), x=centre[:, 0], y=centre[:, 1])
    aside, ratios = np.zeros_like(centre), np.full(len(centre), ratio)
    share, score, _, roughness = _spokes(mosaic, c, aside, axes, ratios)
    is_ring = (share >= _MENDED_SHARE) & (score >= _MIN_SCORE) & (roughness < _MENDED_ROUGHNESS)
    return [
        (int(c.part[i]), _candidate(centre[i], axes[i], share[i], score[i], bloomed=False))
        for i in np.flatnonzero(is_ring)
    ]


def _disc_like(c: Components, sizes_px: F64) -> Components:
    """Return the components shaped like a disc of the sizes wanted in their look, largest first."""
    compactness = _compactness(c, 0.0)
    good = (
        (compactness > _MIN_DISC_COMPACTNESS)
        & (compactness < _MAX_DISC_COMPACTNESS)
        & _is_sized(c, 0.0, sizes_px, _MIN_HOLE_PX)
    )
    return _largest(c, good)


def _is_sized(c: Components, k: float, sizes_px: F64, least_px: float) -> Mask:
    """Tell which rings of ratio k have the sizes wanted in their look, and a least width, px."""
    smallest_px, largest_px = sizes_px
    longer, shorter = _diameters(c, k)
    sized: Mask = (
        (shorter >= least_px)
        & (shorter * _MAX_ASPECT >= longer)
        & (np.sqrt(longer * shorter) < largest_px[c.part])
        & (longer >= smallest_px[c.part])
    )
    return sized


def _diameters(c: Components, k: float) -> tuple[F64, F64]:
    """Return longer and shorter axes (n,), px, of rings of ratio k with these second moments."""
    middle, off = 0.5 * (c.xx + c.yy), np.hypot(0.5 * (c.xx - c.yy), c.xy)
    scale = 16.0 / (1.0 + k * k)
    longer: F64 = np.sqrt(scale * (middle + off))
    shorter: F64 = np.sqrt(scale * np.maximum(middle - off, 0.0))
    return longer, shorter


def _largest(c: Components, good: Mask) -> Components:
    picked = np.flatnonzero(good)
    largest_first = picked[np.argsort(-c.area[picked], kind="stable")]
    return c.at(largest_first[:_MAX_COMPONENTS])


def _ring_like(mosaic: Mosaic, c: Components, k: float, sizes_px: F64) -> Components:
    """Return the components shaped like a ring of the sizes wanted in their look, largest first.

    The second moments of a ring of ratio k with semi-axes A are A A^T (1 + k^2) / 4, its area is
    pi det A (1 - k^2). Area over the root of the moments' determinant therefore distinguishes a
    ring, however oblique, from discs and bars.
    """
    compactness = _compactness(c, k)
    rows, columns = np.rint(c.y).astype(np.intp), np.rint(c.x).astype(np.intp)
    grey = mosaic.grey(c.part, rows, columns)
    is_bloomed = (compactness > _MIN_BLOOMED_COMPACTNESS) & (grey > _CLIPPED)
    good = (
        ((compactness > _MIN_COMPACTNESS) | is_bloomed)
        & (compactness < _MAX_COMPACTNESS)
        & _is_sized(c, k, sizes_px, _MIN_WIDTH_PX)
    )
    return _largest(c, good)


def _root(c: Components) -> F64:
    """Return the roots of the determinants of the second moments."""
    root: F64 = np.sqrt(np.maximum(c.xx * c.yy - c.xy * c.xy, 1e-12))
    return root


def _compactness(c: Components, k: float) -> F64:
    """Return the areas over the roots of the moments' determinants, relative to a ring's."""
    compactness: F64 = c.area / (_root(c) * 4.0 * math.pi * (1.0 - k * k) / (1.0 + k * k))
    return compactness


def _ratios(c: Components, k: float) -> F64:
    """Return the ratios of inner to outer diameter: the print's, or that which bloom has left."""
    q = np.minimum(c.area / (_root(c) * 4.0 * math.pi), 1.0)
    ratio: F64 = np.where(_compactness(c, k) > _MIN_COMPACTNESS, k, np.sqrt((1.0 - q) / (1.0 + q)))
    return ratio


def _axes(c: Components, k: F64) -> F64:
    """Return the symmetric matrices A (n, 2, 2) of `_ring_like`: roots of the scaled moments."""
    root = _root(c)
    # Of a positive definite 2x2 matrix M: (M + sqrt(det M) 1) / sqrt(tr M + 2 sqrt(det M)).
    divisor = np.sqrt((c.xx + c.yy + 2.0 * root) * (1.0 + k * k)) / 2.0
    rows = [[c.xx + root, c.xy], [c.xy, c.yy + root]]
    axes: F64 = (np.array(rows) / divisor).transpose(2, 0, 1)
    return axes


def _in_perspective(mosaic: Mosaic, c: Components, k: F64, holed_px: F64) -> tuple[Components, F64]:
    """Return components about the image of their circle's centre, and `aside` (n, 2), px.

    Perspective moves the centre of a circle's image away from the image of its centre, in
    proportion to the square of its radius: of the circle at scale s (the outline: 1) to
    point + s^2 aside. The centroids of hole and ring, k^2 and 1 + k^2 times `aside` from the point,
    determine both. For components with an area below `holed_px` (images,), px, or without a hole
    that is large enough, `aside` is 0.
    """
    aside = np.zeros((len(c.area), 2))
    for i in np.flatnonzero(c.area >= holed_px[c.part]):
        hole = mosaic.hole(c, int(i))
        if hole is not None:
            aside[i] = (c.x[i], c.y[i]) - hole
    dx, dy = aside.T
    q = k * k
    # The moments are about the ring's centroid, and of two ellipses that are not concentric.
    moments = (c.xx + q * dx * dx, c.yy + q * dy * dy, c.xy + q * dx * dy)
    return Components(c.part, c.area, c.x - (1.0 + q) * dx, c.y - (1.0 + q) * dy, *moments), aside


def _spokes(
    mosaic: Mosaic, c: Components, aside: F64, axes: F64, k: F64
) -> tuple[F64, F64, F64, F64]:
    """Return share, score, white and roughness of rings with these outlines, arrays (n,).

    Components and `aside` are as `_in_perspective` returns them. Share and score are those of
    `Candidate`; white is the lower grey level of hole and surroundings; roughness is how much the
    stroke's level changes from spoke to spoke, over the step to white.
    """
    centre = np.array([c.x, c.y]).T
    scales = np.array([_HOLE_SCALE * k, (1.0 + k) / 2.0, np.full_like(k, _AROUND_SCALE)]).T
    middle = centre[:, None] + scales[:, :, None] ** 2 * aside[:, None]
    at = middle[..., None] + scales[:, :, None, None] * (axes @ _CIRCLE)[:, None]
    columns, rows = np.rint(at).astype(np.intp).transpose(2, 0, 1, 3)
    part = c.part[:, None, None]
    w, h = mosaic.widths[part], mosaic.heights[part]
    inside = ((columns >= 0) & (columns < w) & (rows >= 0) & (rows < h)).all(axis=1)
    seen = inside[:, None]
    levels = np.where(
        seen, mosaic.grey(part, np.where(seen, rows, 0), np.where(seen, columns, 0)), np.nan
    )
    enough = inside.sum(axis=1) >= _MIN_SPOKES
    if enough.all():
        return _judged(levels, inside)
    judged = np.zeros((4, len(centre)))
    if enough.any():
        judged[:, enough] = _judged(levels[enough], inside[enough])
    share, score, white, roughness = judged
    return share, score, white, roughness


def _judged(levels: F64, inside: Mask) -> tuple[F64, F64, F64, F64]:
    """Return share, score, white and roughness for levels (n, 3, spokes), NaN outside the image."""
    hole, stroke, around = levels.transpose(1, 0, 2)
    count = inside.sum(axis=1)
    ordered = np.sort(levels, axis=2)  # NaN last
    one = np.arange(len(levels))
    middle = ordered[one, :, count // 2]
    white = np.minimum(middle[:, 0], middle[:, 2])
    step = white - middle[:, 1]
    low, high = (
        ordered[one, 1, (q * count).astype(np.intp)] for q in (_BRIGHT_QUANTILE, _DARK_QUANTILE)
    )
    own_step = np.minimum(hole, around) - stroke
    is_shown = own_step > np.maximum(_MIN_STEP, _STEP_SHARE * step)[:, None]
    share: F64 = is_shown.sum(axis=1) / count
    score: F64 = step / (_SPREAD_FLOOR + high - low)
    return share, score, white, _roughness(stroke) / np.maximum(step, 1.0)


def _roughness(stroke: F64) -> F64:
    """Return the rms change of levels (n, spokes) from spoke to spoke without the largest ones."""
    change = np.sort((stroke - stroke[:, _BEFORE]) ** 2, axis=1)  # NaN last
    used = np.arange(_SPOKES) < _SMOOTH_QUANTILE * (~np.isnan(change)).sum(axis=1)[:, None]
    total = np.where(used, change, 0.0).sum(axis=1)
    roughness: F64 = np.sqrt(0.5 * total / np.maximum(used.sum(axis=1), 1))
    return roughness
