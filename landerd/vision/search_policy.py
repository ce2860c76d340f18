"""Which markers are looked for where in a frame, and how often: what `Search` decides by.

First where the pad is expected, each marker by a fit that starts there (tracking) and, if that
fails, by detection in a window round it:

1. Only rings, in the 4 frames after one in which squares were looked for and a ring was seen, while
   the estimate holds the heading: squares tell the heading, which changes slowly. In the first of
   them while it knows the pad without its heading. If a ring is seen the frame is done.
2. Squares, in all other frames and where step 1 saw nothing. Once one with sides over 40 px is
   tracked, those that are not are left: it tells the pose as well as all markers do. One that dirt
   or shade leaves less certain does not count so.
3. Rings, after step 2: none beside a square with sides over 40 px, those wholly in the image beside
   smaller squares, all beside none.

Then elsewhere, by what was seen where the pad is expected. A frame in which that was nothing is
called lost, also if the pad was not expected anywhere. Of lost frames in a row the first is
searched thoroughly, and after it every fifth, or the first that is 0.15 s later: a camera of 10
frames a second sees a pad that goes by in few of them.

| seen where expected        | rings in the whole image  | squares                               |
|----------------------------|---------------------------|---------------------------------------|
| rings, by step 1           | not looked for            | not looked for                        |
| squares                    | not looked for            | not looked for                        |
| only rings, by step 3      | not looked for            | round them                            |
| nothing, thorough frame    | thresholds that show most;| round the rings found; if none, in    |
|                            | shadow and motion in the  | the whole image, now or in the next   |
|                            | model; the rest is left   |                                       |
| nothing, squares left      | as below                  | round the rings found; if none, in    |
|                            |                           | the whole image                       |
| nothing, the search of the | the next part of it, or   | round the rings found                 |
| frame before goes on       | one of before once more   |                                       |
| nothing, pad not expected  | the first threshold       | round the rings found                 |
| nothing, pad expected      | not looked for            | not looked for                        |

A thorough search of the whole image for rings takes three frames: what shows most, the other
thresholds, and the plate's outline. In an image full of texture it takes five, one each for what
shows most, for the other thresholds, for the plate's outline, for broken rings, and for far rings
in the finest level, which is not looked at with the first threshold either. Where gravity is known
two more look for what is on the whole like a level ring with the pad's plate about it, of every
second size each. After an image with nothing in it, as clear sky, the next one is searched
thoroughly. What a frame may cost is counted (`ring_work.py`): a search that comes to the end of it
is cut short, and a later frame goes on with what was not tried, twice at most for each part. What
was refused is followed to where it moves in the picture. To look for squares in the whole of an
image full of texture costs as much as a part: those of a pad that has a ring are left for the next
frame, unless a ring was refused because nothing was seen beside it.

Squares "round" a ring that cannot be read are looked for by their print (`square_beside.py`). A pad
without rings that is not expected anywhere is looked for in every frame by its squares.

WhyCodes are not under this policy: `WhyCodeFinder` tracks those whose heading is known where they
are expected, up to the first one over 60 px, and searches the whole image with all thresholds in
every frame in which that shows none.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

# They bound the time a frame takes; at 30 frames a second they leave six thorough searches, and six
# looks at a square, a second.
THOROUGH_EVERY, THOROUGH_AFTER_S = 5, 0.15  # lost frames, or so long after the last
RING_ONLY_FRAMES = 4  # after one in which squares were looked for
OPEN_HEADING_FRAMES = 1  # the same while the pad is known without its heading
LARGE_SQUARE_PX = 40.0  # 0.31 m seen from 3 m: `bench.vision_square` has it within 2 mm there


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
    ring_only: bool = False  # step 1 was enough: squares were not looked for


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """What is looked for beyond the place where the pad is expected."""

    rings: RingSearch = RingSearch.NONE
    squares: SquareSearch = SquareSearch.NONE
    # Where no rings are found, squares in the whole image are wanted, if need be in the next one.
    squares_wait: bool = False


@dataclass(frozen=True, slots=True)
class SearchState:
    """What is remembered from frame to frame."""

    ring_only_frames: int = 0  # that may follow
    lost_frames: int = 0  # in a row, from the last that was searched thoroughly on
    thorough_t: float = -math.inf  # its time, s
    was_cut: bool = False  # the search of the whole image for rings
    squares_wait: bool = False  # those in the whole image


def ring_only_frames(*, is_pad_known: bool, is_heading_known: bool) -> int:
    """Return how many frames in a row may do with a ring, by what the estimate knows."""
    if not is_pad_known:
        return 0
    return RING_ONLY_FRAMES if is_heading_known else OPEN_HEADING_FRAMES


def is_ring_enough(state: SearchState, most: int) -> bool:
    """Tell whether step 1 is taken: rings first, and nothing else if one is seen.

    Args:
        state: before the frame.
        most: `ring_only_frames`.
    """
    return state.ring_only_frames > RING_ONLY_FRAMES - most


def is_square_enough(square_sides_px: Sequence[float]) -> bool:
    """Tell whether one of squares with these shortest sides tells the pose as all markers do."""
    return any(side > LARGE_SQUARE_PX for side in square_sides_px)


def rings_beside(square_sides_px: Sequence[float]) -> ExpectedRings:
    """Return which rings step 3 looks for beside squares with these shortest sides."""
    if is_square_enough(square_sides_px):
        return ExpectedRings.NONE
    return ExpectedRings.WHOLE if square_sides_px else ExpectedRings.ALL


def elsewhere(
    state: SearchState, t: float, seen: Seen, *, is_expected: bool, has_rings: bool
) -> Elsewhere:
    """Return what is looked for after what was seen where the pad is expected.

    Args:
        state: before the frame.
        t: the frame's time, s.
        seen: where the pad is expected.
        is_expected: whether it is expected anywhere.
        has_rings: whether the pad has any.
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
    """Tell whether a lost frame in which squares do not wait is to be searched thoroughly."""
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
        was_cut: whether a search of the whole image for rings came to the end of its work first.
        squares_wait: whether squares in the whole image are left for the next frame.
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
