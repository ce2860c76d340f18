"""Which markers are looked for where in a frame, and how often: the decisions behind `Search`.

First where the pad is expected: each marker by a fit that starts there (tracking) and, if that
fails, by detection in a window round it.

1. Only rings, in the 4 frames after one in which squares were looked for and a ring was seen. Only
   squares tell the heading, but it changes slowly. If the estimator knows the pad without its
   heading, only in the first of these 4 frames; if it does not know the pad, in none. If a ring is
   seen, the frame is done.
2. Squares, in all other frames and if step 1 saw nothing. Once a square with sides over 40 px is
   tracked, the detector does not look for those that are not: this one tells the pose as well as
   all markers do. A square whose pose dirt or shade makes uncertain does not count as one.
3. Rings, after step 2: none if a square with sides over 40 px was seen; those that are expected
   wholly in the image if smaller squares were seen; all if no square was.

Then elsewhere, depending on what was seen where the pad is expected. A frame in which that was
nothing is called lost; so is one in which the pad was not expected anywhere. Of lost frames in a
row the first is searched thoroughly, and after it every fifth, or the first that is 0.15 s later:
a camera of 10 frames a second sees a pad that goes by in only a few of them.

| seen where expected        | rings in the whole image  | squares                               |
|----------------------------|---------------------------|---------------------------------------|
| rings, by step 1           | not looked for            | not looked for                        |
| squares                    | not looked for            | not looked for                        |
| only rings, by step 3      | not looked for            | round them                            |
| nothing, thorough frame    | thresholds that show most;| round the rings found; if none, in    |
|                            | shadow and motion in the  | the whole image, in this frame or, in |
|                            | model; other parts in the | texture, large ones in this frame and |
|                            | next frames               | all in the next                       |
| nothing, squares were left | the next part, if there   | round the rings found; if none, in    |
| for this frame             | is one                    | the whole image                       |
| nothing, the search of the | the next part, or one     | round the rings found                 |
| frame before goes on       | that was cut short again  |                                       |
| nothing, pad not expected  | the first threshold       | round the rings found                 |
| nothing, pad expected      | not looked for            | not looked for                        |

A thorough search of the whole image for rings is spread over several frames (`ring_work.Part`):

- Four in most images: the thresholds that show most rings, the outline of the pad's plate, the
  other thresholds, and last of all the plate's outline in the finest level.
- Five in an image full of texture: one each for the thresholds that show most, the other
  thresholds, the plate's outline, broken rings, and far rings in the finest level, which the first
  threshold of a quick search skips there too.
- Two more where gravity is known: they correlate the image with a level ring and look for the pad's
  plate about the likest places, each for every second size.

An image with nothing in it, as of clear sky, ends the search: the next one is searched thoroughly.

What a frame may cost is counted (`ring_work.py`). A search that reaches that limit is cut short,
and a later frame goes on with what was not tried, at most twice for each part. Places that were
refused are followed as they move in the picture. To look for squares in the whole of an image full
of texture costs as much as a part: for a pad that has a ring this is left for the next frame,
unless a ring was refused because no plate was seen about it. This frame is then looked at reduced
by a half, in less than half of the time, which shows the squares of a pad that is near.

Squares "round" a ring that cannot be decoded are looked for by their print (`square_beside.py`). A
pad without rings that is not expected anywhere is looked for by its squares in every frame.

WhyCodes are not under this policy: `WhyCodeFinder` tracks those whose heading is known where they
are expected, until one over 60 px was found, and searches the whole image with all thresholds in
every frame in which tracking shows none.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

# The first two bound the time that frames take: at 30 frames a second they leave six thorough
# searches, and six looks at a square, a second.
THOROUGH_EVERY, THOROUGH_AFTER_S = 5, 0.15  # lost frames, or s after the last thorough search
RING_ONLY_FRAMES = 4  # frames in a row in which a ring is enough, after one with squares
OPEN_HEADING_FRAMES = 1  # the same while the pad is known without its heading
# Side from which on one square tells the pose as well as all markers, px: 0.31 m seen from 3 m,
# where `bench.vision_square` has its position within 2 mm.
LARGE_SQUARE_PX = 40.0


class ExpectedRings(Enum):
    """Which rings are looked for where they are expected."""

    NONE = "none"
    WHOLE = "those wholly in the image"
    ALL = "all"


class RingSearch(Enum):
    """How the whole image is searched for rings."""

    NONE = "not at all"
    QUICK = "with the first threshold"
    THOROUGH = "with all thresholds, shadow and motion"


class SquareSearch(Enum):
    """Where squares are looked for that were not seen where they are expected."""

    NONE = "nowhere"
    ROUND_RINGS = "round the rings found"
    ANYWHERE = "round the rings found; if there are none, in the whole image"


@dataclass(frozen=True, slots=True)
class Seen:
    """What was seen where the pad is expected; nothing, if it is not expected anywhere."""

    rings: bool = False
    squares: bool = False
    ring_only: bool = False  # a ring was seen in step 1: squares were not looked for


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """What is looked for beyond the place where the pad is expected."""

    rings: RingSearch = RingSearch.NONE
    squares: SquareSearch = SquareSearch.NONE
    # If no rings are found, squares are wanted in the whole image, if not in this one then in the
    # next.
    squares_wait: bool = False


@dataclass(frozen=True, slots=True)
class SearchState:
    """What is remembered from frame to frame."""

    ring_only_frames: int = 0  # frames to come in which a ring is enough
    lost_frames: int = 0  # in a row, counted from the last that was searched thoroughly
    thorough_t: float = -math.inf  # time of that one, s
    was_cut: bool = False  # the search of the whole image for rings was not finished
    squares_wait: bool = False  # the search of the whole image for squares was left for this frame


def ring_only_frames(*, is_pad_known: bool, is_heading_known: bool) -> int:
    """Return for how many frames in a row a ring is enough, given what the estimator knows."""
    if not is_pad_known:
        return 0
    return RING_ONLY_FRAMES if is_heading_known else OPEN_HEADING_FRAMES


def is_ring_enough(state: SearchState, most: int) -> bool:
    """Tell whether step 1 is taken: rings first, and nothing else if one is seen.

    Args:
        state: before the frame.
        most: the value of `ring_only_frames`.
    """
    return state.ring_only_frames > RING_ONLY_FRAMES - most


def is_square_enough(square_sides_px: Sequence[float]) -> bool:
    """Tell whether one of the squares, by their shortest sides, is large enough for the pose."""
    return any(side > LARGE_SQUARE_PX for side in square_sides_px)


def rings_beside(square_sides_px: Sequence[float]) -> ExpectedRings:
    """Return which rings step 3 looks for, given the shortest sides of the squares seen."""
    if is_square_enough(square_sides_px):
        return ExpectedRings.NONE
    return ExpectedRings.WHOLE if square_sides_px else ExpectedRings.ALL


def elsewhere(
    state: SearchState, t: float, seen: Seen, *, is_expected: bool, has_rings: bool
) -> Elsewhere:
    """Return what is looked for elsewhere, given what was seen where the pad is expected.

    Args:
        state: before the frame.
        t: the frame's time, s.
        seen: where the pad is expected.
        is_expected: whether it is expected anywhere.
        has_rings: whether the pad has any rings.
    """
    if seen.squares or seen.ring_only:
        return Elsewhere()
    if seen.rings:
        return Elsewhere(squares=SquareSearch.ROUND_RINGS)
    if state.squares_wait:
        goes_on = RingSearch.THOROUGH if state.was_cut else RingSearch.NONE
        return Elsewhere(goes_on, SquareSearch.ANYWHERE)
    squares = SquareSearch.ROUND_RINGS if has_rings else SquareSearch.ANYWHERE
    if _is_thorough_due(state, t):
        return Elsewhere(RingSearch.THOROUGH, squares, squares_wait=has_rings)
    if state.was_cut:
        return Elsewhere(RingSearch.THOROUGH, SquareSearch.ROUND_RINGS)
    if not is_expected:
        return Elsewhere(RingSearch.QUICK, squares)
    return Elsewhere()


def _is_thorough_due(state: SearchState, t: float) -> bool:
    """Tell whether a lost frame for which no squares were left is to be searched thoroughly."""
    is_late = t - state.thorough_t >= THOROUGH_AFTER_S
    return state.lost_frames % THOROUGH_EVERY == 0 or is_late


def after(
    state: SearchState,
    t: float,
    seen: Seen,
    *,
    was_cut: bool = False,
    squares_wait: bool = False,
) -> SearchState:
    """Return the state for the next frame.

    Args:
        state: before this one.
        t: its time, s.
        seen: where the pad is expected.
        was_cut: whether the search of the whole image for rings goes on in the next frame.
        squares_wait: whether the search of the whole image for squares is left for the next frame.
    """
    ring_only_frames = max(0, state.ring_only_frames - 1)
    if seen.rings and not seen.ring_only:
        ring_only_frames = RING_ONLY_FRAMES
    lost_frames, thorough_t = 0, -math.inf
    if not (seen.rings or seen.squares):
        is_thorough = not state.squares_wait and _is_thorough_due(state, t)
        lost_frames = 1 if is_thorough else state.lost_frames + 1
        thorough_t = t if is_thorough else state.thorough_t
    return SearchState(ring_only_frames, lost_frames, thorough_t, was_cut, squares_wait)
