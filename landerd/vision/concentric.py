"""Tells round markers about one centre apart, which look alike but for their size.

What was found as a ring may be another ring about the same centre, or a WhyCode that cannot be read
yet, at another distance. If so, the true position is the one found times the ratio of both radii
(other marker's over ring's), and the pad's ring is seen there, too. So each sighting is checked by
looking for the ring there: one that is found is reported besides, and `choice` decides between
rings.
"""

from collections.abc import Callable, Sequence

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, WhyCode
from landerd.vision.arrays import Image
from landerd.vision.patch import levels_at
from landerd.vision.pose import circle, rotation_from

# Radius of the circle on which white around a ring is looked at, in outer radii: the smallest one
# that blur leaves white.
_AROUND = 1.12
_POINTS = 32  # on each circle
# Share of the points that must be dark in the stroke, and share that must be white around it.
_LEAST_SHARE = 0.85

# Fits the ring at an expected position (3,), m, and normal (3,); None: it is not there.
Track = Callable[[F64, F64], MarkerSighting | None]


class Concentric:
    """Decides which of a pad's concentric markers the sightings of one of its rings are."""

    def __init__(self, layout: PadLayout, ring: Ring, camera: CameraModel) -> None:
        """Note which markers lie about the ring's centre."""
        rounds: Sequence[Ring | WhyCode] = (*layout.rings, *layout.whycodes)
        self._others = [m for m in rounds if m != ring and m.position_m == ring.position_m]
        self._ring, self._camera = ring, camera

    def sorted_out(
        self, image: Image, found: Sequence[MarkerSighting], track: Track
    ) -> list[MarkerSighting]:
        """Return the sightings without those that are WhyCodes, and with rings at other distances.

        Whether a sighting is this ring or another plain one is left open: `choice` takes those that
        agree with each other. A WhyCode that was not read is not reported as such, so `choice`
        could not tell: it is dropped here.

        Args:
            image: grey image (height, width).
            found: sightings that may be the ring.
            track: see `Track`.
        """
        if not self._others:
            return list(found)
        kept = []
        for sighting in found:
            best = sighting.solutions[0]
            position, normal = np.array(best.position), np.array(best.normal)
            level = self._level(image, position, normal)
            is_code, elsewhere = False, []
            for marker in self._others:
                # Where the ring is if the outline is this marker's.
                at = position * (marker.radius_m / self._ring.radius_m)
                if (ring := track(at, normal)) is not None:
                    elsewhere.append(ring)
                if isinstance(marker, WhyCode):
                    is_code = is_code or self._shows(image, at, normal, level)
            kept += elsewhere if is_code else [sighting, *elsewhere]
        return kept

    def _level(self, image: Image, position: F64, normal: F64) -> float:
        """Return the grey level half-way between a ring's black and the white around it."""
        black, white = self._seen(image, position, normal)
        return 0.5 * (float(np.median(black)) + float(np.median(white)))

    def _shows(self, image: Image, position: F64, normal: F64, level: float) -> bool:
        """Tell whether a ring at a position would have a dark stroke with white around it."""
        black, white = self._seen(image, position, normal)
        share = min(float(np.mean(black < level)), float(np.mean(white > level)))
        return share > _LEAST_SHARE

    def _seen(self, image: Image, position: F64, normal: F64) -> tuple[F64, F64]:
        """Return grey levels (n,) in the stroke and around it of a ring that would be there."""
        stroke = 0.5 * (1.0 + self._ring.inner_ratio)
        radii = self._ring.radius_m * np.repeat([stroke, _AROUND], _POINTS)
        on_ring = radii[:, None] * np.tile(circle(1.0, _POINTS), (2, 1))
        points = position + on_ring @ rotation_from(normal)[:, :2].T
        levels = levels_at(image, self._camera, points)  # NaN, neither dark nor white, out of it
        return levels[:_POINTS], levels[_POINTS:]
