"""How much work a search of the whole image for rings may cost in a frame, and how far it has come.

A thorough search is spread over several frames by its parts (`Part`), and a part that costs too
much over several more. Costs are counted, never timed, so that the same images give the same
sightings on any machine. `RingSearch` spends them; `search_policy` says when a search begins.
"""

from collections import Counter
from dataclasses import dataclass, replace
from enum import Enum

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.vision.arrays import U8

# Costs in units of a rough fit, from their measured times. First those of the stages of a ring's
# fit: rough, full, behind a response, to edges, and with shadow and motion.
ROUGH_COST, FULL_COST, RESPONSE_COST, EDGE_COST, HARD_COST = 1, 2, 4, 3, 6
# Limit for a frame. Half of it may be spent on telling which candidates are worth more.
_FRAME_COST = 14
# Limits for an image that gets one of the parts for textured images, where labelling takes half of
# the time: enough to fit one ring and its edges; and for an image that continues such a part:
# enough to fit one ring behind a response and with shadow or motion.
_PART_COST, _CONTINUED_COST = 6, 11
# Limit for an image that is matched with level rings: edges and plate at two places.
_MATCH_COST = 8
# How many images may get the same part of a search, and how many of the places refused by then the
# next search leaves out. Without a limit, six things on the ground that moved through the picture
# kept a pad from being seen for 28 images.
_MOST_TURNS, _KEPT_REFUSED = 3, 12
_FLOW_PX = (15, 15)  # window of the optical flow about a place, px of the reduced image
# Two places are the same if their centres are nearer than this share of the smaller size, and their
# sizes differ by less than this factor.
_SAME_MIDDLE, _SAME_SIZE = 0.3, 1.6


@dataclass(frozen=True)
class Place:
    """A place in an image where a ring could be."""

    centre: F64  # (2,), px of the whole image
    size_px: float  # diameter, px of the whole image
    reduction: float = 1.0  # of the pyramid's level in which it was found

    def is_same(self, other: "Place") -> bool:
        """Tell whether two places are the same within `_SAME_MIDDLE` and `_SAME_SIZE`."""
        small, large = sorted((self.size_px, other.size_px))
        apart = float(np.hypot(*(self.centre - other.centre)))
        return apart < _SAME_MIDDLE * small and large < _SAME_SIZE * small


class Part(Enum):
    """The part of a thorough search that an image gets."""

    WHOLE = "everything"
    MOST = "the ways to look that show most rings; in texture without BROKEN's and FINEST's"
    REST = "the other ways"
    PLATE = "the outline of the pad's plate, without the finest level"
    PLATE_FINEST = "the same in the finest level"
    # If gravity is known:
    MATCH = "what is on the whole like a level ring, every second size"
    MATCH_BETWEEN = "the same, the sizes between"
    # In images full of texture:
    OTHERS = "the other ways, without those for small rings"
    BROKEN = "holes of rings that are joined to dark ground"
    FINEST = "the finest level: three quarters of all pixels, for rings that are far away"


class RingWork:
    """Counts the work of searching one image after another for one ring.

    A thorough search takes one image for each of its parts: four, in texture five, two more if
    gravity is known. A part that costs more than an image may is cut short, and a later image goes
    on with what was not tried. There, places that were refused in the same reduction are not tried
    again; those refused in another one come last, as they may show in this one. So the search comes
    to an end, after which a new one begins. Things that move across the images are something new in
    each of them: a part therefore gets three images at most, and the next search leaves out what
    was refused by then.

    Attributes:
        part: the part of the search that the image gets.
        is_continued: an earlier image got that part, but was cut short.
        is_spread: the images are full of texture, so that the search is spread over five of them.
        smallest_px: the longer diameter of the smallest ring that is wanted, px.
    """

    def __init__(self, *, parts: bool = True, smallest_px: float = 0.0) -> None:
        """Begin with nothing known; with `parts` False each image gets the whole search."""
        self.smallest_px = smallest_px
        self._first = Part.MOST if parts else Part.WHOLE
        self._left = 0  # work left in this image, in rough fits
        self._search_left = 0  # how much of that may be spent on telling what candidates are
        self._refused: list[Place] = []
        self._before = 0  # how many of them are of earlier images
        self._unexplained: list[Place] = []  # where neither a response nor edges explain a fit
        self._told_before = 0  # how many of both lists are of earlier images
        self._is_cut = False  # the work of this image was spent before its part was done
        self._is_limited = False  # a part was given up after `_MOST_TURNS` images
        self._image: U8 | None = None  # the last one, reduced
        self._open: list[Part] = []  # parts left for the next images, in turn
        self._turns: Counter[Part] = Counter()  # images that each part of this search has had
        self._matches = [Part.MATCH, Part.MATCH_BETWEEN]
        self.part = self._first
        self.is_continued = self.is_spread = False

    @property
    def was_cut(self) -> bool:
        """Whether the search goes on in the next image."""
        return self._goes_on() or bool(self._open)

    def _goes_on(self) -> bool:
        """Tell whether the part that the image got goes on in a later one."""
        return self._has_more() and self._turns[self.part] < _MOST_TURNS

    def _has_more(self) -> bool:
        """Tell whether another image of the same part would try something new."""
        is_news = len(self._refused) + len(self._unexplained) > self._told_before
        return self._is_cut and (is_news or not self.is_continued)

    def begin(self) -> None:
        """Begin with another image: the next part of the search, or a new search."""
        if self._goes_on():
            self._open.append(self.part)
        elif self._has_more():
            self._is_limited = True
        if not self._open:
            self._refused = self._refused[-_KEPT_REFUSED:] if self._is_limited else []
            self._unexplained = []
            self._is_limited = False
            self._turns.clear()
            self.is_spread = False
        self.part = self._open.pop(0) if self._open else self._first
        self.is_continued = self.part in self._turns
        self._turns[self.part] += 1
        self._before = len(self._refused)
        self._told_before = self._before + len(self._unexplained)
        self._left = self._cost()
        self._search_left = max(ROUGH_COST + FULL_COST, self._left // 2)
        self._is_cut = False

    def follow(self, image: U8, reduction: float) -> None:
        """Move the refused and unexplained places with what has moved since the last image.

        By the optical flow of Lucas and Kanade (IJCAI 1981).

        Args:
            image: reduced image (height, width).
            reduction: pixels of the whole image along one of the reduced image.
        """
        before, self._image = self._image, image
        places = self._refused + self._unexplained
        if not places or before is None or before.shape != image.shape:
            return
        were = np.array([p.centre / reduction for p in places], np.float32)[:, None]
        # The start of the flow's search may be left out, but its type stubs do not know that.
        are, is_found, _ = cv2.calcOpticalFlowPyrLK(
            before, image, were, were.copy(), winSize=_FLOW_PX
        )
        moved = [
            replace(place, centre=reduction * at.astype(np.float64)) if found else place
            for place, at, found in zip(places, are[:, 0], is_found.ravel().tolist(), strict=True)
        ]
        count = len(self._refused)
        self._refused, self._unexplained = moved[:count], moved[count:]

    def _cost(self) -> int:
        """Return the limit of what the image may cost, in rough fits."""
        if self.part in (Part.WHOLE, Part.MOST, Part.REST):
            return _FRAME_COST
        if self.part in (Part.MATCH, Part.MATCH_BETWEEN):
            return _MATCH_COST
        return _CONTINUED_COST if self.is_continued else _PART_COST

    def end(self) -> None:
        """End the search: the next image begins a new one."""
        self._open, self._is_cut, self._is_limited = [], False, False

    def leave(self, *parts: Part) -> None:
        """Leave these parts of the search for the next images, one each."""
        if not self.is_continued:
            self._open += parts
            self.is_spread |= Part.FINEST in parts

    def leave_match(self) -> None:
        """Leave the matching for two more images, every second size in each.

        Which half comes first alternates: the first may show a ring that is too uncertain to be
        used, and that ends the search.
        """
        if not self.is_continued:
            self._open += self._matches
            self._matches.reverse()

    def has(self, cost: int) -> bool:
        """Tell whether this much work is left."""
        return cost <= self._left

    def affords_search(self, cost: int, reserve: int) -> bool:
        """Spend work on telling what a candidate is, if a reserve is left after it; else cut."""
        if cost > self._search_left or not self.has(cost + reserve):
            self.cut()
            return False
        self._search_left -= cost
        return self.affords(cost)

    def affords(self, cost: int) -> bool:
        """Spend work if that much is left; else cut the search short."""
        if not self.has(cost):
            self.cut()
            return False
        self._left -= cost
        return True

    def cut(self) -> None:
        """Note that the search of this image is cut short: a later one goes on."""
        self._is_cut = True

    def refuse(self, place: Place) -> None:
        """Remember that no ring was found at a place."""
        self._refused.append(place)

    def leave_unexplained(self, place: Place) -> None:
        """Remember that neither a response nor edges explain what is at a place."""
        self._unexplained.append(place)

    def is_unexplained(self, place: Place) -> bool:
        """Tell whether `leave_unexplained` was called for this place in the present search."""
        return any(place.is_same(u) for u in self._unexplained)

    def is_done(self, place: Place) -> bool:
        """Tell whether an earlier image showed no ring at this place in the same reduction."""
        before = self._refused[: self._before]
        return any(place.reduction == r.reduction and place.is_same(r) for r in before)

    def is_refused(self, place: Place) -> bool:
        """Tell whether no ring was found at this place, in this search or the end of the last."""
        return any(place.is_same(r) for r in self._refused)
