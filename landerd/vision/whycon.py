"""WhyCon rings: search in an image or a part of it, and pose with both cone solutions."""

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.geometry import Vec3
from landerd.messages import MarkerSighting
from landerd.pad import Ring
from landerd.vision.pyramid import Level, levels
from landerd.vision.ring_explained import explained, has_rings_within, is_toned
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pose import F64
from landerd.vision.ring_segment import THRESHOLDS, ring_candidates
from landerd.vision.ring_sighting import ring_sighting
from landerd.vision.ring_stages import (
    full_fits,
    hard_fits,
    is_poor,
    is_ring,
    rough_fit,
    tracked_fits,
)
from landerd.vision.window import Window

U8 = NDArray[np.uint8]

_EDGE_TRIES = 6  # best doubtful fits whose edges are looked at
_HARD_TRIES = 3  # of these, those that are tried again with shadow and motion


def find_rings(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    *,
    window: Window | None = None,
    down: Vec3 | None = None,
    expected_diameter_px: float | None = None,
    thorough: bool = True,
) -> list[MarkerSighting]:
    """Return the rings seen in an image, or in a window of it, nearest first.

    Args:
        image: grey image (height, width) of the camera's size.
        ring: its true size and ratio.
        camera: intrinsics and distortion for this image size.
        window: pixels to search; None for all.
        down: unit vector of gravity, camera frame; where the image cannot tell the two poses of a
            ring apart, the pose that lies more level is put first.
        expected_diameter_px: the ring's larger diameter, if it is known within a factor of two.
        thorough: try a second threshold, and shadow and motion, where the first look finds nothing.
    """
    parts = list(levels(image, camera, window, expected_diameter_px))
    for threshold in THRESHOLDS if thorough else THRESHOLDS[:1]:
        found, doubtful = _plain_pass(image, ring, camera, parts, threshold, down)
        if thorough and not found:
            found = _hard_pass(image, ring, camera, doubtful, down)
        if found:
            return sorted(found, key=lambda s: s.solutions[0].position[2])
    return []


def _plain_pass(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    parts: list[Level],
    threshold: float,
    down: Vec3 | None,
) -> tuple[list[MarkerSighting], list[list[RingFit]]]:
    """Return the rings of the first level that shows any, and the doubtful fits until then."""
    found: list[MarkerSighting] = []
    doubtful: list[list[RingFit]] = []
    for level in parts:
        for candidate in ring_candidates(level.image, ring.inner_ratio, threshold):
            rough = rough_fit(level, candidate, ring)
            if rough is None or any(_covers(s, camera, rough.position) for s in found):
                continue
            fits = full_fits(image, camera, ring, rough, camera.fx / level.camera.fx)
            if fits and _is_ours(image, camera, ring, fits[0]):
                fits = _untoned(image, camera, ring, fits)
                found.append(ring_sighting(fits, ring, camera, down))
            elif fits and is_poor(fits[0]):
                doubtful.append(fits)
        if found:
            break
    return found, doubtful


def _hard_pass(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    doubtful: list[list[RingFit]],
    down: Vec3 | None,
) -> list[MarkerSighting]:
    """Try the best doubtful fits by their edges, with shadow and motion; return the first ring."""
    doubtful = sorted(doubtful, key=lambda fits: fits[0].noise / fits[0].contrast)
    unclear = None
    for plain in doubtful[:_EDGE_TRIES]:
        by_edges = explained(image, camera, ring, plain)
        if by_edges is not None and by_edges.is_toned:
            return [ring_sighting(by_edges.fits, ring, camera, down)]
        unclear = unclear or by_edges
    for plain in doubtful[:_HARD_TRIES]:
        fits = hard_fits(image, camera, ring, plain)
        if _is_ours(image, camera, ring, fits[0]):
            return [ring_sighting(fits, ring, camera, down)]
    return [] if unclear is None else [ring_sighting(unclear.fits, ring, camera, down)]


def _is_ours(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> bool:
    """Tell whether a fit is of a ring and, where it leaves something over, of no other target."""
    if not is_ring(fit, ring):
        return False
    return not (is_poor(fit) and has_rings_within(image, camera, ring, fit))


def _untoned(image: U8, camera: CameraModel, ring: Ring, fits: list[RingFit]) -> list[RingFit]:
    """Return the fits, those to edges where a tone curve has moved both of the ring's."""
    by_edges = explained(image, camera, ring, fits) if is_toned(fits[0], ring) else None
    return fits if by_edges is None else by_edges.fits


def track_ring(
    image: U8,
    ring: Ring,
    camera: CameraModel,
    position: F64,
    normal: F64,
    *,
    down: Vec3 | None = None,
) -> MarkerSighting | None:
    """Return the ring that is where it was expected, to a few pixels; None if it is not there.

    A quarter of the cost of a search. With gravity known, of the two poses only those are fitted
    in which a pad could lie.

    Args:
        image: grey image (height, width) of the camera's size.
        ring: its true size and ratio.
        camera: intrinsics and distortion for this image size.
        position: of the ring's centre, camera frame, m, (3,).
        normal: into the pad, unit vector, camera frame, (3,).
        down: unit vector of gravity, camera frame.
    """
    fits = tracked_fits(image, camera, ring, (position, normal), down)
    if not fits:
        return None
    if is_ring(fits[0], ring):
        return ring_sighting(_untoned(image, camera, ring, fits), ring, camera, down)
    by_edges = explained(image, camera, ring, fits) if is_poor(fits[0]) else None
    return None if by_edges is None else ring_sighting(by_edges.fits, ring, camera, down)


def _covers(sighting: MarkerSighting, camera: CameraModel, position: F64) -> bool:
    """Tell whether a centre lies inside a ring already found."""
    polygon = np.array(sighting.outline_px, dtype=np.float32)
    x, y = camera.pixels(position[None])[0]
    return cv2.pointPolygonTest(polygon, (float(x), float(y)), False) >= 0
