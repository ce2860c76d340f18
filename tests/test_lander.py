import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from landerd.config.models import Config
from landerd.geometry import Vec3, add, horizontal, norm, rotate, sub, transpose
from landerd.guidance.states import State
from landerd.lander import Lander
from landerd.messages import (
    Attitude,
    Command,
    GimbalState,
    Heartbeat,
    LocalPosition,
    Phase,
    PoseSolution,
    RcChannels,
    Setpoint,
    Shutdown,
    Sightings,
    StatusText,
)
from tests.scripted_flight import DT, HIGH, LOW, PAD, RING_PAD, Flight

ROOT = Path(__file__).parents[1]
STOP = Setpoint((0.0, 0.0, 0.0), 0.0)
LATE = 3 * DT  # sightings still on their way when the pad goes out of sight


def said(flight: Flight, words: str) -> bool:
    return any(words in text for text in flight.texts)


# ---- a landing ---------------------------------------------------------------------------------


def test_it_lands_on_the_pad_and_disarms() -> None:
    flight = Flight().engaged()
    flight.until_contact()
    assert flight.distance < 0.1
    assert abs(math.degrees(flight.heading_error)) < 5.0
    flight.run(4.0)
    assert not flight.armed
    assert flight.lander.outcome == "landed"
    assert said(flight, "landed and disarmed")
    assert flight.run(2.0) == []


def test_the_phases_are_those_of_table_2_1_in_their_order() -> None:
    flight = Flight().engaged().until_contact()
    landing = [p for p in flight.phases if p is not Phase.NOT_LANDING]
    # Each is entered; none is skipped on the way.
    assert list(dict.fromkeys(landing)) == [
        Phase.APPROACH,
        Phase.CLOSE_APPROACH,
        Phase.YAW_CORRECTION,
        Phase.DESCENT,
        Phase.LANDED,
    ]


def test_a_pad_of_one_ring_is_landed_on_with_any_heading() -> None:
    flight = Flight(layout=RING_PAD).engaged().until_contact()
    assert flight.distance < 0.1
    assert Phase.YAW_CORRECTION not in flight.phases
    assert all(setpoint.yaw_rate == 0.0 for _, setpoint in flight.setpoints)


def test_setpoints_come_at_every_tick_while_it_flies() -> None:
    flight = Flight().engaged()
    start = len(flight.setpoints)
    flight.run(3.0)
    ticks = [t for t, _ in flight.setpoints[start:]]
    assert len(ticks) == round(3.0 / DT)


def test_turned_to_the_pads_heading_before_it_goes_below_the_alignment_height() -> None:
    flight = Flight(position=(-0.5, 0.0, -4.0))
    flight.pad_heading = math.radians(150.0)
    flight.engaged().until(Phase.DESCENT)
    assert flight.height > flight.config.guidance.descent.alignment_height_m
    assert abs(math.degrees(flight.heading_error)) < 2.5


def test_without_the_pads_heading_it_waits_above_the_alignment_height() -> None:
    flight = Flight(position=(0.0, 0.0, -4.0))
    flight.distort = lambda true: replace(true, north=None, sigma_yaw=None)
    flight.engaged().run(8.0)
    assert flight.lander.phase is Phase.YAW_CORRECTION
    assert flight.height > flight.config.guidance.descent.alignment_height_m
    assert said(flight, "heading not seen")
    flight.distort = lambda true: true
    flight.until_contact()


def test_a_pad_whose_heading_stays_unseen_is_handed_back() -> None:
    config = Config.model_validate({"guidance": {"lost": {"give_up_s": 8.0}}})
    flight = Flight(config=config, position=(0.0, 0.0, -4.0))
    flight.distort = lambda true: replace(true, north=None, sigma_yaw=None)
    flight.engaged().run(5.0)
    assert flight.lander.outcome is None
    flight.run(10.0)
    assert flight.lander.outcome == "handed_back"
    assert said(flight, "heading not seen: pilot, take over")


# ---- who flies ---------------------------------------------------------------------------------


def test_it_is_silent_until_the_pad_was_really_seen() -> None:
    flight = Flight()
    flight.visible = False
    flight.run(1.0)
    flight.pulse_us = HIGH
    assert flight.run(5.0) == []
    flight.visible = True
    assert flight.run(0.1) == []  # one sighting may be a false alarm
    assert flight.run(0.5) != []


def test_a_single_false_alarm_does_not_start_it() -> None:
    flight = Flight()
    flight.visible = False
    flight.run(1.0)
    flight.pulse_us = HIGH
    flight.run(0.5)
    flight.give(flight.sighting())
    assert flight.run(5.0) == []


@pytest.mark.parametrize("change", ["mode", "armed"])
def test_when_guided_is_left_or_it_is_disarmed_nothing_is_sent_from_the_next_tick(
    change: str,
) -> None:
    flight = Flight().engaged()
    flight.run(2.0)
    if change == "mode":
        flight.mode = "LOITER"
    else:
        flight.armed = False
    assert flight.run(3.0) == []
    # And not again when it comes back, until the switch was low.
    flight.mode, flight.armed = "GUIDED", True
    assert flight.run(3.0) == []
    flight.pulse_us = LOW
    assert flight.run(0.2) == []
    flight.pulse_us = HIGH
    assert flight.run(0.5) != []


def test_without_heartbeats_for_3_s_it_stops_falls_silent_and_goes_on_with_them() -> None:
    flight = Flight(position=(-30.0, 0.0, -8.0)).engaged()
    flight.silent = {Heartbeat}
    flight.run(3.0)
    assert set(flight.run(0.9)) == {STOP}
    flight.run(0.2)
    assert flight.run(2.0) == []
    flight.silent = set()
    assert flight.run(1.5) != []


@pytest.mark.parametrize("how", ["low", "no signal", "stale"])
def test_with_the_gate_low_or_stale_it_orders_zero_for_a_second_and_then_nothing(how: str) -> None:
    flight = Flight().engaged()
    flight.run(2.0)
    if how == "stale":
        flight.silent = {RcChannels}
        flight.run(0.5)
    else:
        flight.pulse_us = LOW if how == "low" else 0
    flight.run(2 * DT)  # the switch is seen at 20 Hz
    second = flight.run(1.0 - 2 * DT)
    assert len(second) >= round(0.9 / DT)
    assert all(setpoint == STOP for setpoint in second)
    flight.run(4 * DT)
    assert flight.run(5.0) == []
    assert flight.lander.outcome == "released"


def test_the_gate_low_stops_at_the_first_tick() -> None:
    flight = Flight(position=(-20.0, 0.0, -8.0)).engaged()
    assert norm(flight.run(2.0)[-1].velocity) > 1.0
    flight.give(RcChannels(flight.t, (1500,) * 10 + (LOW,)))
    flight.pulse_us = LOW
    assert flight.run(DT) == [STOP]


def test_stale_rc_does_not_latch() -> None:
    flight = Flight().engaged()
    flight.silent = {RcChannels}
    flight.run(3.0)
    flight.silent = set()
    assert flight.run(0.5) != []


def test_a_restarted_autopilot_is_not_flown_until_the_switch_was_low() -> None:
    flight = Flight().engaged()
    flight.run(1.0)
    flight.restart_autopilot()
    assert all(setpoint == STOP for setpoint in flight.run(1.1))
    assert flight.run(3.0) == []
    assert flight.engaged().run(1.0) != []


def test_after_a_restart_of_the_autopilot_pad_and_vehicle_are_forgotten() -> None:
    flight = Flight().engaged()  # its local frame may have another origin afterwards
    flight.visible = False
    flight.restart_autopilot()
    assert flight.lander.prior(flight.t).down is None
    flight.run(0.1)
    assert flight.lander.prior(flight.t).pad is None
    assert flight.lander.relative_state(flight.t) is None


def test_it_takes_over_from_the_ground_station_without_a_jerk() -> None:
    flight = Flight(position=(-20.0, 0.0, -8.0))
    flight.visible = False
    flight.order = Setpoint((3.0, 0.0, 0.0), 0.0)
    flight.run(1.5)
    flight.pulse_us = HIGH
    flight.run(0.5)
    flight.visible = True
    first = flight.run(0.5)[0].velocity
    assert first == pytest.approx((3.0, 0.0, 0.0), abs=0.1)


def test_a_restarted_landerd_does_not_fly_with_the_switch_left_high() -> None:
    flight = Flight().engaged()
    flight.lander = Lander(flight.config, PAD)
    assert flight.run(5.0) == []
    assert said(flight, "low, then high")


def test_told_to_shut_down_it_hovers_half_a_second_and_falls_silent_whatever_the_switch_does() -> (
    None
):
    flight = Flight().engaged()
    flight.run(1.0)
    flight.give(Shutdown(flight.t))
    first = flight.run(0.5)
    assert first == [STOP] * len(first)
    assert len(first) == 20
    assert said(flight, "told to stop: take over")
    flight.pulse_us = LOW
    flight.run(0.2)
    flight.pulse_us = HIGH
    assert set(flight.run(0.5)) == {STOP}
    assert flight.run(3.0) == []


# ---- out of sight ------------------------------------------------------------------------------


def test_out_of_sight_it_slows_to_a_hover_without_turning_or_descending() -> None:
    flight = Flight(position=(-15.0, 0.0, -8.0)).engaged()
    flight.run(1.5)
    assert horizontal(flight.velocity) > 2.0
    flight.visible = False
    flight.run(0.5 + LATE)
    before = flight.setpoints[-1][1]
    limits = flight.config.guidance.limits
    flown = flight.run(2.9)
    for setpoint in flown:
        assert setpoint.yaw_rate == 0.0
        assert setpoint.velocity[2] <= 0.0
        change = horizontal(sub(setpoint.velocity, before.velocity))
        assert change <= limits.acceleration_mps2 * DT + 1e-6
        before = setpoint
    assert len(flown) == round(2.9 / DT)  # repeated and not once
    assert horizontal(flown[-1].velocity) < 1e-3
    assert said(flight, "not in sight")


def test_the_pilot_is_told_when_another_pad_is_in_sight() -> None:
    flight = Flight(position=(-3.0, 0.0, -6.0)).engaged()
    flight.run(1.0)
    flight.visible = False
    for seq in range(20):
        flight.give(Sightings(flight.t, seq, (), (), other_id=7))
        flight.run(DT)
    assert said(flight, "another pad, tag 7, seen")


def test_out_of_sight_a_turn_and_a_descent_end_within_half_a_second() -> None:
    flight = Flight(position=(0.0, 0.0, -6.0))
    flight.pad_heading = 3.0
    flight.engaged().until(Phase.YAW_CORRECTION)
    flight.run(0.5)
    assert flight.setpoints[-1][1].yaw_rate > 0.1
    last_seen = flight.t
    flight.visible = False
    flight.run(2.0)
    for t, setpoint in flight.setpoints:
        if t > last_seen + 0.5:
            assert setpoint.yaw_rate == 0.0
            assert setpoint.velocity[2] <= 0.0


def test_with_the_pad_out_of_sight_it_holds_climbs_and_hands_back_and_says_so() -> None:
    flight = Flight(position=(-1.0, 0.0, -6.0)).engaged()
    flight.run(1.0)
    flight.visible = False
    flight.run(2.5)
    height = flight.height
    lost = flight.config.guidance.lost
    flight.run(2.0)
    assert flight.height > height + 0.2  # climbing by now
    flight.run(20.0)
    assert flight.height == pytest.approx(height + lost.climb_m, abs=0.5)
    flight.run(10.0)
    assert flight.lander.outcome == "handed_back"
    assert said(flight, "pilot, take over")
    assert said(flight, "climbing")
    flight.run(2.0)
    # Silent now, also when the pad comes back, until the pilot asks again.
    flight.visible = True
    assert flight.run(3.0) == []
    flight.pulse_us = LOW
    flight.run(0.2)
    flight.pulse_us = HIGH
    assert flight.run(0.5) != []


def test_handing_back_ends_with_zero_velocity_and_not_with_the_last_order() -> None:
    config = Config.model_validate({"guidance": {"lost": {"give_up_s": 4.0}}})
    flight = Flight(config=config).engaged()
    flight.visible = False
    flight.run(4.4)
    assert flight.lander.outcome is None
    last = flight.run(3.0)
    zeros = [setpoint for setpoint in last if setpoint == STOP]
    assert len(zeros) >= round(0.9 / DT)
    assert last[-1] == STOP


def test_the_landing_goes_on_when_the_pad_is_seen_again() -> None:
    flight = Flight().engaged()
    flight.run(1.0)
    flight.visible = False
    flight.run(3.0)
    assert flight.lander.phase is Phase.NOT_LANDING
    assert flight.lander.aborts == 1
    flight.visible = True
    flight.until_contact()
    assert flight.distance < 0.1


def test_every_loss_of_sight_is_told_to_the_pilot() -> None:
    flight = Flight(position=(-20.0, 0.0, -8.0)).engaged()
    for _ in range(3):
        flight.visible = True
        flight.run(1.0)
        before = len(flight.texts)
        flight.visible = False
        flight.run(1.0)
        assert any("not in sight" in text for text in flight.texts[before:])


def test_the_pilot_is_told_at_once_when_the_camera_sends_no_more_pictures() -> None:
    flight = Flight(position=(-3.0, 0.0, -4.0)).engaged().until(Phase.DESCENT)
    before = len(flight.texts)
    flight.silent = {Sightings}
    flight.run(2.0)
    assert flight.texts[before:] == ["landerd: no pictures from camera, holding"]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Attitude, "attitude is stale"),
        (LocalPosition, "position is stale"),
        (GimbalState, "gimbal angles are stale"),
        (Sightings, "no pictures"),
    ],
)
def test_stale_input_is_not_flown_on_and_fresh_input_is_again(kind: type, words: str) -> None:
    flight = Flight(position=(-20.0, 0.0, -8.0)).engaged()
    flight.run(1.0)
    flight.silent = {kind}
    flight.run(0.9)  # at most 0.3 s stale, then 0.5 s without a sighting
    flown = flight.run(3.2)
    assert all(s.yaw_rate == 0.0 and s.velocity[2] <= 0.0 for s in flown)
    assert horizontal(flown[-1].velocity) < 0.01
    assert said(flight, words)
    flight.silent = set()
    flight.run(1.0)
    assert flight.lander.phase is not Phase.NOT_LANDING


@pytest.mark.parametrize("kind", [Attitude, LocalPosition])
def test_stale_attitude_or_position_stops_sooner_than_a_lost_pad(kind: type) -> None:
    flight = Flight(position=(-20.0, 0.0, -8.0)).engaged()
    flight.run(1.0)
    flight.silent = {kind}
    flight.run(0.35)
    assert flight.lander.state is State.SEARCHING


def test_moments_of_stale_attitude_break_off_no_descent_and_longer_ones_do() -> None:
    flight = Flight(position=(0.3, 0.0, -3.5)).engaged()
    while flight.height > 1.5:
        flight.tick()
    freshness_s = flight.config.freshness.attitude_s
    flown_by = set()
    for _ in range(flight.config.guidance.lost.retries + 1):
        flight.silent = {Attitude}
        flight.run(freshness_s + 0.1)
        flown_by.add(flight.lander.state)
        flight.silent = set()
        flight.run(0.15)
        flown_by.add(flight.lander.state)
    assert flown_by == {State.SEARCHING, State.TRACKING}
    assert flight.lander.phase is Phase.DESCENT  # no landing begins anew
    assert flight.lander.aborts == 0
    assert not said(flight, "stale")  # it was over by the time that anybody has read it
    flight.silent = {Attitude}
    flight.run(freshness_s + 0.4)
    assert flight.lander.aborts == 1
    assert said(flight, "attitude is stale, ")


def test_without_a_position_it_does_not_climb() -> None:
    flight = Flight().engaged()
    flight.silent = {LocalPosition}
    flight.run(3.0)
    flown = flight.run(8.0)
    assert flown
    assert all(abs(setpoint.velocity[2]) < 1e-6 for setpoint in flown)
    assert not said(flight, "climbing")


@pytest.mark.parametrize("kind", [Attitude, LocalPosition])
def test_low_over_the_pad_without_a_position_it_climbs_out_of_reach_and_hovers(kind: type) -> None:
    flight = Flight().engaged()
    while flight.height > 0.5:
        flight.tick()
    flight.silent = {kind}
    flown = flight.run(4.0)
    assert said(flight, "stale, climbing")
    assert 1.2 < flight.height < 2.0
    assert abs(flown[-1].velocity[2]) < 1e-6
    assert flight.lander.reason.endswith("stale, holding")


# ---- bad sightings -----------------------------------------------------------------------------


def spoilt(true: PoseSolution, field: str, bad: float) -> PoseSolution:
    vector = (bad, 0.0, 1.0)
    match field:
        case "position":
            return replace(true, position=vector)
        case "normal":
            return replace(true, normal=vector)
        case "north":
            return replace(true, north=vector)
        case "covariance":
            return replace(true, covariance=(vector, (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4)))
        case "sigma_yaw":
            return replace(true, sigma_yaw=bad)
        case "sigma_tilt":
            return replace(true, sigma_tilt=bad)
        case _:
            return replace(true, cost=bad)


@pytest.mark.parametrize("bad", [math.nan, -1e200])
@pytest.mark.parametrize(
    "field", ["position", "normal", "north", "covariance", "sigma_yaw", "sigma_tilt", "cost"]
)
def test_sightings_with_impossible_numbers_count_as_none(field: str, bad: float) -> None:
    flight = Flight(position=(-6.0, 0.0, -8.0)).engaged()
    flight.run(1.0)
    flight.distort = lambda true: spoilt(true, field, bad)
    flight.run(1.0)
    assert flight.lander.phase is Phase.NOT_LANDING
    flight.distort = lambda true: true
    flight.run(0.5)
    assert flight.lander.phase is not Phase.NOT_LANDING
    seen = flight.lander.relative_state(flight.t)
    assert seen is not None
    assert norm(sub(seen.error, sub(flight.pad, flight.feet))) < 0.05


def test_a_sighting_with_an_impossible_or_old_time_changes_nothing() -> None:
    flight, other = Flight().engaged(), Flight().engaged()
    for f in (flight, other):
        f.run(1.0)
    for t in (math.nan, flight.t - 0.5, -math.inf):
        far = replace(flight.sighting(), t=t)
        shifted = replace(far.pad[0], position=add(far.pad[0].position, (1.0, 0.0, 0.0)))
        flight.give(replace(far, pad=(shifted,)))
    assert flight.run(1.0) == other.run(1.0)


# ---- touch-down --------------------------------------------------------------------------------


def test_after_contact_it_presses_on_until_on_ground_and_then_disarms() -> None:
    flight = Flight().engaged().until_contact()
    assert flight.contact_t is not None
    flight.run(0.5)
    # The tag is out of the picture by now: that must not end it (the thesis's lander stopped).
    flight.visible = False
    pressed = flight.run(0.9)  # ON_GROUND comes 1.5 s after contact
    assert all(setpoint.velocity[2] > 0.1 for setpoint in pressed)
    assert flight.disarm_orders == []
    flight.run(1.1)
    assert not flight.armed
    assert flight.disarm_orders[0] > flight.contact_t + 1.0


def test_it_lands_a_second_time_as_it_did_the_first() -> None:
    flight = Flight().engaged().until_contact()
    flight.run(4.0)
    flight.position, flight.velocity, flight.contact_t = (1.0, -0.5, -7.0), (0.0, 0.0, 0.0), None
    flight.armed = True
    flight.engaged().until(Phase.LANDED)
    assert flight.contact_t is None
    before = flight.distance
    flight.run(0.2)  # still led onto the pad, not yet standing on it
    assert flight.distance <= before + 0.005
    assert len(flight.disarm_orders) == 1
    flight.until_contact().run(4.0)
    assert flight.lander.outcome == "landed"
    assert not flight.armed


def test_disarm_is_repeated_until_the_autopilot_does_it() -> None:
    flight = Flight().engaged().until_contact()
    flight.run(1.0)
    orders = 0
    for _ in range(round(2.5 / DT)):
        flight.armed = True
        flight.tick()
        orders = len(flight.disarm_orders)
    assert orders >= 3


def test_after_commit_it_does_not_give_way_to_a_deck_that_comes_up() -> None:
    # It would hover just over the deck, and order no descent while standing on it.
    flight = Flight(pad_velocity=(0.0, 0.0, -0.35), position=(-3.0, 1.0, -14.0)).engaged()
    flight.until(Phase.LANDED)
    flight.run(0.6)
    assert flight.contact_t is not None
    assert all(order.velocity[2] > 0.0 for order in flight.run(1.0))


def seen_elsewhere(true: PoseSolution) -> PoseSolution:
    return replace(true, position=add(true.position, (0.0, 0.0, 2.0)))


def test_after_commit_a_pad_that_is_seen_elsewhere_is_climbed_away_from() -> None:
    flight = Flight().engaged().until(Phase.LANDED)
    flight.distort = seen_elsewhere
    flight.run(0.25)
    assert flight.lander.phase is Phase.NOT_LANDING
    assert "pad missed, climbing away" in flight.lander.reason
    assert flight.run(0.3)[-1].velocity[2] < -0.3


def test_after_commit_a_pad_a_little_aside_is_no_other_pad() -> None:
    # Markers printed so far apart, as the nearer one takes over. All sightings before agreed.
    flight = Flight().engaged().until(Phase.LANDED)
    flight.distort = lambda true: replace(true, position=add(true.position, (0.018, 0.0, 0.018)))
    flight.until_contact()
    flight.run(4.0)
    assert not said(flight, "climbing")
    assert flight.lander.outcome == "landed"


def test_refused_sightings_with_the_feet_at_the_pad_are_no_reason_to_climb() -> None:
    # The touch turns the airframe faster than the lens's direction is known.
    flight = Flight().engaged().until_contact()
    flight.distort = seen_elsewhere
    orders = flight.run(0.5)
    assert flight.lander.phase is Phase.LANDED
    assert all(order.velocity[2] > 0.0 for order in orders)


def test_on_one_foot_it_is_not_told_to_climb_for_the_pad_that_slides_below() -> None:
    # It seems to be clear of the pad: gear and camera were measured some centimetres wrong.
    flight = Flight().engaged().until(Phase.LANDED)
    while flight.height > 0.055:
        flight.tick()
    flight.pitch_rate = 0.6  # about the foot that is down
    for _ in range(round(0.4 / DT)):
        flight.velocity = (0.4, 0.0, 0.03)
        flight.tick()
    assert not said(flight, "climbing")
    assert flight.lander.state is State.ON_PAD


def test_where_disarming_is_refused_it_stands_level_and_the_pilot_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ON_GROUND came with the touch: 8 m/s of wind dragged it 9 m, with thrust, in silence."""
    monkeypatch.setattr("tests.scripted_flight.LANDED_AFTER_S", 0.1)
    flight = Flight().engaged().until_contact()
    for _ in range(round(6.5 / DT)):
        flight.tick()
        flight.armed = True  # whatever is ordered
        assert not said(flight, "by hand") or flight.t - (flight.contact_t or 0.0) > 4.5
    assert flight.disarm_orders
    assert flight.pressed
    assert said(flight, "does not disarm: disarm by hand")
    assert flight.lander.outcome == "touchdown_unconfirmed"
    flight.run(1.0)
    assert flight.lander.outcome == "landed"


def test_without_on_ground_it_stands_level_and_the_pilot_is_told() -> None:
    flight = Flight().engaged()
    flight.detects_landing = False
    flight.until_contact()
    flight.run(6.0)
    assert flight.lander.outcome == "touchdown_unconfirmed"
    assert said(flight, "disarm by hand")
    assert flight.disarm_orders == []
    flight.run(10.0)
    assert sum("disarm by hand" in text for text in flight.texts) in (3, 4)  # and not 11
    flight.pressed.clear()
    assert flight.run(2.0) == []
    assert len(flight.pressed) == 80  # at the rate of set-points
    assert flight.pressed[-1].heading == pytest.approx(flight.yaw, abs=0.01)
    flight.detects_landing = True  # late, as after a pad that braked for seconds
    flight.run(1.0)
    assert flight.lander.outcome == "landed"
    assert said(flight, "landed and disarmed")


@pytest.mark.parametrize("pad_velocity", [(0.0, 0.0, 0.0), (2.0, 1.0, 0.0)])
def test_carried_by_the_pad_it_presses_on_gently_and_stands_level_within_a_second(
    pad_velocity: Vec3,
) -> None:
    flight = Flight(pad_velocity=pad_velocity).engaged()
    flight.detects_landing = False
    flight.until_contact()
    flown = flight.run(0.6)
    assert len(flown) == 24
    # On top of what the pad is believed to sink.
    assert all(0.0 < setpoint.velocity[2] <= 0.32 for setpoint in flown)
    assert flight.pressed == []
    flight.run(0.6)
    assert flight.pressed


def test_blown_across_the_pad_it_goes_with_the_pad_for_two_seconds() -> None:
    flight = Flight().engaged()
    flight.detects_landing = False
    flight.skids = 0.2
    flight.until_contact()
    flown = flight.run(2.0)
    assert len(flown) == 80
    assert all(setpoint.velocity[2] > 0.0 for setpoint in flown)
    assert flight.pressed == []
    flight.run(1.0)
    assert flight.pressed


def test_leaning_against_wind_it_comes_down_quicker_once_it_is_committed() -> None:
    fastest = {}
    for pitch in (0.0, math.radians(-20.0)):
        flight = Flight().engaged().until(Phase.LANDED)
        flight.visible = False
        flight.pitch = pitch
        fastest[pitch] = max(order.velocity[2] for order in flight.run(0.4))
    level, leaning = fastest.values()
    assert level <= 0.302  # and what is believed of the heave of a pad that stands
    assert 0.45 < leaning <= 0.64  # on top of what the pad is believed to sink


def test_it_commits_below_the_commit_height_only() -> None:
    flight = Flight().engaged().until(Phase.LANDED)
    assert flight.height < flight.config.guidance.descent.commit_height_m + 0.03


def test_a_pad_lost_for_good_just_before_commit_is_climbed_away_from() -> None:
    flight = Flight().engaged()
    while flight.height > 0.4:
        flight.tick()
    flight.visible = False
    lowest = flight.height
    flight.run(10.0)
    assert flight.contact_t is None
    assert flight.height > lowest
    assert flight.disarm_orders == []


def test_a_landing_that_may_never_commit_is_handed_back_to_the_pilot_from_higher_up() -> None:
    never = {"commit_miss_m": 0.001}  # nearer than any landing
    config = Config.model_validate({"guidance": {"descent": never, "lost": {"retries": 1}}})
    flight = Flight(config=config).engaged()
    while flight.lander.outcome is None:
        assert flight.t < 150.0
        flight.tick()
    flight.run(1.0)
    assert flight.contact_t is None
    assert flight.lander.aborts == 2
    assert flight.lander.outcome == "handed_back"
    assert said(flight, "take over")
    assert flight.height > 0.8
    assert flight.run(1.0) == []


def test_it_turns_with_a_turning_pad_until_contact() -> None:
    flight = Flight()
    turn = math.radians(10.0)
    flight.engaged()
    while flight.contact_t is None:
        assert flight.t < 160.0
        flight.pad_heading += turn * DT
        flight.tick()
    assert abs(math.degrees(flight.heading_error)) < 2.0


def test_disarmed_in_the_air_after_commit_is_not_called_landed() -> None:
    flight = Flight().engaged().until(Phase.LANDED)
    assert flight.contact_t is None
    flight.armed = False
    flight.run(0.2)
    assert flight.lander.outcome != "landed"


def test_an_autopilot_that_restarts_during_touch_down_is_not_called_landed() -> None:
    flight = Flight().engaged().until_contact()
    flight.run(0.5)
    flight.silent = {Heartbeat}
    flight.restart_autopilot()
    flight.run(1.0)
    assert flight.lander.outcome == "released"


# ---- a moving pad ------------------------------------------------------------------------------


def test_the_estimate_keeps_up_with_a_moving_pad() -> None:
    flight = Flight(position=(-4.0, 0.0, -8.0), pad_velocity=(0.8, 0.6, 0.0)).engaged()
    flight.run(3.0)
    seen = flight.lander.relative_state(flight.t)
    assert seen is not None
    assert norm(sub(seen.error, sub(flight.pad, flight.feet))) < 0.05
    assert norm(sub(seen.pad_velocity, flight.pad_velocity)) < 0.1


# ---- what vision is told -----------------------------------------------------------------------


def test_the_prior_says_where_pad_north_and_gravity_are_in_the_picture() -> None:
    flight = Flight().engaged()
    flight.run(2.0)
    prior = flight.lander.prior(flight.t)
    true = flight.sighting().pad[0]
    assert prior.down == pytest.approx(true.normal, abs=1e-3)
    assert prior.pad is not None
    assert norm(sub(prior.pad.position, true.position)) < 0.05
    assert prior.pad.north is not None
    assert norm(sub(prior.pad.north, true.north or (0.0, 0.0, 0.0))) < 0.02
    assert prior.pad.sigma_m < 0.2


def test_with_nothing_known_the_prior_is_empty() -> None:
    prior = Lander(Config(), PAD).prior(1.0)
    assert prior.down is None
    assert prior.pad is None


def test_long_out_of_sight_the_prior_tells_gravity_only() -> None:
    flight = Flight().engaged()
    flight.visible = False
    flight.run(2.0)
    prior = flight.lander.prior(flight.t)
    down: Vec3 = rotate(transpose(flight.R_local_camera()), (0.0, 0.0, 1.0))
    assert prior.down == pytest.approx(down, abs=1e-4)
    assert prior.pad is None


# ---- purity ------------------------------------------------------------------------------------


def eventful() -> Flight:
    """A flight with most of what can happen in it."""
    flight = Flight().engaged()
    flight.run(2.0)
    flight.visible = False
    flight.run(5.0)
    flight.visible = True
    flight.run(1.0)
    flight.silent = {Attitude}
    flight.run(0.5)
    flight.silent = set()
    flight.pulse_us = LOW
    flight.run(1.5)
    flight.pulse_us = HIGH
    flight.until_contact().run(4.0)
    return flight


def test_the_same_messages_give_the_same_commands_to_the_bit() -> None:
    flight = eventful()
    again = Lander(flight.config, PAD)
    commands: list[Command] = [c for message in flight.inputs for c in again.step(message)]
    assert len(commands) > 1000
    assert repr(commands) == repr(flight.commands)  # repr tells every bit of a float


def test_the_pilots_lines_are_not_cut_at_50_characters() -> None:
    lines = [c.text for c in eventful().commands if isinstance(c, StatusText)]
    assert lines
    for line in lines:
        assert line.isascii()
        assert line.startswith("landerd: ")
        assert len(line) < 50  # with 50 it may have been cut


PURE = """
import builtins, random, socket, sys, time
import cv2, numpy, pydantic, yaml  # what they do at their import is theirs
sys.path.insert(0, {root!r})

def forbidden(*args, **kwargs):
    raise AssertionError("the core touched the world")

for module, names in (
    (time, ("time", "monotonic", "perf_counter", "time_ns", "monotonic_ns", "sleep")),
    (random, ("random", "gauss", "uniform", "Random", "seed")),
    (socket, ("socket", "create_connection")),
    (builtins, ("open", "input", "print")),
):
    for name in names:
        setattr(module, name, forbidden)
numpy.random.default_rng = forbidden

from tests.scripted_flight import Flight

flight = Flight().engaged()
flight.until_contact().run(4.0)
sys.stdout.write(flight.lander.outcome)
"""


def test_the_core_touches_no_clock_file_socket_or_chance() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PURE.format(root=str(ROOT))],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout == "landed", done.stderr


# ---- how a landing ends without one ------------------------------------------------------------


def test_a_landing_that_takes_too_long_is_handed_back() -> None:
    config = Config.model_validate({"guidance": {"lost": {"total_s": 4.0}}})
    flight = Flight(config=config, position=(-60.0, 0.0, -20.0)).engaged()
    flight.run(3.0)
    assert flight.lander.outcome is None
    flown = flight.run(3.0)
    assert flown[-1] == STOP
    assert flight.lander.outcome == "handed_back"
    assert said(flight, "no landing in time: pilot, take over")
    assert flight.run(3.0) == []  # until the switch was low
    assert flight.engaged().run(1.0) != []


def test_the_time_of_a_landing_runs_on_while_it_searches_and_anew_after_a_release() -> None:
    config = Config.model_validate({"guidance": {"lost": {"total_s": 6.0}}})
    flight = Flight(config=config, position=(-60.0, 0.0, -20.0)).engaged()
    flight.run(2.0)
    flight.visible = False
    flight.run(2.0)
    flight.visible = True
    flight.run(2.5)
    assert flight.lander.outcome == "handed_back"
    flight.engaged().run(4.0)
    assert flight.lander.outcome is None


def test_disarmed_with_a_foot_beside_the_plate_is_not_called_landed() -> None:
    flight = Flight().engaged()
    flight.skids = 0.9
    flight.until_contact()
    flight.run(4.0)
    assert not flight.armed
    assert flight.lander.outcome == "landed_off_pad"
    assert said(flight, "disarmed beside the pad")
    assert not said(flight, "landed and disarmed")
