"""Projects the edges of markers, as they are printed, placed and folded, by the true lens."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.sim.options import SimOptions
from hw.sim.picture.numbered import View, carries
from hw.sim.picture.pad_print import Fold, fold
from hw.sim.picture.shutter import Readout
from hw.sim.picture.view import Frustum, in_camera, matrix, middle, on_pad
from hw.sim.snapshot import CameraPose, PadPose
from landerd.camera_model import F64, CameraModel
from landerd.geometry import IDENTITY
from landerd.pad import Marker, PadLayout, Ring
from landerd.simulation.sight.edges import Edges, edges_of
from landerd.vision.pose import MIN_DEPTH_M, Pose, rotation_2d, turned_about_normal

_AT_ORIGIN = PadPose((0.0, 0.0, 0.0), IDENTITY)
# Largest turn of the camera by vibration, and from its interpolated way in an exposure, rad.
_SHAKES = 0.05
_ROUNDS = 2  # of finding the row in which a rolling shutter shows a point


@dataclass(frozen=True, slots=True)
class Seen:
    """One marker in one picture."""

    px: F64  # places of its edges, (n, 2)
    shown: NDArray[np.bool_]  # which of them the picture shows, (n,)
    pose: Pose  # true pose at the middle of the exposure
    path_px: F64  # of the image during the exposure, (2,)


class WorldView:
    """The pad's markers as the true lens sees them."""

    def __init__(self, printed: PadLayout, lens: CameraModel, options: SimOptions) -> None:
        """Take the layout as printed, the true lens, and the fold of the plate in `options`."""
        self._printed, self._lens = printed, lens
        self._fold = fold(printed, options.pad.bend_deg)
        self._frustum = Frustum(lens)
        self._places = [_placed(m, edges_of(m)) for m in printed.markers]
        self._centres = [np.array([*m.position_m, 0.0]) for m in printed.markers]
        self._radii = [
            float(np.linalg.norm(self._on_pad(_AT_ORIGIN, flat) - centre, axis=1).max())
            for flat, centre in zip(self._places, self._centres, strict=True)
        ]

    def seen(self, image: NDArray[np.uint8], view: View, number: int) -> Seen | None:
        """Return a marker in a picture; None: it is out of sight.

        Args:
            image: the numbered picture, parts of which may be missing.
            view: of the picture.
            number: of the marker in the layout.
        """
        if self._is_passed(view, number):
            return None
        camera, pad = middle(view.start, view.end), view.pad
        pose = self._pose(camera, pad, self._printed.markers[number])
        if float(pose.normal @ pose.t) <= 0.0 or pose.t[2] < MIN_DEPTH_M:
            return None
        flat = self._places[number]
        points = in_camera(camera, self._on_pad(pad, flat))
        in_front = points[:, 2] > MIN_DEPTH_M
        if not in_front.any():
            return None
        points[~in_front] = pose.t
        px = self._lens.pixels(points)
        if view.readout is not None:
            px = self._rolled(view, flat, points, px)
        shown = in_front & carries(image, view, px)
        return Seen(px, shown, pose, self._path(view))

    def _is_passed(self, view: View, number: int) -> bool:
        """Tell whether a marker is certainly not in the picture, faster than by projecting it."""
        place = on_pad(view.pad, self._centres[number][None])
        centres = np.concatenate([in_camera(camera, place) for camera in (view.start, view.end)])
        if self._frustum.holds(centres).any():
            return False
        readout = view.readout
        if readout is not None and len(readout.snapshots) > 1:
            cameras, looks, pads, turned = readout.poses
            centres = ((turned @ self._centres[number] + pads - cameras)[:, None] @ looks)[:, 0]
        reach = self._radii[number] + _SHAKES * np.linalg.norm(centres, axis=1)
        in_front = bool((centres[:, 2] > MIN_DEPTH_M + reach).all())
        return in_front and self._frustum.passes(centres, reach)

    def _pose(self, camera: CameraPose, pad: PadPose, marker: Marker) -> Pose:
        """Return the pose of a marker as on a flat plate, camera frame."""
        place = np.array([[*marker.position_m, 0.0]])
        t = in_camera(camera, on_pad(pad, place))[0]
        R = matrix(camera.R_local_camera).T @ matrix(pad.R_local_pad)
        if not isinstance(marker, Ring):
            R = turned_about_normal(R, math.radians(marker.heading_deg))
        return Pose(R, t, np.zeros((6, 6)), 0.0)

    def _on_pad(self, pad: PadPose, flat: F64) -> F64:
        """Return points (n, 3) of the flat pad in the local frame, on the plate as it is folded."""
        points = on_pad(pad, flat)
        bent: Fold | None = self._fold
        if bent is not None:
            beyond = flat[:, :2] @ bent.way > bent.least
            if beyond.any():
                points[beyond] = on_pad(bent.far_part(pad), flat[beyond])
        return points

    def _rolled(self, view: View, flat: F64, points: F64, px: F64) -> F64:
        """Return the places of points in the image, px, (n, 2), each exposed with its row.

        Args:
            view: with the poses during the readout.
            flat: the points on the flat pad, pad frame, m, (n, 3).
            points: the points at the middle of the exposure, camera frame, m, (n, 3).
            px: their places then, (n, 2).
        """
        readout = view.readout
        assert readout is not None
        height = self._lens.height
        shots = points[None] if len(readout.snapshots) == 1 else self._shots(readout, flat)
        n = np.arange(len(px))
        for _ in range(_ROUNDS):
            share = np.minimum(np.maximum((px[:, 1] + 0.5) / height, 0.0), 1.0)
            at = share * (len(shots) - 1)
            before = np.minimum(at.astype(np.intp), max(len(shots) - 2, 0))
            after = np.minimum(before + 1, len(shots) - 1)
            k = (at - before)[:, None]
            p = (1.0 - k) * shots[before, n] + k * shots[after, n]
            if readout.vibration is not None:
                t = readout.t + readout.readout_s * (share - 0.5)
                x, y, z = p.T
                about_x, about_y = readout.vibration.turns(t, readout.exposure_s).T
                # The cross product written out: numpy's own takes ten times as long.
                p = np.array([x - about_y * z, y + about_x * z, z - (about_x * y - about_y * x)]).T
            p[:, 2] = np.maximum(p[:, 2], MIN_DEPTH_M)
            px = self._lens.pixels(p)
        return px

    def _shots(self, readout: Readout, flat: F64) -> F64:
        """Return points (n, 3) of the flat pad in the camera frame at each snapshot, (k, n, 3)."""
        cameras, looks, pads, turned = readout.poses
        points = flat @ turned.transpose(0, 2, 1) + pads[:, None]
        bent: Fold | None = self._fold
        if bent is not None:
            beyond = flat[:, :2] @ bent.way > bent.least
            if beyond.any():
                far = [bent.far_part(s.pad) for s in readout.snapshots]
                points[:, beyond] = [on_pad(pad, flat[beyond]) for pad in far]
        shots: F64 = (points - cameras[:, None]) @ looks
        return shots

    def _path(self, view: View) -> F64:
        """Return the path of the pad in the image during the exposure, px, (2,)."""
        if view.start == view.end:
            return np.zeros(2)
        marker = np.array(view.pad.position)[None]
        first, last = (in_camera(c, marker)[0] for c in (view.start, view.end))
        focal = self._lens.focal
        if min(first[2], last[2]) < MIN_DEPTH_M:
            return np.zeros(2)
        path: F64 = focal * (last[:2] / last[2] - first[:2] / first[2])
        return path


def _placed(marker: Marker, edges: Edges) -> F64:
    """Return the middles of a marker's edges (n, 3), flat pad's frame, m."""
    points = edges.points
    if not isinstance(marker, Ring):
        points = points @ rotation_2d(math.radians(marker.heading_deg)).T
    return np.column_stack([points + np.array(marker.position_m), np.zeros(len(points))])
