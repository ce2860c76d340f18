"""Where a pad's ring is by the outline of its plate, for rings that are broken up themselves.

Leaf shade together with dirt leaves no dark component that is round as a whole, while the white
plate still has four straight sides. Bright areas with four corners are taken for the plate, their
poses computed (Collins and Bartoli, "Infinitesimal plane-based pose estimation", IJCV 2014), and
the one is returned under which the edges of plate and ring are seen at most of a few places.
`ring_search` starts its fit there (the part PLATE of a search).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.pad import PadLayout, Ring
from landerd.vision.arrays import U8, Mask
from landerd.vision.edge_profile import is_step
from landerd.vision.patch import levels_at
from landerd.vision.plate_outline import along, plate_corners
from landerd.vision.pose import circle
from landerd.vision.pyramid import Level
from landerd.vision.ring_pose import CirclePose
from landerd.vision.square_pose import shortest_side

# ---- bright areas with four corners ------------------------------------------------------------
# A pixel is bright if it exceeds the mean of its surroundings (side, px of a level) by a factor and
# by some grey levels. The first pair finds white on bright ground, the second half-shaded white on
# dark ground, which the first would join with sunny patches of that. Of 192 plain pads 4 to 17 m
# away 149 have four corners by these, 96 by the second alone.
_WAYS = ((61, 1.15), (41, 1.35))
_BRIGHTER_BY = 6.0
# Least points of an outline, least area, px, and largest area, a share of the level.
_LEAST_OUTLINE_PX, _LEAST_AREA_PX, _MOST_AREA = 24, 60.0, 0.4
# Least share of the enclosing quadrilateral that the hull fills, of the hull that the area fills,
# and least hull area over its circumference squared (a square has 1/16). Blur rounds small corners.
_LEAST_FOUR, _LEAST_FILLED, _LEAST_WIDE = 0.8, 0.6, 0.02
_MOST_QUADS = 8  # of a search that are tried: those with the straightest sides

# ---- sides at the steepest fall ----------------------------------------------------------------
# Sides are moved to where grey levels fall most steeply outwards. Places along a side, as shares of
# it, and distances across it that are looked at, px: smaller ones for sides shorter than
# _FULL_SIDE_PX.
_ALONG = np.linspace(0.12, 0.88, 16)
_ACROSS = np.arange(-3.0, 3.01, 0.5)
# Rounds of that; length below which distances are reduced; shortest side; largest move of a corner.
_ROUNDS, _FULL_SIDE_PX, _SHORTEST_SIDE_PX, _MOST_MOVED_PX = 2, 9.0, 4.0, 6.0
_BEFORE, _NEXT = np.array([3, 0, 1, 2]), np.array([1, 2, 3, 0])  # indices of neighbouring corners
# Least fall, grey levels in half a px, and least number of a side's places with such a fall.
_LEAST_FALL, _LEAST_PLACES = 4.5, 6
# Before any pose is known: distance from the outline to either side, of its shortest side in the
# image, and least share of the places with a step. 850 plates that were seen have it, in 2000
# pictures of pads; 0.6 loses four of them.
_BESIDE_SIDE, _LEAST_OUTLINED = 0.045, 0.45

# ---- poses -------------------------------------------------------------------------------------
# Largest rms error of the corners under a pose: a share of the shortest side, plus px.
_MOST_OFF, _MOST_OFF_PX = 0.06, 1.0
_BESIDE = 0.12  # distance from the plate's outline to either side, in radii of the ring
_PER_SIDE, _PLACES = 12, 24  # places on each side of the plate, and round the ring
# Least share of the places with a step: on the plate's outline; and from hole to stroke as well as
# from white to stroke. Plates in leaf shade and dirt have 0.8 to 1; of 823 tiles of photographs
# none has as much.
_LEAST_PLATE, _LEAST_RING = 0.75, 0.75


class PlateSearch:
    """Looks for a pad's plate, to tell where one of its rings is."""

    def __init__(self, layout: PadLayout, ring: Ring) -> None:
        """Prepare the places to look at."""
        corners = plate_corners(layout.plate)
        self._corners = np.column_stack([corners, np.zeros(4)])
        self._centre = np.array(ring.position_m)
        places, ways = along(corners, _PER_SIDE)
        ways = ways * (_BESIDE * ring.radius_m)
        outer = circle(ring.radius_m, _PLACES)
        inner = ring.inner_ratio * outer
        at = (0.7 * inner, 1.2 * outer, 0.5 * (inner + outer))
        self._on_ring = len(places)  # first pair of points that belongs to the ring
        brighter = [places - ways, *(self._centre + p for p in at[:2])]
        darker = [places + ways, *(self._centre + p for p in (at[2], at[2]))]
        self._points: F64 = np.concatenate([*brighter, *darker])

    def find(self, image: U8, levels: Sequence[Level], camera: CameraModel) -> CirclePose | None:
        """Return the pose of the ring on what looks most like the plate; None: nothing does.

        Args:
            image: grey image (height, width).
            levels: of its pyramid in which corners are looked for.
            camera: the lens.
        """
        quads = [q for level in levels for way in _WAYS for q in _quads(level, *way)]
        straightest = sorted(quads, key=lambda found: -found[0])[:_MOST_QUADS]
        if not straightest:
            return None
        corners = _on_steps(image, np.array([outline for _, outline in straightest]))
        corners = corners[_are_outlined(image, corners)]
        poses = [pose for outline in corners for pose in self._poses(camera, outline)]
        if not poses:
            return None
        shares = self._shares_seen(image, camera, poses)
        likest = int(np.argmax(shares))
        R, t = poses[likest]
        return (t + R[:, :2] @ self._centre, R[:, 2]) if shares[likest] > 0.0 else None

    def _poses(self, camera: CameraModel, corners: F64) -> list[tuple[F64, F64]]:
        """Return the poses (R, t) of the plate for corners (4, 2), px, either way round."""
        rays = camera.rays(corners)
        if not _are_clockwise(np.diff(rays, axis=0)):
            rays, corners = rays[::-1], corners[::-1]
        most_off = (_MOST_OFF * shortest_side(corners) + _MOST_OFF_PX) / camera.fx
        poses = []
        for first in range(4):
            turned = np.ascontiguousarray(np.roll(rays, first, axis=0))
            _, turns, places, off = cv2.solvePnPGeneric(
                self._corners, turned, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
            )
            for turn, place, by in zip(turns, places, np.ravel(off), strict=True):
                R, t = cv2.Rodrigues(turn)[0].astype(np.float64), place[:, 0].astype(np.float64)
                if by < most_off and float(R[:, 2] @ t) > 0.0:
                    poses.append((R, t))
        return poses

    def _shares_seen(self, image: U8, camera: CameraModel, poses: list[tuple[F64, F64]]) -> F64:
        """Return for each pose the product of the shares of plate's and ring's edges seen.

        0: too few.
        """
        points = np.concatenate([t + self._points @ R[:, :2].T for R, t in poses])
        levels = levels_at(image, camera, points).reshape(len(poses), 2, -1)
        steps = is_step(levels[:, 1], levels[:, 0])
        plate = steps[:, : self._on_ring].mean(axis=1)
        hole, white = steps[:, self._on_ring :].reshape(len(poses), 2, -1).mean(axis=2).T
        is_seen = (plate >= _LEAST_PLATE) & (np.minimum(hole, white) >= _LEAST_RING)
        return np.where(is_seen, plate * hole * white, 0.0)


def _on_steps(image: U8, corners: F64) -> F64:
    """Return the corners (n, 4, 2) moved so that sides lie where white ends.

    Left out are those with a side along which it does not end, or a corner that moves too far.
    """
    moved = corners
    for _ in range(_ROUNDS):
        lines, has_ends = _side_lines(image, moved)
        corners = corners[has_ends]
        (a, b, c), (d, e, f) = (np.moveaxis(x, 2, 0) for x in (lines[:, _BEFORE], lines))
        crossed = np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = crossed[..., :2] / crossed[..., 2:]
        is_near = (np.abs(moved - corners) < _MOST_MOVED_PX).all(axis=(1, 2))
        corners, moved = corners[is_near], moved[is_near]
    return moved


def _side_lines(image: U8, corners: F64) -> tuple[F64, Mask]:
    """Return homogeneous lines (m, 4, 3) where white ends near each side of corners (n, 4, 2).

    Only of those m of the n for which it ends along all sides; a mask (n,) tells which these are.
    """
    sides = corners[:, _NEXT] - corners
    lengths = np.hypot(sides[..., 0], sides[..., 1])
    has_ends = lengths.min(axis=1) >= _SHORTEST_SIDE_PX
    if not has_ends.any():
        return np.empty((0, 4, 3)), has_ends
    corners, sides, lengths = corners[has_ends], sides[has_ends], lengths[has_ends]
    out = np.stack([sides[..., 1], -sides[..., 0]], axis=2) / lengths[..., None]
    out *= np.where(_are_clockwise(sides), 1.0, -1.0)[:, None, None]
    across = np.minimum(1.0, lengths / _FULL_SIDE_PX)[..., None] * _ACROSS
    places = corners[:, :, None] + _ALONG[:, None] * sides[:, :, None]
    at = places[:, :, :, None] + across[:, :, None, :, None] * out[:, :, None, None]
    x, y = np.moveaxis(at.reshape(-1, len(_ACROSS), 2), 2, 0).astype(np.float32)
    grey = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    levels = grey.reshape(at.shape[:4]).astype(np.float64)
    falls = np.maximum(levels[..., :-1] - levels[..., 1:], 0.0) ** 2
    weight = falls.sum(axis=3)
    between = 0.5 * (across[..., :-1] + across[..., 1:])
    off = (falls * between[:, :, None]).sum(axis=3) / np.maximum(weight, 1e-6)
    is_step = weight > _LEAST_FALL**2
    is_told = is_step.sum(axis=2).min(axis=1) >= _LEAST_PLACES
    ends = (places + off[..., None] * out[:, :, None])[is_told]
    has_ends[has_ends] = is_told
    lines = [
        _line(p[seen])
        for of_sides, are_seen in zip(ends, is_step[is_told], strict=True)
        for p, seen in zip(of_sides, are_seen, strict=True)
    ]
    return np.array(lines).reshape(-1, 4, 3), has_ends


def _line(points: F64) -> F64:
    """Return the homogeneous line (3,) fitted robustly to points (n, 2)."""
    fitted = cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01)
    dx, dy, x, y = fitted.ravel().astype(np.float64).tolist()
    return np.array([-dy, dx, dy * x - dx * y])


def _are_clockwise(sides: F64) -> Mask:
    """Tell which convex outlines run clockwise in the image, by their sides (..., 2 or more, 2)."""
    first, second = sides[..., 0, :], sides[..., 1, :]
    are_clockwise: Mask = first[..., 0] * second[..., 1] >= first[..., 1] * second[..., 0]
    return are_clockwise


def _are_outlined(image: U8, corners: F64) -> Mask:
    """Tell for which corners (n, 4, 2) steps are seen along enough of the four sides.

    Asked before poses are computed, which takes several times as long.
    """
    if not len(corners):
        return np.zeros(0, np.bool_)
    sides = corners[:, _NEXT] - corners
    reach = _BESIDE_SIDE * np.hypot(sides[..., 0], sides[..., 1]).min(axis=1)[:, None, None]
    places, ways = along(corners, _PER_SIDE)
    at = np.stack([places - reach * ways, places + reach * ways])
    x, y = np.moveaxis(at.reshape(-1, 4 * _PER_SIDE, 2), 2, 0).astype(np.float32)
    grey = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    brighter, darker = grey.reshape(2, -1, 4 * _PER_SIDE).astype(np.float64)
    steps = is_step(darker, brighter)
    return np.asarray(steps.mean(axis=1) > _LEAST_OUTLINED)


def _quads(level: Level, around_px: int, factor: float) -> list[tuple[float, F64]]:
    """Return straightness and corners (4, 2), px of the image, of bright areas with four corners.

    Straightness is the share of the quadrilateral that the area's hull fills.

    Args:
        level: of the pyramid.
        around_px: side of the surroundings, px of the level.
        factor: by which bright pixels exceed the mean of them.
    """
    around = cv2.blur(level.image, (around_px, around_px))
    least = cv2.convertScaleAbs(around, alpha=factor, beta=_BRIGHTER_BY)
    bright = cv2.compare(level.image, least, cv2.CMP_GT)
    bright = cv2.morphologyEx(bright, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    outlines = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    found = []
    for outline in [o for o in outlines if len(o) >= _LEAST_OUTLINE_PX]:
        inside = cv2.contourArea(outline)
        if inside <= _LEAST_FILLED * _LEAST_AREA_PX:
            continue  # before the hull, which takes longer
        hull = cv2.convexHull(outline)
        area, length = cv2.contourArea(hull), cv2.arcLength(hull, True)
        if not max(_LEAST_AREA_PX, _LEAST_WIDE * length**2) < area < _MOST_AREA * bright.size:
            continue
        if inside <= _LEAST_FILLED * area or len(hull) < 4:
            continue
        corners = cv2.approxPolyN(hull.astype(np.float32), 4, ensure_convex=True).reshape(-1, 2)
        share = area / max(cv2.contourArea(corners), 1.0)
        if len(corners) == 4 and share > _LEAST_FOUR:
            at = (corners + 0.5) * level.reduction - 0.5 + level.corner
            found.append((share, at.astype(np.float64)))
    return found
