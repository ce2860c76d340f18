"""Whether the pad's plate is seen about a ring, which look-alikes lack.

A small ring behind a tone curve looks like one whose ratio is off by a tenth, and somebody else's
ring may have the right ratio. But if the pad has another marker beside its ring, its plate reaches
round that marker, too, and this shows long before the marker can be read. The heading need not be
known: a ring is refused if the outlines of plate and prints are seen at no heading, or if they are
seen at others as well, as white all around would fit them. On ground as bright as the plate
(concrete, snow) the prints alone decide.

If the pad has nothing beside its ring, only the plate is looked for, and only about rings so small
that their ratio tells little: on bright ground the plate is not seen, so larger rings are accepted
without it.

The search and `vision` ask `contradicts` and `supports`; `ring_explained` asks `voucher` about
rings whose edges alone show too little.
"""

from collections.abc import Mapping

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring
from landerd.vision.arrays import U8
from landerd.vision.patch import whole_in_picture
from landerd.vision.plate_heading import PlateHeading
from landerd.vision.plate_outline import PlateOutline, outlines, own_levels, plate_corners
from landerd.vision.pose import circle, px_per_m, rotation_from
from landerd.vision.ring_explained import Vouches

_MIN_RADIUS_PX = 3.5  # of a ring: smaller ones are not refused
_RATIO_TELLS_PX = 14.0  # radius from which on a ring's ratio tells it from others


class PlateCheck:
    """Looks for the outlines of a pad's plate and prints about a ring."""

    def __init__(
        self, camera: CameraModel, layout: PadLayout, headings: Mapping[Ring, PlateHeading]
    ) -> None:
        """Prepare the outlines about each ring of a pad.

        Args:
            camera: the lens.
            layout: the pad.
            headings: of the rings that have other markers beside them.
        """
        self._camera, self._headings = camera, headings
        self._outlines = {ring: PlateOutline(outlines(layout, ring)) for ring in layout.rings}
        # From each ring's centre to the farthest corner of the plate, m.
        corners = plate_corners(layout.plate)
        self._reaches = {
            ring: float(np.linalg.norm(corners - ring.position_m, axis=1).max())
            for ring in layout.rings
        }
        self._last: tuple[MarkerSighting, bool | None] | None = None

    def contradicts(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether a sighting cannot be the pad's ring, as the plate about it is missing.

        Args:
            image: grey image (height, width).
            ring: of the pad.
            sighting: of what was taken for that ring.
        """
        return self._is_seen(image, ring, sighting) is False

    def supports(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether the plate counts as seen about a sighting.

        Where the plate carries the ring alone it must be seen; else it is enough that it is not
        known to be missing.
        """
        is_seen = self._is_seen(image, ring, sighting)
        return is_seen is True if ring not in self._headings else is_seen is not False

    def shows(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool:
        """Tell whether the plate about a sighting, or the ring by itself, tells it from others.

        The plate does if it is seen, and at no heading would the picture's edge cut it: what is cut
        might be what another ring's plate lacks.
        """
        if ring not in self._headings:
            return True
        best = sighting.solutions[0]
        axes = rotation_from(np.array(best.normal))[:, :2]
        points = np.array(best.position) + circle(self._reaches[ring]) @ axes.T
        is_whole = whole_in_picture(self._camera, points) is not None
        return is_whole and self._is_seen(image, ring, sighting) is True

    def _is_seen(self, image: U8, ring: Ring, sighting: MarkerSighting) -> bool | None:
        """Tell whether the plate is seen about a ring under one of its poses; None: undecided."""
        # Kept, as the search asks about a sighting, and then `vision` does.
        if self._last is None or self._last[0] is not sighting:
            is_seen: bool | None = False
            for s in sighting.solutions:
                of_pose = self._is_about(image, ring, np.array(s.position), np.array(s.normal))
                if of_pose is not False:
                    is_seen = of_pose
                    break
            self._last = sighting, is_seen
        return self._last[1]

    def voucher(self, image: U8, ring: Ring) -> Vouches | None:
        """Return the test whether the plate is seen about a ring; None: it carries that alone."""
        if ring not in self._headings:
            return None

        def vouches(t: F64, normal: F64, contrast: float) -> bool:
            return self._has_outlines(image, ring, t, normal) is True

        return vouches

    def _is_about(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool | None:
        """Tell whether the plate is seen about a ring's pose; None: undecided."""
        radius_px = self._radius_px(ring, t, normal)
        if radius_px < _MIN_RADIUS_PX:
            return None
        is_seen = self._has_outlines(image, ring, t, normal)
        is_told = ring not in self._headings and radius_px > _RATIO_TELLS_PX
        return None if is_told and is_seen is False else is_seen

    def _radius_px(self, ring: Ring, t: F64, normal: F64) -> float:
        return px_per_m(self._camera, t, normal) * ring.radius_m

    def _has_outlines(self, image: U8, ring: Ring, t: F64, normal: F64) -> bool | None:
        """Tell whether the outlines are seen about a ring's pose; None: too little is in view."""
        axes = rotation_from(normal)[:, :2]
        levels = own_levels(image, self._camera, ring, t, axes)
        if levels is None:
            return None
        is_seen = self._outlines[ring].is_seen(image, self._camera, t, axes, levels)
        heading = self._headings.get(ring)
        if is_seen is False or heading is None or self._radius_px(ring, t, normal) < _MIN_RADIUS_PX:
            return is_seen
        stands_out = heading.stands_out(image, self._camera, t, axes)
        return False if stands_out is False else is_seen
