import math
from dataclasses import replace

import pytest

from landerd.config.models import AimSection, Config, VehicleSection
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.geometry import IDENTITY, Vec3
from landerd.guidance.look_direction import LookDirection
from landerd.messages import Attitude, LocalPosition
from landerd.pad import PadLayout, Plate, Ring
from tests.estimation.hovering import BELOW, hear, shown
from tests.scripted_flight import PAD, TAG

FAR_TAG = TAG.model_copy(update={"position_m": (0.75, 0.0)})
WIDE_PAD = PadLayout(
    name="ring and tag beside it",
    markers=(Ring(kind="whycon", outer_diameter_m=1.0), FAR_TAG),
    plate=Plate(north_m=1.0, south_m=0.6, east_m=0.6, west_m=0.6),
)


def looked(
    layout: PadLayout,
    below: float,
    heading: float | None,
    *,
    pitch: float = 0.0,
    velocity: Vec3 = (0.0, 0.0, 0.0),
    lead_s: float = 0.0,
) -> Vec3:
    """Direction to look in from straight above a pad."""
    config = Config(vehicle=VehicleSection(camera_offset_m=(0.0, 0.0, 0.0)))
    poses = PoseHistory(config)
    poses.add(LocalPosition(1.0, (0.0, 0.0, -below), (0.0, 0.0, 0.0)))
    poses.add(Attitude(1.0, 0.0, pitch, 0.0, (0.0, 0.0, 0.0)))
    pad = PadEstimate(
        t=1.0,
        position=(0.0, 0.0, 0.0),
        velocity=velocity,
        covariance=IDENTITY,
        sigma_velocity=0.1,
        sigma_heave=0.1,
        heading=heading,
        sigma_heading=0.01,
        turn_rate=0.0,
        normal=(0.0, 0.0, 1.0),
    )
    direction = LookDirection(layout).direction(poses, pad, lead_s)
    assert direction is not None
    return direction


def test_from_afar_it_looks_at_the_middle_of_all_markers() -> None:
    north = looked(WIDE_PAD, 10.0, 0.0)
    assert math.atan2(north[0], north[2]) == pytest.approx(0.2 / 10.0, abs=0.005)
    east = looked(WIDE_PAD, 10.0, math.radians(90.0))
    assert math.atan2(east[1], east[2]) == pytest.approx(0.2 / 10.0, abs=0.005)


def test_just_above_the_pad_it_looks_at_the_marker_that_tells_the_heading() -> None:
    direction = looked(WIDE_PAD, 0.3, 0.0)
    assert math.degrees(math.atan2(direction[0], direction[2])) == pytest.approx(67.0, abs=3.0)


def test_just_above_the_pad_it_does_not_follow_it_up_and_down() -> None:
    """With pictures stamped 80 ms late, aim and estimate swung each other up there."""
    still, rising = (looked(WIDE_PAD, 0.3, 0.0, velocity=(0, 0, v), lead_s=0.1) for v in (0, -1))
    assert rising == pytest.approx(still)
    still, rising = (looked(WIDE_PAD, 3.0, 0.0, velocity=(0, 0, v), lead_s=0.1) for v in (0, -1))
    assert rising != pytest.approx(still, abs=0.001)
    still, driven = (looked(WIDE_PAD, 0.3, 0.0, velocity=(v, 0, 0), lead_s=0.1) for v in (0, 1))
    assert driven != pytest.approx(still, abs=0.001)


def test_without_a_heading_it_looks_at_the_landing_point() -> None:
    assert looked(WIDE_PAD, 0.3, None) == pytest.approx((0.0, 0.0, 1.0))


def test_the_airframes_lean_is_taken_out() -> None:
    leaning = looked(PAD, 10.0, None, pitch=math.radians(-20.0))
    assert math.degrees(math.atan2(leaning[0], leaning[2])) == pytest.approx(20.0, abs=0.1)


def test_a_pad_seen_once_is_looked_at_for_a_second() -> None:
    # At the edge of the picture of a camera that is swept it would be gone in the next one.
    estimator = Estimator(Config())
    for i in range(30):
        hear(estimator, 0.05 * i)
    assert LookDirection(PAD).ahead(estimator, 1.45, AimSection()) is None
    aside = replace(BELOW, position=(2.0, 0.0, 5.0))
    estimator.on_sightings(shown(1.45, aside))
    for i in range(30, 60):
        hear(estimator, 0.05 * i)
        direction = LookDirection(PAD).ahead(estimator, 0.05 * i, AimSection())
        if i < 47:
            assert direction is not None
            assert math.atan2(direction[1], direction[2]) == pytest.approx(0.4, abs=0.05)
    assert direction is None


def test_after_a_pad_was_lost_another_seen_once_is_looked_at() -> None:
    estimator = Estimator(Config())
    hear(estimator, 0.0)
    for i in range(1, 120):
        hear(estimator, 0.05 * i)
        if i <= 30:
            estimator.on_sightings(shown(0.05 * i, BELOW))
    assert estimator.pad(1.5) is not None
    estimator.on_sightings(shown(5.95, replace(BELOW, position=(2.0, 0.0, 5.0))))
    hear(estimator, 6.0)
    direction = LookDirection(PAD).ahead(estimator, 6.0, AimSection())
    assert direction is not None
    assert math.atan2(direction[1], direction[2]) == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize(("speed", "looks"), [(4.0, True), (-4.0, False), (-1.0, True)])
def test_a_pad_seen_once_is_not_looked_back_at_while_flying_on(speed: float, looks: bool) -> None:
    # Boards of others turned the camera back while the pad ahead came and went.
    estimator = Estimator(Config())
    for i in range(30):
        hear(estimator, 0.05 * i, "attitude", "gimbal")
        estimator.on_telemetry(LocalPosition(0.05 * i, (0.0, 0.0, -5.0), (0.0, speed, 0.0)))
    estimator.on_sightings(shown(1.45, replace(BELOW, position=(2.0, 0.0, 5.0))))  # to the east
    assert (LookDirection(PAD).ahead(estimator, 1.46, AimSection()) is not None) is looks
