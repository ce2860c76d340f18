"""Where the feet are on the plate, which decides whether it counts as landed."""

import math

import pytest

from landerd.config.models import VehicleSection
from landerd.geometry import Vec3
from landerd.guidance.footprint import Footprint, most_lean
from landerd.guidance.relative_state import RelativeState
from landerd.pad import Plate

DT = 0.025
PLATE = Plate(south_m=0.62, north_m=1.02, west_m=0.62, east_m=0.62)
FOOTPRINT = (0.44, 0.26)  # the circle through the feet has a radius of 0.26 m


def touched(sigma_mps: float) -> Footprint:
    """Return a footprint that touched on the landing point of a pad heading north."""
    footprint = Footprint(PLATE, FOOTPRINT)
    still = (0.0, 0.0, 0.0)
    relative = RelativeState(still, still, still, 0.01, 0.0, 0.0, sigma_velocity=sigma_mps)
    footprint.touch(relative, 0.0)
    return footprint


@pytest.mark.parametrize(
    ("footprint_m", "gear_height_m", "commit_height_m", "expected_deg"),
    [
        (FOOTPRINT, 0.20, 0.16, 27.0),  # rubber slides before it tips over
        ((0.4, 0.4), 0.20, 0.16, 25.7),  # and what is wider touches higher up
        ((1.2, 0.8), 0.30, 0.2, 13.3),
        (FOOTPRINT, 0.20, 0.05, 9.4),
        (FOOTPRINT, 0.0, 0.16, 27.0),
        ((0.3, 0.3), 0.30, 0.16, 14.0),  # as high as wide
        ((0.44, 0.24), 0.21, 0.16, 21.6),
        ((0.44, 0.18), 0.25, 0.16, 10.2),  # narrow and high
        ((0.18, 0.44), 0.25, 0.16, 10.2),
    ],
)
def test_it_may_lean_as_far_as_rubber_and_the_gear_hold_and_no_foot_touches_before_commit(
    footprint_m: tuple[float, float],
    gear_height_m: float,
    commit_height_m: float,
    expected_deg: float,
) -> None:
    vehicle = VehicleSection(footprint_m=footprint_m, gear_height_m=gear_height_m)
    lean_deg = math.degrees(most_lean(vehicle, commit_height_m))
    assert lean_deg == pytest.approx(expected_deg, abs=0.1)


def follow(footprint: Footprint, velocity: Vec3, pad_velocity: Vec3, duration_s: float) -> None:
    """Let the feet move at a velocity for a while, from wherever they are."""
    for i in range(round(duration_s / DT) + 1):
        t = i * DT
        feet = (t * velocity[0], t * velocity[1], t * velocity[2])
        footprint.slide(t, feet, 0.0, pad_velocity)


def test_feet_carried_by_a_moving_pad_stay_on_the_plate_where_they_touched() -> None:
    footprint = touched(0.02)
    follow(footprint, (5.0, 0.0, 0.0), (5.0, 0.0, 0.0), 2.5)
    assert footprint.on_plate


@pytest.mark.parametrize(("heading", "is_on"), [(0.0, False), (0.5 * math.pi, True), (None, False)])
def test_a_pad_that_has_turned_since_the_touch_has_its_plate_elsewhere(
    heading: float | None, is_on: bool
) -> None:
    """0.7 m to the east is beside the plate, unless the plate's longer side is there by now."""
    footprint = touched(0.02)
    footprint.see((0.0, -0.7, 0.0), heading)
    assert footprint.on_plate is is_on


@pytest.mark.parametrize("away", [(-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
def test_feet_that_slide_are_followed_over_the_edge(away: Vec3) -> None:
    footprint = touched(0.02)
    follow(footprint, (0.3 * away[0], 0.3 * away[1], 0.0), (0.0, 0.0, 0.0), 2.5)
    assert not footprint.on_plate


def test_a_slide_that_has_ended_counts_however_uncertain_the_pad_is() -> None:
    footprint = touched(0.3)
    follow(footprint, (0.0, 0.6, 0.0), (0.0, 0.0, 0.0), 1.0)
    for i in range(80):
        footprint.slide(1.0 + i * DT, (0.0, 0.6, 0.0), 0.0, (0.0, 0.0, 0.0))
    assert not footprint.on_plate


def test_a_pad_that_seems_to_move_within_its_uncertainty_does_not_count_as_a_slide() -> None:
    """It seems so for 2.5 s, until the vehicle stands level and the plate holds its feet."""
    footprint = touched(0.15)
    follow(footprint, (0.0, 0.0, 0.0), (0.0, 0.25, 0.0), 2.5)
    assert footprint.on_plate
    unsure = touched(0.05)
    follow(unsure, (0.0, 0.0, 0.0), (0.0, 0.4, 0.0), 2.5)
    assert not unsure.on_plate


@pytest.mark.parametrize(
    ("yaw_deg", "east_m", "is_on"),
    [(0.0, 0.45, True), (180.0, 0.45, True), (0.0, 0.52, False), (90.0, 0.45, False)],
)
def test_it_is_the_feet_that_stand_on_the_plate_not_a_circle_through_them(
    yaw_deg: float, east_m: float, is_on: bool
) -> None:
    """Once, with all feet on the plate, the pilot read "disarmed beside the pad"."""
    footprint = touched(0.0)
    for i in range(2):
        feet = (0.0, i * east_m, 0.0)
        footprint.slide(10.0 * i, feet, math.radians(yaw_deg), (0.0, 0.0, 0.0))
    assert footprint.on_plate is is_on
