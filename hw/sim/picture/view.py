"""One camera at one pose: projection from the world to pixels, and which markers are in view."""

import functools
import itertools
import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.snapshot import CameraPose, PadPose
from landerd.camera_model import CameraModel
from landerd.geometry import Mat3, Vec3, dot, sub
from landerd.pad import WHYCODE_BAND, Marker, PadLayout, Ring, Square

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

NEAR_PLANE_M = 0.01  # depth below which nothing is drawn
CIRCLE_POINTS = 32  # number of points on a marker's outline
_CELL_RINGS = (1.0, 0.75, 0.5, 0.25)  # outlines of a square and in it, shares of its side
_ABOVE_M = 1e-3  # least height of a camera above a plane that it sees

# Second map for cv2.remap if its first map holds both coordinates. OpenCV's types forbid None
# here, and with an empty array, which they allow, it draws wrong pictures.
NO_SECOND_MAP = cast(F64, None)


class Frustum:
    """The space that a camera sees, a little widened, as half-spaces of the camera frame."""

    def __init__(self, camera: CameraModel) -> None:
        """Compute the borders."""
        self.camera = camera
        x = np.arange(-1.0, camera.width + 1.0)
        y = np.arange(-1.0, camera.height + 1.0)
        border = np.concatenate(
            [
                np.column_stack([np.tile(x, 2), np.repeat([y[0], y[-1]], len(x))]),
                np.column_stack([np.repeat([x[0], x[-1]], len(y)), np.tile(y, 2)]),
            ]
        )
        rays = camera.rays(border)
        # Outside the field of view the distortion polynomial may fold back into it, so that
        # nothing beyond this margin may be projected.
        margin = 0.05 * (rays.max(axis=0) - rays.min(axis=0))
        (x0, y0), (x1, y1) = rays.min(axis=0) - margin, rays.max(axis=0) + margin
        planes = np.array(
            [
                [0.0, 0.0, 1.0, -NEAR_PLANE_M],
                [1.0, 0.0, -x0, 0.0],
                [-1.0, 0.0, x1, 0.0],
                [0.0, 1.0, -y0, 0.0],
                [0.0, -1.0, y1, 0.0],
            ]
        )
        self.planes = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)

    def clip(self, polygon: F64) -> F64:
        """Return the part (m, 3) of a convex polygon (n, 3), camera frame, that is in view."""
        return self._clipped([polygon])[0]

    def _cut(self, polygon: F64, crossed: NDArray[np.bool_]) -> F64:
        """Return the part of a convex polygon (n, 3) inside the borders that it crosses.

        `crossed` tells which borders these are, (planes,).
        """
        points = [tuple(p) for p in polygon.tolist()]
        for a, b, c, d in self.planes[crossed].tolist():
            kept: list[tuple[float, ...]] = []
            inside = [a * x + b * y + c * z + d for x, y, z in points]
            for i, (p, here) in enumerate(zip(points, inside, strict=True)):
                before = inside[i - 1]
                if (here >= 0.0) != (before >= 0.0):
                    q, k = points[i - 1], before / (before - here)
                    kept.append(tuple(u + k * (w - u) for u, w in zip(q, p, strict=True)))
                if here >= 0.0:
                    kept.append(p)
            points = kept
        return np.array(points, dtype=np.float64).reshape(-1, 3)

    def contains(self, points: F64) -> bool:
        """Tell whether all points (n, 3), camera frame, can be projected."""
        return bool(self.holds(points).all())

    def holds(self, points: F64) -> NDArray[np.bool_]:
        """Tell which points (n, 3), camera frame, can be projected, (n,)."""
        return np.asarray((self._distances(points) >= 0.0).all(axis=1), dtype=np.bool_)

    def near(self, centres: F64, radii: F64) -> NDArray[np.bool_]:
        """Tell which balls about centres (n, 3), camera frame, may be in view, (n,)."""
        return np.asarray((self._distances(centres) >= -radii[:, None]).all(axis=1))

    def touches(self, centre: F64, radius: float) -> bool:
        """Tell whether a ball about a centre (3,), camera frame, may be in view."""
        return bool((self.planes[:, :3] @ centre + self.planes[:, 3] >= -radius).all())

    def passes(self, centres: F64, radii: F64) -> bool:
        """Tell whether all balls about centres (n, 3), camera frame, lie beyond one border.

        Then nothing between them is in view either.
        """
        return bool((self._distances(centres) < -radii[:, None]).all(axis=0).any())

    def outlines(self, polygons: list[F64]) -> list[F64]:
        """Return the parts in view of convex polygons (n, 3), camera frame, as px (m, 2).

        m is 0 for a polygon that is out of view.
        """
        seen = self._clipped(polygons)
        if not any(map(len, seen)):
            return [p[:, :2] for p in seen]
        pixels = self.camera.pixels(np.concatenate(seen))
        ends = itertools.accumulate(map(len, seen), initial=0)
        return [pixels[start:end] for start, end in itertools.pairwise(ends)]

    def _clipped(self, polygons: list[F64]) -> list[F64]:
        """Return the parts (m, 3) of convex polygons (n, 3), camera frame, that are in view."""
        outside = self._distances(np.concatenate(polygons)) < 0.0
        if not outside.any():
            return polygons
        starts = list(itertools.accumulate(map(len, polygons[:-1]), initial=0))
        crossed = np.asarray(np.logical_or.reduceat(outside, starts))
        hidden = np.asarray(np.logical_and.reduceat(outside, starts))
        cut, gone = np.asarray(crossed.any(axis=1)), np.asarray(hidden.any(axis=1))
        return [
            p[:0] if g else self._cut(p, borders) if c else p
            for p, g, c, borders in zip(polygons, gone, cut, crossed, strict=True)
        ]

    def _distances(self, points: F64) -> F64:
        """Return the distances (n, planes) of points (n, 3) from borders, positive inside."""
        return cast(F64, points @ self.planes[:, :3].T + self.planes[:, 3])


def matrix(m: Mat3) -> F64:
    """Return a rotation as an array (3, 3)."""
    return np.array(m, dtype=np.float64)


def in_camera(pose: CameraPose, points: F64) -> F64:
    """Return points (n, 3) of the local frame in the camera frame."""
    inside: F64 = (points - np.array(pose.position)) @ matrix(pose.R_local_camera)
    return inside


def on_pad(pad: PadPose, points: F64) -> F64:
    """Return points (n, 3) of the pad frame in the local frame."""
    placed: F64 = points @ matrix(pad.R_local_pad).T + np.array(pad.position)
    return placed


def is_above(pose: CameraPose, plane: PadPose) -> bool:
    """Tell whether the camera is above a plane, on the side from which it can be seen."""
    R = plane.R_local_pad
    into = (R[0][2], R[1][2], R[2][2])
    return dot(into, sub(pose.position, plane.position)) < -_ABOVE_M


def plane_homography(pose: CameraPose, plane: PadPose) -> F64 | None:
    """Return the homography (3, 3) from rays (x, y, 1) to points (north, east, 1) of a plane, m.

    Its third row gives a ray's descent to the plane per unit of depth, which is positive if the ray
    meets the plane. None: the camera is not above the plane.
    """
    R = matrix(plane.R_local_pad).T
    cx, cy, cz = R @ (np.array(pose.position) - np.array(plane.position))
    if cz >= -_ABOVE_M:
        return None
    d = R @ matrix(pose.R_local_camera)
    return np.stack([cx * d[2] - cz * d[0], cy * d[2] - cz * d[1], d[2]])


def footprint(det: float, descent: float, pitch: float) -> float:
    """Return the distance between neighbouring samples on a plane, m.

    The determinant of a homography's Jacobian is that of the homography over the cube of its
    denominator.

    Args:
        det: determinant of the `plane_homography`.
        descent: value of its third row for the ray.
        pitch: distance between neighbouring rays on z = 1.
    """
    return pitch * math.sqrt(abs(det) / descent**3)


def level_of_detail(apart_m: float, texel_m: float, levels: int) -> int:
    """Return the level of detail whose texels are nearest to the distance of samples.

    Args:
        apart_m: distance of samples.
        texel_m: side of a texel of level 0; it doubles with each level.
        levels: number of levels.
    """
    return min(max(round(math.log2(max(apart_m, 1e-9) / texel_m)), 0), levels - 1)


def rays_at(camera: CameraModel, x: F64, y: F64) -> F32:
    """Return the rays (rows, columns, 2) of the pixels at columns x and rows y."""
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    return camera.rays(pixels.reshape(-1, 2)).reshape(*pixels.shape).astype(np.float32)


def blur(image: NDArray[np.uint8], sigma: float) -> None:
    """Blur an image in place by a Gaussian; sigma in px, below 0.1 it does nothing."""
    if sigma >= 0.1:
        size = 2 * math.ceil(2.5 * sigma) + 1
        cv2.GaussianBlur(image, (size, size), sigma, dst=image, borderType=cv2.BORDER_REPLICATE)


@functools.lru_cache(maxsize=1)  # it is needed for each marker of a picture
def middle(start: CameraPose, end: CameraPose) -> CameraPose:
    """Return the pose half-way between two poses that differ little."""
    if start == end:
        return start
    position = tuple((a + b) / 2 for a, b in zip(start.position, end.position, strict=True))
    # The rotation nearest to the mean of two is the one half-way between them.
    u, _, vt = np.linalg.svd(matrix(start.R_local_camera) + matrix(end.R_local_camera))
    R = u @ vt
    return CameraPose(cast(Vec3, position), cast(Mat3, tuple(tuple(row) for row in R.tolist())))


def visible_markers(
    layout: PadLayout,
    frustum: Frustum,
    pose: CameraPose,
    pad: PadPose,
    share: float = 0.5,
    *,
    by_cells: bool = False,
) -> list[int]:
    """Return the indices in `layout.markers` of markers that are in the image.

    A marker is in the image if a share of one of its outlines is. A ring has two, as near the pad
    vision uses the inner one. Only geometry counts, not what may hide a marker.

    Args:
        layout: of the pad.
        frustum: of the camera.
        pose: of the camera.
        pad: its pose.
        share: least share of an outline.
        by_cells: whether outlines round a square's inner cells count, too.
    """
    if not is_above(pose, pad):
        return []
    camera = frustum.camera
    outlines, parts = _outlines(layout.markers, by_cells=by_cells)
    points = in_camera(pose, on_pad(pad, outlines))
    shown = frustum.holds(points)
    if not shown.any():
        return []
    x, y = camera.pixels(points[shown]).T
    shown[shown] = (
        (x >= -0.5) & (x <= camera.width - 0.5) & (y >= -0.5) & (y <= camera.height - 0.5)
    )
    return [
        index
        for index, of_marker in enumerate(parts)
        if any(np.count_nonzero(shown[k]) >= share * (k.stop - k.start) for k in of_marker)
    ]


@functools.cache
def _outlines(
    markers: tuple[Marker, ...], *, by_cells: bool
) -> tuple[F64, tuple[list[slice], ...]]:
    """Return the points of all markers' outlines (n, 3), pad frame, m, and slices of them.

    For each marker these are the slices of its outlines.
    """
    outlines: list[F64] = []
    parts: list[list[slice]] = []
    start = 0
    for marker in markers:
        of_marker = _outlines_of(marker, by_cells=by_cells)
        parts.append([])
        for outline in of_marker:
            parts[-1].append(slice(start, start + len(outline)))
            start += len(outline)
        outlines += of_marker
    return np.concatenate(outlines), tuple(parts)


def _outlines_of(marker: Marker, *, by_cells: bool) -> list[F64]:
    """Return the points (n, 3) of each outline of a marker, pad frame, m, the outermost first."""
    a = np.linspace(0.0, 2.0 * math.pi, CIRCLE_POINTS, endpoint=False)
    if isinstance(marker, Square):
        # Distance of the square's border from its centre in each direction.
        border = 0.5 * marker.size_m / np.maximum(np.abs(np.cos(a)), np.abs(np.sin(a)))[:, None]
        radii = [share * border for share in (_CELL_RINGS if by_cells else (1.0,))]
        a = a + math.radians(marker.heading_deg)
    else:
        inner = marker.inner_ratio if isinstance(marker, Ring) else WHYCODE_BAND
        radii = [np.array(marker.radius_m), np.array(inner * marker.radius_m)]
    place = np.array([*marker.position_m, 0.0])
    ways = np.column_stack([np.cos(a), np.sin(a), np.zeros(len(a))])
    return [place + r * ways for r in radii]
