"""A ring on level ground by the four sides of its plate, where nothing else shows it.

Where leaf shade, dirt or blur leave neither edges nor grey levels of a ring to be fitted, the sides
of the plate still tell its place, heading and size on the plane that gravity gives, and with them
where the ring is. Whether there is a ring is decided by what should be bright and dark on it.

`ring_search` calls `find` at places that correlate with a level ring (`ring_match`), `search` calls
`near` where an expected ring's place is uncertain. The sighting has stage PLATE.
"""

import math

import numpy as np

from landerd.camera_model import F64, CameraModel, Window
from landerd.geometry import Vec3
from landerd.messages import PLATE, MarkerSighting, PoseSolution
from landerd.pad import Plate, Ring
from landerd.vision.arrays import Image
from landerd.vision.patch import levels_at
from landerd.vision.plate_heading import PlateHeading
from landerd.vision.pose import (
    LEVEL_SIGMA,
    MIN_DEPTH_M,
    circle,
    mat3,
    normal_of,
    px_per_m,
    rotation_2d,
    rotation_from,
    vec3,
)
from landerd.vision.ring_match import DARK, SMALLEST_PX, STEP, matches

# Factors on the size that correlation found; the one that correlates best is used.
_SIZES = (0.8, 0.87, 0.94, 1.0, 1.07, 1.15, 1.23)
_OFF_SIGMA, _SIZE_SIGMA = 0.3, 0.15  # sigma of the place found, in radii, and of the size, a share
# Radii of the circles about the ring's centre on which it is compared: in the hole, in its radii;
# in the stroke, shares of its width from the inner edge; outside, in the ring's radii.
_INSIDE, _STROKE, _OUTSIDE = (0.25, 0.54, 0.8), (0.15, 0.32, 0.5, 0.67, 0.83), (1.08, 1.15, 1.2)
_RAYS = 32  # points on each circle
_MOST_CUT = 0.3  # largest share of these points out of the picture
# How much of the outlines must be seen at the best of `HEADINGS`; after the fit, the share of the
# places on all sides with a step, and the same for each side.
_LEAST_ROUGH, _LEAST_SIDES, _LEAST_SIDE = 0.4, 0.9, 0.6
# Least step: a share of the sum of the levels on both sides, and grey levels.
_STEP, _LEAST_STEP = 0.06, 4.0
# What the ring must show, in logarithms of grey levels: the share of the rays on which margin and
# hole are brighter than the stroke by more than the first; the difference of their medians; and the
# correlation with white, black, white. Of the rings of 16 px and more that nothing else showed in
# 240 pictures of 106 field days three in ten pass, one of those more than a tenth of the range off;
# of 800 look-alikes and 176 photographs none.
_DARKER, _LEAST_DARKER = 0.08, (0.6, 0.8)
_LEAST_MEDIAN, _LEAST_CORRELATION = 0.1, 0.45
# A ring whose medians differ by more than the first is less hidden, and must correlate better: up
# to the third at the second. One that differs by more than that would have been found by itself.
_CLEAR_FROM, _CLEAR, _CLEAR_CORRELATION = 0.5, 1.0, 0.85
# Errors that the scatter of the sides does not show: of the range, a share, and aside, in radii;
# and by how many px bright white has grown on all sides. (The normal's error is gravity's.)
_RANGE_SIGMA, _ASIDE_SIGMA = 0.03, 0.1
_GROWN_PX = 0.5
_INFLATION = 2.0  # factor on the covariance of the sides' fit
_OUTLINE_POINTS = 32
_LARGEST_PX = 100.0  # diameter: larger rings show more by themselves, and their plate is cut


class PlateRing:
    """Finds one ring of a pad by the sides of the plate about it."""

    def __init__(self, plate: Plate, ring: Ring, heading: PlateHeading) -> None:
        """Prepare the places to look at, beside those of the heading about the same ring."""
        self._ring, self._heading = ring, heading
        width = min(plate.north_m + plate.south_m, plate.east_m + plate.west_m)
        self._half_width = 0.5 * width
        hole = ring.inner_ratio
        stroke = (hole + share * (1.0 - hole) for share in _STROKE)
        radii = [*(r * hole for r in _INSIDE), *stroke, *_OUTSIDE]
        points = [circle(r * ring.radius_m, _RAYS) for r in radii]
        self._points: F64 = np.concatenate(points)
        white = [True] * len(_INSIDE) + [False] * len(_STROKE) + [True] * len(_OUTSIDE)
        self._is_white = np.repeat(np.array(white, dtype=np.float64), _RAYS)

    def near(
        self, image: Image, camera: CameraModel, expected: F64, down: Vec3
    ) -> MarkerSighting | None:
        """Return the ring on a level plate near where it is expected; None: none is seen.

        Arguments as of `find`, except that the ring may lie its diameter aside of `expected`, (3,).
        """
        if float(expected[2]) < MIN_DEPTH_M:
            return None
        x, y = camera.pixels(expected[None])[0].tolist()
        focal = camera.focal
        size = focal * self._ring.outer_diameter_m / float(np.linalg.norm(expected))
        if not SMALLEST_PX < size < _LARGEST_PX:
            return None
        window = Window(int(x - 2 * size), int(y - 2 * size), int(x + 2 * size), int(y + 2 * size))
        sizes = (size / STEP, size, size * STEP)
        places = matches(image, camera, self._ring, down, sizes, 1, window)
        return self.find(image, camera, places[0], down) if places else None

    def find(self, image: Image, camera: CameraModel, t: F64, down: Vec3) -> MarkerSighting | None:
        """Return the ring on a level plate at a place; None: none is seen.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: where the ring's centre may be, (3,), camera frame, m; its range to within a fifth.
            down: unit vector of gravity, camera frame.
        """
        normal = np.array(down)
        axes = rotation_from(normal)[:, :2]
        centres = t / np.array(_SIZES)[:, None]
        of_sizes = self._levels(image, camera, centres[:, None], axes).reshape(len(_SIZES), -1)
        likest = centres[int(np.argmax([self._correlation(levels) for levels in of_sizes]))]
        seen, _ = self._heading.ways(image, camera, likest, axes)
        k = int(np.argmax(seen))
        if seen[k] < _LEAST_ROUGH:
            return None
        angle = float(self._heading.angles[k])
        fit = self._heading.sides.fit(image, camera, likest, axes, angle, _OFF_SIGMA, _SIZE_SIGMA)
        if fit is None or not 0.5 < fit.size < 2.0:
            return None
        at = (likest + axes @ fit.middle) / fit.size
        levels = self._levels(image, camera, at, axes)
        if not self._is_ring(levels):
            return None
        if not self._has_sides(image, camera, at, axes @ rotation_2d(fit.heading)):
            return None
        return self._sighting(camera, at, axes, fit.covariance)

    def _levels(self, image: Image, camera: CameraModel, at: F64, axes: F64) -> F64:
        """Return logarithms of levels about centres (..., 3), one after another, (n,).

        Each has circles * rays of them, NaN out of the picture.
        """
        points = (at + self._points @ axes.T).reshape(-1, 3)
        levels: F64 = np.log(levels_at(image, camera, points) + DARK)
        return levels

    def _correlation(self, levels: F64) -> float:
        """Return the correlation of levels with white, black, white; -1: too many are cut off."""
        in_view = ~np.isnan(levels)
        if in_view.mean() < 1.0 - _MOST_CUT:
            return -1.0
        a, b = levels[in_view], self._is_white[in_view] - self._is_white[in_view].mean()
        a = a - a.mean()
        return float(a @ b) / math.sqrt(max(float(a @ a) * float(b @ b), 1e-9))

    def _is_ring(self, levels: F64) -> bool:
        """Tell whether levels show a stroke between margin and hole that is darker than both."""
        correlation = self._correlation(levels)
        if correlation < _LEAST_CORRELATION:
            return False
        rays = levels.reshape(-1, _RAYS)
        inside, stroke, outside = np.split(rays, [len(_INSIDE), len(_INSIDE) + len(_STROKE)])
        medians = []
        for white, least in zip((outside, inside), _LEAST_DARKER, strict=True):
            rise = white.mean(axis=0) - stroke.mean(axis=0)  # NaN: not in the picture
            if float((rise > _DARKER).mean()) < least:
                return False
            medians.append(float(np.nanmedian(white)) - float(np.nanmedian(stroke)))
        wanted = np.interp(
            min(medians), (_CLEAR_FROM, _CLEAR), (_LEAST_CORRELATION, _CLEAR_CORRELATION)
        )
        return _LEAST_MEDIAN < min(medians) < _CLEAR and correlation > float(wanted)

    def _has_sides(self, image: Image, camera: CameraModel, at: F64, north: F64) -> bool:
        """Tell whether all sides of the plate are seen; `north` are the pad's axes (3, 2)."""
        about = self._heading.about
        _, inside, beyond = about.levels(image, camera, at, north, np.eye(2)[None])
        steps = inside - beyond > np.maximum(_STEP * (inside + beyond), _LEAST_STEP)
        sides = steps[:, about.is_plate].reshape(4, -1).mean(axis=1)
        return bool(sides.mean() > _LEAST_SIDES and sides.min() >= _LEAST_SIDE)

    def _sighting(self, camera: CameraModel, at: F64, axes: F64, covariance: F64) -> MarkerSighting:
        radius, distance = self._ring.radius_m, float(np.linalg.norm(at))
        aside = _INFLATION * covariance[1:3, 1:3] + np.eye(2) * (_ASIDE_SIGMA * radius) ** 2
        normal = normal_of(axes)
        grown = _GROWN_PX / (px_per_m(camera, at, normal) * self._half_width)
        along = _INFLATION * float(covariance[3, 3]) + _RANGE_SIGMA**2 + grown**2
        C = axes @ aside @ axes.T + along * np.outer(at, at) + np.eye(3) * (1e-3 * distance) ** 2
        pose = PoseSolution(
            position=vec3(at),
            normal=vec3(normal),
            north=None,
            covariance=mat3(C),
            sigma_yaw=None,
            sigma_tilt=LEVEL_SIGMA,
            cost=0.0,
        )
        edge = camera.pixels(at + circle(radius, _OUTLINE_POINTS) @ axes.T)
        outline = tuple((x, y) for x, y in edge.tolist())
        return MarkerSighting("whycon", None, (pose,), outline, PLATE)
