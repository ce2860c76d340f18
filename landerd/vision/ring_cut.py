"""Rings that the image's edge cuts, at any distance, by an arc of one of their edges.

The visible part of such a ring does not have a ring's moments, so `ring_segment` does not find it.
But where its outline, or its hole's, does not run along the image's edge, it is an arc of an
ellipse. That determines a cone of sight and with it two poses, good enough to start a fit to the
edges (`ring_search.RingSearch.find_cut`).
"""

from collections.abc import Iterator

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.pad import Ring
from landerd.vision.arrays import U8
from landerd.vision.ring_edges import points_on
from landerd.vision.ring_explained import MIN_COS
from landerd.vision.ring_pose import CirclePose, cone_through, poses_of_cone

# Least length of an arc, px of the level: of 90 arcs of rings of which 0.3 and more was seen the
# shortest had 33.
_LEAST_ARC = 32
# Largest rms distance of an arc's pixels from the conic, px of the level: those arcs gave 0.22 to
# 0.35, as pixels are whole.
_MAX_OFF_PX = 0.42
_CONVEX = 0.85  # least area between an arc and its chord, over that of its convex hull
_INWARDS_PX = 2.0  # distance from the arc inwards at which it is tested for black or white
# A ring counts as cut if a circle of this share of its radius is. One that is cut less is found as
# a whole one, and better so where motion makes it look larger than it is.
_CUT_SHARE = 0.93
_BORDER_PX = 2  # width of the level's border: dark areas end there because the image does


def cut_rings(dark: U8, camera: CameraModel, ring: Ring) -> list[tuple[CirclePose, CirclePose]]:
    """Return both poses of what may be a ring that the image's edge cuts, the longest arc first.

    Args:
        dark: (height, width), 255 where the whole image is dark, else 0; it is reduced.
        camera: that would see the image at this size.
        ring: its true size and ratio.
    """
    found = []
    for arc in sorted(_arcs(dark), key=len, reverse=True):
        poses = _poses(dark, camera, ring, arc)
        if poses is not None and _is_cut(camera, ring, poses[0]):
            found.append(poses)
    return found


def _arcs(dark: U8) -> Iterator[F64]:
    """Yield the parts (n, 2) of outlines of what is dark that do not run along the image's edge."""
    contours, _ = cv2.findContours(_at_border(dark), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    most = np.array(dark.shape[::-1]) - _BORDER_PX
    for contour in contours:
        if len(contour) < _LEAST_ARC:
            continue
        at = contour[:, 0]
        is_border = np.asarray(((at < _BORDER_PX) | (at >= most)).any(axis=1))
        # Begun at the image's edge, that no arc is in two parts.
        first = int(is_border.argmax())
        around = np.concatenate([contour[first:], contour[:first]])
        border = np.flatnonzero(np.concatenate([is_border[first:], is_border[:first], [True]]))
        for k in np.flatnonzero(np.diff(border) > _LEAST_ARC):
            arc = around[border[k] + 1 : border[k + 1]]
            if _is_convex(arc):
                yield arc[:, 0].astype(np.float64)


def _at_border(dark: U8) -> U8:
    """Return what is dark and connected to the image's edge: of texture the rest is most."""
    count, labelled = cv2.connectedComponents(dark, connectivity=8, ltype=cv2.CV_32S)
    labels, n = np.asarray(labelled, dtype=np.int32), _BORDER_PX
    is_kept = np.zeros(count, np.uint8)
    for border in (labels[:n], labels[-n:], labels[:, :n], labels[:, -n:]):
        is_kept[border] = 255
    is_kept[0] = 0
    return is_kept[labels]


def _is_convex(arc: "cv2.typing.MatLike") -> bool:
    """Tell whether an arc (n, 1, 2) bends one way only: of what texture outlines little does."""
    return cv2.contourArea(arc) > _CONVEX * cv2.contourArea(cv2.convexHull(arc))


def _poses(
    dark: U8, camera: CameraModel, ring: Ring, arc: F64
) -> tuple[CirclePose, CirclePose] | None:
    """Return both poses of a ring of which an edge is an arc (n, 2), px; None: it is no ellipse."""
    rays = camera.rays(arc)
    cone = cone_through(rays)
    poses = None if cone is None else poses_of_cone(cone, 1.0)
    if cone is None or poses is None or not all(_may_be_seen(*pose) for pose in poses):
        return None
    v = np.column_stack([rays, np.ones(len(rays))])
    across = v @ cone
    off = (across * v).sum(axis=1) / (2.0 * np.hypot(across[:, 0], across[:, 1]))
    if np.sqrt(np.mean(off * off)) * camera.fx > _MAX_OFF_PX:
        return None
    inwards = camera.pixels(poses[0][0][None])[0] - arc
    inwards *= _INWARDS_PX / np.maximum(np.hypot(*inwards.T), 1e-9)[:, None]
    x, y = np.rint(arc + inwards).astype(np.intp).T
    h, w = dark.shape
    is_outline = np.mean(dark[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)] > 0) > 0.5
    radius = ring.radius_m * (1.0 if is_outline else ring.inner_ratio)
    (t, n), (other_t, other_n) = poses
    return (radius * t, n), (radius * other_t, other_n)


def _may_be_seen(position: F64, normal: F64) -> bool:
    """Tell whether a ring lies in front of the camera, and not so flat that its edges tell none."""
    distance, ahead = float(np.linalg.norm(position)), float(position[2])
    return ahead > 0.0 and float(position @ normal) > MIN_COS * distance


def _is_cut(camera: CameraModel, ring: Ring, pose: CirclePose) -> bool:
    points = pose[0] + _CUT_SHARE * (points_on(ring, pose) - pose[0])
    if float(points[:, 2].min()) <= 0.0:
        return True
    px = camera.pixels(points)
    return bool((px < 0.0).any() or (px > (camera.width - 1, camera.height - 1)).any())
