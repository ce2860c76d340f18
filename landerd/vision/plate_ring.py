"""A ring on level ground that nothing shows but its plate's four sides, and light and dark on it.

Where leaf shade, dirt or blur leave neither edges nor levels of a ring, the plate about it is still
told by its sides: place, heading and size on a plane that gravity gives, and with them where the
ring is. That there is one is asked of what should be bright and dark on it.
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

# Factors on the size that correlation found, of which the best goes on.
_SIZES = (0.8, 0.87, 0.94, 1.0, 1.07, 1.15, 1.23)
_OFF_SIGMA, _SIZE_SIGMA = 0.3, 0.15  # of that place, in radii, and of that size
# Circles about the ring's centre at which it is compared: of the hole's radius, within the stroke
# from its inner edge on, and of the ring's radius.
_INSIDE, _STROKE, _OUTSIDE = (0.25, 0.54, 0.8), (0.15, 0.32, 0.5, 0.67, 0.83), (1.08, 1.15, 1.2)
_RAYS = 32
_MOST_CUT = 0.3  # of that, out of the picture
# How much of the plate's outlines is seen roughly; then of its sides' places, all and of each side,
# with a step beyond this share of the light on both sides, and grey levels.
_LEAST_ROUGH, _LEAST_SIDES, _LEAST_SIDE = 0.4, 0.9, 0.6
_STEP, _LEAST_STEP = 0.06, 4.0
# Of the ring: shares of the rays on which the stroke is darker than margin and hole, by so much of
# a logarithm, both on the median by more; and the correlation. Of the rings of 16 px and more that
# nothing else showed in 240 pictures of 106 field days three in ten have all of it, one of those
# more than a tenth of the range off; of 800 look-alikes and 176 photographs none.
_DARKER, _LEAST_DARKER = 0.08, (0.6, 0.8)
_LEAST_MEDIAN, _LEAST_CORRELATION = 0.1, 0.45
# What stands out by half as much as the second of these is hidden by less, and is to be more alike;
# by more it would have been told by itself.
_CLEAR_FROM, _CLEAR, _CLEAR_CORRELATION = 0.5, 1.0, 0.85
# What the sides' scatter does not tell: of the range, of the radius aside, and of the normal, which
# is gravity's; and by how many px bright white has grown to all sides.
_RANGE_SIGMA, _ASIDE_SIGMA = 0.03, 0.1
_GROWN_PX = 0.5
_INFLATION = 2.0
_OUTLINE_POINTS = 32
_LARGEST_PX = 100.0  # of a ring: larger ones show more than that, and their plate is cut


class PlateRing:
    """What is looked at about one ring of a pad."""

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
        """Return the ring on a level plate that is about where it is expected; None: none is.

        Arguments as of `find`, but that the ring may lie its diameter aside.
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
        """Return the ring on a level plate about a place; None: none is seen.

        Args:
            image: grey image (height, width).
            camera: the lens.
            t: where the ring's centre may be (3,), camera frame, m; the range to a fifth.
            down: unit vector of gravity, camera frame.
        """
        normal = np.array(down)
        axes = rotation_from(normal)[:, :2]
        sizes = [t / size for size in _SIZES]
        likest = max(sizes, key=lambda at: self._correlation(self._levels(image, camera, at, axes)))
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
        """Return logarithmic levels (circles * rays,) about a centre; NaN out of the picture."""
        levels: F64 = np.log(levels_at(image, camera, at + self._points @ axes.T) + DARK)
        return levels

    def _correlation(self, levels: F64) -> float:
        """Return the correlation coefficient with white, black, white; -1: it is cut."""
        in_view = ~np.isnan(levels)
        if in_view.mean() < 1.0 - _MOST_CUT:
            return -1.0
        a, b = levels[in_view], self._is_white[in_view] - self._is_white[in_view].mean()
        a = a - a.mean()
        return float(a @ b) / math.sqrt(max(float(a @ a) * float(b @ b), 1e-9))

    def _is_ring(self, levels: F64) -> bool:
        """Tell whether the stroke is darker than margin and hole, and as much as it stands out."""
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
        """Tell whether all sides of the plate are seen, under the pad's axes north (3, 2)."""
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
