"""Held over the marker while the pilot's switch is in its middle, and landed when it is up."""

from dataclasses import replace

import pytest

from landerd.config.models import Config
from landerd.geometry import Vec3, add, horizontal, sub
from landerd.guidance.states import State
from landerd.messages import Phase, RcChannels, Setpoint
from tests.scripted_flight import HIGH, LOW, Flight

pytestmark = pytest.mark.long

MIDDLE = 1500
HEIGHT_M = 2.0
RC = {"gate_threshold_us": 1300, "land_threshold_us": 1700}
STOP = Setpoint((0.0, 0.0, 0.0), 0.0)
TOLD = "landerd: holding over the marker, switch to land"


def switched(position: Vec3 = (-6.0, 2.0, -8.0), **more: object) -> Flight:
    """Return a flight whose pilot has a three-position switch; more: keys of `guidance`."""
    config = Config.model_validate({"rc": RC, "guidance": more})
    return Flight(config=config, position=position)


def engage(flight: Flight) -> Flight:
    """Move the pilot's switch into its middle, and fly until landerd has taken over."""
    flight.run(1.1)
    flight.pulse_us = MIDDLE
    assert flight.run(0.5), flight.lander.reason
    return flight


def held(flight: Flight) -> Flight:
    """Fly on until the vehicle hovers where the pilot asked it to hold."""
    end = flight.t + 60.0
    while TOLD not in flight.texts:
        assert flight.t < end, flight.lander.reason
        flight.tick()
    flight.run(3.0)
    return flight


def test_it_holds_over_the_pad_says_so_once_and_lands_when_the_switch_goes_up() -> None:
    flight = held(engage(switched()))
    for _ in range(100):
        flight.run(0.1)
        assert flight.distance < 0.1
        assert flight.height == pytest.approx(HEIGHT_M, abs=0.1)
    assert flight.lander.phase is Phase.YAW_CORRECTION
    assert flight.texts.count(TOLD) == 1
    flight.pulse_us = HIGH
    flight.until_contact()
    assert flight.distance < 0.1
    flight.run(4.0)
    assert flight.lander.outcome == "landed"


def test_it_holds_for_longer_than_a_landing_may_take() -> None:
    flight = held(engage(switched(lost={"total_s": 10.0})))
    flight.run(12.0)
    assert flight.lander.state is State.TRACKING
    flight.pulse_us = HIGH
    flight.run(1.0)  # from the go on it has all of its time
    assert flight.lander.phase is Phase.DESCENT
    flight.until_contact()


def test_after_holding_the_time_limit_of_a_landing_applies() -> None:
    flight = held(engage(switched(lost={"total_s": 10.0})))
    flight.pulse_us = HIGH
    flight.pad_velocity = (0.0, 0.0, 1.2)  # it runs away below
    flight.run(12.0)
    assert flight.lander.outcome == "handed_back"


def test_a_pad_whose_heading_stays_unseen_is_held_over_all_the_same() -> None:
    flight = engage(switched(lost={"give_up_s": 5.0}))
    flight.distort = lambda true: replace(true, north=None, sigma_yaw=None)
    flight.run(15.0)
    assert flight.lander.state is State.TRACKING
    assert flight.height > HEIGHT_M - 0.1


@pytest.mark.parametrize("speed", [0.0, 1.0, 4.0])
def test_asked_in_the_descent_it_climbs_to_where_it_holds(speed: float) -> None:
    flight = switched()
    flight.pad_velocity = (speed, 0.0, 0.0)
    engage(flight)
    flight.pulse_us = HIGH
    while flight.height > 1.0:
        flight.tick()
    flight.pulse_us = MIDDLE
    flight.run(0.1)
    flown = flight.run(8.0)
    assert not any(s.velocity[2] > 0.0 for s in flown[:60])
    assert flight.height == pytest.approx(HEIGHT_M, abs=0.1)
    assert flight.distance < 0.15


def test_a_descent_after_a_hold_is_not_judged_by_one_before_it() -> None:
    """It was told to be kept off all the way down to where it had been before."""
    flight = switched(hold={"height_m": 9.0}, limits={"descent_mps": 0.7})
    engage(flight)
    flight.pulse_us = HIGH
    while flight.height > 2.0:
        flight.tick()
    flight.run_in_gusts(3.0)
    flight.pulse_us = MIDDLE
    while flight.height < 8.9:
        flight.tick()
    before = len(flight.texts)
    flight.pulse_us = HIGH
    flight.until_contact()
    assert not any("descends within" in text for text in flight.texts[before:])


@pytest.mark.parametrize("height_m", [0.5, 3.5])
def test_it_holds_at_the_configured_height(height_m: float) -> None:
    flight = held(engage(switched(hold={"height_m": height_m})))
    assert flight.height == pytest.approx(height_m, abs=0.1)


def test_committed_it_climbs_away_and_holds_and_that_is_no_failed_descent() -> None:
    flight = switched(lost={"retries": 0})
    engage(flight)
    flight.pulse_us = HIGH
    flight.until(Phase.LANDED)
    flight.pulse_us = MIDDLE
    flight.run(0.3)
    assert flight.lander.state is State.WAVING_OFF
    assert any("asked to hold, climbing away" in text for text in flight.texts)
    held(flight)
    assert flight.contact_t is None
    assert flight.height == pytest.approx(HEIGHT_M, abs=0.1)
    assert flight.lander.outcome is None
    flight.pulse_us = HIGH
    flight.until_contact()


def test_on_the_pad_the_request_to_hold_has_no_effect() -> None:
    flight = switched()
    engage(flight)
    flight.pulse_us = HIGH
    flight.until_contact()
    flight.run(0.3)
    flight.pulse_us = MIDDLE
    assert all(s.velocity[2] >= 0.0 for s in flight.run(4.0))
    assert flight.lander.outcome == "landed"


def test_asked_to_hold_as_it_stands_there_it_is_not_told_that_the_pad_is_not_found() -> None:
    """The pad below was in sight all the time."""
    flight = switched()
    engage(flight)
    flight.pulse_us = HIGH
    flight.until(Phase.LANDED)
    while flight.height > 0.075:
        flight.tick()
    flight.pulse_us = LOW
    flight.run(0.2)
    flight.position = add(flight.position, (0.0, 0.0, flight.height))  # a gust sets it down
    flight.run(0.1)
    flight.pulse_us = MIDDLE
    flight.run(flight.config.guidance.lost.give_up_s + 2.0)
    assert "landerd: no landing possible: pilot, take over" in flight.texts
    assert not any("not found" in text for text in flight.texts)


@pytest.mark.parametrize("change", ["low", "stale", "mode", "armed"])
def test_a_closed_gate_another_mode_or_disarming_ends_holding(change: str) -> None:
    flight = held(engage(switched()))
    if change == "low":
        flight.pulse_us = LOW
    elif change == "stale":
        flight.silent = {RcChannels}
        flight.run(0.5)
    elif change == "mode":
        flight.mode = "LOITER"
    else:
        flight.armed = False
    flown = flight.run(3.0)[2:]
    assert set(flown) <= {STOP}
    assert bool(flown) is (change in ("low", "stale"))
    assert flight.run(1.0) == []
    assert flight.lander.outcome == ("released" if flown else "taken over")


def test_leaving_guided_latches_also_with_the_switch_in_its_middle() -> None:
    flight = held(engage(switched()))
    flight.mode = "LOITER"
    flight.run(1.1)
    flight.mode = "GUIDED"
    assert flight.run(3.0) == []
    flight.pulse_us = LOW
    flight.run(0.2)
    flight.pulse_us = MIDDLE
    assert flight.run(1.0) != []


def test_out_of_sight_it_searches_and_then_holds_again() -> None:
    flight = held(engage(switched()))
    flight.visible = False
    flight.run(2.0)
    assert flight.lander.state is State.SEARCHING
    flight.visible = True
    flight.run(10.0)
    assert flight.height == pytest.approx(HEIGHT_M, abs=0.1)
    assert flight.contact_t is None


def test_a_switch_of_two_positions_lands_wherever_it_is_high() -> None:
    flight = Flight()
    flight.run(1.1)
    flight.pulse_us = 1600
    flight.until_contact()


def test_held_over_a_moving_pad_it_goes_with_it() -> None:
    flight = Flight(config=Config.model_validate({"rc": RC}), pad_velocity=(1.0, -0.5, 0.0))
    held(engage(flight))
    assert flight.distance < 0.1
    assert horizontal(sub(flight.velocity, flight.pad_velocity)) < 0.1


@pytest.mark.parametrize("middle_s", [0.05, 0.2, 1.0])
def test_a_vehicle_on_the_pad_does_not_take_off_to_hold(middle_s: float) -> None:
    """On its way from low to high the switch passes its middle position, which asks to hold."""
    flight = switched()
    flight.detects_landing = False
    flight.engaged()
    while flight.lander.state is not State.ON_PAD:
        flight.tick()
    flight.run(1.5)
    flight.pulse_us = LOW
    flight.run(3.0)
    flight.pulse_us = MIDDLE
    ordered = flight.run(middle_s)
    assert ordered == []
    assert flight.lander.reason == "on the pad: holding begins in the air"
    flight.pulse_us = HIGH
    ordered = flight.run(3.0)
    assert flight.lander.state is State.ON_PAD
    assert all(order.velocity[2] > -0.05 for order in ordered)
    assert flight.height < 0.01
