"""Whether a ring has about it the plate that carries the pad's other markers.

A look-alike whose ratio is off by a tenth cannot be told from a small ring behind a tone curve, nor
a ring of the right ratio that is somebody else's. But where the pad has another marker, the plate
reaches round it, which is seen long before that marker can be read. No heading need be known: a
ring is refused if there is none under which the outlines of plate and prints are seen, or if they
are seen under others as well, as white all round a ring fits them.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import Ring
from landerd.vision.expected import any_across
from landerd.vision.patch import levels_at
from landerd.vision.plate_heading import PlateHeading
from landerd.vision.plate_outline import PlateOutline
from landerd.vision.pose import circle, px_per_m, rotation_from
from landerd.vision.ring_explained import Vouches

U8 = NDArray[np.uint8]

_MIN_RADIUS_PX = 3.5  # of the ring: nothing can be said against smaller ones
_MOST_CUT = 0.3  # of what tells its black and white, that may be out of the picture
_OWN_WHITE = 1.1  # times the ring's radius: within the margin of any print


class PlateCheck:
    """Looks for the outlines of a pad's plate and prints about a ring."""

    def __init__(self, camera: CameraModel, headings: Mapping[Ring, PlateHeading]) -> None:
        """Look at the outlines about each ring of the headings."""
        self._camera, self._headings = camera, headings
        self._outlines = {ring: PlateOutline(h.about) for ring, h in headings.items()}
        self._last: tuple[MarkerSighting, bool] | None = None

    def contradicts(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether a ring cannot be the pad's, as it lacks the plate.

        Args:
            image: grey image (height, width).
            ring: of the pad.
            sighting: what was taken for it.
        """
        if ring not in self._outlines:
            return False
        if self._last is None or self._last[0] is not sighting:  # the search asks, and then vision
            is_bare = all(
                self._is_bare(image, ring, np.array(s.position), np.array(s.normal))
                for s in sighting.solutions
            )
            self._last = sighting, is_bare
        return self._last[1]

    def voucher(self, image: U8, ring: Ring) -> Vouches | None:
        """Return what tells whether the plate is seen about a ring; None: it cannot be."""
        if ring not in self._outlines:
            return None

        def vouches(t: F64, normal: F64, contrast: float) -> bool:
            return self._has_outlines(image, ring, t, normal) is True

        return vouches

    def _is_bare(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool:
        """Tell whether there is no heading under which a ring's pose has the plate about it."""
        if self._is_tiny(ring, t, normal):
            return False
        return self._has_outlines(image, ring, t, normal) is False

    def _is_tiny(self, ring: Ring, t: F64, normal: F64) -> bool:
        return px_per_m(self._camera, t, normal) * ring.radius_m < _MIN_RADIUS_PX

    def _has_outlines(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool | None:
        """Tell whether a ring's pose has the plate about it; None: it cannot be looked at."""
        axes = rotation_from(normal, any_across(normal))[:, :2]
        rims = np.concatenate([circle(0.5 * (1.0 + ring.inner_ratio)), circle(_OWN_WHITE)])
        levels = levels_at(image, self._camera, t + ring.radius_m * rims @ axes.T)
        if np.isnan(levels).mean() > _MOST_CUT:
            return None
        black, white = np.nanmedian(levels.reshape(2, -1), axis=1).tolist()
        outline = self._outlines[ring]
        is_seen = outline.is_seen(image, self._camera, t, axes, (black, white))
        if is_seen is False or self._is_tiny(ring, t, normal):
            return is_seen
        stands_out = self._headings[ring].stands_out(image, self._camera, t, axes)
        return False if stands_out is False else is_seen
