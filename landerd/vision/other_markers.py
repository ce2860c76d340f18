"""Tells what a picture shows instead of the pad: rings without its plate, and other markers.

For `landerd detect` and `landerd check`: another id, dictionary, ratio or plate than those of the
pad that lies there is the commonest reason why a pad is not found.
"""

import math
import statistics
from collections.abc import Collection, Iterable, Iterator

from landerd.camera_model import CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring, WhyCode, whycode_ids
from landerd.vision.arrays import Image
from landerd.vision.pose import box
from landerd.vision.ring_work import RingWork
from landerd.vision.square import clear_ids
from landerd.vision.whycode import WhyCodeFinder
from landerd.vision.whycon import find_rings

# Ratios of rings that are tried, and the least error of the ratio that is told, relative to it.
_RATIOS, _RATIO_OFF = [0.25 * 1.05**k for k in range(23)], 0.08
_SAME_PLACE = 0.3  # distance of two rings that are one, over the diameter
# Dictionaries whose ids are told, beside the pad's: those of which texture shows hardly any without
# an error. The larger ones of a size begin with the smaller ones.
_DICTIONARIES = ("APRILTAG_36h11", "APRILTAG_25h9", "4X4_50", "5X5_1000", "6X6_1000", "7X7_1000")


def other_markers(
    image: Image, layout: PadLayout, camera: CameraModel, seen: Collection[str]
) -> list[str]:
    """Return in words which markers, not those of the pad file, an image shows.

    Args:
        image: grey image (height, width).
        layout: the pad.
        camera: the lens.
        seen: kinds of the pad's markers that were found in the image, which are not looked for.
    """
    told: list[str] = []
    if layout.rings and "whycon" not in seen:
        told += _ring(image, layout, camera)
    if layout.squares and not {s.kind for s in layout.squares} & set(seen):
        told += _squares(image, layout)
    if layout.whycodes and "whycode" not in seen:
        told += _codes(image, layout, camera)
    return told


def rings_without_plate(
    image: Image, layout: PadLayout, camera: CameraModel
) -> list[MarkerSighting]:
    """Return rings like the pad's, whether or not its plate is seen about them, nearest first.

    Args:
        image: grey image (height, width), searched to the end.
        layout: the pad.
        camera: the lens.
    """
    found: list[MarkerSighting] = []
    for ring in layout.rings:
        work = RingWork()
        found += find_rings(image, ring, camera, work=work)
        while not found and work.was_cut:
            found += find_rings(image, ring, camera, work=work)
    return found


def _ring(image: Image, layout: PadLayout, camera: CameraModel) -> list[str]:
    """Return in words which ring of another ratio is the clearest: the one most ratios show."""
    shown: list[tuple[float, tuple[float, float], float]] = []  # ratio, middle and diameter, px
    for ratio in _RATIOS:
        ring = Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=ratio)
        for sighting in find_rings(image, ring, camera, work=RingWork()):
            x, y, w, h = box(sighting.outline_px)
            shown.append((ratio, (x, y), max(w, h)))
    if not shown:
        return []
    of_each = [
        [ratio for ratio, at, _ in shown if math.dist(at, middle) < _SAME_PLACE * diameter]
        for _, middle, diameter in shown
    ]
    most: list[float] = max(of_each, key=len)
    ratio = statistics.median(most)
    own = {ring.inner_ratio for ring in layout.rings}
    if any(abs(ratio / r - 1.0) < _RATIO_OFF for r in own):
        return []
    return [f"a ring whose inner ratio is about {ratio:.2f} ({_has(f'{r:.3g}' for r in own)})"]


def _squares(image: Image, layout: PadLayout) -> Iterator[str]:
    """Yield in words which tags of other ids there are, dictionary by dictionary."""
    own = sorted({s.dictionary for s in layout.squares})
    known = {d: [s.id for s in layout.squares if s.dictionary == d] for d in own}
    has = _has(f"{_ids(numbers)} of {name}" for name, numbers in known.items())
    told = {(_family(s.dictionary), s.id) for s in layout.squares}
    for name in (*own, *_DICTIONARIES):
        numbers = [n for n in clear_ids(image, name) if (_family(name), n) not in told]
        told |= {(_family(name), n) for n in numbers}
        if numbers:
            yield f"tag {_ids(numbers)} of {name} ({has})"


def _family(dictionary: str) -> str:
    """Return what dictionaries have in common of which the larger begin with the smaller ones."""
    return dictionary.partition("_")[0] if dictionary[0].isdigit() else dictionary


def _codes(image: Image, layout: PadLayout, camera: CameraModel) -> Iterator[str]:
    """Yield in words which WhyCodes of other numbers there are."""
    for bits in sorted({code.bits for code in layout.whycodes}):
        own = {code.id for code in layout.whycodes if code.bits == bits}
        others = tuple(
            WhyCode(kind="whycode", outer_diameter_m=1.0, bits=bits, id=number)
            for number in whycode_ids(bits)
            if number not in own
        )
        finder = WhyCodeFinder(layout.model_copy(update={"markers": others}), camera)
        for found in finder.find(image, None, None):
            yield f"WhyCode {found.code.id} of {bits} bits ({_has([_ids(own)])})"


def _ids(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


def _has(own: Iterable[str]) -> str:
    return f"the pad file has {', '.join(sorted(own))}"
