"""Tells what a picture shows instead of the pad: rings without its plate, and other markers.

For `landerd detect` and `landerd check`: another id, dictionary, ratio or plate than those of the
pad that lies there is the commonest reason why a pad is not found.
"""

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from landerd.camera_model import CameraModel
from landerd.messages import MarkerSighting
from landerd.pad import PadLayout, Ring
from landerd.vision.arrays import Image
from landerd.vision.pose import box
from landerd.vision.ring_work import RingWork
from landerd.vision.square import clear_ids
from landerd.vision.whycode import codes_read
from landerd.vision.whycon import find_rings

# Ratios of rings that are tried, and the least error of the ratio that is told, relative to it.
_RATIOS, _RATIO_OFF = [0.25 * 1.05**k for k in range(23)], 0.08
# Two rings lie about one centre if they are nearer than the first, over the smaller diameter; they
# are one if their diameters differ by less than the second, a factor, too.
_SAME_PLACE, _SAME_SIZE = 0.3, 1.3
# Dictionaries whose ids are told, beside the pad's: those of which texture shows hardly any without
# an error. The larger ones of a size begin with the smaller ones.
_DICTIONARIES = ("APRILTAG_36h11", "APRILTAG_25h9", "4X4_50", "5X5_1000", "6X6_1000", "7X7_1000")
# Bits of WhyCodes that are told, beside those of the pad's.
_BITS = (6, 7, 8)
# Longer side of an image, px, above which it is reduced: what is told is clear to see.
_LONGEST_PX = 1600

_Place = tuple[float, float, float]  # middle and diameter of a ring, px


def other_markers(
    image: Image, layout: PadLayout, camera: CameraModel, seen: Sequence[MarkerSighting]
) -> list[str]:
    """Return in words which markers, not those of the pad file, an image shows.

    Args:
        image: grey image (height, width).
        layout: the pad.
        camera: the lens.
        seen: the pad's markers that were found in the image, their outlines in its pixels.
    """
    height, width = image.shape
    k = min(1.0, _LONGEST_PX / max(width, height))
    if k < 1.0:
        size = round(k * width), round(k * height)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        camera = camera.resized(*size, k)
        seen = [replace(m, outline_px=tuple((k * x, k * y) for x, y in m.outline_px)) for m in seen]
    found = {(m.kind, m.id) for m in seen}
    told: list[str] = []
    places = [_place(m.outline_px) for m in seen]
    lacks_ring = bool(layout.rings) and ("whycon", None) not in found
    if lacks_ring or any((c.kind, c.id) not in found for c in layout.whycodes):
        bits = {*_BITS, *(code.bits for code in layout.whycodes)}
        own = {(code.id, code.bits) for code in layout.whycodes}
        for code, outline in codes_read(image, camera, bits).items():
            place = _place([(float(x), float(y)) for x, y in outline])
            is_known = (code.id, code.bits) in own or any(_is_same(place, p) for p in places)
            if not is_known:
                has = [f"{number} of {n} bits" for number, n in own] or ["none"]
                told.append(f"WhyCode {code.id} of {code.bits} bits ({_has(has)})")
            places.append(place)
    if lacks_ring:
        told += _ring(image, layout, camera, places)
    if any((s.kind, s.id) not in found for s in layout.squares):
        told += _squares(image, layout)
    return told


def rings_without_plate(
    image: Image, layout: PadLayout, camera: CameraModel
) -> list[tuple[Ring, MarkerSighting]]:
    """Return rings like the pad's, whether or not its plate is seen about them.

    Args:
        image: grey image (height, width), searched to the end.
        layout: the pad.
        camera: the lens.
    """
    found: list[tuple[Ring, MarkerSighting]] = []
    for ring in layout.rings:
        work = RingWork()
        found += [(ring, s) for s in find_rings(image, ring, camera, work=work)]
        while not found and work.was_cut:
            found += [(ring, s) for s in find_rings(image, ring, camera, work=work)]
    return found


def _ring(image: Image, layout: PadLayout, camera: CameraModel, known: list[_Place]) -> list[str]:
    """Return in words which ring of another ratio is the clearest: the one most ratios show.

    Args:
        image: grey image (height, width).
        layout: the pad.
        camera: the lens.
        known: places of what is no plain ring, or told already.
    """
    shown: list[tuple[float, _Place]] = []  # ratio and place
    for ratio in _RATIOS:
        ring = Ring(kind="whycon", outer_diameter_m=1.0, inner_ratio=ratio)
        for sighting in find_rings(image, ring, camera, work=RingWork()):
            place = _place(sighting.outline_px)
            if not any(_is_at(place, other) for other in known):
                shown.append((ratio, place))
    if not shown:
        return []
    of_each = [[ratio for ratio, at in shown if _is_at(at, place)] for _, place in shown]
    most: list[float] = max(of_each, key=len)
    ratio = statistics.median(most)
    own = {ring.inner_ratio for ring in layout.rings}
    if any(abs(ratio / r - 1.0) < _RATIO_OFF for r in own):
        return []
    return [f"a ring whose inner ratio is about {ratio:.2f} ({_has(f'{r:.3g}' for r in own)})"]


def _place(outline: Sequence[tuple[float, float]]) -> _Place:
    x, y, width, height = box(outline)
    return x, y, max(width, height)


def _is_at(a: _Place, b: _Place) -> bool:
    """Tell whether two rings lie about one centre: one may be in the other's heart."""
    return math.dist(a[:2], b[:2]) < _SAME_PLACE * min(a[2], b[2])


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


def _is_same(a: _Place, b: _Place) -> bool:
    """Tell whether two places are those of one ring."""
    small, large = sorted((a[2], b[2]))
    return _is_at(a, b) and large < _SAME_SIZE * small


def _ids(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


def _has(own: Iterable[str]) -> str:
    return f"the pad file has {', '.join(sorted(own))}"
