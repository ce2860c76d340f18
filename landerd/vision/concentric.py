"""Round markers about one centre, which look alike but for their size: which one an outline is.

A ring's outline may be that of another ring about the same centre, or of a WhyCode that cannot be
read yet, nearer or farther away. It is where the pad's ring shows at that other distance.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, WhyCode
from landerd.vision.arrays import Image
from landerd.vision.pose import MIN_DEPTH_M, circle, rotation_from

# Where white around a ring is looked at, in outer radii: the nearest that blur leaves white.
_AROUND = 1.12
_POINTS = 32
_LEAST_SHARE = 0.85  # of the points that must be dark in the stroke and white around it

Track = Callable[[F64, F64], MarkerSighting | None]  # of a ring at a position, with a normal


class Concentric:
    """Sorts out what was found of one ring of a pad."""

    def __init__(self, layout: PadLayout, ring: Ring, camera: CameraModel) -> None:
        """Note which markers lie about the ring's centre."""
        rounds: Sequence[Ring | WhyCode] = (*layout.rings, *layout.whycodes)
        self._others = [m for m in rounds if m != ring and m.position_m == ring.position_m]
        self._ring, self._camera = ring, camera

    def sorted_out(
        self, image: Image, found: Sequence[MarkerSighting], track: Track
    ) -> list[MarkerSighting]:
        """Return what was found but other markers, and where the ring is if that is one of them.

        Of several rings `choice` takes those that agree with each other. A WhyCode that was not
        read is none of them, and left out here.

        Args:
            image: grey image (height, width).
            found: that may be the ring.
            track: fits the ring at a position (3,), m, with a normal, and tells whether it is one.
        """
        kept = []
        for sighting in found:
            best = sighting.solutions[0]
            position, normal = np.array(best.position), np.array(best.normal)
            is_code, elsewhere = False, []
            for marker in self._others:
                # Where the ring is if the outline is this marker's.
                at = position * (marker.radius_m / self._ring.radius_m)
                if (ring := track(at, normal)) is not None:
                    elsewhere.append(ring)
                if isinstance(marker, WhyCode):
                    level = self._level(image, position, normal)
                    is_code = is_code or self._shows(image, at, normal, level)
            kept += elsewhere if is_code else [sighting, *elsewhere]
        return kept

    def _level(self, image: Image, position: F64, normal: F64) -> float:
        """Return the grey level between a ring's black and the white around it."""
        black, white = self._seen(image, position, normal)
        return 0.5 * (float(np.median(black)) + float(np.median(white)))

    def _shows(self, image: Image, position: F64, normal: F64, level: float) -> bool:
        """Tell whether the ring's stroke is dark at a position, with white around it."""
        if position[2] < self._ring.radius_m + MIN_DEPTH_M:
            return False
        black, white = self._seen(image, position, normal)
        share = min(float(np.mean(black < level)), float(np.mean(white > level)))
        return share > _LEAST_SHARE

    def _seen(self, image: Image, position: F64, normal: F64) -> tuple[F64, F64]:
        """Return the grey levels (n,) of the ring's stroke and around it, where it would be."""
        stroke = 0.5 * (1.0 + self._ring.inner_ratio)
        radii = self._ring.radius_m * np.repeat([stroke, _AROUND], _POINTS)
        on_ring = radii[:, None] * np.tile(circle(1.0, _POINTS), (2, 1))
        points = position + on_ring @ rotation_from(normal)[:, :2].T
        px = self._camera.pixels(points).astype(np.float32)
        # Beyond the image nothing is dark, nor white.
        levels = cv2.remap(
            image.astype(np.float32),
            px[None, :, 0],
            px[None, :, 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(np.nan,),
        )[0].astype(np.float64)
        return levels[:_POINTS], levels[_POINTS:]
