"""WhyCon rings: detection in an image or a window, tracking, and pose with both cone solutions.

The marker is that of Krajnik et al., "A practical multirobot localization system", JIRS 2014: a
black ring on white. Its outline, an ellipse in the image, has two poses, of which a fit to the
pixels tells the true one if it can.

This module puts the stages of a ring in order; each has its own module. A search makes a pyramid
(`pyramid`), marks what is dark and picks outlines like a ring's (`ring_segment`), and fits the
likely ones (`ring_search`), spread over frames as `ring_work` counts. A fit goes from rough to full
to a full one with shadow or motion (`ring_fit_stages`), else to the edges alone (`ring_explained`);
`ring_selection` decides whether it is of the ring.
"""

import math
from collections.abc import Iterator

from landerd.camera_model import F64, CameraModel, Window
from landerd.geometry import Vec3
from landerd.messages import MarkerSighting
from landerd.pad import Ring
from landerd.vision.arrays import U8
from landerd.vision.pyramid import Level, levels
from landerd.vision.ring_explained import Vouches, edge_fits
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_fit_stages import TRACKED_BAND_PX, expected_poses, is_off_cut, tracked_fits
from landerd.vision.ring_match import SIZES, SMALLEST_PX, STEP
from landerd.vision.ring_pose import CirclePose
from landerd.vision.ring_response import CameraResponse
from landerd.vision.ring_search import Beside, RingSearch
from landerd.vision.ring_segment import (
    LARGE_STROKE_PX,
    STROKE_PX,
    Segmentation,
    dark_between,
    dark_by_mean,
    dark_in_small,
)
from landerd.vision.ring_selection import explained_fits, remember
from landerd.vision.ring_sighting import ring_sighting
from landerd.vision.ring_work import Part, RingWork

# Segmentation of dark strokes in the coarsest level and in the others. In 100 pictures in each of
# the conditions of `bench.vision_conditions` and 336 of the field world it shows all but 2 % of the
# rings that it and thresholds by local means show together.
_LARGE, _OTHERS = dark_between(LARGE_STROKE_PX), dark_between(STROKE_PX)
# Thresholds by local means, which a thorough search uses too: for the largest rings, and in a later
# picture for rings in dirt and motion.
_WIDE, _LOW = dark_by_mean(0.86), dark_by_mean(0.55)
_MATCHED = [SMALLEST_PX * STEP**k for k in range(SIZES)]  # longer diameters of level rings, px
# Parts of a search that are left for later images, one each, if the first is full of texture:
# labelling what is dark takes the most time there.
_IN_TEXTURE = (Part.OTHERS, Part.PLATE, Part.BROKEN, Part.FINEST)
# The same in other images; PLATE_FINEST comes last. In both, squares are looked for in the next
# image, beside the part that takes the least.
_ELSEWHERE = (Part.PLATE, Part.REST)


def find_rings(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    *,
    window: Window | None = None,
    down: Vec3 | None = None,
    expected_diameter_px: float | None = None,
    thorough: bool = True,
    work: RingWork | None = None,
    response: CameraResponse | None = None,
    beside: Beside | None = None,
) -> list[MarkerSighting]:
    """Return the rings seen in an image, or in a window of it, nearest first.

    Args:
        image: grey image (height, width) of the camera's size.
        ring: its true size and ratio.
        camera: intrinsics and distortion for this image size.
        window: pixels to search; None for all.
        down: unit vector of gravity, camera frame; where the image cannot tell the two poses of a
            ring apart, the pose that lies more level is put first.
        expected_diameter_px: the ring's longer diameter, if it is known within a factor of two.
        thorough: also try other thresholds, and shadow and motion, if the first finds nothing.
        work: keeps from image to image how far the search has come; None: all parts of the search
            are done in this image.
        response: keeps the camera's response from image to image; None: it is taken to be linear
            at first.
        beside: what the ring's surroundings tell: that it is not the pad's, whereupon the search
            goes on; that it is, although its edges alone do not show it; and where it lies.
    """
    work = work or RingWork(parts=False)
    work.begin()
    response = response or CameraResponse()
    search = RingSearch(image, ring, camera, down, work, response, beside or Beside())
    parts = levels(image, camera, window, expected_diameter_px, 1.0 - ring.inner_ratio)
    is_whole = thorough and window is None
    for small in parts[1:2]:  # a small window has none
        work.follow(small.image, small.reduction)
    if any(_ways(search, parts, work, thorough=thorough, is_whole=is_whole)):
        return search.nearest_first()
    search.find_doubtful()
    if thorough and not search.found:
        search.find_hard()
    return search.nearest_first()


def _ways(
    search: RingSearch, parts: list[Level], work: RingWork, *, thorough: bool, is_whole: bool
) -> Iterator[bool]:
    """Search in each way of the part that is due; yield whether it showed a ring.

    The caller stops at the first that does.
    """
    part = work.part
    if part in (Part.WHOLE, Part.MOST):
        yield any(search.find_clear(looks) for looks in _looks(parts, thorough=thorough))
        yield is_whole and any(search.find_cut(level, _WIDE) for level in parts[:1])
    if part is Part.MOST:
        is_dear = any(search.is_textured(*_look(level)) for level in parts[-2:-1])
        if thorough:
            _leave_parts(search, work, is_dear=is_dear)
        if is_dear:
            return
    if part in (Part.WHOLE, Part.MOST, Part.FINEST):
        yield search.find_clear(_finest(parts))
    if part in (Part.WHOLE, Part.MOST, Part.BROKEN):
        yield search.find_holes([_look(level) for level in parts[:-1] or parts])
    if thorough and part in (Part.WHOLE, Part.REST, Part.OTHERS):
        yield search.find_clear([(level, _WIDE) for level in _coarse(parts)])
    if thorough and part in (Part.WHOLE, Part.REST):
        yield search.find_clear([(level, dark_in_small) for level in parts[-2:]])
    if is_whole:
        yield from _ways_in_whole(search, parts, work)


def _leave_parts(search: RingSearch, work: RingWork, *, is_dear: bool) -> None:
    """Leave the other parts of a search for later images, the likelier to show a ring first."""
    work.leave(*_IN_TEXTURE if is_dear else _ELSEWHERE)
    if search.is_level_known:
        work.leave_match()
    if not is_dear:
        work.leave(Part.PLATE_FINEST)


def _ways_in_whole(search: RingSearch, parts: list[Level], work: RingWork) -> Iterator[bool]:
    """Do the same with the ways that need the whole image.

    Those are for rings that the image's edge cuts, or that only their plate shows.
    """
    # In texture together with the part that takes the least.
    if work.part in (Part.WHOLE, Part.REST, Part.BROKEN):
        yield any(search.find_cut(level, _WIDE) for level in _coarse(parts))
    if work.part in (Part.WHOLE, Part.PLATE):
        # The finest level by itself: the areas tried are those with the straightest sides, and its
        # texture has straighter ones than a plate in shade and dirt, which the others show better.
        yield search.find_on_plate(parts[:-1] or parts)
    if work.part in (Part.WHOLE, Part.PLATE_FINEST):
        yield search.find_on_plate(parts[1:][-1:])
    if work.part in (Part.WHOLE, Part.MATCH):
        yield search.find_matched(_MATCHED[::2])
    if work.part in (Part.WHOLE, Part.MATCH_BETWEEN):
        yield search.find_matched(_MATCHED[1::2])


def _looks(parts: list[Level], *, thorough: bool) -> Iterator[list[tuple[Level, Segmentation]]]:
    """Yield levels with segmentations that are looked at together, the cheapest first.

    The caller stops at the first that shows a ring.
    """
    coarse = _coarse(parts)
    for level in [*parts[:1], *coarse[:1]]:
        yield [_look(level)]
    # Both means in the coarsest level take less time than one segmentation two levels finer.
    largest = [(level, way) for way in (_WIDE, _LOW) for level in parts[:1]] if thorough else []
    yield [*largest, *(_look(level) for level in coarse[1:])]


def _coarse(parts: list[Level]) -> list[Level]:
    """Return the levels between the coarsest and the finest."""
    return [level for level in parts[1:] if level.reduction > 1.0]


def _finest(parts: list[Level]) -> list[tuple[Level, Segmentation]]:
    """Return the level at the image's own size with its segmentation, unless it is the only one."""
    return [_look(level) for level in parts[1:] if level.reduction == 1.0]


def _look(level: Level) -> tuple[Level, Segmentation]:
    return level, _LARGE if math.isinf(level.largest_px) else _OTHERS


def track_ring(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    position: F64,
    normal: F64,
    *,
    down: Vec3 | None = None,
    response: CameraResponse | None = None,
    vouches: Vouches | None = None,
) -> MarkerSighting | None:
    """Return the ring that is within a few pixels of where it is expected; None: it is not there.

    Takes a quarter of the time of a search. If gravity is known, the mirrored pose is fitted only
    if a pad could lie that way.

    Args:
        image: grey image (height, width) of the camera's size.
        ring: its true size and ratio.
        camera: intrinsics and distortion for this image size.
        position: of the ring's centre, camera frame, m, (3,).
        normal: into the pad, unit vector, camera frame, (3,).
        down: unit vector of gravity, camera frame.
        response: keeps the camera's response from image to image; None: it is taken to be linear
            at first.
        vouches: tells that a ring is the pad's although its edges alone do not show it; None: no
            such ring is taken.
    """
    response = response or CameraResponse()
    expected = (position, normal)
    starts = expected_poses(ring, expected, down)
    fits: list[RingFit] = []
    if response.pictures_by_edges:
        fits = edge_fits(image, camera, ring, starts, vouches)
    if not fits:
        fits = _by_grey(image, ring, camera, starts, response, vouches)
    if not fits and not response.pictures_by_edges:
        # Shadows may have led the fit to grey levels away from where the edges are.
        fits = edge_fits(image, camera, ring, starts, vouches)
    if not fits:
        return None
    remember(response, fits[0])
    return ring_sighting(fits, ring, camera, down)


def _by_grey(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    starts: list[CirclePose],
    response: CameraResponse,
    vouches: Vouches | None,
) -> list[RingFit]:
    """Return the fits to grey levels near expected poses, best first; empty: they are no ring's.

    Or the fits to edges, if the image's edge cuts the ring and moved the fit off its pixels.
    """
    fits = tracked_fits(image, camera, ring, starts, response.response)
    if not fits:
        return []
    if is_off_cut(camera, ring, starts[0], fits[0], TRACKED_BAND_PX):
        return edge_fits(image, camera, ring, [_pose(f) for f in fits], vouches)
    return explained_fits(image, camera, ring, fits, vouches)


def _pose(fit: RingFit) -> CirclePose:
    return fit.position, fit.normal
