"""The part of vision that looks at pixels: detects and fits single markers in a camera's images.

`Detectors` is the interface, `PixelDetectors` the implementation on real pictures. The rest of
vision (where to look how often, which markers belong to one pad, its pose) calls only these, so
that a simulator without pictures can substitute its own.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from landerd.camera_model import F64, CameraModel, Window
from landerd.geometry import Vec3
from landerd.messages import BESIDE, Light, MarkerSighting, PoseSolution
from landerd.pad import PadLayout, Ring, Square
from landerd.vision.arrays import Image
from landerd.vision.concentric import Concentric
from landerd.vision.expected import Expected
from landerd.vision.metering import Meter
from landerd.vision.other_ids import OtherIds
from landerd.vision.plate_check import PlateCheck
from landerd.vision.plate_heading import PlateHeading, PlateNorth
from landerd.vision.plate_outline import has_beside
from landerd.vision.plate_ring import PlateRing
from landerd.vision.plate_search import PlateSearch
from landerd.vision.pose import Pose
from landerd.vision.print_edges import EdgeFit
from landerd.vision.print_fit import Fit
from landerd.vision.pyramid import is_blank
from landerd.vision.ring_response import CameraResponse
from landerd.vision.ring_search import Beside, Refusal
from landerd.vision.ring_work import RingWork
from landerd.vision.square import MIN_SIDE_PX, FoundSquare, SquareFinder, printed_cells
from landerd.vision.square_beside import SquareBeside
from landerd.vision.square_fit import SquarePrint
from landerd.vision.square_pose import square_points
from landerd.vision.whycode import FoundCode, WhyCodeFinder
from landerd.vision.whycon import find_rings, track_ring

_KEPT_BYTES = 1 << 24  # 16 MiB, the size of about 18 grey images of 1280x720


class Detectors(Protocol):
    """Finds one pad's markers in one camera's images; `Search` decides what is looked for where."""

    def track_ring(
        self,
        image: Image,
        ring: Ring,
        position: F64,
        normal: F64,
        down: Vec3 | None,
        *,
        vouched: bool = False,
    ) -> MarkerSighting | None:
        """See `whycon.track_ring`; vouched: the pad is known to be there, with or without plate."""
        ...

    def find_rings(
        self,
        image: Image,
        ring: Ring,
        *,
        window: Window | None = None,
        down: Vec3 | None = None,
        expected_diameter_px: float | None = None,
        thorough: bool = True,
        work: RingWork | None = None,
        refuses: Refusal | None = None,
        vouched: bool = False,
    ) -> list[MarkerSighting]:
        """See `whycon.find_rings`; vouched: as in `track_ring`."""
        ...

    def ring_on_plate(
        self, image: Image, ring: Ring, expected: F64, down: Vec3
    ) -> MarkerSighting | None:
        """Return the ring that its level plate shows near an expected centre, (3,), m; or None."""
        ...

    def track_square(self, image: Image, square: Square, expected: Pose) -> Fit | EdgeFit | None:
        """See `SquarePrint.track`."""
        ...

    def find_squares(
        self,
        image: Image,
        window: Window | None = None,
        scale: float = 1.0,
        smallest_px: float = MIN_SIDE_PX,
        *,
        evened_px: int | None = None,
    ) -> list[FoundSquare]:
        """See `SquareFinder.find`."""
        ...

    def is_blank(self, image: Image) -> bool:
        """See `pyramid.is_blank`."""
        ...

    def is_textured(self, image: Image) -> bool:
        """See `square.is_textured`."""
        ...

    def squares_beside(
        self, image: Image, ring: Ring, sighting: MarkerSighting
    ) -> list[FoundSquare]:
        """See `SquareBeside.find`."""
        ...

    def square_poses(
        self,
        image: Image,
        found: FoundSquare,
        down: Vec3 | None,
        normal: Vec3 | None,
        start: Pose | None,
    ) -> tuple[list[Pose], str]:
        """See `SquarePrint.poses`."""
        ...

    def find_codes(
        self, image: Image, expected: Expected | None, normal: Vec3 | None
    ) -> list[FoundCode]:
        """See `WhyCodeFinder.find`."""
        ...

    def lacks_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """See `PlateCheck.contradicts`."""
        ...

    def has_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """See `PlateCheck.supports`."""
        ...

    def shows_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """See `PlateCheck.shows`."""
        ...

    def plate_north(
        self, image: Image, ring: Ring, sighting: MarkerSighting, known: F64 | None
    ) -> PlateNorth | None:
        """See `PlateHeading.find`."""
        ...

    def other_id(self, image: Image, ring: Ring, sighting: MarkerSighting) -> int | None:
        """See `OtherIds.beside`."""
        ...

    def light(self, image: Image, pad: PoseSolution | None, down: Vec3 | None) -> Light:
        """See `Meter.light`."""
        ...


def keep_freed_memory() -> None:
    """Let the C library keep freed memory, up to twice `_KEPT_BYTES`, instead of returning it.

    glibc raises its limits once a block of that size was allocated and freed: mallopt(3),
    M_MMAP_THRESHOLD. Without this each search gets its arrays from the kernel anew, page by page:
    in an image full of texture that was a fifth of the time.
    """
    np.empty(_KEPT_BYTES, np.uint8)


class PixelDetectors:
    """Detectors that search real pictures."""

    def __init__(self, layout: PadLayout, camera: CameraModel) -> None:
        """Prepare finders and prints of a pad's markers."""
        self._camera = camera
        self._meter = Meter(camera, layout.plate)
        self._plates = {ring: PlateSearch(layout, ring) for ring in layout.rings}
        self._concentric = {ring: Concentric(layout, ring, camera) for ring in layout.rings}
        self._plate_headings = {
            ring: PlateHeading(layout, ring) for ring in layout.rings if has_beside(layout, ring)
        }
        self._plate = PlateCheck(camera, layout, self._plate_headings)
        self._on_plates = {
            ring: PlateRing(layout.plate, ring, heading)
            for ring, heading in self._plate_headings.items()
        }
        self._prints: Mapping[Square, SquarePrint] = {
            s: SquarePrint(s, printed_cells(s), layout.plate.white_round(s)) for s in layout.squares
        }
        self._beside = {
            (r, s): SquareBeside(s, printed_cells(s), r)
            for r in layout.rings
            for s in layout.squares
        }
        self._squares = SquareFinder(layout)
        self._other_ids = OtherIds(layout, camera, self._squares)
        self._codes = WhyCodeFinder(layout, camera)
        self._response = CameraResponse()

    def track_ring(
        self,
        image: Image,
        ring: Ring,
        position: F64,
        normal: F64,
        down: Vec3 | None,
        *,
        vouched: bool = False,
    ) -> MarkerSighting | None:
        """See `whycon.track_ring`."""
        return track_ring(
            image,
            ring,
            self._camera,
            position,
            normal,
            down=down,
            response=self._response,
            vouches=_known if vouched else self._plate.voucher(image, ring),
        )

    def find_rings(
        self,
        image: Image,
        ring: Ring,
        *,
        window: Window | None = None,
        down: Vec3 | None = None,
        expected_diameter_px: float | None = None,
        thorough: bool = True,
        work: RingWork | None = None,
        refuses: Refusal | None = None,
        vouched: bool = False,
    ) -> list[MarkerSighting]:
        """See `whycon.find_rings`."""
        vouches = _known if vouched else self._plate.voucher(image, ring)
        found = find_rings(
            image,
            ring,
            self._camera,
            window=window,
            down=down,
            expected_diameter_px=expected_diameter_px,
            thorough=thorough,
            work=work,
            response=self._response,
            beside=Beside(refuses, vouches, self._plates[ring], self._on_plates.get(ring)),
        )

        def track(position: F64, normal: F64) -> MarkerSighting | None:
            tracked = self.track_ring(image, ring, position, normal, down, vouched=vouched)
            is_another = tracked is not None and refuses is not None and refuses(tracked)
            return None if is_another else tracked

        return self._concentric[ring].sorted_out(image, found, track)

    def ring_on_plate(
        self, image: Image, ring: Ring, expected: F64, down: Vec3
    ) -> MarkerSighting | None:
        """See `PlateRing.near`."""
        on_plate = self._on_plates.get(ring)
        return None if on_plate is None else on_plate.near(image, self._camera, expected, down)

    def track_square(self, image: Image, square: Square, expected: Pose) -> Fit | EdgeFit | None:
        """See `SquarePrint.track`."""
        return self._prints[square].track(image, self._camera, expected)

    def find_squares(
        self,
        image: Image,
        window: Window | None = None,
        scale: float = 1.0,
        smallest_px: float = MIN_SIDE_PX,
        *,
        evened_px: int | None = None,
    ) -> list[FoundSquare]:
        """See `SquareFinder.find`."""
        return self._squares.find(image, window, scale, smallest_px, evened_px=evened_px)

    def is_blank(self, image: Image) -> bool:
        """See `pyramid.is_blank`."""
        return is_blank(image)

    def is_textured(self, image: Image) -> bool:
        """See `square.is_textured`."""
        return self._squares.is_textured(image)

    def squares_beside(
        self, image: Image, ring: Ring, sighting: MarkerSighting
    ) -> list[FoundSquare]:
        """See `SquareBeside.find`."""
        found = []
        for square in self._prints:
            pose = self._beside[ring, square].find(image, self._camera, sighting.solutions)
            if pose is not None:
                corners = pose.points(square_points(square.size_m))
                found.append(FoundSquare(square, self._camera.pixels(corners), beside=pose))
        return found

    def square_poses(
        self,
        image: Image,
        found: FoundSquare,
        down: Vec3 | None,
        normal: Vec3 | None,
        start: Pose | None,
    ) -> tuple[list[Pose], str]:
        """See `SquarePrint.poses`."""
        if found.beside is not None:
            return [found.beside], BESIDE
        return self._prints[found.square].poses(
            image, self._camera, found.corners, down, normal, start, found.fit
        )

    def find_codes(
        self, image: Image, expected: Expected | None, normal: Vec3 | None
    ) -> list[FoundCode]:
        """See `WhyCodeFinder.find`."""
        return self._codes.find(image, expected, normal)

    def lacks_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """See `PlateCheck.contradicts`."""
        return self._plate.contradicts(image, ring, sighting)

    def has_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """See `PlateCheck.supports`."""
        return self._plate.supports(image, ring, sighting)

    def shows_plate(self, image: Image, ring: Ring, sighting: MarkerSighting) -> bool:
        """See `PlateCheck.shows`."""
        return self._plate.shows(image, ring, sighting)

    def plate_north(
        self, image: Image, ring: Ring, sighting: MarkerSighting, known: F64 | None
    ) -> PlateNorth | None:
        """See `PlateHeading.find`."""
        heading = self._plate_headings.get(ring)
        if heading is None:
            return None
        return heading.find(image, self._camera, sighting.solutions, known)

    def other_id(self, image: Image, ring: Ring, sighting: MarkerSighting) -> int | None:
        """See `OtherIds.beside`."""
        return self._other_ids.beside(image, ring, sighting)

    def light(self, image: Image, pad: PoseSolution | None, down: Vec3 | None) -> Light:
        """See `Meter.light`."""
        return self._meter.light(image, pad, down)


def _known(position: F64, normal: F64, contrast: float) -> bool:
    """Vouch for any ring: the pad is known to be where it was looked for."""
    return True
