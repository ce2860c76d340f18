import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd.config.models import DescentSection
from landerd.geometry import Vec3, rot_z, rotate, scale
from landerd.guidance.phases import Phases, descent_radius, region_height
from landerd.messages import Phase
from tests.guidance.situations import situation

OPTIONS = DescentSection(k1_m=0.12, k2_per_m=0.36, commit_height_m=0.12)  # thesis 3.6


def phases(*, has_heading: bool = True) -> Phases:
    return Phases(OPTIONS, has_heading=has_heading)


def test_the_descent_region_of_the_thesis() -> None:
    # 3.6: "about 4.4 meters" at 10 m of altitude, 0.12 m on the ground.
    assert descent_radius(OPTIONS, 10.0) == pytest.approx(4.4, abs=0.02)
    assert descent_radius(OPTIONS, 0.0) == 0.12
    # Figure 2.14.
    assert descent_radius(DescentSection(k1_m=0.15, k2_per_m=0.4), 5.0) == pytest.approx(
        1.108, abs=1e-3
    )


def test_below_the_pads_plane_the_region_is_no_smaller_than_on_it() -> None:
    assert descent_radius(OPTIONS, -3.0) == 0.12


@given(st.floats(0.0, 30.0), st.floats(0.0, 20.0), st.floats(0.0, 2.0))
def test_descent_is_never_allowed_outside_the_region(
    height: float, distance: float, sigma_m: float
) -> None:
    allowed = phases().may_descend(situation(distance, height, sigma_m=sigma_m))
    if distance >= descent_radius(OPTIONS, height):
        assert not allowed
    # Nor where the position is not known well enough to tell.
    if distance + sigma_m >= descent_radius(OPTIONS, height):
        assert not allowed


def test_over_a_pad_that_is_not_known_well_enough_to_descend_the_pilot_is_told_so() -> None:
    """As 14 m above it, with a region configured as narrow there as on the ground."""
    p = Phases(DescentSection(k1_m=0.12, k2_per_m=0.03), has_heading=False)
    phase, why = p.step(situation(0.05, 14.0, sigma_m=0.2))
    assert (phase, why) == (Phase.CLOSE_APPROACH, "pad known to 0.4 m, descends with 0.2")
    assert "away" in p.step(situation(0.05, 14.0, sigma_m=0.05))[1]


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 180.0, 225.0])
def test_a_vehicle_carried_out_of_the_region_stops_sinking_before_it_is_out(
    bearing_deg: float,
) -> None:
    to_pad = rotate(rot_z(math.radians(bearing_deg)), (1.0, 0.0, 0.0))

    def may_descend(opens_mps: float) -> bool:
        north, east, _ = scale(to_pad, 0.8 * descent_radius(OPTIONS, 1.0))
        rate = scale(to_pad, opens_mps)
        return phases().may_descend(situation(error=(north, east, 1.0), rate=rate))

    assert may_descend(0.0)
    assert not may_descend(0.4)
    assert may_descend(-0.4)


def flown(p: Phases, seconds: float, *, sinks_mps: float) -> None:
    """Keep it in DESCENT for some time, outside of the narrow region."""
    p.restart()
    for _ in range(3):
        p.step(situation(0.05, 1.0))
    off = situation(0.16, 0.5, rate=(0.0, 0.0, -sinks_mps))
    for _ in range(round(seconds / 0.1)):
        p.watch((0.0, 0.0, 1.0), off, 0.1)
        assert p.step(off)[0] is Phase.DESCENT


def test_the_descent_region_grows_to_its_limit_while_gusts_keep_it_from_sinking() -> None:
    p = phases()
    flown(p, 4.0, sinks_mps=0.0)
    assert not p.may_descend(situation(0.16, 0.5))
    flown(p, 60.0, sinks_mps=0.0)
    assert p.may_descend(situation(0.16, 0.5))
    widest = OPTIONS.widest_k1_m / OPTIONS.k1_m * descent_radius(OPTIONS, 0.5)
    assert p.may_descend(situation(0.99 * widest, 0.5))
    assert not p.may_descend(situation(1.01 * widest, 0.5))
    flown(p, 60.0, sinks_mps=0.3)  # the next landing sinks
    assert not p.may_descend(situation(0.16, 0.5))


def test_a_region_configured_wider_than_the_limit_does_not_grow() -> None:
    wide = Phases(OPTIONS.model_copy(update={"k1_m": 0.24}), has_heading=True)
    flown(wide, 60.0, sinks_mps=0.0)
    assert wide.widening == 1.0


def test_a_landing_goes_through_table_2_1_in_order() -> None:
    p = phases()
    seen = [
        p.step(r)[0]
        for r in (
            situation(30.0, 10.0, heading_deg=None),
            situation(14.0, 10.0, heading_deg=None),
            situation(13.0, 10.0, heading_deg=40.0),  # 3 delta is 13.2 m
            situation(4.0, 10.0, heading_deg=40.0),
            situation(1.0, 8.0, heading_deg=10.0),
            situation(0.2, 5.0, heading_deg=1.0),
            situation(0.05, 1.0, heading_deg=1.0),
            situation(0.03, 0.13, heading_deg=1.0),
            situation(0.03, 0.11, heading_deg=1.0),
            situation(0.03, 0.05, heading_deg=1.0),
        )
    ]
    assert seen == [
        Phase.APPROACH,
        Phase.APPROACH,
        Phase.CLOSE_APPROACH,
        Phase.YAW_CORRECTION,
        Phase.YAW_CORRECTION,
        Phase.DESCENT,
        Phase.DESCENT,
        Phase.DESCENT,
        Phase.LANDED,
        Phase.LANDED,
    ]


def test_until_aligned_there_is_a_floor_above_the_alignment_height() -> None:
    p = phases()
    p.step(situation(0.1, 5.0, heading_deg=20.0))
    assert p.floor_m > OPTIONS.alignment_height_m
    p.step(situation(0.1, 5.0, heading_deg=1.0))
    assert p.floor_m == 0.0


def floor_after(p: Phases, seconds: float, height: float, heading_deg: float | None) -> float:
    """Return the floor after some seconds at a height, or where that rises at the floor."""
    for _ in range(round(20.0 * seconds)):
        at = situation(0.1, max(height, p.floor_m), heading_deg=heading_deg)
        p.watch((0.0, 0.0, 1.0), at, 0.05)
        p.step(at)
    return p.floor_m


def test_where_no_heading_is_seen_at_the_alignment_height_it_climbs_to_see_more() -> None:
    p, least = phases(), OPTIONS.alignment_height_m
    assert floor_after(p, 2.0, 0.0, None) < least + 0.2
    assert floor_after(p, 6.0, 0.0, None) > 1.8 * least
    seen_at = floor_after(p, 20.0, 0.0, None)
    assert seen_at == pytest.approx(3.0 * least, abs=0.2)
    # Lower down the heading might be lost again before the vehicle has turned.
    assert floor_after(p, 5.0, 0.0, 40.0) == seen_at
    assert floor_after(p, 1.0, 0.0, 0.5) == 0.0
    assert floor_after(p, 1.0, 0.0, 40.0) < least + 0.2


def test_on_the_way_down_to_the_alignment_height_the_heading_is_not_waited_for() -> None:
    p = phases()
    assert floor_after(p, 30.0, 9.0, None) < OPTIONS.alignment_height_m + 0.2


def test_aligned_within_1_2_degrees_and_off_again_beyond_2_5() -> None:
    p = phases()

    def phase_at(heading_deg: float) -> Phase:
        return p.step(situation(0.1, 3.0, heading_deg=heading_deg))[0]

    assert phase_at(3.0) is Phase.YAW_CORRECTION
    assert phase_at(-1.3) is Phase.YAW_CORRECTION
    assert phase_at(-1.1) is Phase.DESCENT
    assert phase_at(2.4) is Phase.DESCENT
    assert phase_at(-2.6) is Phase.YAW_CORRECTION
    assert p.floor_m > OPTIONS.alignment_height_m
    assert phase_at(2.0) is Phase.YAW_CORRECTION
    assert phase_at(1.0) is Phase.DESCENT


def test_it_does_not_commit_to_a_pad_that_just_went_out_of_sight() -> None:
    p = phases()
    p.step(situation(0.02, 0.5, heading_deg=0.0))
    assert p.step(situation(0.02, 0.1, heading_deg=0.0), 0.45)[0] is Phase.DESCENT
    assert p.step(situation(0.02, 0.1, heading_deg=0.0), 0.2)[0] is Phase.LANDED


def test_the_higher_it_commits_the_younger_the_last_sighting_must_be() -> None:
    p = phases()
    p.step(situation(0.02, 0.5, heading_deg=0.0))
    assert p.step(situation(0.02, 0.11, heading_deg=0.0), 0.42)[0] is Phase.DESCENT
    assert p.step(situation(0.02, 0.11, heading_deg=0.0), 0.3)[0] is Phase.LANDED


def test_the_region_stays_finite_at_any_height() -> None:
    assert descent_radius(DescentSection(), 2500.0) < math.inf


def test_a_heading_out_of_sight_stops_the_descent() -> None:
    p = phases()
    assert p.step(situation(0.1, 3.0, heading_deg=0.0))[0] is Phase.DESCENT
    phase, why = p.step(situation(0.1, 1.0, heading_deg=None))
    assert phase is Phase.YAW_CORRECTION
    assert "heading" in why
    assert p.floor_m > 1.0


def test_low_down_it_climbs_if_the_pads_heading_is_out_of_sight() -> None:
    p = phases()
    assert p.step(situation(0.1, 3.0, heading_deg=0.0))[0] is Phase.DESCENT
    phase, why = p.step(situation(0.1, 0.6, heading_deg=None))
    assert phase is not Phase.LANDED
    assert p.goes_around
    assert "climbing" in why
    p.step(situation(0.1, 2.0, heading_deg=None))
    assert p.goes_around
    p.step(situation(0.1, 2.0, heading_deg=0.0))
    assert not p.goes_around
    p.step(situation(0.1, 3.0, heading_deg=None))
    assert not p.goes_around


@pytest.mark.parametrize("heading_deg", [None, 90.0])
def test_a_pad_without_heading_needs_no_alignment(heading_deg: float | None) -> None:
    p = phases(has_heading=False)
    assert p.step(situation(0.1, 3.0, heading_deg=heading_deg))[0] is Phase.DESCENT
    assert p.floor_m == 0.0
    assert p.step(situation(0.05, 0.1, heading_deg=heading_deg))[0] is Phase.LANDED


def test_it_commits_only_aligned_over_the_pad_and_below_the_commit_height() -> None:
    for distance, height, heading_deg in (
        (0.02, 0.13, 0.0),  # too high
        (0.02, 0.10, 10.0),  # heading off
        (0.21, 0.10, 0.0),  # beside it
        (0.02, 0.10, None),  # heading not known
    ):
        p = phases()
        p.step(situation(0.02, 1.0))
        phase = p.step(situation(distance, height, heading_deg=heading_deg))[0]
        assert phase is not Phase.LANDED, (distance, height, heading_deg)


def test_it_does_not_commit_as_it_climbs_away() -> None:
    p = phases()
    p.step(situation(0.05, 1.0))
    assert p.step(situation(0.02, 0.1, rate=(0.0, 0.0, 0.3)))[0] is Phase.DESCENT
    assert p.step(situation(0.02, 0.1, rate=(0.0, 0.0, -0.3)))[0] is Phase.LANDED


def test_drifting_far_out_is_an_approach_again_but_not_at_the_bound_itself() -> None:
    p = phases()
    bound = 3.0 * descent_radius(OPTIONS, 5.0)
    assert p.step(situation(0.1, 5.0))[0] is Phase.DESCENT
    assert p.step(situation(1.1 * bound, 5.0))[0] is not Phase.APPROACH
    assert p.step(situation(1.5 * bound, 5.0))[0] is Phase.APPROACH


def test_a_new_landing_begins_at_the_beginning() -> None:
    p = phases()
    p.step(situation(0.1, 3.0))
    p.restart()
    assert p.phase is Phase.APPROACH
    assert p.floor_m > OPTIONS.alignment_height_m


@pytest.mark.parametrize(
    "rate",
    [
        (0.5, 0.0, -0.3),  # slides over the pad
        (0.0, 0.0, -1.2),  # the deck comes up
    ],
)
def test_it_does_not_commit_to_a_bad_touch_down_but_climbs_and_tries_again(rate: Vec3) -> None:
    p = phases()
    p.step(situation(0.02, 1.0))
    assert p.step(situation(0.02, 0.11, rate=rate))[0] is Phase.DESCENT
    p.step(situation(0.02, 0.05, rate=rate))
    assert p.goes_around
    assert p.floor_m == OPTIONS.retry_height_m
    assert p.step(situation(0.02, 0.11))[0] is not Phase.LANDED
    p.step(situation(0.02, OPTIONS.retry_height_m + 0.1))
    assert not p.goes_around
    assert p.step(situation(0.02, 0.11))[0] is Phase.LANDED


def test_region_height_is_the_height_at_which_the_region_has_a_given_radius() -> None:
    assert descent_radius(OPTIONS, region_height(OPTIONS, 1.0)) == pytest.approx(1.0)
    assert region_height(OPTIONS, 0.05) == 0.0


def test_the_pilot_is_never_told_a_height_of_minus_zero() -> None:
    _, why = phases().step(situation(0.0, -0.02))
    assert "-0.0" not in why
    assert "0.0 m up" in why
