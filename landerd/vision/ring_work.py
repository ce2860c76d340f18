"""What a search for rings may still cost in a frame, and where earlier ones stopped.

Costs are counted, never timed, so that the same images give the same sightings on any machine.
"""

from collections import Counter
from dataclasses import dataclass, replace
from enum import Enum

import cv2
import numpy as np

from landerd.camera_model import F64
from landerd.vision.arrays import U8

# In rough fits: what the stages of a ring's fit take, as measured, and what a frame may take.
ROUGH_COST, FULL_COST, RESPONSE_COST, EDGE_COST, HARD_COST = 1, 2, 2, 3, 6
_FRAME_COST = 14  # half of it to tell what is worth more
# Of an image that gets one of texture's parts, where to label takes half of the time: to fit one
# ring and its edges; in an image that goes on with it, one behind a response, in shadow or motion.
_PART_COST, _CONTINUED_COST = 6, 11
_MATCH_COST = 8  # of one that is matched: two places, of each edges and plate
# Images that get the same part of a search, and of what was refused by then so many places that the
# next search leaves out: without a limit six things on the ground that moved through the picture
# kept a pad from being seen for 28 images.
_MOST_TURNS, _KEPT_REFUSED = 3, 12
_FLOW_PX = (15, 15)  # about a place, in the reduced image
_SAME_MIDDLE, _SAME_SIZE = 0.3, 1.6  # of places that are one: of the size, and a factor


@dataclass(frozen=True)
class Place:
    """Where in an image a ring could be."""

    centre: F64  # (2,), px
    size_px: float
    reduction: float = 1.0  # of the image in which it shows

    def is_same(self, other: "Place") -> bool:
        """Tell whether two places are about the same."""
        small, large = sorted((self.size_px, other.size_px))
        apart = float(np.hypot(*(self.centre - other.centre)))
        return apart < _SAME_MIDDLE * small and large < _SAME_SIZE * small


class Part(Enum):
    """What of a search an image gets."""

    WHOLE = "everything"
    MOST = "the ways to look that show most rings; in texture without BROKEN's and FINEST's"
    REST = "the other ways"
    PLATE = "the outline of the pad's plate"
    # Where gravity is known:
    MATCH = "what is on the whole like a level ring, every second size"
    MATCH_BETWEEN = "the same, the sizes between"
    # Of images full of texture:
    OTHERS = "the other ways, without those for small rings"
    BROKEN = "holes of rings that are joined to dark ground"
    FINEST = "the finest level: three quarters of all pixels, for rings that are far away"


class RingWork:
    """The counted work of the searches of one image after another for one ring.

    A thorough search takes three images, in texture five, two more where gravity is known: one for
    each of its parts. What costs more than an image may is cut short, and a later one goes on with
    what was not tried: places that were refused come last, as they show in another reduction of the
    image; what was refused in the same one is not tried again. So it comes to an end, after which a
    new search begins. What moves across the images is something new in each: a part gets three of
    them at most, and the next search goes on from there.

    Attributes:
        part: what the image gets.
        is_continued: an image before got that part, but not to the end.
        is_spread: the search is of images full of texture, over five of them.
        smallest_px: the larger diameter of the smallest ring that is wanted.
    """

    def __init__(self, *, parts: bool = True, smallest_px: float = 0.0) -> None:
        """Begin with nothing known; with `parts` False an image gets the whole search."""
        self.smallest_px = smallest_px
        self._first = Part.MOST if parts else Part.WHOLE
        self._left = self._search_left = 0
        self._refused: list[Place] = []
        self._before = 0  # of them, in the images before
        self._unexplained: list[Place] = []
        self._told_before = 0  # of both
        self._is_cut = False
        self._is_limited = False  # the search was not taken to its end
        self._image: U8 | None = None  # the last one, reduced
        self._open: list[Part] = []  # what is left for the next images, in turn
        self._turns: Counter[Part] = Counter()
        self._matches = [Part.MATCH, Part.MATCH_BETWEEN]
        self.part = self._first
        self.is_continued = self.is_spread = False

    @property
    def was_cut(self) -> bool:
        """Whether the search goes on in the next image."""
        return self._goes_on() or bool(self._open)

    def _goes_on(self) -> bool:
        """Tell whether the part that the image got goes on."""
        return self._has_more() and self._turns[self.part] < _MOST_TURNS

    def _has_more(self) -> bool:
        """Tell whether the part that the image got would come to something new in the next."""
        is_news = len(self._refused) + len(self._unexplained) > self._told_before
        return self._is_cut and (is_news or not self.is_continued)

    def begin(self) -> None:
        """Begin the search of another image, or go on with the last one's."""
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
        """Take what was refused to where it has moved since the image before.

        By the optical flow of Lucas and Kanade (IJCAI 1981) in the reduced image.
        """
        before, self._image = self._image, image
        places = self._refused + self._unexplained
        if not places or before is None or before.shape != image.shape:
            return
        were = np.array([p.centre / reduction for p in places], np.float32)[:, None]
        # Where the flow's search starts may be left out, which its types do not know.
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
        """Return what the image may cost."""
        if self.part in (Part.WHOLE, Part.MOST, Part.REST):
            return _FRAME_COST
        if self.part in (Part.MATCH, Part.MATCH_BETWEEN):
            return _MATCH_COST
        return _CONTINUED_COST if self.is_continued else _PART_COST

    def end(self) -> None:
        """End the search of the images before: the next begins anew."""
        self._open, self._is_cut, self._is_limited = [], False, False

    def leave(self, *parts: Part) -> None:
        """Leave the other parts of a search for the next images, one each."""
        if not self.is_continued:
            self._open += parts
            self.is_spread = Part.FINEST in parts

    def leave_match(self) -> None:
        """Leave the matching for two images more, every second size each, in turn the first.

        The first may show a ring that is not known well enough, which ends the search.
        """
        if not self.is_continued:
            self._open += self._matches
            self._matches.reverse()

    def has(self, cost: int) -> bool:
        """Tell whether a cost is left to spend."""
        return cost <= self._left

    def affords_search(self, cost: int, reserve: int) -> bool:
        """Spend a cost on telling what a candidate is, if a reserve is left then; else cut."""
        if cost > self._search_left or not self.has(cost + reserve):
            self.cut()
            return False
        self._search_left -= cost
        return self.affords(cost)

    def affords(self, cost: int) -> bool:
        """Spend a cost if it is left; else the search is cut."""
        if not self.has(cost):
            self.cut()
            return False
        self._left -= cost
        return True

    def cut(self) -> None:
        """End the search of this image: it goes on in the next."""
        self._is_cut = True

    def refuse(self, place: Place) -> None:
        """Remember that no ring is at a place."""
        self._refused.append(place)

    def leave_unexplained(self, place: Place) -> None:
        """Remember that neither a response nor edges explain what is at a place."""
        self._unexplained.append(place)

    def is_unexplained(self, place: Place) -> bool:
        """Tell whether they were tried there, in this image or since searches are cut."""
        return any(place.is_same(u) for u in self._unexplained)

    def is_done(self, place: Place) -> bool:
        """Tell whether an image before showed no ring at a place, in the same reduction."""
        before = self._refused[: self._before]
        return any(place.reduction == r.reduction and place.is_same(r) for r in before)

    def is_refused(self, place: Place) -> bool:
        """Tell whether no ring was found at a place, in this image or since searches are cut."""
        return any(place.is_same(r) for r in self._refused)
