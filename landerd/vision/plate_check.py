"""Whether a ring has about it the plate that carries the pad's other markers.

A look-alike whose ratio is off by a tenth cannot be told from a small ring behind a tone curve, nor
a ring of the right ratio that is somebody else's. But where the pad has another marker, the plate
reaches round it, which is seen long before that marker can be read. No heading need be known: a
ring is refused if there is none under which the outlines of plate and prints are seen, or if they
are seen under others as well, as white all round a ring fits them. On ground as bright as the
plate, as concrete or snow, the prints alone tell it.

Of a pad that has nothing beside its ring the plate alone is looked for, and only about rings so
small that their ratio tells little: on ground as bright as the plate it is not seen, and larger
rings are taken without.
"""

from collections.abc import Mapping

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring
from landerd.vision.arrays import U8
from landerd.vision.patch import levels_at
from landerd.vision.plate_heading import PlateHeading
from landerd.vision.plate_outline import PlateOutline, outlines
from landerd.vision.pose import circle, px_per_m, rotation_from
from landerd.vision.ring_explained import Vouches

_MIN_RADIUS_PX = 3.5  # of the ring: nothing can be said against smaller ones
_RATIO_TELLS_PX = 14.0  # radius of the ring from which on its ratio tells it from others
_MOST_CUT = 0.6  # of what tells its black and white, that may be out of the picture
_OWN_WHITE = 1.1  # times the ring's radius: within the margin of any print


class PlateCheck:
    """Looks for the outlines of a pad's plate and prints about a ring."""

    def __init__(
        self, camera: CameraModel, layout: PadLayout, headings: Mapping[Ring, PlateHeading]
    ) -> None:
        """Look at the outlines about each ring of a pad; `headings`: of those with some beside."""
        self._camera, self._headings = camera, headings
        self._outlines = {ring: PlateOutline(outlines(layout, ring)) for ring in layout.rings}
        self._last: tuple[MarkerSighting, bool | None] | None = None

    def contradicts(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether a ring cannot be the pad's, as it lacks the plate.

        Args:
            image: grey image (height, width).
            ring: of the pad.
            sighting: what was taken for it.
        """
        return self._is_seen(image, ring, sighting) is False

    def supports(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether it is more than not contradicted, where the plate has the ring alone."""
        is_seen = self._is_seen(image, ring, sighting)
        return is_seen is True if ring not in self._headings else is_seen is not False

    def _is_seen(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool | None:
        """Tell whether the plate is about a ring under any of its poses; None: it may be."""
        if self._last is None or self._last[0] is not sighting:  # the search asks, and then vision
            is_seen: bool | None = False
            for s in sighting.solutions:
                of_pose = self._is_about(image, ring, np.array(s.position), np.array(s.normal))
                if of_pose is not False:
                    is_seen = of_pose
                    break
            self._last = sighting, is_seen
        return self._last[1]

    def voucher(self, image: U8, ring: Ring) -> Vouches | None:
        """Return what tells whether the plate is seen about a ring; None: it cannot be."""
        if ring not in self._headings:
            return None

        def vouches(t: F64, normal: F64, contrast: float) -> bool:
            return self._has_outlines(image, ring, t, normal) is True

        return vouches

    def _is_about(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool | None:
        """Tell whether there is a heading under which a ring's pose has the plate about it."""
        radius_px = self._radius_px(ring, t, normal)
        if radius_px < _MIN_RADIUS_PX:
            return None
        is_seen = self._has_outlines(image, ring, t, normal)
        is_told = ring not in self._headings and radius_px > _RATIO_TELLS_PX
        return None if is_told and is_seen is False else is_seen

    def _radius_px(self, ring: Ring, t: F64, normal: F64) -> float:
        return px_per_m(self._camera, t, normal) * ring.radius_m

    def _has_outlines(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool | None:
        """Tell whether a ring's pose has the plate about it; None: it cannot be looked at."""
        axes = rotation_from(normal)[:, :2]
        rims = np.concatenate([circle(0.5 * (1.0 + ring.inner_ratio)), circle(_OWN_WHITE)])
        levels = levels_at(image, self._camera, t + ring.radius_m * rims @ axes.T)
        if np.isnan(levels).mean() > _MOST_CUT:
            return None
        black, white = np.nanmedian(levels.reshape(2, -1), axis=1).tolist()
        outline = self._outlines[ring]
        is_seen = outline.is_seen(image, self._camera, t, axes, (black, white))
        heading = self._headings.get(ring)
        if is_seen is False or heading is None or self._radius_px(ring, t, normal) < _MIN_RADIUS_PX:
            return is_seen
        stands_out = heading.stands_out(image, self._camera, t, axes)
        return False if stands_out is False else is_seen
