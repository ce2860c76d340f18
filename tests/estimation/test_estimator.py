"""The estimator, fed with messages: freshness, accepted sightings, predictions for vision."""

import math
from dataclasses import replace

import pytest

from landerd.config.models import CameraSection, Config
from landerd.estimation.estimator import Estimator
from landerd.messages import Attitude, ClockSync, GimbalState, LocalPosition, Reference
from tests.estimation.hovering import BELOW, TELEMETRY, hear, shown


def seeing(until: float = 1.0) -> Estimator:
    """A vehicle that hovers over a pad and has seen it for some frames."""
    estimator = Estimator(Config())
    for i in range(12):
        t = until - 0.44 + 0.04 * i
        hear(estimator, t)
        estimator.on_sightings(shown(t, BELOW))
    return estimator


def test_an_accepted_sighting_has_the_time_of_its_exposure() -> None:
    estimator = seeing(until=1.0)
    hear(estimator, 1.04)
    observations = estimator.on_sightings(shown(1.04, BELOW))
    assert observations is not None
    assert [o.t for o in observations] == [1.04]
    assert estimator.sighting_t == 1.04
    assert estimator.nis >= 0.0


@pytest.mark.parametrize("t", [1.0, 0.9, math.nan, -math.inf])
def test_a_frame_that_is_late_or_has_no_time_is_not_looked_at(t: float) -> None:
    estimator = seeing(until=1.0)
    assert estimator.on_sightings(shown(t, BELOW)) is None
    assert estimator.frame_t == 1.0


def test_a_frame_without_the_pad_or_with_an_impossible_one_is_no_sighting() -> None:
    estimator = seeing(until=1.0)
    hear(estimator, 1.04)
    assert estimator.on_sightings(shown(1.02)) == []
    assert estimator.on_sightings(shown(1.03, replace(BELOW, cost=1e7))) == []
    assert (estimator.sighting_t, estimator.frame_t) == (1.0, 1.03)


@pytest.mark.parametrize(("source", "late"), [("attitude", 0.21), ("position", 0.31)])
def test_a_vehicle_is_fresh_only_while_position_and_attitude_are(source: str, late: float) -> None:
    estimator = seeing(until=1.0)
    assert estimator.fresh_vehicle(1.1) is not None
    assert estimator.stale(1.1) is None
    others = [s for s in TELEMETRY if s != source]
    hear(estimator, 1.0 + late, *others)
    assert estimator.fresh_vehicle(1.0 + late) is None
    assert estimator.vehicle(1.0 + late) is not None
    assert estimator.stale(1.0 + late) == source


def test_of_several_stale_inputs_the_gimbal_is_named_last() -> None:
    estimator = seeing(until=1.0)
    hear(estimator, 1.31, "position", "attitude")
    assert estimator.stale(1.31) == "gimbal"
    assert estimator.fresh_vehicle(1.31) is not None
    assert estimator.stale(9.0) == "attitude"


def test_a_jump_of_the_local_frame_moves_neither_pad_nor_vehicle() -> None:
    estimator = seeing(until=1.0)
    pad, vehicle = estimator.pad(1.0), estimator.vehicle(1.0)
    estimator.on_telemetry(LocalPosition(1.02, (3.0, 0.0, -5.0), (0.0, 0.0, 0.0)))
    after = estimator.vehicle(1.0)
    assert estimator.pad(1.0) == pad
    assert vehicle is not None
    assert after is not None
    assert after.feet == pytest.approx(vehicle.feet)


@pytest.mark.parametrize("is_seen", [True, False])
def test_a_reset_of_the_heading_does_not_move_a_known_pad(is_seen: bool) -> None:
    estimator = seeing(until=1.0)
    before = estimator.vehicle(1.0)
    begins = 1.02 if is_seen else 9.02
    for i in range(20):
        t = begins + 0.02 * i
        hear(estimator, t, "position", "gimbal")
        estimator.on_telemetry(Attitude(t, 0.0, 0.0, 0.7 if i else 0.0, (0.0, 0.0, 0.0)))
    vehicle = estimator.vehicle(begins + 0.4)
    assert before is not None
    assert vehicle is not None
    assert vehicle.yaw == pytest.approx(before.yaw if is_seen else 0.7)
    assert vehicle.autopilot_yaw == pytest.approx(0.7)  # to stand level with


def test_after_a_restart_nothing_of_vehicle_or_pad_is_known() -> None:
    estimator = seeing(until=1.0)
    estimator.on_restart()
    assert estimator.pad(1.0) is None
    assert estimator.vehicle(1.0) is None
    assert estimator.sighting_t == -math.inf


def test_pad_and_vehicle_are_those_of_the_newest_data_also_where_they_were_asked_for_before() -> (
    None
):
    estimator = seeing(until=1.0)
    pad, vehicle = estimator.pad(1.1), estimator.vehicle(1.1)
    aside = replace(BELOW, position=(0.05, 0.0, 5.0))
    estimator.on_telemetry(LocalPosition(1.06, (0.0, 0.0, -5.0), (1.0, 0.0, 0.0)))
    hear(estimator, 1.06, "attitude", "gimbal")
    assert estimator.on_sightings(shown(1.04, aside))
    assert estimator.pad(1.1) != pad
    assert estimator.vehicle(1.1) != vehicle
    estimator.on_restart()
    assert estimator.pad(1.1) is None
    assert estimator.vehicle(1.1) is None


def test_vision_is_told_of_the_pad_for_a_second() -> None:
    estimator = seeing(until=1.0)
    prior = estimator.prior(1.0)
    assert prior.pad is not None
    assert prior.pad.position == pytest.approx(BELOW.position, abs=0.01)
    hear(estimator, 2.1)
    prior = estimator.prior(2.1)
    assert prior.down is not None
    assert prior.pad is None


def test_half_the_round_trip_counts_as_age_of_the_autopilots_telemetry() -> None:
    estimator = seeing(until=1.0)
    assert estimator.stale(1.15) is None
    estimator.on_clock(ClockSync(1.0, 0.1))
    assert estimator.stale(1.05) is None
    assert estimator.stale(1.15) == "attitude"
    assert not estimator.has_fresh_vehicle(1.15)


@pytest.mark.parametrize("from_autopilot", [False, True])
def test_half_the_round_trip_counts_as_age_of_gimbal_angles_from_the_autopilot(
    from_autopilot: bool,
) -> None:
    estimator = seeing(until=1.0)
    estimator.on_clock(ClockSync(1.0, 0.1))
    estimator.on_telemetry(
        GimbalState(1.02, 0.0, -1.5, 0.0, Reference.BODY, from_autopilot=from_autopilot)
    )
    hear(estimator, 1.24, "position", "attitude")
    assert estimator.stale(1.24) == ("gimbal" if from_autopilot else None)


def test_the_cameras_stated_time_error_counts_as_age_and_as_sigma_of_the_clock() -> None:
    estimator = Estimator(Config())
    hear(estimator, 0.98)
    hear(estimator, 1.02)
    estimator.on_sightings(replace(shown(1.0, BELOW), sigma_t=0.03))
    assert estimator.sensor_errors.sigma_clock_s == pytest.approx(math.hypot(0.02, 0.03))
    estimator = seeing(until=1.0)
    hear(estimator, 1.04)
    assert estimator.on_sightings(replace(shown(1.04, BELOW), sigma_t=0.03))
    assert estimator.sight_age(1.1) == pytest.approx(0.11)


@pytest.mark.parametrize(("late_s", "older_s"), [(0.03, 0.03), (-0.03, 0.02)])
def test_the_assumed_or_learned_clock_error_counts_in_the_age_of_pictures(
    late_s: float, older_s: float
) -> None:
    estimator = Estimator(Config())
    arm = Config().vehicle.camera_offset_m[0]
    for i in range(1, 400):
        t = 0.02 * i  # it flies to and fro over a pad that stands
        north, v = math.sin(3.0 * (t - late_s)), 3.0 * math.cos(3.0 * t)
        estimator.on_telemetry(LocalPosition(t, (math.sin(3.0 * t), 0.0, -5.0), (v, 0.0, 0.0)))
        hear(estimator, t, "attitude", "gimbal")
        estimator.on_sightings(shown(t, replace(BELOW, position=(0.0, north + arm, 5.0))))
    assert estimator.sight_age(estimator.sighting_t) == pytest.approx(older_s, abs=0.005)


def test_health_has_the_refused_share_and_the_age_of_pictures() -> None:
    estimator = seeing(until=1.0)
    estimator.on_tick(1.06)
    health = estimator.health.newest
    assert health is not None
    assert health.refused == 0.0
    assert health.picture_age_s == pytest.approx(0.06)
    aside = replace(BELOW, position=(2.0, 0.0, 5.0))
    count = health.sightings
    for i in range(4):
        t = 1.04 + 0.04 * i
        hear(estimator, t)
        estimator.on_sightings(shown(t, aside))
        estimator.on_tick(t + 0.1)
    health = estimator.health.newest
    assert health is not None
    assert health.sightings == count + 4
    assert health.refused == pytest.approx(4.0 / (count + 4))
    assert health.nis > 3.0
    estimator.on_tick(5.0)
    assert estimator.health.newest is None  # nothing was seen lately
    assert estimator.health.flight == health


def test_a_picture_is_placed_where_the_configured_clock_says() -> None:
    # Stamped 40 ms late, while the vehicle flies north at 5 m/s.
    config = Config(camera=CameraSection(clock_offset_s=0.04))
    estimator = Estimator(config)
    observations = []
    for i in range(60):
        t = 0.02 * i
        estimator.on_telemetry(LocalPosition(t, (5.0 * t, 0.0, -5.0), (5.0, 0.0, 0.0)))
        hear(estimator, t, "attitude", "gimbal")
        if t > 0.5 and (seen := estimator.on_sightings(shown(t, BELOW))):
            observations.append(seen[0].position[0] - 5.0 * (t - 0.04))
    assert observations
    assert observations[0] == pytest.approx(Config().vehicle.camera_offset_m[0], abs=0.02)


def test_a_refused_sighting_is_reported_as_refused() -> None:
    estimator = seeing(until=1.0)
    hear(estimator, 1.04)
    far = replace(BELOW, position=(0.0, 4.0, 5.0))
    assert estimator.on_sightings(shown(1.04, far)) == []
    assert estimator.refused_t == 1.04


def test_vision_is_told_where_a_pad_seen_once_may_be_now() -> None:
    estimator = Estimator(Config())
    for i in range(61):
        t = 0.02 * i
        hear(estimator, t, "attitude", "gimbal")
        flown = 5.0 * max(0.0, t - 1.0)
        estimator.on_telemetry(LocalPosition(t, (flown, 0.0, -5.0 - flown), (5.0, 0.0, -5.0)))
        if i == 50:
            assert estimator.prior(t).maybe is None
            estimator.on_sightings(shown(t, BELOW))
    prior = estimator.prior(1.2)
    assert prior.pad is None
    assert prior.maybe is not None
    assert prior.maybe.position == pytest.approx((0.0, 1.0, 6.0), abs=0.05)
    assert prior.maybe.sigma_m > 0.5  # it may be moving
    hear(estimator, 1.5)
    assert estimator.prior(1.5).maybe is None


def test_a_pad_driven_along_with_does_not_brake_while_no_position_is_told() -> None:
    """Once, the position was held still after 0.1 s, and a pad at 10 m/s seemed to do 1 m/s."""
    estimator = Estimator(Config())
    for i in range(60):
        t = 0.04 * i
        hear(estimator, t, "attitude", "gimbal")
        if t <= 2.05:
            estimator.on_telemetry(LocalPosition(t, (10.0 * t, 0.0, -5.0), (10.0, 0.0, 0.0)))
        estimator.on_sightings(shown(t, BELOW))
    pad = estimator.pad(2.36)
    assert pad is not None
    assert pad.velocity == pytest.approx((10.0, 0.0, 0.0), abs=0.2)
