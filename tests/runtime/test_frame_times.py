"""Pictures with time stamps that cannot be true are not searched."""

from collections.abc import Callable

import pytest

from landerd.runtime.frame_times import FrameTimes

FRAME_S = 1 / 30
Age = Callable[[int], float]  # of a frame at its arrival by its number, s


def jittery(i: int) -> float:
    return 0.1 + 0.01 * ((7 * i) % 5)


def used(times: FrameTimes, ages: Age, first: int, last: int) -> list[bool]:
    """Return which of the frames from the first to before the last are used."""
    return [times.why_false(FRAME_S * i - ages(i), FRAME_S * i) is None for i in range(first, last)]


def running() -> FrameTimes:
    """Return the times after three seconds of good frames."""
    times = FrameTimes()
    assert all(used(times, jittery, 0, 90))
    return times


@pytest.mark.parametrize("ahead_s", [0.1, 0.14, 0.5, 3.0])
def test_frames_stamped_late_are_refused_at_once(ahead_s: float) -> None:
    times = running()
    assert not any(used(times, lambda i: jittery(i) - ahead_s, 90, 105))
    assert all(used(times, jittery, 105, 200))


def test_a_frame_that_jumps_ahead_is_refused_and_the_next_ones_are_not() -> None:
    times = running()
    flags = used(times, lambda i: jittery(i) - 0.08 * (i % 10 == 0), 90, 390)
    assert [i for i, is_used in enumerate(flags, 90) if not is_used] == list(range(90, 390, 10))


@pytest.mark.parametrize(("sooner_s", "frames"), [(0.1, 91), (0.08, 91), (0.04, 0)])
def test_a_camera_that_has_become_quicker_is_used_again_after_three_seconds(
    sooner_s: float, frames: int
) -> None:
    times = running()
    assert all(used(times, lambda i: jittery(i) - sooner_s, 90, 300)[frames:])


def test_frames_that_arrive_as_late_as_they_like_are_used() -> None:
    times = running()
    assert all(used(times, lambda i: jittery(i) + 0.3, 110, 200))
    assert all(used(times, jittery, 230, 300))


def test_a_stamp_that_is_no_number_or_no_later_than_the_last_is_refused() -> None:
    times = running()
    now = FRAME_S * 90
    for t in (float("nan"), float("inf"), now - 2.0, FRAME_S * 89 - jittery(89)):
        assert times.why_false(t, now) is not None
    assert times.why_false(now - jittery(90), now) is None
