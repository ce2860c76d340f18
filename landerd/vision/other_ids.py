"""Tells whether a ring is another pad's, by the id of a tag beside it.

Landing pads of the same print may stand side by side and differ only by the ids of their square
markers. An id is read from a side of 14 px on. It counts only if it is read without any error, and
its tag is as large and as far from the ring as the pad's own tag would be.
"""

import math

import numpy as np

from landerd.camera_model import F64, CameraModel, Window
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring
from landerd.vision.arrays import Image
from landerd.vision.patch import is_any_in_picture
from landerd.vision.pose import MIN_DEPTH_M, circle, px_per_m, rotation_from
from landerd.vision.square import SquareFinder

# Least expected side of a tag, px, that is looked for, and the side to which smaller ones than that
# are enlarged.
_MIN_SIDE_PX, _READ_AT_PX = 14.0, 40.0
_HEADINGS = 32  # headings of the pad at which a tag is tested for being in the picture
_LEAST_SIDE = 0.6  # least side of outlines that are looked at, over the expected one
# Largest errors of a tag's side, over the side, and of its distance from the ring, over the larger
# of distance and side.
_SIZE_OFF, _PLACE_OFF = 0.25, 0.2


class OtherIds:
    """Looks for squares with other ids about the rings of one pad."""

    def __init__(self, layout: PadLayout, camera: CameraModel, squares: SquareFinder) -> None:
        """Prepare for one camera.

        Args:
            layout: of the pad.
            camera: the lens.
            squares: the finder of the pad's squares.
        """
        # For each ring: dictionary, side and distance from the ring, m, of the pad's squares;
        # those that agree in all three only once.
        self._beside = {
            ring: sorted(
                {
                    (s.dictionary, s.size_m, math.dist(s.position_m, ring.position_m))
                    for s in layout.squares
                }
            )
            for ring in layout.rings
        }
        self._camera = camera
        self._finder = squares

    def beside(self, image: Image, ring: Ring, sighting: MarkerSighting) -> int | None:
        """Return the id of a square beside a ring that proves it another pad's; None: none does.

        Args:
            image: grey image (height, width).
            ring: of the pad.
            sighting: what was taken for this ring.
        """
        best = sighting.solutions[0]
        t, normal = np.array(best.position), np.array(best.normal)
        scale_px = px_per_m(self._camera, t, normal)
        axes = rotation_from(normal)[:, :2]
        for dictionary, size, distance in self._beside[ring]:
            side_px = scale_px * size
            window = self._window(t + circle(distance + 0.75 * size) @ axes.T)
            if side_px < _MIN_SIDE_PX or window is None:
                continue
            ends = t + circle(distance + 0.5 * size, _HEADINGS) @ axes.T
            if not is_any_in_picture(self._camera, ends):
                continue
            scale = max(1.0, _READ_AT_PX / side_px)
            least_px = _LEAST_SIDE * scale * side_px
            others = self._finder.find_others(image, dictionary, window, scale, least_px)
            for number, corners in others:
                side, away = self._on_plane(corners, t, normal)
                is_as_large = abs(side - size) < _SIZE_OFF * size
                if is_as_large and abs(away - distance) < _PLACE_OFF * max(distance, size):
                    return number
        return None

    def _window(self, points: F64) -> Window | None:
        """Return the part of the picture that holds points (n, 3), camera frame, m; may be empty.

        None: a point is behind the lens, or nearer to it than `MIN_DEPTH_M`.
        """
        if float(points[:, 2].min()) < MIN_DEPTH_M:
            return None
        px = self._camera.pixels(points)
        (x0, y0), (x1, y1) = px.min(axis=0), px.max(axis=0)
        window = Window(math.floor(x0), math.floor(y0), math.ceil(x1) + 1, math.ceil(y1) + 1)
        return window.within(self._camera.width, self._camera.height)

    def _on_plane(self, corners: F64, t: F64, normal: F64) -> tuple[float, float]:
        """Return the mean side of a square, m, and its centre's distance from t, m.

        Args:
            corners: of the square in the image, px, (4, 2).
            t: point (3,) of the plane it lies in, camera frame, m.
            normal: unit vector (3,) of that plane.
        """
        rays = np.column_stack([self._camera.rays(corners), np.ones(4)])
        points = rays * (float(normal @ t) / (rays @ normal))[:, None]
        side = float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).mean())
        return side, float(np.linalg.norm(points.mean(axis=0) - t))
