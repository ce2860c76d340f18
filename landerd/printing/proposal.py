"""A layout for a pad of a given size that is to be seen from a given distance."""

import math
from dataclasses import dataclass

from landerd.pad import Marker, PadError, PadLayout, Plate, Ring, Square, WhyCode, size_m

# How large a marker must be in the image, px across, to be told in 99 of 100 pictures. It is from
# the ranges in docs/markers.md, measured with the thesis's camera (focal length 391 px): a ring of
# 1 m to 25 m, a WhyCode of 1 m to 20 m, a tag of 0.3125 m to 8 m.
_LEAST_PX = {"whycon": 15.6, "whycode": 19.5, "apriltag": 15.3, "aruco": 15.3}
_PLATE_PER_RING = 1.24  # side of the plate over the ring's diameter: a quarter of a radius of white
_WHYCODE_HEART, _RING_HEART = 0.16, 0.18  # size of what stands in the heart, of the outer diameter
# A ring of this size is whole in the image of the thesis's camera, and a square's diagonal fits it,
# until the feet are 0.1 m above the pad.
_NEAR_M = 0.45
_STEP_M = 0.01
_NEAREST_PX = 0.9  # of the image's shorter side that the whole marker may fill


@dataclass(frozen=True)
class View:
    """What of a camera decides how far it sees: focal length and shorter side of its image, px."""

    focal_px: float
    side_px: float

    def farthest_m(self, marker: Marker) -> float:
        """Return from how far the marker is told."""
        return self.focal_px * size_m(marker) / _LEAST_PX[marker.kind]

    def nearest_m(self, marker: Marker) -> float:
        """Return from how near it is still whole in the image, the camera looking straight down."""
        across = size_m(marker) * (math.sqrt(2.0) if isinstance(marker, Square) else 1.0)
        return self.focal_px * across / (_NEAREST_PX * self.side_px)


def propose(side_m: float, distance_m: float, view: View) -> PadLayout:
    """Return the simplest layout that is seen from there and down to the ground.

    In this order: one WhyCode; a WhyCode with a small one in its heart; a plain ring, which is seen
    farther, with a tag in its heart.

    Args:
        side_m: of the plate, m.
        distance_m: from which the pad is to be seen, m.
        view: of the camera.

    Raises:
        PadError: nothing on a plate of this size is seen from so far.
    """
    largest = _rounded(side_m / _PLATE_PER_RING)
    if largest < _STEP_M:
        raise PadError(f"a pad of {side_m:g} m is too small for any marker")
    choices = (
        (_whycode(min(largest, _NEAR_M), 5),),
        (_whycode(largest, 5), _whycode(_inner(largest, _WHYCODE_HEART), 11)),
        (
            Ring(kind="whycon", outer_diameter_m=largest),
            _tag(min(_inner(largest, _RING_HEART), _NEAR_M / math.sqrt(2.0))),
        ),
    )
    half = side_m / 2.0
    plate = Plate(north_m=half, south_m=half, east_m=half, west_m=half)
    for markers in choices:
        if view.farthest_m(markers[0]) >= distance_m:
            name = f"{side_m:g} m seen from {distance_m:g} m"
            return PadLayout(name=name, markers=markers, plate=plate)
    farthest = view.farthest_m(choices[-1][0])
    needed = math.ceil(10.0 * side_m * distance_m / farthest) / 10.0
    raise PadError(
        f"a pad of {side_m:g} m is seen from {farthest:.0f} m at most; from {distance_m:g} m: "
        f"a pad of {needed:g} m, or a camera of longer focal length (--camera FILE)"
    )


def _whycode(diameter: float, number: int) -> WhyCode:
    return WhyCode(kind="whycode", outer_diameter_m=diameter, bits=6, id=number)


def _tag(size: float) -> Square:
    return Square(kind="apriltag", dictionary="APRILTAG_36h11", id=1, size_m=_rounded(size))


def _inner(diameter: float, share: float) -> float:
    return min(_rounded(share * diameter), _NEAR_M)


def _rounded(length: float) -> float:
    """Round down to whole centimetres; small ones to millimetres."""
    step = _STEP_M if length >= 0.3 else _STEP_M / 10.0
    return round(math.floor(length / step + 1e-9) * step, 6)
