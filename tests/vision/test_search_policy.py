"""Which markers are searched for where, and how often: the rows of the policy's tables."""

import pytest

from landerd.vision.search_policy import (
    LARGE_SQUARE_PX,
    Elsewhere,
    ExpectedRings,
    RingSearch,
    SearchState,
    Seen,
    SquareSearch,
    after,
    elsewhere,
    is_ring_enough,
    ring_only_frames,
    rings_beside,
)

RING, SQUARE, NOTHING = Seen(rings=True), Seen(squares=True), Seen()
TRACKED_RING = Seen(rings=True, ring_only=True)
BOTH = Seen(rings=True, squares=True)
HELD = ring_only_frames(is_pad_known=True, is_heading_known=True)

THOROUGH = Elsewhere(RingSearch.THOROUGH, SquareSearch.ROUND_RINGS, squares_wait=True)
SQUARES = Elsewhere(RingSearch.NONE, SquareSearch.ANYWHERE)
QUICK = Elsewhere(RingSearch.QUICK, SquareSearch.ROUND_RINGS)
NOWHERE = Elsewhere()


def searches(frames: list[tuple[Seen, bool]], *, hz: float = 30.0) -> list[Elsewhere]:
    """Return what is looked for elsewhere in frames of (seen where expected, is expected)."""
    state = SearchState()
    made = []
    for k, (seen, is_expected) in enumerate(frames):
        looked = elsewhere(state, k / hz, seen, is_expected=is_expected, has_rings=True)
        made.append(looked)
        state = after(state, k / hz, seen, squares_wait=looked.squares_wait)
    return made


# ---- where the pad is expected ------------------------------------------------------------------


def test_squares_are_looked_for_beside_a_ring_in_every_fifth_frame_while_the_heading_is_held() -> (
    None
):
    state = SearchState()
    with_squares = []
    for _ in range(15):
        ring_is_enough = is_ring_enough(state, HELD)
        with_squares.append(not ring_is_enough)
        state = after(state, 0.0, TRACKED_RING if ring_is_enough else RING)
    assert with_squares == [True, False, False, False, False] * 3


def test_squares_are_looked_for_in_every_other_frame_while_the_heading_is_open() -> None:
    state, most = SearchState(), ring_only_frames(is_pad_known=True, is_heading_known=False)
    with_squares = []
    for _ in range(6):
        ring_is_enough = is_ring_enough(state, most)
        with_squares.append(not ring_is_enough)
        state = after(state, 0.0, TRACKED_RING if ring_is_enough else RING)
    assert with_squares == [True, False] * 3


def test_squares_are_looked_for_in_every_frame_without_an_estimate() -> None:
    most = ring_only_frames(is_pad_known=False, is_heading_known=False)
    assert not is_ring_enough(after(SearchState(), 0.0, BOTH), most)


def test_squares_are_looked_for_until_a_ring_is_seen_beside_which_they_may_wait() -> None:
    for seen in (NOTHING, SQUARE):
        assert not is_ring_enough(after(SearchState(), 0.0, seen), HELD)
    for seen in (RING, BOTH):
        assert is_ring_enough(after(SearchState(), 0.0, seen), HELD)


def test_a_frame_in_which_the_ring_alone_was_not_seen_counts_as_well() -> None:
    state = after(SearchState(), 0.0, RING)
    for _ in range(4):
        assert is_ring_enough(state, HELD)
        state = after(state, 0.0, SQUARE)
    assert not is_ring_enough(state, HELD)


@pytest.mark.parametrize(
    ("sides_px", "which"),
    [
        ([], ExpectedRings.ALL),
        ([20.0, 30.0], ExpectedRings.WHOLE),
        ([LARGE_SQUARE_PX], ExpectedRings.WHOLE),
        ([20.0, LARGE_SQUARE_PX + 1.0], ExpectedRings.NONE),
    ],
)
def test_the_larger_the_square_the_fewer_rings_are_looked_for(
    sides_px: list[float], which: ExpectedRings
) -> None:
    assert rings_beside(sides_px) is which


# ---- elsewhere ----------------------------------------------------------------------------------


def test_nothing_is_looked_for_elsewhere_once_a_square_tells_the_heading() -> None:
    for seen in (SQUARE, BOTH):
        assert searches([(seen, True)]) == [NOWHERE]


def test_nothing_is_looked_for_elsewhere_while_the_ring_is_enough() -> None:
    assert searches([(TRACKED_RING, True)]) == [NOWHERE]


def test_squares_are_looked_for_round_a_ring_that_was_seen_without_any() -> None:
    assert searches([(RING, True)]) == [Elsewhere(RingSearch.NONE, SquareSearch.ROUND_RINGS)]


def test_a_pad_never_seen_is_searched_in_every_frame_and_thoroughly_in_every_fifth() -> None:
    assert searches([(NOTHING, False)] * 10) == [THOROUGH, SQUARES, QUICK, QUICK, QUICK] * 2


def test_a_pad_expected_but_not_seen_is_searched_elsewhere_in_every_fifth_frame_only() -> None:
    frames = [(NOTHING, True)] * 10
    assert searches(frames) == [THOROUGH, SQUARES, NOWHERE, NOWHERE, NOWHERE] * 2


@pytest.mark.parametrize(("hz", "between"), [(10.0, [SQUARES]), (20.0, [SQUARES, NOWHERE])])
def test_fewer_frames_a_second_are_searched_thoroughly_as_often(
    hz: float, between: list[Elsewhere]
) -> None:
    frames = [(NOTHING, True)] * 6
    assert searches(frames, hz=hz) == ([THOROUGH, *between] * 3)[:6]


def test_squares_are_looked_for_between_thorough_searches_however_few_frames_there_are() -> None:
    assert searches([(NOTHING, True)] * 4, hz=4.0) == [THOROUGH, SQUARES] * 2


@pytest.mark.parametrize("seen", [RING, SQUARE, BOTH, TRACKED_RING])
def test_the_first_frame_after_a_loss_is_searched_thoroughly(seen: Seen) -> None:
    lost_again = [(NOTHING, True), (NOTHING, True), (seen, True), (NOTHING, True), (NOTHING, True)]
    assert searches(lost_again)[-2:] == [THOROUGH, SQUARES]


def test_frames_without_expectation_count_as_lost_like_those_with() -> None:
    frames = [(NOTHING, False), (NOTHING, True), (NOTHING, False)]
    assert searches(frames) == [THOROUGH, SQUARES, QUICK]


@pytest.mark.parametrize("is_expected", [True, False])
def test_a_search_that_was_cut_short_goes_on_in_the_next_frame(is_expected: bool) -> None:
    state = after(after(SearchState(), 0.0, NOTHING), 0.03, NOTHING, was_cut=True)
    goes_on = Elsewhere(RingSearch.THOROUGH, SquareSearch.ROUND_RINGS)
    assert elsewhere(state, 0.06, NOTHING, is_expected=is_expected, has_rings=True) == goes_on
    assert (
        elsewhere(after(state, 0.06, NOTHING), 0.09, NOTHING, is_expected=True, has_rings=True)
        == NOWHERE
    )


@pytest.mark.parametrize("is_expected", [True, False])
def test_a_search_goes_on_beside_the_squares_that_were_left(is_expected: bool) -> None:
    state = after(SearchState(), 0.0, NOTHING, was_cut=True, squares_wait=True)
    both = Elsewhere(RingSearch.THOROUGH, SquareSearch.ANYWHERE)
    assert elsewhere(state, 0.06, NOTHING, is_expected=is_expected, has_rings=True) == both
    state = after(state, 0.06, NOTHING, was_cut=True)
    goes_on = Elsewhere(RingSearch.THOROUGH, SquareSearch.ROUND_RINGS)
    assert elsewhere(state, 0.06, NOTHING, is_expected=is_expected, has_rings=True) == goes_on


def test_squares_of_a_pad_without_rings_do_not_wait() -> None:
    at_once = elsewhere(SearchState(), 0.0, NOTHING, is_expected=False, has_rings=False)
    assert at_once == Elsewhere(RingSearch.THOROUGH, SquareSearch.ANYWHERE)
    state = after(SearchState(), 0.0, NOTHING)
    next_frame = elsewhere(state, 0.03, NOTHING, is_expected=False, has_rings=False)
    assert next_frame.squares is SquareSearch.ANYWHERE
