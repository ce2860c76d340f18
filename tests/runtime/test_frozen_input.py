"""Which input counts as frozen: repeated to the bit with new time stamps."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from landerd.messages import Attitude, GimbalState, LocalPosition, Reference
from landerd.runtime.frozen_input import RESTLESS_ESTIMATES, RESTLESS_REPORTS, FrozenInput

REPORTS = [
    Attitude(0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)),
    LocalPosition(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    GimbalState(0.0, 0.0, 0.0, 0.0, Reference.BODY),
]
Report = Attitude | LocalPosition | GimbalState


def at(report: Report, i: int) -> Report:
    """Return the report number i of a sensor that is never still."""
    if isinstance(report, LocalPosition):
        return replace(report, t=0.02 * i, position=(0.0, 0.0, 1e-3 * i))
    return replace(report, t=0.02 * i, pitch=1e-3 * i)


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: type(report).__name__)
def test_a_report_that_always_changed_and_then_repeats_is_frozen(report: Report) -> None:
    frozen = FrozenInput()
    assert not any(frozen.repeats(at(report, i)) for i in range(RESTLESS_REPORTS + 1))
    last = at(report, RESTLESS_REPORTS)
    assert frozen.repeats(replace(last, t=last.t + 0.02))
    assert frozen.repeats(replace(last, t=last.t + 0.04))
    assert not frozen.repeats(at(report, RESTLESS_REPORTS + 3))


@pytest.mark.parametrize(("step_deg", "is_noticed"), [(0.003, True), (0.01, False), (0.1, False)])
def test_angles_that_are_not_coarse_are_known_to_be_frozen_after_few_reports(
    step_deg: float, is_noticed: bool
) -> None:
    """A gimbal that froze 1.4 s after the start was flown on for 0.9 s."""
    frozen, last = FrozenInput(), GimbalState(0.0, 0.0, 0.0, 0.0, Reference.BODY)
    for i in range(RESTLESS_ESTIMATES + 1):
        last = replace(last, t=0.02 * i, yaw=math.radians(step_deg) * i)
        assert not frozen.repeats(last)
    assert frozen.repeats(replace(last, t=last.t + 0.02)) == is_noticed


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: type(report).__name__)
def test_reports_that_repeat_from_the_beginning_are_not_frozen(report: Report) -> None:
    frozen = FrozenInput()
    assert not any(frozen.repeats(at(report, i // 2)) for i in range(3 * RESTLESS_REPORTS))


@pytest.mark.parametrize("report", REPORTS[:2], ids=lambda report: type(report).__name__)
def test_reports_that_were_still_on_the_ground_may_be_frozen_in_flight(report: Report) -> None:
    frozen = FrozenInput()
    assert not any(frozen.repeats(replace(report, t=-1.0 + 0.02 * i)) for i in range(40))
    assert not any(frozen.repeats(at(report, i)) for i in range(1, RESTLESS_ESTIMATES + 1))
    last = at(report, RESTLESS_ESTIMATES)
    assert frozen.repeats(replace(last, t=last.t + 0.02))


def test_a_picture_that_differs_in_one_pixel_is_another() -> None:
    frozen = FrozenInput()
    image = np.random.default_rng(1).integers(0, 255, (48, 64), np.uint8)
    assert not frozen.picture_repeats(image)
    assert frozen.picture_repeats(image)
    image[33, 5] ^= 1  # in the same memory
    assert not frozen.picture_repeats(image)


@pytest.mark.parametrize("level", [0, 255])
def test_pictures_that_are_all_white_or_black_are_new_ones_whatever_pixels_are_dead(
    level: int,
) -> None:
    frozen, image = FrozenInput(), np.full((48, 64), level, np.uint8)
    image[20, 30] = 128
    assert not any(frozen.picture_repeats(image) for _ in range(3))


def test_a_frozen_picture_is_noticed_without_comparing_all_its_levels() -> None:
    """This runs in the loop: 27 ms per picture of 1920x1080 left too little time for set-points."""

    def quickest(call: Callable[[], object]) -> float:
        began = [time.perf_counter()]
        for _ in range(7):
            call()
            began.append(time.perf_counter())
        return min(later - t for t, later in pairwise(began))

    frozen = FrozenInput()
    image = np.random.default_rng(1).integers(0, 255, (1080, 1920), np.uint8)
    frozen.picture_repeats(image)
    assert frozen.picture_repeats(image)
    assert quickest(lambda: frozen.picture_repeats(image)) < 0.5 * quickest(
        lambda: np.median(image)
    )


@pytest.mark.parametrize("rows", [1, 10, 12])
def test_of_an_even_picture_only_rows_with_different_levels_count(rows: int) -> None:
    """Of 1080 rows a hundredth may differ, among them those that are compared first."""
    frozen, image = FrozenInput(), np.full((1080, 64), 255, np.uint8)
    image[: 32 * rows : 32] = np.random.default_rng(1).integers(0, 250, (rows, 64), np.uint8)
    frozen.picture_repeats(image)
    assert frozen.picture_repeats(image) == (rows > 10)
