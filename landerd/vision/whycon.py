"""WhyCon rings: search in an image or a part of it, and pose with both cone solutions."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.geometry import Mat3, Vec3
from landerd.messages import MarkerSighting, PoseSolution
from landerd.pad import Ring
from landerd.vision.pose import gravity_cost
from landerd.vision.ring_fit import RingFit, fit_ring
from landerd.vision.ring_light import evenly_lit
from landerd.vision.ring_pixels import MARGIN, edge_pixels, pixels_near
from landerd.vision.ring_pose import F64, cone_through, mirrored, poses_of_cone
from landerd.vision.ring_segment import THRESHOLDS, Ellipse, ring_candidates
from landerd.vision.window import Window

U8 = NDArray[np.uint8]

_HARD_TRIES = 3  # best doubtful fits that are tried again with shadow and motion
_EDGE_BIAS_PX = 0.004  # what the edge model leaves out, as an error of every edge
_ASIDE_BIAS_PX = 0.003  # and as one that differs from side to side
# What lies beyond the white margin shines into it, the more the narrower the margin is in the
# image. Measured on exact images of 20 to 30 m at 0 to 70 degrees.
_NARROW_BIAS_PX = 0.18
_NARROW_PX = 0.33
_LEVEL = math.cos(math.radians(25.0))  # pads that lean more are not landed on
_TRACK_REACH_PX = 4.0  # how far from where they are expected edges are found
_FLOOR_M = 1.5e-5  # of sigma


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
    found: list[MarkerSighting] = []
    levels = list(_levels(image, camera, window, expected_diameter_px))
    for threshold in THRESHOLDS if thorough else THRESHOLDS[:1]:
        doubtful: list[list[RingFit]] = []
        for level in levels:
            for candidate in ring_candidates(level.image, ring.inner_ratio, threshold):
                rough = _rough_fit(level, candidate, ring)
                if rough is None or any(_covers(s, camera, rough.position) for s in found):
                    continue
                fits = _fit_both(image, ring, camera, rough, camera.fx / level.camera.fx)
                if fits and _is_ring(fits[0], ring.inner_ratio):
                    found.append(_sighting(fits, ring, camera, down))
                elif fits and _is_poor(fits[0]):
                    doubtful.append(fits)
            if found:
                break
        doubtful.sort(key=lambda fits: fits[0].noise / fits[0].contrast)
        for plain in doubtful[: _HARD_TRIES if thorough and not found else 0]:
            fits = _fit_hard(image, camera, plain, ring)
            if _is_ring(fits[0], ring.inner_ratio):
                found.append(_sighting(fits, ring, camera, down))
                break
        if found:
            break
    return sorted(found, key=lambda s: s.solutions[0].position[2])


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
    radius, ratio = ring.outer_diameter_m / 2.0, ring.inner_ratio
    starts = [(position, normal)]
    other = mirrored(position, normal, radius)
    if other is not None and (down is None or float(other[1] @ np.array(down)) > _LEVEL):
        starts.append(other)
    pixels = pixels_near(
        image, camera, starts[0], radius, ratio, _TRACK_REACH_PX, 200, supersample=True
    )
    fits = [] if pixels is None else fit_ring(pixels, starts, radius, ratio, 1.0, 4)
    return _sighting(fits, ring, camera, down) if fits and _is_ring(fits[0], ratio) else None


@dataclass(frozen=True)
class _Level:
    """The searched part of an image at reduced size, and the camera that would see just that."""

    image: U8
    camera: CameraModel


def _levels(
    image: U8, camera: CameraModel, window: Window | None, expected_px: float | None
) -> Iterator[_Level]:
    """Yield the part to search, coarse levels first: rings are looked for at 10 to 100 px."""
    h, w = image.shape
    part = Window(0, 0, w, h) if window is None else window.within(w, h)
    crop = image[part.y0 : part.y1, part.x0 : part.x1]
    size = max(crop.shape)
    if expected_px is not None:
        # Far rings are looked for in an enlarged window: their holes are few pixels.
        halvings = [max(-1, round(math.log2(max(expected_px, 1.0) / 28.0)))]
    else:
        halvings = list(range(max(0, math.ceil(math.log2(max(size, 1) / 100.0))), -1, -1))
    for n in halvings:
        k = 2.0**n
        small_h, small_w = int(crop.shape[0] / k), int(crop.shape[1] / k)
        if min(small_h, small_w) < 8:
            continue
        small: NDArray[Any] = crop
        if n > 0:
            whole = crop[: int(small_h * k), : int(small_w * k)]
            small = cv2.resize(whole, (small_w, small_h), interpolation=cv2.INTER_AREA)
        elif n < 0:
            small = cv2.resize(crop, (small_w, small_h), interpolation=cv2.INTER_CUBIC)
        yield _Level(
            small,
            replace(
                camera,
                width=small_w,
                height=small_h,
                fx=camera.fx / k,
                fy=camera.fy / k,
                # Pixel centres, not edges, are whole numbers.
                cx=(camera.cx - part.x0 + 0.5) / k - 0.5,
                cy=(camera.cy - part.y0 + 0.5) / k - 0.5,
            ),
        )


def _rough_fit(level: _Level, candidate: Ellipse, ring: Ring) -> RingFit | None:
    """Return the better pose of a candidate in the reduced image; None if it is no ring."""
    radius, ratio = ring.outer_diameter_m / 2.0, ring.inner_ratio
    cone = cone_through(level.camera.rays(candidate.points()))
    poses = None if cone is None else poses_of_cone(cone, radius)
    if poses is None:
        return None
    pixels = pixels_near(
        level.image, level.camera, poses[0], radius, ratio, 3.0, 180, supersample=False
    )
    fits = [] if pixels is None else fit_ring(pixels, poses, radius, ratio, 1.0, 3)
    return fits[0] if fits and fits[0].contrast > 10.0 else None


def _fit_both(
    image: U8, ring: Ring, camera: CameraModel, rough: RingFit, zoom: float
) -> list[RingFit]:
    """Return both poses fitted to the image, the better first; empty if the fits fail."""
    radius, ratio = ring.outer_diameter_m / 2.0, ring.inner_ratio
    start = (rough.position, rough.normal)
    other = mirrored(*start, radius)
    blur = rough.blur_px * zoom
    if zoom > 1.0:
        blur = min(max(0.6, blur - 0.3 * zoom), 8.0)
    pixels = pixels_near(
        image, camera, start, radius, ratio, max(2.0, 2.0 * blur), 560, supersample=True
    )
    if pixels is None or other is None:
        return []
    return fit_ring(pixels, (start, other), radius, ratio, blur, 8)


def _fit_hard(image: U8, camera: CameraModel, plain: list[RingFit], ring: Ring) -> list[RingFit]:
    """Return the best of plain fits and those with a shadow's edge or motion in the model."""
    shaded = _fit_shaded(image, camera, plain[0], ring)
    moving = _fit_moving(image, camera, plain[0], ring)
    return min(
        (fits for fits in (plain, shaded, moving) if fits),
        key=lambda fits: fits[0].noise / max(fits[0].contrast, 1.0),
    )


def _is_poor(fit: RingFit) -> bool:
    """Tell whether more is left over than a camera's noise, but the fit is not hopeless."""
    noisy = fit.noise > 2.0 + 0.025 * fit.contrast or fit.inliers < 0.97
    return noisy and fit.contrast > max(2.5 * fit.noise, 10.0)


def _fit_shaded(image: U8, camera: CameraModel, fit: RingFit, ring: Ring) -> list[RingFit]:
    """Return the fits with a shadow's edge undone; empty if there is none."""
    radius, ratio = ring.outer_diameter_m / 2.0, ring.inner_ratio
    fits = [fit]
    for _ in range(2):  # the better the pose, the better the shadow's edge
        pose = (fits[0].position, fits[0].normal)
        # Wide enough to hold pixels that are white and nothing else.
        pixels = pixels_near(image, camera, pose, radius, ratio, 3.5, 700, supersample=True)
        lit = None if pixels is None else evenly_lit(pixels, fits[0], radius, ratio)
        other = mirrored(*pose, radius)
        if lit is None or other is None:
            return []
        fits = fit_ring(lit, (pose, other), radius, ratio, fits[0].blur_px, 8)
        if not fits:
            return []
    return fits


def _fit_moving(image: U8, camera: CameraModel, fit: RingFit, ring: Ring) -> list[RingFit]:
    """Return the fits with straight motion during the exposure; empty if they fail."""
    radius, ratio = ring.outer_diameter_m / 2.0, ring.inner_ratio
    path = max(3.0, 2.5 * fit.blur_px)
    pose = (fit.position, fit.normal)
    pixels = pixels_near(
        image, camera, pose, radius, ratio, 2.0 + 0.6 * path, 560, supersample=True
    )
    if pixels is None:
        return []
    ways = [path * np.array([math.cos(a), math.sin(a)]) for a in np.arange(4) * math.pi / 4.0]
    fits = fit_ring(pixels, [pose] * 4, radius, ratio, 0.7, 6, ways)
    if not fits:
        return []
    pose = (fits[0].position, fits[0].normal)
    other = mirrored(*pose, radius)
    if other is None:
        return []
    return fit_ring(
        pixels, (pose, other), radius, ratio, fits[0].blur_px, 6, [fits[0].motion_px] * 2
    )


def _is_ring(fit: RingFit, ratio: float) -> bool:
    """Tell whether a fit describes a ring of this ratio well.

    The limits lie between what true rings and look-alikes gave on made images: squares, discs and
    rings of another ratio leave an eighth of the pixels unexplained, texture has little contrast.
    """
    moved = bool(np.any(fit.motion_px))
    return (
        fit.contrast > 12.0
        and fit.contrast > (20.0 if moved else 9.0) * fit.noise
        and fit.inliers > 0.93
        and abs(fit.ratio - ratio) < 0.03 * ratio + 2.0 * fit.sigma_ratio
        and fit.sigma_ratio < 0.06 * ratio
    )


def _sighting(
    fits: list[RingFit], ring: Ring, camera: CameraModel, down: Vec3 | None
) -> MarkerSighting:
    """Return the message of a fitted ring."""
    fits = sorted(fits, key=lambda f: f.cost + gravity_cost(f.normal, down))
    radius = ring.outer_diameter_m / 2.0
    edge = edge_pixels(camera, (fits[0].position, fits[0].normal), (radius,), 32)[0]
    return MarkerSighting(
        kind="whycon",
        id=None,
        solutions=tuple(_solution(f, fits, radius, camera) for f in fits),
        outline_px=tuple((x, y) for x, y in edge.tolist()),
    )


def _solution(
    fit: RingFit, fits: list[RingFit], radius: float, camera: CameraModel
) -> PoseSolution:
    t, n = fit.position, fit.normal
    distance = float(np.linalg.norm(t))
    focal = math.sqrt(camera.fx * camera.fy)
    sight = t / distance
    # An edge error that is common to the whole outline moves the range, one that differs from
    # side to side the direction.
    bias_px = _EDGE_BIAS_PX + _NARROW_BIAS_PX * math.exp(
        -MARGIN * focal * radius / distance * float(n @ sight) / _NARROW_PX
    )
    along = bias_px * distance * distance / (focal * radius)
    aside = _ASIDE_BIAS_PX * distance / focal
    C = fit.covariance + np.outer(sight, sight) * along**2 + np.eye(3) * (aside**2 + _FLOOR_M**2)
    # As far as the other pose may be the true one, the error may be the way to it.
    for other in fits:
        chance = 1.0 / (1.0 + math.exp(min(0.5 * abs(other.cost - fit.cost), 50.0)))
        way = other.position - t
        C = C + chance * np.outer(way, way)
    covariance: Mat3 = (
        (float(C[0, 0]), float(C[0, 1]), float(C[0, 2])),
        (float(C[1, 0]), float(C[1, 1]), float(C[1, 2])),
        (float(C[2, 0]), float(C[2, 1]), float(C[2, 2])),
    )
    return PoseSolution(
        position=(float(t[0]), float(t[1]), float(t[2])),
        normal=(float(n[0]), float(n[1]), float(n[2])),
        north=None,
        covariance=covariance,
        sigma_yaw=None,
        sigma_tilt=fit.sigma_tilt,
        cost=fit.cost,
    )


def _covers(sighting: MarkerSighting, camera: CameraModel, position: F64) -> bool:
    """Tell whether a centre lies inside a ring already found."""
    polygon = np.array(sighting.outline_px, dtype=np.float32)
    x, y = camera.pixels(position[None])[0]
    return cv2.pointPolygonTest(polygon, (float(x), float(y)), False) >= 0
