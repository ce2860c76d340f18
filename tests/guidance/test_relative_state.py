import math

import pytest

from landerd.estimation.pad_filter import PadEstimate
from landerd.geometry import Vec3
from landerd.guidance.relative_state import RelativeState
from tests.estimation.vehicles import flying, vehicle


def pad(
    position: Vec3, *, velocity: Vec3 = (0.0, 0.0, 0.0), heading: float | None = None
) -> PadEstimate:
    covariance = ((0.04, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 9.0))
    return PadEstimate(
        10.0,
        position,
        velocity,
        covariance,
        0.1,
        0.1,
        heading,
        0.02,
        0.0,
        (0.0, 0.0, 1.0),
    )


def test_height_is_from_the_feet_to_the_pad_and_distance_is_horizontal() -> None:
    seen = RelativeState.between(vehicle(flying()), pad((4.0, -2.0, 0.0)), 0.0)
    assert seen.distance == pytest.approx(5.0)
    assert seen.height == pytest.approx(4.8)


def test_the_pads_and_the_vehicles_motion_are_taken_together() -> None:
    seen = RelativeState.between(
        vehicle(flying(velocity=(2.0, 0.0, 0.5))),
        pad((4.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0)),
        0.0,
    )
    assert seen.error_rate == pytest.approx((-1.0, 0.0, -0.5))


def test_the_heading_is_off_by_the_short_way_round() -> None:
    seen = RelativeState.between(
        vehicle(flying(yaw=math.radians(170.0))),
        pad((0.0, 0.0, 0.0), heading=math.radians(-170.0)),
        0.0,
    )
    assert seen.heading_error == pytest.approx(math.radians(20.0))
    assert RelativeState.between(vehicle(flying()), pad((0.0, 0.0, 0.0)), 0.0).heading_error is None


def test_the_worse_horizontal_direction_counts_and_so_does_the_lenss_direction() -> None:
    below = pad((1.0, 2.0, 0.0))  # 4.8 m under the feet
    tape_m = 0.01  # of the camera's place on the airframe
    alone = RelativeState.between(vehicle(flying()), below, 0.0).sigma_m
    assert alone == pytest.approx(math.hypot(0.2, tape_m))
    with_lens = RelativeState.between(vehicle(flying()), below, 0.05).sigma_m
    assert with_lens == pytest.approx(math.hypot(0.2, 0.05 * 4.8, tape_m))


def test_a_decks_sinking_counts_only_as_far_as_it_is_known() -> None:
    # The worse it is known, the slower it is sunk to: it may come up.
    for heave, least in ((0.4, 0.2), (0.1, -0.1), (-0.3, -0.5)):
        deck = pad((0.0, 0.0, 0.0), velocity=(0.0, 0.0, heave))
        seen = RelativeState.between(vehicle(flying()), deck, 0.0)
        assert seen.sure_heave == pytest.approx(least)


def test_the_plane_of_a_tilted_pad_counts_only_near_the_pad() -> None:
    # From 30 m away its plane lies 5 m higher or lower: the descent region is not that wide.
    tilted = (-math.sin(math.radians(10.0)), 0.0, math.cos(math.radians(10.0)))
    over, far = (
        RelativeState.between(
            vehicle(flying()), pad((1.0 + north, 2.0, 0.0))._replace(normal=tilted), 0.0
        )
        for north in (0.5, -30.0)
    )
    assert over.height == pytest.approx(4.8 * tilted[2] + 0.5 * tilted[0])
    assert far.height == pytest.approx(4.8, abs=0.2)
