"""The states of a landing in flight: each event of the table, and the orders in each state."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import pytest

from landerd.config.models import Config, GuidanceSection
from landerd.config.parameters import with_value
from landerd.geometry import (
    IDENTITY,
    Vec3,
    add,
    clamp,
    cross,
    horizontal,
    matscale,
    rot_zyx,
    rotate,
    scale,
    sub,
)
from landerd.guidance.sink_rate import safe_sink_rate
from landerd.guidance.states import State
from landerd.messages import (
    Attitude,
    Input,
    LocalPosition,
    Phase,
    PoseSolution,
    PressDown,
    RcChannels,
    Setpoint,
)
from landerd.pad import PadLayout, Plate
from tests.scripted_flight import DT, HIGH, LOW, PAD, RING_PAD, Flight

STOP = Setpoint((0.0, 0.0, 0.0), 0.0)
SINKS_SLOWLY = {"touchdown_descent_mps": 0.1}  # 6 cm up it is not all but down


def to(flight: Flight, state: State, *, at_most_s: float = 60.0) -> list[State]:
    """Fly until a state is reached; return the states on the way, without repetitions."""
    gone = [flight.lander.state]
    end = flight.t + at_most_s
    while flight.lander.state is not state:
        assert flight.t < end, f"{flight.lander.state}: {flight.lander.reason}"
        flight.tick()
        if flight.lander.state is not gone[-1]:
            gone.append(flight.lander.state)
    return gone


def test_a_landing_goes_through_tracking_committed_and_on_the_pad() -> None:
    flight = Flight()
    flight.run(1.1)
    assert flight.lander.state is State.SILENT
    flight.pulse_us = HIGH
    assert to(flight, State.ON_PAD) == [
        State.SILENT,
        State.TRACKING,
        State.COMMITTED,
        State.ON_PAD,
    ]
    assert flight.lander.phase is Phase.LANDED
    assert flight.lander.needs_sight  # until it stands still
    flight.run(1.0)
    assert not flight.lander.needs_sight
    assert to(flight, State.SILENT) == [State.ON_PAD, State.SILENT]
    assert flight.lander.outcome == "landed"


def test_released_it_streams_stops_for_its_time_and_is_silent() -> None:
    flight = Flight().engaged()
    flight.pulse_us = LOW
    to(flight, State.RELEASING)
    begun = flight.t
    assert flight.setpoints[-1][1] == STOP
    to(flight, State.SILENT)
    assert abs(flight.t - begun - flight.config.guidance.release_s) < 2 * DT
    assert flight.run(1.0) == []


def test_granted_again_while_it_stops_it_goes_on_at_once_if_it_sees_the_pad() -> None:
    flight = Flight().engaged()
    flight.pulse_us = LOW
    to(flight, State.RELEASING)
    flight.pulse_us = HIGH
    assert to(flight, State.TRACKING, at_most_s=0.2) == [State.RELEASING, State.TRACKING]


def test_granted_again_while_it_stops_without_the_pad_it_hands_back_after_a_while() -> None:
    config = Config.model_validate({"guidance": {"lost": {"give_up_s": 3.0}}})
    flight = Flight(config=config).engaged()
    flight.visible = False
    to(flight, State.SEARCHING)
    flight.pulse_us = LOW
    to(flight, State.RELEASING)
    flight.pulse_us = HIGH
    assert all(setpoint == STOP for setpoint in flight.run(2.8))
    assert flight.lander.state is State.RELEASING
    to(flight, State.SILENT, at_most_s=2.0)  # a ground station may fly it to the pad then
    assert "landerd: pad not found: pilot, take over" in flight.texts
    flight.visible = True
    assert flight.run(1.0) == []
    flight.pulse_us = LOW
    flight.run(0.2)
    flight.pulse_us = HIGH
    to(flight, State.TRACKING, at_most_s=1.0)


def test_out_of_sight_it_searches_and_tracks_again() -> None:
    flight = Flight().engaged()
    flight.visible = False
    assert to(flight, State.SEARCHING) == [State.TRACKING, State.SEARCHING]
    flight.visible = True
    assert to(flight, State.TRACKING) == [State.SEARCHING, State.TRACKING]


@pytest.mark.parametrize(("layout", "waits_s"), [(PAD, 0.0), (RING_PAD, 0.95)])
def test_a_ring_alone_is_looked_at_for_a_second_before_it_sinks_and_again_when_it_was_gone(
    layout: PadLayout, waits_s: float
) -> None:
    flight = Flight(layout=layout, position=(0.2, 0.0, -8.0)).engaged()
    for _ in range(2):
        flight.visible = False
        to(flight, State.SEARCHING)
        flight.visible = True
        to(flight, State.TRACKING)
        seen_t = flight.t
        while not flight.setpoints[-1][1].velocity[2] > 0.0:
            assert flight.t < seen_t + 3.0
            flight.tick()
        assert waits_s <= flight.t - seen_t < waits_s + 0.4


def test_carried_up_again_after_commit_it_sinks_as_slowly_as_the_autopilots_timeout_stops() -> None:
    quick = GuidanceSection(touchdown_descent_mps=0.6)  # or leaning against wind
    flight = Flight(config=Config(guidance=quick)).engaged()
    to(flight, State.COMMITTED)
    gear_m = flight.config.vehicle.gear_height_m
    ordered = []
    for height, steps in ((0.15, 12), (0.28, 24)):
        for _ in range(steps):
            flight.position = (*flight.position[:2], flight.pad[2] - gear_m - height)
            flight.velocity = (0.0, 0.0, 0.0)
            flight.tick()
        assert flight.lander.state is State.COMMITTED
        ordered.append(flight.setpoints[-1][1].velocity[2])
    assert ordered[0] > 0.5
    assert 0.3 < ordered[1] < 0.5  # design rule 2


def test_it_sinks_no_faster_than_a_gentle_autopilot_can_stop_should_landerd_die() -> None:
    config = Config.model_validate({"autopilot": {"vertical_acceleration_mps2": 0.4}})
    flight = Flight(config=config, position=(0.2, 0.0, -6.0)).engaged()
    while flight.lander.state is not State.COMMITTED:
        flight.tick()
        sinks = flight.setpoints[-1][1].velocity[2]
        left_m = max(0.0, flight.height - sinks * config.autopilot.guided_timeout_s)
        assert sinks**2 - 2.0 * 0.4 * left_m < 0.5**2  # design rule 2


def test_to_a_deck_that_heaved_as_it_was_seen_from_3_m_it_sinks_more_slowly() -> None:
    """It may rise again at any time, whatever the estimate says."""
    sinks = []
    for heave in (0.0, 0.6):
        flight = Flight(position=(0.2, 0.0, -6.0)).engaged()
        while flight.height > 1.0:
            is_high = flight.height > 3.0
            flight.pad_velocity = (0.0, 0.0, heave * math.sin(flight.t) if is_high else 0.0)
            flight.tick()
        sinks.append(flight.setpoints[-1][1].velocity[2])
    still, heaved = sinks
    assert 0.2 < heaved < still - 0.05


@pytest.mark.parametrize("height", [0.8, 1.0, 1.3])
def test_taken_over_while_it_sinks_fast_just_over_the_pad_it_orders_no_more_than_can_be_stopped(
    height: float,
) -> None:
    """After a link that was cut it sank at 0.8 m/s from 0.9 m, and was ordered to."""
    flight = Flight(position=(0.0, 0.0, -4.0))
    flight.pad_heading = flight.yaw
    flight.run(1.1)
    flight.order = Setpoint((0.0, 0.0, 0.9), 0.0)  # by hand
    while flight.height > height:
        flight.tick()
    assert flight.velocity[2] > 0.7
    flight.pulse_us = HIGH
    while flight.lander.state is not State.COMMITTED:
        flight.tick()
        sinks = flight.setpoints[-1][1].velocity[2] if flight.setpoints else 0.0
        left_m = max(0.0, flight.height - sinks * flight.config.autopilot.guided_timeout_s)
        assert sinks**2 - 2.0 * 1.0 * left_m < 0.5**2  # design rule 2


def test_it_leaves_room_for_a_deck_that_may_come_up_as_far_as_is_known() -> None:
    autopilot = {"guided_timeout_s": 1.0, "vertical_acceleration_mps2": 1.0}
    config = Config.model_validate({"autopilot": autopilot})
    flight = Flight(config=config, position=(0.2, 0.0, -5.0))
    flight.distort = lambda true: replace(true, covariance=matscale(IDENTITY, 0.1**2))
    flight.engaged()
    while flight.height > 0.5:
        flight.tick()
        safe = safe_sink_rate(flight.height, 0.0, 1.0, 1.0)  # over one that surely stands
        assert flight.height > 2.0 or flight.setpoints[-1][1].velocity[2] < safe - 0.1


def test_leaning_too_far_to_touch_it_waits_over_the_pad_for_a_lull_and_then_hands_back() -> None:
    """On a 10 m/s pad with wind ahead, all that touched leaning over 31 degrees tipped over."""
    config = Config.model_validate({"guidance": {"lost": {"give_up_s": 4.0}}})
    flight = Flight(config=config)
    flight.lean = math.radians(-33.0)
    flight.engaged()
    lowest = flight.height
    while flight.lander.state is State.TRACKING:
        flight.tick()
        lowest = min(lowest, flight.height)
        assert flight.t < 160.0
    assert 0.7 < lowest < 1.2  # from 2 m up it would not be down before the lull is over
    assert "landerd: yaw correction: leans too far: 34 degrees" in flight.texts
    assert "landerd: no landing possible: pilot, take over" in flight.texts


def test_why_it_waits_over_the_pad_is_told_again_every_ten_seconds() -> None:
    """A vehicle that did not turn hovered until its time was over, and said why once."""
    flight = Flight()
    flight.engaged()
    told: list[float] = []
    while flight.t < 170.0 and flight.lander.state is State.TRACKING:
        flight.order = replace(flight.order, yaw_rate=0.0)
        said = len(flight.texts)
        flight.tick()
        told += [flight.t for text in flight.texts[said:] if "heading 25 degrees off" in text]
    assert flight.height > flight.config.guidance.descent.alignment_height_m
    assert len(told) > 5
    assert all(7.0 < later - t < 11.0 for t, later in itertools.pairwise(told))


def test_an_approach_that_does_not_come_nearer_is_told_every_ten_seconds() -> None:
    """Once, the pilot heard nothing between its beginning and the hand-back, 2 minutes later."""
    config = with_value(Config(), "guidance.limits.speed_mps", 2.0)
    flight = Flight(config=config, pad_velocity=(2.0, 0.0, 0.0)).engaged()
    flight.texts.clear()
    flight.run(35.0)
    assert flight.lander.phase is Phase.APPROACH
    assert len(flight.texts) == 3
    assert all("m away" in text for text in flight.texts)


def test_that_a_landing_goes_on_after_a_hold_is_told_twice() -> None:
    """Its first line was lost, and the pilot read "holding" for a descent of 15 s."""
    flight = Flight().engaged().until(Phase.DESCENT)
    flight.visible = False
    flight.until(Phase.NOT_LANDING)
    assert flight.texts[-1].endswith("holding")
    flight.visible = True
    flight.until(Phase.DESCENT)
    flight.run(0.1)
    flight.texts.clear()
    flight.run(1.0)
    assert not flight.texts
    flight.run(1.0)
    assert [text.partition(": ")[2].split()[0] for text in flight.texts] == ["descent:"]
    flight.run(2.5)
    assert len(flight.texts) == 1


def test_an_approach_that_comes_nearer_is_not_told_of_again() -> None:
    flight = Flight(position=(-90.0, 0.0, -8.0)).engaged()
    flight.texts.clear()
    flight.run(12.0)
    assert flight.lander.phase is Phase.APPROACH
    assert not flight.texts


@pytest.mark.parametrize(
    ("kind", "ticks", "text"),
    [
        (LocalPosition, 16, "landerd: position is stale now and then: link?"),
        (Attitude, 12, "landerd: attitude is stale now and then: link?"),
    ],
)
def test_data_that_come_too_seldom_to_land_by_are_told(kind: type, ticks: int, text: str) -> None:
    """It waited over the pad for 105 s, and handed back because no landing came in time."""
    flight = Flight().engaged()
    while flight.height > 2.0:
        flight.tick()
    told = len(flight.texts)
    for tick in range(400):
        flight.silent = set() if tick % ticks == 0 else {kind}
        flight.tick()
    assert flight.contact_t is None
    assert flight.texts[told:].count(text) == 1


@pytest.mark.parametrize("turns", [True, False])
def test_leaning_too_far_it_waits_with_clear_feet_also_where_the_alignment_height_is_low(
    turns: bool,
) -> None:
    """With 0.1 m a foot touched before the lean was known; with 0.05 it landed leaning so."""
    flight = Flight(config=with_value(Config(), "guidance.descent.alignment_height_m", 0.05))
    flight.lean = math.radians(-33.0)
    flight.engaged()
    while flight.lander.state is State.TRACKING:
        if not turns:
            flight.order = replace(flight.order, yaw_rate=0.0)
        flight.tick()
        assert flight.height > 0.7
    assert flight.contact_t is None


def test_a_narrow_gear_lands_with_less_lean() -> None:
    config = Config.model_validate(
        {"vehicle": {"footprint_m": [0.44, 0.18], "gear_height_m": 0.25}}
    )
    flight = Flight(config=config)
    flight.lean = math.radians(-18.0)
    flight.engaged()
    flight.run(25.0)
    assert flight.contact_t is None
    assert "landerd: yaw correction: leans too far: 18 degrees" in flight.texts


def test_a_vehicle_that_leaned_too_far_to_land_lands_in_a_lull() -> None:
    flight = Flight()
    flight.lean = math.radians(-33.0)
    flight.engaged()
    flight.run(15.0)
    assert flight.lander.state is State.TRACKING
    flight.lean = math.radians(-22.0)
    to(flight, State.COMMITTED)


@pytest.mark.parametrize(("slope_deg", "lands"), [(8.0, True), (0.0, True), (-8.0, False)])
def test_the_lean_that_forbids_a_landing_is_relative_to_the_plate(
    slope_deg: float, lands: bool
) -> None:
    """Once, in wind from ahead, it slid off a plate that sloped down with the wind."""
    flight = Flight()
    flight.slope, flight.lean = math.radians(slope_deg), math.radians(-22.0)
    flight.engaged()
    flight.run(25.0)
    assert (flight.contact_t is not None) == lands
    assert any("leans too far: 30 degrees" in text for text in flight.texts) != lands


def test_a_plate_that_is_tilted_just_before_the_touch_is_not_landed_on() -> None:
    """A leaning vehicle touched one that somebody had lifted, slid off it, and was thrown over."""
    flight = Flight()
    flight.lean = math.radians(-12.0)
    flight.engaged()
    while flight.height > 0.4:
        flight.tick()
    flight.slope = math.radians(-24.0)
    flight.run(5.0)
    assert flight.contact_t is None
    assert any("leans too far" in text for text in flight.texts)


def test_a_lean_that_grows_all_the_way_down_is_known_before_the_touch() -> None:
    """Over a truck that sped up it touched leaning 30 degrees: the mean of two seconds was 25."""
    flight = Flight()
    flight.lean = math.radians(-21.0)
    flight.engaged()
    while flight.height > 2.5:
        flight.tick()
    began = flight.t
    while flight.t < began + 12.0 and flight.contact_t is None:
        flight.lean = -math.radians(min(30.0, 21.0 + 3.0 * (flight.t - began)))
        flight.tick()
    assert flight.contact_t is None
    assert any("leans too far" in text for text in flight.texts)


def test_a_gust_does_not_end_a_descent() -> None:
    """Leaning by 26 degrees for a second, it need not wait for a lull."""
    flight = Flight()
    flight.lean = math.radians(-18.0)
    flight.engaged()
    while flight.height > 0.7:
        flight.tick()
    began = flight.t
    while flight.contact_t is None:
        t = flight.t - began
        flight.lean = -math.radians(18.0 + (8.0 * math.sin(math.pi * t) if t < 1.0 else 0.0))
        flight.tick()
        assert t < 15.0
    assert not any("leans too far" in text for text in flight.texts)


def test_no_landing_begins_while_it_may_already_stand_on_the_pad() -> None:
    """Once, it was lifted off: after a gap of telemetry the pad's velocity was uncertain."""
    flight = Flight(position=(0.0, 0.0, -Config().vehicle.gear_height_m))
    flight.contact_t, flight.detects_landing = 0.0, False

    def noisy(true: PoseSolution) -> PoseSolution:
        """Refractions and an askew lens: alike from picture to picture."""
        error = (0.06 * math.sin(6.0 * flight.t), 0.0, 0.05 * math.sin(9.0 * flight.t))
        covariance = matscale(IDENTITY, 0.05**2)
        return replace(true, position=add(true.position, error), covariance=covariance)

    flight.distort = noisy
    flight.pulse_us = LOW
    flight.run(1.1)
    flight.visible = False
    flight.run(2.0)
    flight.pulse_us, flight.visible = HIGH, True
    to(flight, State.ON_PAD)
    assert all(setpoint.velocity[2] >= 0.0 for _, setpoint in flight.setpoints)


def test_committed_and_sight_is_lost_it_sinks_on_then_climbs_without_holding() -> None:
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    held: Vec3 = flight.position
    flight.visible = False
    # A vehicle that answers no order: neither contact nor a sighting.
    lost_t = flight.t
    while flight.lander.state is State.COMMITTED:
        flight.position, flight.velocity = held, (0.0, 0.0, 0.31)
        flight.tick()
    assert flight.lander.state is State.WAVING_OFF
    assert 0.6 < flight.t - lost_t < 0.8  # in 0.2 s more contact would have been noticed
    assert "climbing away" in flight.lander.reason
    assert flight.setpoints[-1][1].velocity[2] < -0.3
    to(flight, State.SEARCHING, at_most_s=1.1)
    assert flight.lander.aborts == 1


def test_blind_below_the_commit_height_and_not_committed_it_sinks_no_farther() -> None:
    """Once, it sank on until sight was 0.5 s old, and touched before the climb took effect."""
    flight = Flight().engaged()
    while flight.height > 0.26:
        flight.tick()
    flight.visible = False
    flight.run(0.4)
    assert flight.lander.state is State.TRACKING
    assert flight.setpoints[-1][1].velocity[2] <= 0.0
    to(flight, State.SEARCHING, at_most_s=0.5)
    assert flight.height > 0.1


def test_sight_lost_as_it_sinks_fast_to_a_pad_that_moves_it_climbs_with_the_pad() -> None:
    """Once, 0.1 m higher, it was ordered to hover, sank on, and its feet were dragged along."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0)).engaged()
    while flight.height > 0.44:
        flight.tick()
    flight.visible = False
    to(flight, State.WAVING_OFF, at_most_s=0.6)
    assert flight.height > 0.22
    begun, seen = flight.t, len(flight.setpoints)
    to(flight, State.SEARCHING)
    assert 0.8 < flight.t - begun < 1.6  # 0.4 m higher
    orders = [setpoint.velocity for _, setpoint in flight.setpoints[seen:-1]]
    assert all(north > 0.9 and down <= 0.0 for north, _, down in orders)
    assert orders[0][2] > -0.2  # there is room to begin gently
    assert orders[-1][2] < -0.4


def test_leaning_as_the_pad_does_no_foot_is_taken_to_be_down() -> None:
    """A foot would be down if the plate sloped the other way: once it was pressed down 16 cm up."""
    flight = Flight()
    flight.pad_heading, flight.lean, flight.slope = 0.0, math.radians(14.0), math.radians(-5.0)
    to(flight.engaged(), State.COMMITTED)
    while flight.height > 0.13:
        flight.tick()
    held = flight.position
    for _ in range(26):  # a gust, or a cushion of air
        flight.position, flight.velocity = held, (0.0, 0.0, 0.0)
        flight.tick()
    assert flight.lander.state is State.COMMITTED


def test_a_touch_too_high_for_the_configured_gear_is_noticed_and_told_to_the_pilot() -> None:
    """Once, with a gear 12 cm longer than configured, it stood under thrust and did not say why."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.COMMITTED)
    while flight.height > 0.14:
        flight.tick()
    held, begun = flight.position, flight.t
    while flight.lander.state is State.COMMITTED:
        flight.position, flight.velocity = held, (0.0, 0.0, 0.0)
        flight.tick()
    assert flight.lander.state is State.ON_PAD
    assert 0.9 < flight.t - begun < 1.7
    assert any("touched 0.1" in text and "gear" in text for text in flight.texts)


def test_on_a_pad_seen_to_slide_away_under_its_feet_it_is_waved_off() -> None:
    """Once, it flew on beside the pad with the pad's former velocity, and was levelled there."""
    flight = Flight(pad_velocity=(4.0, 0.0, 0.0))
    to(flight.engaged(), State.COMMITTED)
    while flight.height > 0.14:
        flight.tick()
    over, speed, slid_m = sub(flight.position, flight.pad), 4.0, 0.0
    begun = flight.t
    while flight.lander.state in (State.COMMITTED, State.ON_PAD):
        assert flight.t < begun + 3.0
        if flight.lander.state is State.ON_PAD:  # for a gust held it up; and now the pad brakes
            speed -= 3.0 * DT
            slid_m += (4.0 - speed) * DT
        flight.pad_velocity = (speed, 0.0, 0.0)
        flight.position = add(flight.pad, add(over, (slid_m, 0.0, 0.0)))
        flight.velocity = (4.0, 0.0, 0.0)
        flight.tick()
    assert flight.pressed == []


def test_a_vehicle_that_ends_below_the_plate_has_not_landed_on_the_pad() -> None:
    """Once, one that fell off the plate and came upright beside it was told to have landed."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.run(1.0)
    flight.visible = False
    flight.pad = add(flight.pad, (0.0, 0.0, 0.3))  # the ground beside it
    for i in range(12):
        flight.velocity = (0.0, 0.0, min(1.0, 10.0 * i * DT))
        flight.tick()
        if i == 2:  # until then it may be rocking on the plate
            flight.contact_t = None
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed_off_pad"


@pytest.mark.parametrize("jump", [(0.0, 0.0, 0.5), (2.0, -1.0, 0.0)])
def test_a_jump_of_the_local_frame_while_it_stands_does_not_undo_the_landing(
    jump: Vec3,
) -> None:
    """Once, the EKF reset its height at the touch, and it was told to have fallen off the plate."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.visible = False
    flight.run(0.1)
    flight.position, flight.pad = add(flight.position, jump), add(flight.pad, jump)
    flight.run(1.5)
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed"


def test_waved_off_from_a_pad_that_drives_off_it_climbs_away_with_it() -> None:
    """Once, it climbed straight up while the pad carried its feet away, and tipped over."""
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    flight.pad_velocity = (1.0, 0.0, 0.0)
    to(flight, State.WAVING_OFF, at_most_s=0.5)
    for _ in range(24):
        flight.pad_velocity = add(flight.pad_velocity, (2.0 * DT, 0.0, 0.0))
        flight.tick()
    north, _, down = flight.setpoints[-1][1].velocity
    assert flight.lander.state is State.WAVING_OFF
    assert north > 1.4
    assert down < -0.3


def test_too_low_to_try_any_longer_it_climbs_at_once() -> None:
    """A leaning vehicle's lowest foot is nearly down: climbing gently, it was dragged along."""
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.01}}})
    flight = Flight(config=never_fit).engaged()
    while "climbing again" not in flight.lander.reason:
        flight.tick()
    assert flight.lander.state is State.TRACKING
    assert flight.setpoints[-1][1].velocity[2] == -never_fit.guidance.limits.climb_mps


def test_the_pilot_is_told_why_a_landing_that_is_not_off_is_not_carried_through() -> None:
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_slip_mps": 0.001}}})
    flight = Flight(config=never_fit, pad_velocity=(0.5, 0.0, 0.0)).engaged()
    while "climbing again" not in flight.lander.reason:
        flight.tick()
    assert "m/s across" in flight.lander.reason
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.01}}})
    flight = Flight(config=never_fit).engaged()
    while "climbing again" not in flight.lander.reason:
        flight.tick()
    assert flight.lander.reason.startswith("may miss by 0.0")


def test_too_low_and_aside_it_climbs_before_it_goes_back_over_the_pad() -> None:
    """Once, a deck that came up touched its feet meanwhile, and dragged it along at 0.4 m/s."""
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.01}}})
    flight = Flight(config=never_fit).engaged()
    while flight.height > 0.1:
        flight.tick()
    flight.position = add(flight.position, (-0.25, 0.0, 0.0))
    flight.run(0.2)
    assert "climbing again" in flight.lander.reason
    assert flight.height < 0.16
    assert horizontal(flight.setpoints[-1][1].velocity) < 0.1


@pytest.mark.parametrize(("plate_m", "state"), [(0.6, State.COMMITTED), (0.1, State.TRACKING)])
def test_a_deck_that_comes_up_before_a_climb_begins_is_landed_on(
    plate_m: float, state: State
) -> None:
    """Once, a deck came up to its feet, and it stood there ordered to climb for more than 1 s."""
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.001}}})
    plate = Plate(north_m=plate_m, south_m=plate_m, east_m=plate_m, west_m=plate_m)
    flight = Flight(config=never_fit, layout=PAD.model_copy(update={"plate": plate})).engaged()
    while flight.height > 0.16:
        flight.tick()
    flight.pad_velocity = (0.0, 0.0, -0.3)
    while flight.lander.state is State.TRACKING and "climbing again" not in flight.lander.reason:
        flight.tick()
    assert flight.lander.state is state


def test_where_pictures_show_the_pad_lower_than_telemetry_a_climb_keeps_its_limits() -> None:
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.01}}})
    flight = Flight(config=never_fit).engaged()
    while flight.height > 0.115:
        flight.tick()
    flight.distort = lambda true: replace(true, position=add(true.position, (0.0, 0.0, 0.4)))
    setpoints = flight.run(0.15)
    assert "climbing again" in flight.lander.reason
    assert all(setpoint.velocity[2] > -0.1 for setpoint in setpoints)


def test_blind_just_over_a_pad_that_moves_it_climbs_away_with_it_though_not_committed() -> None:
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.01}}})
    flight = Flight(config=never_fit, pad_velocity=(1.0, 0.0, 0.0)).engaged()
    while flight.height > 0.19:
        flight.tick()
    flight.silent.add(Attitude)
    assert to(flight, State.WAVING_OFF, at_most_s=0.3) == [State.TRACKING, State.WAVING_OFF]
    north, _, down = flight.setpoints[-1][1].velocity
    assert north == pytest.approx(1.0, abs=0.1)
    assert down == -never_fit.guidance.limits.climb_mps


def test_too_low_over_a_deck_that_comes_up_it_climbs_faster_than_that() -> None:
    never_fit = Config.model_validate({"guidance": {"descent": {"commit_miss_m": 0.01}}})
    flight = Flight(config=never_fit, pad_velocity=(0.0, 0.0, -0.2)).engaged()
    while "climbing again" not in flight.lander.reason or flight.height < 0.6:
        flight.tick()
    climb = -flight.setpoints[-1][1].velocity[2]
    assert climb == pytest.approx(never_fit.guidance.lost.climb_mps + 0.2, abs=0.05)


def test_released_as_it_touches_a_moving_pad_it_stands_there_until_its_thrust_is_back() -> None:
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0)).engaged()
    to(flight, State.COMMITTED)
    while flight.contact_t is None:
        flight.tick()
    flight.run(0.25)  # pressed down
    flight.pulse_us = LOW
    on_pad, released_t = flight.position[2], flight.t
    gone: list[State] = []
    while flight.lander.state is not State.STANDING:
        assert flight.t < released_t + 0.6, gone
        # Told to climb, but its thrust is not there yet: it goes with the pad.
        flight.position = (*flight.position[:2], on_pad)
        flight.velocity = flight.pad_velocity
        flight.tick()
        gone.append(flight.lander.state)
    assert State.LEAVING in gone
    assert flight.setpoints[-1][1].velocity[2] < -0.3  # it would have left
    climbs, levelled = len(flight.setpoints), len(flight.pressed)
    flight.run(0.5)
    assert len(flight.setpoints) == climbs
    assert len(flight.pressed) > levelled


def released_touching() -> Flight:
    """Return a flight whose feet have just touched a pad of 1 m/s, the switch low."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0)).engaged()
    flight.detects_landing = False
    to(flight, State.COMMITTED)
    while flight.contact_t is None:
        flight.tick()
    flight.pulse_us = LOW
    return flight


def tick_on_pad(flight: Flight, *, bounces: bool) -> None:
    """Let a control period go by in which the vehicle goes with the pad, whatever is ordered."""
    goes_up = (
        round(flight.t / DT) % 2 == 0
    )  # a bounce that lasted would be seen as a pad that heaves
    bounce = -0.3 if goes_up else 0.3
    flight.velocity = (*flight.pad_velocity[:2], bounce if bounces else 0.0)
    height = flight.position[2]
    flight.tick()
    flight.position = (*flight.position[:2], height)


def test_released_just_as_it_touches_a_moving_pad_it_is_found_to_stand_before_it_lifts() -> None:
    """Once, this was found too late: it climbed on, and was stopped with its feet on the pad."""
    flight = released_touching()
    released_t = flight.t
    while flight.lander.state is not State.STANDING:
        assert flight.t < released_t + 0.5
        # Its thrust is not there yet.
        tick_on_pad(flight, bounces=flight.t < released_t + 0.2)
    flight.run(0.5)
    assert flight.pressed


def test_the_pilot_is_told_that_the_landing_goes_on_where_it_stands_after_a_release() -> None:
    """Once, he read "granted", and else that it was climbing away, until it was disarmed."""
    flight = released_touching()
    to_leave = flight.t + 0.5
    while flight.lander.state is not State.ON_PAD:
        assert flight.t < to_leave
        tick_on_pad(flight, bounces=flight.t < to_leave - 0.3)
        flight.pulse_us = HIGH if flight.lander.state is State.LEAVING else flight.pulse_us
    flight.run(1.0)
    assert "landerd: RC 11 is low, climbing away" in flight.texts
    assert flight.texts[-1] == "landerd: landed: stands on the pad"
    assert "landerd: granted" not in flight.texts
    assert flight.lander.phase is Phase.LANDED


def test_released_it_climbs_away_for_a_second_at_most_also_where_it_rests_on_the_pad() -> None:
    """Its thrust is just coming back: levelled then, vehicles were thrown off 5 m/s pads."""
    flight = released_touching()
    released_t = flight.t
    while flight.lander.state in (State.COMMITTED, State.LEAVING):
        assert flight.t < released_t + 1.2
        tick_on_pad(flight, bounces=flight.t < released_t + 0.6)
    assert flight.lander.state is State.RELEASING
    assert not flight.pressed


def test_a_vehicle_on_the_pad_stays_there_when_the_autopilot_restarts() -> None:
    """Once, as the pad was forgotten then, it was levelled only when it lifted, and fell."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0)).engaged()
    flight.detects_landing = False
    to(flight, State.ON_PAD)
    flight.pitch_rate = 0.8  # rocks
    flight.run(0.2)
    flight.restart_autopilot()
    flight.visible = False
    on_pad, restarted_t = flight.position[2], flight.t
    while flight.lander.state is not State.STANDING:
        assert flight.t < restarted_t + 0.6
        flight.position = (*flight.position[:2], on_pad)
        flight.velocity = flight.pad_velocity
        flight.pitch_rate = 0.0 if flight.t > restarted_t + 0.1 else 0.8
        flight.tick()
    flight.run(0.5)
    assert len(flight.pressed) > 10


def test_it_stays_there_too_when_the_autopilot_restarts_just_after_the_touch() -> None:
    """Once, it climbed for a second, and was stopped as it lifted from a pad of 5 m/s."""
    flight = Flight(pad_velocity=(5.0, 0.0, 0.0)).engaged()
    flight.detects_landing = False
    to(flight, State.ON_PAD)
    flight.restart_autopilot()
    flight.visible = False
    restarted_t = flight.t
    while flight.lander.state is not State.STANDING:
        assert flight.t < restarted_t + 0.45  # from then on its thrust may lift it
        tick_on_pad(flight, bounces=False)
    flight.run(0.5)
    assert flight.pressed


def test_released_as_it_touches_before_that_is_sure_it_is_levelled_once_it_lies_there() -> None:
    """Once, it was stopped there with thrust, and granted again began from a false velocity."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.COMMITTED)
    while flight.contact_t is None:
        flight.tick()
    flight.run(0.15)
    assert flight.lander.state is State.COMMITTED
    flight.pulse_us = LOW
    to(flight, State.STANDING, at_most_s=0.2)
    assert not flight.pressed
    flight.run(0.8)
    assert flight.pressed
    flight.pulse_us = HIGH
    assert to(flight, State.ON_PAD, at_most_s=0.2) == [State.STANDING, State.ON_PAD]


def test_sight_lost_too_long_as_its_feet_arrive_it_goes_on_down() -> None:
    """It was told to climb, and stood on the pad under thrust, dragged, until it lifted."""
    flight = Flight().engaged()
    flight.detects_landing = False
    to(flight, State.COMMITTED)
    flight.visible = False
    flight.position = add(flight.position, (0.0, 0.0, -0.04))
    position = flight.position
    while flight.lander.state is State.COMMITTED:
        # It sinks somewhat more slowly than ordered: air cushions it.
        flight.velocity = (0.0, 0.0, 0.25)
        position = add(position, (0.0, 0.0, 0.25 * DT))
        flight.tick()
        flight.position = position
    assert 0.0 < flight.height < 0.06
    assert flight.lander.state is State.ON_PAD
    assert flight.setpoints[-1][1].velocity[2] > 0.0


def test_released_as_its_feet_arrive_it_stands_there() -> None:
    """RC was lost for 0.3 s: it stood on the pad with thrust, unseen, for half a minute."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.COMMITTED)
    while flight.height > 0.04:
        flight.tick()
    flight.pulse_us = LOW
    to(flight, State.STANDING, at_most_s=0.2)
    flight.visible = False
    flight.pulse_us = HIGH
    to(flight, State.ON_PAD, at_most_s=0.2)
    flight.run(1.5)
    assert flight.contact_t is not None
    assert flight.pressed


def test_released_in_the_air_after_commit_it_is_stopped() -> None:
    flight = Flight()
    to(flight.engaged(), State.COMMITTED)
    while flight.height > 0.1:
        flight.tick()
    flight.pulse_us = LOW
    to(flight, State.RELEASING, at_most_s=0.2)


@pytest.mark.parametrize(("lean_deg", "height_m"), [(18.0, 0.055), (3.0, 0.08)])
def test_stopped_just_over_the_pad_it_is_levelled_where_wind_has_a_foot_down(
    lean_deg: float, height_m: float
) -> None:
    """Once, stopped with its thrust against the wind, it was dragged off its pad and tipped."""
    flight = Flight().engaged()
    flight.detects_landing, flight.lean = False, math.radians(lean_deg)
    to(flight, State.COMMITTED)
    while flight.height > height_m:  # a foot is down that leans by 18 degrees
        flight.tick()
    flight.pulse_us, flight.contact_t = LOW, flight.t
    released_t, position = flight.t, flight.position
    while flight.lander.state is not State.SILENT:
        flight.position, flight.velocity = position, (0.0, 0.0, 0.0)
        flight.tick()
    assert flight.t < released_t + flight.config.guidance.release_s + 0.2
    assert bool(flight.pressed) == (lean_deg == 18.0)


@pytest.mark.parametrize("ticks", [0, 2, 4])  # that the switch is in its middle on its way
def test_a_switch_that_passes_its_middle_releases_as_one_that_has_none(ticks: int) -> None:
    """It was taken for a hold asked: the climb that began hid the touch from the release."""
    three_positions = {"gate_threshold_us": 1300, "land_threshold_us": 1700}
    flight = Flight(config=Config.model_validate({"rc": three_positions})).engaged()
    flight.detects_landing, flight.lean = False, math.radians(18.0)
    to(flight, State.COMMITTED)
    while flight.height > 0.09:
        flight.tick()
    flight.pulse_us = 1500
    flight.run(ticks * DT)
    flight.pulse_us, position = LOW, flight.position
    while flight.lander.state is not State.SILENT:
        if flight.height < 0.075:  # the foot that leans down is on the pad, and holds it up
            flight.position, flight.velocity = position, (0.0, 0.0, 0.0)
            flight.contact_t = flight.contact_t or flight.t
        position = flight.position
        flight.tick()
    assert flight.pressed


def test_pressed_down_for_long_without_data_it_stands_level_when_released_on_a_moving_pad() -> None:
    """Once, it climbed away after 12 s on the pad, and tipped over in the stop that followed."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.silent.add(Attitude)
    flight.run(3.0)
    assert flight.lander.state is State.ON_PAD
    climbs = len(flight.setpoints)
    flight.pulse_us = LOW
    to(flight, State.SILENT, at_most_s=2.0)
    assert all(setpoint.velocity[2] > 0.0 for _, setpoint in flight.setpoints[climbs:])
    assert len(flight.pressed) > 30


def test_pressed_down_for_long_without_data_it_stands_level() -> None:
    """Once, it was pressed down with thrust left for 3 s, and wind dragged it off the plate.

    Two seconds of it tipped one over on a pad that turned.
    """
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.silent.add(LocalPosition)
    flight.run(0.9)
    assert flight.pressed == []
    flight.run(0.6)
    assert flight.pressed


def levelled_out() -> Flight:
    """Return a flight whose vehicle the pad, which moves at 1 m/s, has just levelled."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pitch_rate = 0.8
    flight.run(0.4)
    flight.pitch_rate = 0.0
    return flight


@pytest.mark.parametrize("restarts", [False, True])
def test_a_vehicle_that_stood_is_left_standing_when_released_without_data(
    *, restarts: bool
) -> None:
    """Once, stale data made landerd forget that it stood: it climbed away from a moving pad."""
    flight = levelled_out()
    while flight.lander.needs_sight:
        flight.tick()
    assert flight.pressed == []  # not for long enough to be levelled
    flight.silent = {Attitude}
    if restarts:
        flight.restart_autopilot()
    else:
        flight.run(0.3)
        flight.pulse_us = LOW
    flown = len(flight.setpoints)
    to(flight, State.STANDING, at_most_s=0.1)
    flight.run(0.3)
    flight.silent = set()
    to(flight, State.SILENT, at_most_s=0.8)
    assert len(flight.setpoints) <= flown + 1  # the switch is told of at every other step
    assert len(flight.pressed) > 30
    assert flight.pressed[0].heading == pytest.approx(flight.yaw, abs=0.01)


def test_should_the_core_fail_a_vehicle_on_a_moving_pad_is_to_stand_level() -> None:
    flight = levelled_out()
    while not flight.pressed:
        flight.tick()
        orders = flight.lander.last_orders
        assert orders is not None
        at_once = orders.at(0.0)
        climbs = isinstance(at_once, Setpoint) and at_once.velocity[2] < 0.0
        assert climbs or orders.then == PressDown(flight.yaw) == at_once


def test_should_the_core_fail_just_after_the_touch_the_vehicle_is_to_stand_level() -> None:
    """Stopped for as long as orders are streamed, and then left with thrust, wind drags it off."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    orders = flight.lander.last_orders
    assert orders is not None
    assert orders.at(0.0) == STOP
    assert orders.at(0.7) == PressDown(flight.yaw)
    assert orders.at(flight.config.guidance.release_s) is None  # silent, as after any release


def test_touching_with_an_edge_it_leans_over_it_is_not_sliding_off() -> None:
    """As the pad levels it, its middle moves across the pad and sinks, while the edge stands."""
    flight = Flight(config=Config.model_validate({"vehicle": {"footprint_m": [0.44, 0.26]}}))
    # A bent plate, a gear measured wrong: it takes itself to be so much higher.
    flight.distort = lambda true: replace(true, position=add(true.position, (0.0, 0.0, 0.07)))
    to(flight.engaged(), State.COMMITTED)
    while flight.height > 0.08:
        flight.tick()
    edge = (-0.22, 0.0, flight.config.vehicle.gear_height_m)
    flight.lean, flight.pitch_rate = 0.3, -1.5
    stands = add(flight.position, rotate(rot_zyx(flight.yaw, flight.lean, 0.0), edge))
    while flight.lean > 1e-6:
        flight.lean += flight.pitch_rate * DT
        R = rot_zyx(flight.yaw, flight.lean, 0.0)
        flight.position = sub((*stands[:2], flight.pad[2]), rotate(R, edge))
        flight.velocity = rotate(R, cross(edge, (0.0, flight.pitch_rate, 0.0)))
        flight.tick()
        assert flight.lander.state in (State.COMMITTED, State.ON_PAD)
    flight.pitch_rate = flight.lean = 0.0
    assert to(flight, State.SILENT)[-2:] == [State.ON_PAD, State.SILENT]
    assert flight.lander.outcome == "landed"


def test_released_as_it_slides_across_a_pad_that_stopped_it_is_not_levelled() -> None:
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0)).engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.03:
        flight.tick()
    flight.pulse_us = LOW
    low, flight.pad_velocity = flight.position[2], (0.0, 0.0, 0.0)
    while flight.lander.state is not State.RELEASING:
        # Its thrust is not back: it brushes the pad, neither sinking nor climbing.
        flight.position, flight.velocity = (*flight.position[:2], low), (1.0, 0.0, 0.0)
        flight.tick()
        assert flight.lander.state is not State.STANDING
    assert flight.pressed == []


def test_released_just_over_a_pad_its_turn_to_climb_is_not_taken_for_rest() -> None:
    """Levelled 0.1 m up, it was blown across a pad of 5 m/s, and tipped over."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0))
    to(flight.engaged(), State.COMMITTED)
    flight.lean = 0.3  # into the wind, so that a foot is low
    while flight.height > 0.05:
        flight.tick()
    flight.pulse_us = LOW
    to(flight, State.LEAVING, at_most_s=0.2)
    for k in range(round(0.4 / DT)):  # it answers late
        flight.velocity = (1.0, 0.0, 0.05 - 0.25 * k * DT)
        flight.position = add(flight.position, (0.0, 0.0, max(0.0, -flight.height)))
        flight.tick()
        assert flight.lander.state is State.LEAVING
    assert flight.pressed == []


def test_released_over_a_deck_that_sinks_away_it_is_not_levelled_in_the_air() -> None:
    """It fell 0.2 m onto the deck, at 0.8 m/s."""
    flight = Flight(pad_velocity=(0.0, 0.0, 0.25))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pulse_us = LOW
    to(flight, State.STANDING)
    flight.position = sub(flight.position, (0.0, 0.0, 0.02))  # stopped, it lifts off
    while flight.lander.state is State.STANDING:
        flight.tick()
    assert flight.height > 0.1
    assert flight.pressed == []
    assert flight.order == STOP


def without_thrust(pad_mps: float = 1.0) -> Flight:
    """Return a flight that stands level without thrust on a pad that drives north."""
    flight = Flight(pad_velocity=(pad_mps, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    while not flight.pressed:
        flight.tick()
    return flight


def test_levelled_on_the_pad_it_stays_so_when_data_are_stale() -> None:
    flight = without_thrust()
    flight.run(0.15)
    flown, levelled = len(flight.setpoints), len(flight.pressed)
    flight.silent = {LocalPosition}
    flight.run(0.8)
    assert len(flight.setpoints) == flown
    assert len(flight.pressed) > levelled + 20
    assert flight.pressed[-1].heading == pytest.approx(0.6, abs=0.01)


def test_levelled_on_an_edge_it_falls_onto_its_feet_without_thrust() -> None:
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    while not flight.pressed:
        flight.tick()
    middle = add(flight.position, (0.0, 0.0, -0.04))

    def sinks(seconds: float, speed_mps: float) -> list[Setpoint]:
        flown = len(flight.setpoints)
        for _ in range(round(seconds / DT)):
            flight.position, flight.velocity = middle, (0.0, 0.0, speed_mps)
            flight.tick()
        return [setpoint for _, setpoint in flight.setpoints[flown:]]

    flight.pitch_rate = 4.0
    assert sinks(0.1, 0.6) == []
    flight.pitch_rate = 0.0
    assert sinks(0.1, 1.0) != []  # what sinks so fast without turning is in the air


def test_levelled_after_a_release_it_stays_so_as_it_rocks() -> None:
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pulse_us = LOW
    flight.pitch_rate = 0.8
    flight.run(0.4)
    flight.pitch_rate = 0.0
    while not flight.pressed:
        assert flight.lander.state is State.STANDING
        flight.tick()
    flown = len(flight.setpoints)
    flight.pitch_rate = 0.8  # as its thrust goes; given back, it threw the vehicle off its feet
    flight.run(0.15)
    flight.pitch_rate = 0.0
    flight.run(0.2)
    assert len(flight.setpoints) == flown


@pytest.mark.parametrize("heave", [-0.3, 0.3])
def test_released_as_it_stands_on_a_fast_deck_that_heaves_it_stays_there(heave: float) -> None:
    flight = Flight(pad_velocity=(1.0, 0.0, heave))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pulse_us = LOW
    feet_over_pad = sub(flight.position, flight.pad)
    while flight.lander.state is not State.STANDING:
        assert flight.lander.state in (State.ON_PAD, State.LEAVING)
        flight.tick()
        # Told to climb, its thrust is not there yet.
        flight.position, flight.velocity = add(flight.pad, feet_over_pad), flight.pad_velocity
    flight.run(0.5)
    assert flight.pressed


def test_it_stands_on_a_deck_that_sinks_ever_faster() -> None:
    """The deck's speed is known late, its height at once: once it was stopped by the speed."""
    flight = Flight()
    flight.detects_landing = False
    flight.distort = lambda true: replace(true, covariance=matscale(IDENTITY, 0.02**2))
    to(flight.engaged(), State.ON_PAD)
    on_pad = sub(flight.position, flight.pad)
    for i in range(60):
        flight.pad_velocity = (0.0, 0.0, 0.2 * i * DT)
        flight.position, flight.velocity = add(flight.pad, on_pad), flight.pad_velocity
        flight.tick()
    assert flight.pressed


def test_carried_on_while_its_data_are_stale_it_has_not_slid() -> None:
    flight = Flight(pad_velocity=(2.0, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.run(0.15)
    flight.silent = {Attitude}
    flight.run(1.0)
    flight.silent, flight.detects_landing = set(), True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed"


@pytest.mark.parametrize("switch_us", [HIGH, LOW])
def test_a_vehicle_that_turns_over_on_the_ground_is_given_no_thrust(switch_us: int) -> None:
    """Once, one that lost a motor 0.11 m up was ordered to climb for 13 s, and thrown about."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0)).engaged().until(Phase.DESCENT)
    while flight.height > 0.18:
        flight.tick()
    flight.pitch, flight.pulse_us = math.radians(80.0), switch_us
    flight.contact_t, flight.detects_landing = flight.t, False  # on an edge
    flight.run(0.2)
    before = len(flight.pressed)
    assert flight.run(1.0) == []
    assert len(flight.pressed) > before
    assert "landerd: turns over, disarm by hand" in flight.texts
    flight.detects_landing, flight.pitch = True, 0.0  # fallen back onto its feet
    flight.run(3.0)
    assert flight.armed == (switch_us == LOW)
    assert flight.lander.outcome == ("tipped_over" if switch_us == HIGH else "released")


def test_a_levelled_vehicle_that_turns_over_and_falls_back_onto_its_feet_has_not_landed() -> None:
    """Once, one that lay on its side for 2.5 s, levelled, was told to have landed off the plate."""
    flight = Flight().engaged()
    flight.detects_landing = False
    to(flight, State.ON_PAD)
    flight.run(1.5)
    assert flight.pressed
    flight.pitch = math.radians(70.0)
    flight.run(0.5)
    assert "landerd: turns over, disarm by hand" in flight.texts
    flight.detects_landing, flight.pitch = True, 0.0
    flight.run(3.0)
    assert not flight.armed
    assert flight.lander.outcome == "tipped_over"


def test_levelled_it_gets_no_thrust_back_as_it_tips_about_an_edge() -> None:
    """Its middle rises then; a foot stays where it was."""
    flight = Flight().engaged()
    flight.detects_landing = False
    to(flight, State.ON_PAD)
    while not flight.pressed:
        flight.tick()
    assert flight.lander.state is State.ON_PAD
    gear, half_m = flight.config.vehicle.gear_height_m, 0.5 * flight.config.vehicle.footprint_m[0]
    (north, east, down), before = flight.position, len(flight.pressed)
    flight.pitch_rate = 1.2
    for _ in range(24):
        flight.pitch += flight.pitch_rate * DT
        up = half_m * math.sin(flight.pitch) + gear * (math.cos(flight.pitch) - 1.0)
        rises = (down - up - flight.position[2]) / DT
        flight.position, flight.velocity = (north, east, down - up), (0.0, 0.0, rises)
        flight.order = Setpoint(flight.velocity, 0.0)
        assert flight.run(DT) == []
    assert math.degrees(flight.pitch) > 40.0
    assert len(flight.pressed) == before + 24


def test_a_large_lean_for_a_moment_or_high_up_is_not_taken_for_turning_over() -> None:
    flight = Flight().engaged().until(Phase.DESCENT)
    flight.lean = math.radians(80.0)
    flight.run(0.3)
    flight.lean = 0.0
    while flight.height > 0.25:
        flight.tick()
    flight.lean = math.radians(80.0)
    flight.run(0.05)
    flight.lean = 0.0
    flight.run(0.1)
    assert not flight.pressed
    assert not any("turns over" in text for text in flight.texts)


def test_a_vehicle_that_lies_tipped_over_on_the_pad_has_not_landed() -> None:
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pitch = -0.9
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "tipped_over"
    assert "landerd: disarmed, tipped over" in flight.texts


def test_released_for_a_moment_as_it_stands_there_it_has_landed_all_the_same() -> None:
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.run(1.0)
    flight.pulse_us = LOW
    to(flight, State.STANDING)
    flight.pulse_us = HIGH
    to(flight, State.ON_PAD)
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed"


def test_committed_and_the_position_is_stale_it_climbs_away_at_once_and_then_holds() -> None:
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    flight.silent = {LocalPosition}
    to(flight, State.WAVING_OFF, at_most_s=0.4)
    to(flight, State.SEARCHING, at_most_s=1.1)
    assert "climbing" in flight.lander.reason  # out of reach of a deck that heaves,
    flight.run(2.1)
    assert "holding" in flight.lander.reason  # and without a position no further


@pytest.mark.parametrize(
    ("height", "silent", "lasts_s"),
    [
        # Stale a moment after the touch: too early to call that contact.
        (0.02, {Attitude}, 0.35),
        # And just before it: told to climb, it was dragged half a metre across the plate.
        (0.08, {Attitude, LocalPosition}, 0.45),
    ],
)
def test_committed_and_its_data_are_stale_as_it_touches_it_does_not_climb_again(
    height: float, silent: set[type], lasts_s: float
) -> None:
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    while flight.height > height:
        flight.tick()
    before = len(flight.setpoints)
    flight.silent = silent
    flight.run(lasts_s)
    flight.silent = set()
    assert to(flight, State.SILENT) == [State.ON_PAD, State.SILENT]
    assert all(setpoint.velocity[2] >= 0.0 for _, setpoint in flight.setpoints[before:])
    assert flight.lander.outcome == "landed"


def test_committed_and_its_data_are_stale_before_the_touch_it_is_not_told_to_descend() -> None:
    """Once, it was: for the 0.1 s in which it sank onto the pad anyway."""
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.08:
        flight.tick()
    flight.silent = {Attitude, LocalPosition}
    to(flight, State.ON_PAD, at_most_s=0.35)
    begins = len(flight.setpoints) - 1
    flight.run(0.15)
    assert all(setpoint.velocity[2] == 0.0 for _, setpoint in flight.setpoints[begins:])
    flight.run(0.15)
    assert flight.setpoints[-1][1].velocity[2] > 0.0


@pytest.mark.parametrize(("acceleration", "stays_s"), [(0.4, 0.4), (2.5, 2.5)])
def test_waved_off_as_it_touches_unnoticed_it_is_pressed_down_where_its_thrust_is_not_back(
    acceleration: float, stays_s: float
) -> None:
    """Once, it was levelled just as it lifted, thrown 0.4 m high, and fell beside the pad."""
    autopilot = {"vertical_acceleration_mps2": acceleration}
    config = Config.model_validate({"autopilot": autopilot, "guidance": SINKS_SLOWLY})
    flight = Flight(config=config).engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.06:
        flight.tick()
    flight.silent = {Attitude, LocalPosition}  # stale before the touch shows
    to(flight, State.WAVING_OFF, at_most_s=0.35)
    flight.silent = set()
    ground = flight.pad[2] - flight.config.vehicle.gear_height_m
    (north, east, down), waved_off_t = flight.position, flight.t
    while flight.lander.state is State.WAVING_OFF:
        assert flight.t < waved_off_t + stays_s + 0.2
        down = min(ground, down + 0.1 * DT)
        sinks = 0.1 if down < ground else 0.0
        flight.position, flight.velocity = (north, east, down), (0.0, 0.0, sinks)
        flight.tick()
    assert flight.t > waved_off_t + stays_s - 0.1
    climbs = len(flight.setpoints)
    assert flight.setpoints[-2][1].velocity[2] == 0.0  # the climb ends at once
    assert not flight.pressed
    assert to(flight, State.SILENT) == [State.ON_PAD, State.SILENT]
    assert flight.lander.outcome == "landed"
    assert all(setpoint.velocity[2] > 0.0 for _, setpoint in flight.setpoints[climbs:])


def test_the_pilot_is_told_of_a_touch_down_that_wrong_velocities_hide() -> None:
    """Once, it pressed down for 7 s, ever harder as it seemed to sink, and told nothing."""
    flight = Drifting().engaged()
    flight.detects_landing = False
    to(flight, State.COMMITTED)
    while flight.contact_t is None:
        flight.tick()
    flight.run(6.5)
    assert any("touch-down not confirmed" in text for text in flight.texts)


def test_sight_shows_a_touch_down_that_wrong_velocities_hide() -> None:
    """With ON_GROUND said it stood under thrust for ever, and was not disarmed."""
    flight = Drifting().engaged()
    to(flight, State.COMMITTED)
    while flight.contact_t is None:
        flight.tick()
    flight.run(2.5)
    assert not flight.armed


class Drifting(Flight):
    """A flight whose autopilot's height drifts downwards from commit on."""

    drift_mps = drift_m = 0.0

    def _telemetry(self) -> list[Input]:
        if self.lander.state is State.COMMITTED:
            self.drift_mps = min(self.drift_mps + 1.5 * DT, 8.0)
        self.drift_m += self.drift_mps * DT
        return [
            replace(
                message,
                position=add(message.position, (0.0, 0.0, self.drift_m)),
                velocity=add(message.velocity, (0.0, 0.0, self.drift_mps)),
            )
            if isinstance(message, LocalPosition)
            else message
            for message in super()._telemetry()
        ]


class Biased(Flight):
    """A flight whose autopilot's height sinks all the time, as its velocity does."""

    def _telemetry(self) -> list[Input]:
        return [
            replace(
                message,
                position=add(message.position, (0.0, 0.0, 0.05 * self.t)),
                velocity=add(message.velocity, (0.0, 0.0, 0.05)),
            )
            if isinstance(message, LocalPosition)
            else message
            for message in super()._telemetry()
        ]


def test_released_on_the_pad_it_stands_level_though_its_height_drifts() -> None:
    """Once, the drift was taken for sinking, and it was left there with its thrust on."""
    flight = Biased()
    flight.detects_landing = False
    flight.distort = lambda true: replace(true, covariance=matscale(IDENTITY, 0.1**2))
    to(flight.engaged(), State.ON_PAD)
    flight.run(0.2)
    flight.visible = False
    flight.restart_autopilot()
    to(flight, State.STANDING)
    flight.run(0.9)
    assert flight.pressed


def test_a_vehicle_that_hovers_over_a_pad_in_sight_has_not_touched() -> None:
    """Once, over a deck that began to sink, it counted as on the pad up to 0.3 m above it."""
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.1:
        flight.tick()
    hovers = flight.position
    for _ in range(30):
        flight.position, flight.velocity = hovers, (0.0, 0.0, 0.0)
        flight.tick()
    assert flight.lander.state is State.COMMITTED


def test_a_vehicle_that_a_gust_held_up_and_lifts_was_not_on_the_pad() -> None:
    """Once, pressed down in the air, it was carried off by a false pad velocity, and tipped."""
    flight = Flight(pad_velocity=(2.0, 0.0, 0.0)).engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.07:
        flight.tick()

    def held(up_mps: float) -> None:
        height = flight.height
        flight.tick()
        lifted = height + up_mps * DT - flight.height
        flight.position = add(flight.position, (0.0, 0.0, -lifted))
        flight.velocity = (*flight.velocity[:2], -up_mps)

    while flight.lander.state is State.COMMITTED:
        held(0.0)
    assert flight.lander.state is State.ON_PAD
    while flight.lander.state is State.ON_PAD:
        held(0.15)
        assert flight.height < 0.22
    assert flight.lander.state is State.COMMITTED
    to(flight, State.ON_PAD)
    assert flight.distance < 0.1


def test_a_vehicle_that_was_held_up_and_sinks_on_out_of_sight_was_not_on_the_pad() -> None:
    """Over a deck that sank away it was pressed down for a second, onto what nobody had seen."""
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.1:
        flight.tick()
    flight.visible, lost_t = False, flight.t
    held = flight.position
    while flight.lander.state is State.COMMITTED:
        flight.position, flight.velocity = held, (0.0, 0.0, 0.0)
        flight.tick()
    assert flight.lander.state is State.ON_PAD
    flight.pad = add(flight.pad, (0.0, 0.0, 0.4))
    to(flight, State.WAVING_OFF)
    assert flight.t - lost_t < 1.3
    assert flight.contact_t is None
    flight.visible = True
    to(flight, State.ON_PAD)
    assert flight.height < 0.05


def test_waved_off_it_is_not_levelled_as_its_feet_come_free() -> None:
    """Once, after 1 s on a deck that began to sink, it was thrown 0.7 m high and fell beside it."""
    flight = Flight(config=Config.model_validate({"guidance": SINKS_SLOWLY})).engaged()
    to(flight, State.COMMITTED)
    while flight.height > 0.06:
        flight.tick()
    flight.silent = {Attitude, LocalPosition}
    to(flight, State.WAVING_OFF, at_most_s=0.35)
    on_pad = (*flight.position[:2], flight.pad[2] - flight.config.vehicle.gear_height_m)
    waved_off_t = flight.t
    while flight.t < waved_off_t + 1.2:
        flight.silent = flight.silent if flight.t < waved_off_t + 0.4 else set()
        flight.position, flight.velocity = on_pad, (0.0, 0.0, 0.0)
        flight.tick()
    flight.run(1.0)
    assert not flight.pressed
    assert flight.lander.state is not State.ON_PAD
    assert flight.height > 0.2


def test_levelled_as_its_thrust_lifted_it_flies_on_instead_of_falling() -> None:
    """Once, it was thrown 0.5 m high, level and without thrust, and fell beside the pad."""
    flight = without_thrust()
    ordered = len(flight.setpoints)
    for _ in range(round(0.3 / DT)):
        flight.tick()
        flight.position = add(flight.position, (0.0, 0.0, -0.5 * DT))
        flight.velocity = (*flight.velocity[:2], -0.5)
    assert len(flight.setpoints) > ordered
    assert flight.setpoints[-1][1].velocity[0] == pytest.approx(1.0, abs=0.1)


def left_standing(*, detects_landing: bool = False) -> Flight:
    """Return a flight that a false heartbeat ended on the pad, motors on, the switch low now."""
    flight = Flight()
    flight.detects_landing = detects_landing
    to(flight.engaged(), State.ON_PAD)
    flight.armed = False
    to(flight, State.SILENT)
    flight.armed = True
    flight.pulse_us = LOW
    return flight


def does_not_take_off(flight: Flight) -> None:
    """Check that a landing that begins on the pad ends there."""
    begun = len(flight.setpoints)
    assert to(flight, State.ON_PAD) == [State.SILENT, State.ON_PAD]
    flight.run(0.5)
    assert all(setpoint.velocity[2] >= 0.0 for _, setpoint in flight.setpoints[begun:])


@pytest.mark.parametrize("beside_m", [0.0, 1.5])
def test_a_landing_that_begins_on_the_pad_ends_there_and_not_beside_it(beside_m: float) -> None:
    flight = left_standing()
    flight.pad_heading += 0.2  # not as it was to be put down
    flight.pad = add(flight.pad, (0.0, beside_m, 0.0))
    flight.run(1.0)
    flight.pulse_us = HIGH
    if beside_m:
        assert to(flight, State.TRACKING) == [State.SILENT, State.TRACKING]
        flight.run(0.5)
        assert flight.lander.state is State.TRACKING
        return
    does_not_take_off(flight)
    assert flight.phases[-1] is Phase.LANDED


def test_a_landing_begun_where_the_autopilot_says_it_stands_ends_there() -> None:
    """Once, landerd restarted on the pad, believed to be above and aside of it, and climbed."""
    flight = left_standing(detects_landing=True)
    flight.pad = add(flight.pad, (0.17, 0.0, 0.09))
    flight.run(1.5)
    flight.pulse_us = HIGH
    does_not_take_off(flight)


def test_a_landing_begun_on_feet_that_seem_to_be_over_the_pad_ends_there() -> None:
    """The gear is longer than configured; a false heartbeat had ended the first landing."""
    flight = left_standing()
    flight.distort = lambda true: replace(true, position=scale(true.position, 1.6))
    flight.run(3.0)
    flight.pulse_us = HIGH
    does_not_take_off(flight)


def test_a_landing_that_begins_on_a_pad_just_come_in_sight_does_not_take_off() -> None:
    flight = left_standing()
    flight.visible = False
    flight.run(3.0)
    flight.pulse_us = HIGH
    flight.run(0.5)
    flight.visible = True
    does_not_take_off(flight)


def changes_speed(flight: Flight, last: float, by_mps2: float) -> Iterator[float]:
    """Fly on while the pad changes its speed to the last one, m/s; yield it after each step."""
    speed = flight.pad_velocity[0]
    while speed != last:
        speed += clamp(last - speed, -DT * by_mps2, DT * by_mps2)
        flight.pad_velocity = (speed, 0.0, 0.0)
        flight.tick()
        yield speed


@pytest.mark.parametrize("brake_mps2", [2.0, 4.0])
def test_on_a_pad_that_brakes_as_it_is_touched_it_goes_with_it_and_has_landed(
    brake_mps2: float,
) -> None:
    """This holds however long the estimator takes to follow the pad's velocity."""
    flight = Flight(pad_velocity=(1.5, 0.0, 0.0))
    flight.detects_landing = False
    flight.distort = lambda true: replace(true, covariance=matscale(IDENTITY, 0.1**2))
    to(flight.engaged(), State.ON_PAD)
    for _ in changes_speed(flight, 0.0, brake_mps2):
        pass
    flight.run(0.6)
    assert flight.pressed or abs(flight.order.velocity[0]) < 0.3
    flight.run(0.6)
    assert flight.pressed
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed"


def test_on_a_pad_that_brakes_faster_than_set_points_may_follow_it_is_levelled() -> None:
    """Kept at 1 m/s more than the pad's speed, a vehicle leaned back until it tipped over."""
    flight = Flight(pad_velocity=(4.0, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pitch_rate = 0.8  # not all feet are down
    for speed in changes_speed(flight, 0.0, 2.0):
        assert flight.pressed or flight.order.velocity[0] - speed < 0.9
    assert flight.pressed


def test_on_a_pad_that_starts_and_slides_under_it_it_is_levelled_as_it_leans() -> None:
    """Held where it touched, a vehicle that the pad dragged along tipped over in 1.2 s."""
    flight = Flight()
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.pitch_rate = 0.8  # not all feet are down
    speed = 0.0
    for _ in range(round(0.5 / DT)):
        speed += 4.0 * DT
        flight.pad_velocity, flight.skids = (speed, 0.0, 0.0), -0.55 * speed
        flight.pitch += 0.5 * DT
        flight.tick()
    assert flight.pressed


@pytest.mark.parametrize("speeds_mps", [(1.5, 0.0), (0.0, 1.0)], ids=["brakes", "starts"])
@pytest.mark.parametrize("by_mps2", [1.0, 4.0])
def test_on_a_pad_that_changes_its_speed_out_of_sight_it_goes_with_it_and_has_landed(
    speeds_mps: tuple[float, float], by_mps2: float
) -> None:
    """Once, the autopilot was told the pad's old velocity until the vehicle tipped over."""
    first, last = speeds_mps
    flight = Flight(pad_velocity=(first, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.visible = False
    flight.run(0.3)
    for speed in changes_speed(flight, last, by_mps2):
        assert flight.pressed or abs(flight.order.velocity[0] - speed) < 0.3 + 0.3 * by_mps2
    flight.run(0.5)
    assert flight.pressed or abs(flight.order.velocity[0] - last) < 0.2
    flight.run(0.7)
    assert flight.pressed
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed"


@pytest.mark.parametrize(("by_mps2", "then_s"), [(1.0, 0.0), (100.0, 0.8)])
def test_in_sight_again_a_pad_that_stopped_unseen_is_not_driven_across(
    by_mps2: float, then_s: float
) -> None:
    flight = Flight(pad_velocity=(1.5, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.COMMITTED)
    flight.visible = False
    to(flight, State.ON_PAD)
    flight.run(0.3)
    flight.pitch_rate = 0.8  # not all feet are down
    for _ in changes_speed(flight, 0.0, by_mps2):
        pass
    flight.run(then_s)
    flight.visible = True
    orders = flight.run(0.5)
    assert flight.pressed if by_mps2 > 2.0 else orders
    assert all(order.velocity[0] < 0.3 for order in orders)


@pytest.mark.parametrize(("first_mps", "by_mps2", "then_s"), [(0.9, 0.7, 0.0), (1.5, 4.0, 0.9)])
def test_on_a_pad_that_has_braked_stale_data_are_no_reason_to_drive_on(
    first_mps: float, by_mps2: float, then_s: float
) -> None:
    flight = Flight(pad_velocity=(first_mps, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    flight.visible = False
    flight.pitch_rate = 0.8  # not all feet are down
    for _ in changes_speed(flight, 0.0, by_mps2):
        pass
    flight.run(then_s)
    flight.silent = {Attitude}
    orders = flight.run(0.5)
    assert flight.pressed if by_mps2 > 2.0 else orders
    assert all(order.velocity[0] < 0.5 for order in orders)


def test_blown_across_a_pad_that_drives_on_it_is_not_taken_for_carried() -> None:
    flight = Flight(pad_velocity=(3.0, 0.0, 0.0))
    flight.detects_landing = False
    flight.skids = -0.5
    to(flight.engaged(), State.ON_PAD)
    flight.run(1.0)
    assert flight.pressed == []
    assert flight.order.velocity[0] == pytest.approx(3.0, abs=0.2)


def test_a_pad_that_is_seen_to_speed_up_under_feet_that_slide_is_gone_with() -> None:
    """Once, the velocity at the touch was kept for as long as the pad slid under the vehicle."""
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0))
    flight.detects_landing = False
    flight.skids = -0.3
    to(flight.engaged(), State.ON_PAD)
    flight.pad_velocity, flight.skids = (2.0, 0.0, 0.0), -1.3
    flight.run(1.2)
    assert flight.pressed == []
    assert flight.order.velocity[0] == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("is_seen", [True, False], ids=["for a moment", "by nobody"])
def test_a_pad_that_hardly_is_seen_to_speed_up_under_the_feet_is_gone_with_as_before(
    is_seen: bool,
) -> None:
    flight = Flight(pad_velocity=(1.0, 0.0, 0.0))
    flight.detects_landing = False
    flight.skids = -0.3
    to(flight.engaged(), State.ON_PAD)
    flight.visible = is_seen
    flight.pad_velocity, flight.skids = (2.0, 0.0, 0.0), -1.3
    flight.run(0.3 if is_seen else 1.2)
    flight.pad_velocity, flight.skids = (1.0, 0.0, 0.0), -0.3
    orders = flight.run(0.5)
    assert [o.velocity[0] for o in orders] == pytest.approx([1.0] * len(orders), abs=0.2)


def test_a_vehicle_that_slid_across_a_braking_pad_goes_with_it_once_it_stands() -> None:
    """Once, it was pressed on with the former velocity for 2 s, across a pad that stood."""
    flight = Flight(pad_velocity=(0.5, 0.0, 0.0))
    flight.detects_landing = False
    flight.distort = lambda true: replace(true, covariance=matscale(IDENTITY, 0.1**2))
    to(flight.engaged(), State.ON_PAD)
    flight.pad_velocity, flight.skids = (0.0, 0.0, 0.0), 1.0
    flight.run(0.5)
    flight.skids = 0.0
    flight.run(0.6)
    assert flight.pressed or abs(flight.order.velocity[0]) < 0.2
    flight.run(0.6)
    assert flight.pressed


def test_a_vehicle_left_behind_by_the_pad_has_not_landed_on_it() -> None:
    """This holds however uncertain the pad's velocity was at the touch."""
    flight = Flight()
    flight.detects_landing = False
    flight.distort = lambda true: replace(true, covariance=matscale(IDENTITY, 0.1**2))
    to(flight.engaged(), State.ON_PAD)
    flight.pad_velocity, flight.skids = (0.8, 0.0, 0.0), -0.8
    flight.run(2.5)
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed_off_pad"


@pytest.mark.parametrize(("slides_mps", "outcome"), [(-4.0, "landed_off_pad"), (0.0, "landed")])
def test_levelled_as_it_slid_and_blown_off_then_it_has_not_landed_on_the_pad(
    slides_mps: float, outcome: str
) -> None:
    """From a pad of 10 m/s; another pad of 4 m/s brakes under what stands on it."""
    flight = Flight(pad_velocity=(4.0, 0.0, 0.0))
    flight.detects_landing = False
    to(flight.engaged(), State.ON_PAD)
    while not flight.pressed:
        flight.tick()
    if slides_mps:
        flight.skids, flight.visible = slides_mps, False
    else:
        flight.pad_velocity = (0.0, 0.0, 0.0)
    flight.run(0.2)
    assert flight.lander.needs_sight or not slides_mps  # of what is seen to be taken along not
    flight.run(1.5)
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == outcome


def test_a_pad_that_turns_off_under_the_vehicle_that_stands_on_it_stays_in_the_picture() -> None:
    """The lens was turned to where it would have driven: disarmed beside the pad, it was said."""
    flight = without_thrust(2.0)
    flight.pad_velocity, flight.visible = (0.0, 2.0, 0.0), False
    flight.run(2.0)
    right, down, ahead = flight.sighting().markers[0].solutions[0].position
    assert math.hypot(right, down) < 0.6 * ahead
    flight.visible, flight.detects_landing = True, True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed"


def test_it_stays_in_the_picture_too_while_the_released_vehicle_is_levelled() -> None:
    flight = without_thrust(2.0)
    flight.pulse_us = LOW
    flight.pad_velocity, flight.visible = (0.0, 2.0, 0.0), False
    to(flight, State.STANDING, at_most_s=0.3)
    while flight.lander.state is State.STANDING:
        right, down, ahead = flight.sighting().markers[0].solutions[0].position
        assert math.hypot(right, down) < 0.6 * ahead
        flight.tick()


def test_levelled_as_it_is_dragged_off_and_granted_again_it_has_not_landed_on_the_pad() -> None:
    """Levelled it counted as standing, and 0.5 m of slide at 0.8 m/s were not noticed."""
    flight = Flight()
    flight.lean = math.radians(18.0)
    flight.detects_landing = False
    to(flight.engaged(), State.COMMITTED)
    while flight.contact_t is None:
        flight.tick()
    flight.pulse_us, flight.skids, flight.visible = LOW, -0.8, False
    while not flight.pressed:
        flight.tick()
    flight.run(0.5)
    flight.skids, flight.pulse_us = 0.0, HIGH
    to(flight, State.ON_PAD, at_most_s=0.3)
    flight.run(0.5)
    flight.detects_landing = True
    to(flight, State.SILENT)
    assert flight.lander.outcome == "landed_off_pad"


def test_a_core_that_fails_while_it_slides_on_the_pad_leaves_it_pressed_down(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A stop relative to the ground tips what slides over, on a fast pad."""
    monkeypatch.setattr("tests.scripted_flight.LANDED_AFTER_S", 0.1)
    flight = Flight().engaged().until_contact()
    flight.skids = -0.8
    while not flight.disarm_orders:
        flight.tick()
    assert flight.pressed == []
    last = flight.lander.last_orders
    assert last is not None
    assert isinstance(last.then, PressDown)


def test_gusts_that_keep_it_from_descending_are_told() -> None:
    """Once it was kept at 4 m for 30 s and handed back, and nothing was said meanwhile."""
    flight = Flight().engaged().until(Phase.DESCENT)
    while flight.height > 4.0:
        flight.tick()
    before = len(flight.texts)
    flight.run_in_gusts(20.0)
    told = [text for text in flight.texts[before:] if "descends within 0." in text]
    assert told, flight.texts[before:]


def test_a_search_that_finds_nothing_ends_with_stop_orders_and_a_hand_back() -> None:
    config = Config.model_validate({"guidance": {"lost": {"give_up_s": 2.0}}})
    flight = Flight(config=config).engaged()
    flight.visible = False
    gone = to(flight, State.RELEASING)
    assert gone == [State.TRACKING, State.SEARCHING, State.RELEASING]
    assert flight.lander.outcome == "handed_back"
    assert flight.lander.reason == "pad not found"
    assert flight.setpoints[-1][1] == STOP


def test_disarmed_after_commit_but_before_contact_counts_as_taken_over() -> None:
    flight = Flight().engaged()
    to(flight, State.COMMITTED)
    flight.armed = False
    to(flight, State.SILENT)
    assert flight.lander.outcome == "taken over"


def test_disarmed_on_the_pad_without_on_ground_is_not_called_landed() -> None:
    flight = Flight().engaged()
    to(flight, State.ON_PAD)
    flight.armed = False
    to(flight, State.SILENT)
    assert flight.lander.outcome == "taken over"


def test_with_output_landing_target_it_stays_silent_though_the_gate_is_open() -> None:
    config = Config.model_validate({"guidance": {"output": "landing_target"}})
    flight = Flight(config=config)
    flight.run(1.1)
    flight.pulse_us = HIGH
    assert flight.run(2.0) == []
    assert flight.lander.state is State.SILENT
    assert flight.lander.phase is Phase.NOT_LANDING


def test_metres_above_a_fast_pad_left_behind_the_switch_stops_it_at_once() -> None:
    """That it was just over the pad when sight ended no longer matters."""
    flight = Flight(pad_velocity=(4.0, 0.0, 0.0)).engaged()
    to(flight, State.COMMITTED)
    flight.visible = False
    flight.silent.add(Attitude)
    flight.run(0.3)
    flight.silent.clear()
    flight.run(5.0)
    assert flight.lander.state is State.SEARCHING
    last = flight.lander.last_orders
    assert last is not None
    assert last.first is None
    flight.pulse_us = LOW
    to(flight, State.RELEASING, at_most_s=0.2)
    assert set(flight.run(3.0)) == {STOP}


def test_no_landing_is_given_back_just_over_a_fast_pad() -> None:
    """If its time ran out there and it were stopped, its feet would touch at the pad's speed."""

    def over_pad(total_s: float) -> Flight:
        descent = {"commit_slip_mps": 0.001}  # never fit to commit
        config = Config.model_validate(
            {"guidance": {"descent": descent, "lost": {"total_s": total_s}}}
        )
        flight = Flight(config=config, pad_velocity=(5.0, 0.0, 0.0))
        to(flight.engaged(), State.TRACKING)
        return flight

    flight = over_pad(120.0)
    began = flight.t
    while flight.height > 0.12:
        flight.tick()
    low_s = flight.t - began
    for later_s in (0.3, 0.4, 0.5, 0.6):
        flight = over_pad(low_s + later_s)
        gone = to(flight, State.RELEASING)
        assert flight.lander.outcome == "handed_back"
        assert State.COMMITTED not in gone
        assert flight.height > 0.18
        assert flight.contact_t is None


def test_time_released_does_not_count_in_the_time_of_the_landing() -> None:
    """Once, RC was stale for two minutes, and then the pilot read "no landing in time"."""
    flight = Flight(position=(-15.0, 2.0, -8.0)).engaged()
    flight.silent.add(RcChannels)
    to(flight, State.SILENT)
    flight.run(flight.config.guidance.lost.total_s)
    flight.silent.clear()
    to(flight, State.ON_PAD)
    assert flight.lander.outcome is None
    assert not any("take over" in text for text in flight.texts)


@pytest.mark.parametrize("gap_s", [0.1, 0.5, 0.9])
def test_each_time_that_it_may_not_fly_on_from_the_pad_it_is_stopped_for_as_long(
    gap_s: float,
) -> None:
    """Once, after RC was stale and back, the second stop lasted only what the first had left."""
    flight = Flight().engaged()
    flight.until_contact()
    flight.detects_landing = False
    flight.run(1.0)
    flight.silent.add(RcChannels)
    to(flight, State.STANDING)
    flight.silent.clear()
    to(flight, State.ON_PAD)
    flight.run(gap_s)
    flight.pulse_us = LOW
    to(flight, State.STANDING)
    began = flight.t
    to(flight, State.SILENT)
    assert flight.t - began == pytest.approx(flight.config.guidance.release_s, abs=2 * DT)


def test_a_vehicle_on_the_plate_whose_position_goes_stale_has_landed_there() -> None:
    """Once, its last velocity carried it on below the pad: "disarmed beside the pad"."""
    flight = Flight().engaged().until(Phase.LANDED)
    while flight.height > 0.05:
        flight.tick()
    flight.silent.add(LocalPosition)
    flight.run(6.0)
    assert flight.lander.outcome == "landed"


def test_a_control_step_that_comes_late_does_not_end_the_sight_of_a_young_picture() -> None:
    """Once, after the loop hung for 0.475 s, a picture 0.05 s old counted as a loss of sight."""
    flight = Flight(position=(-3.0, 0.0, -4.0)).engaged()
    flight.until(Phase.DESCENT)
    while flight.height > 1.2:
        flight.tick()
    flight.held_up(0.475)
    assert flight.lander.state is State.TRACKING
    assert flight.lander.aborts == 0


@pytest.mark.parametrize("rc_is_stale", [False, True])
def test_descents_that_are_broken_off_in_sight_are_limited_in_number(rc_is_stale: bool) -> None:
    """A pad that jumps aside after every commit is given up, however well it is seen.

    RC that is stale for a while after each of them does not restart the count either.
    """
    config = Config.model_validate({"guidance": {"lost": {"retries": 2}}})
    flight = Flight(config=config).engaged()
    committed, end = 0, flight.t + 60.0
    while not any("take over" in text for text in flight.texts):
        assert flight.t < end
        before = flight.lander.state
        flight.tick()
        if flight.lander.state is State.COMMITTED is not before:
            committed += 1
            flight.pad = add(flight.pad, (0.0, 0.9, 0.0))
            if rc_is_stale:
                to(flight, State.WAVING_OFF, at_most_s=3.0)
                flight.run(1.5)
                flight.silent.add(RcChannels)
                flight.run(2.0)
                flight.silent.clear()
    assert committed == 3


@pytest.mark.parametrize("every_s", [0.6, 0.8])
def test_rc_that_is_stale_now_and_then_does_not_hold_the_vehicle_for_ever(every_s: float) -> None:
    flight = Flight().engaged()
    flight.run(2.0)
    flight.visible = False
    telemetry, last = flight._telemetry, flight.t

    def seldom() -> list[Input]:
        nonlocal last
        messages = telemetry()
        if flight.t - last >= every_s:
            last = flight.t
            return messages
        return [m for m in messages if not isinstance(m, RcChannels)]

    flight._telemetry = seldom  # type: ignore[method-assign]
    to(flight, State.SILENT, at_most_s=40.0)
    assert flight.lander.outcome in ("released", "handed_back")


@pytest.mark.parametrize("ground_m", [-20.0, 0.0, 20.0])
def test_a_search_climbs_as_far_wherever_the_autopilots_origin_is(ground_m: float) -> None:
    """It begins while the position is stale, so the height it starts from is known later."""
    flight = Flight(position=(-6.0, 2.0, ground_m - 8.0))
    flight.pad = (0.0, 0.0, ground_m)
    flight.engaged()
    flight.run(3.0)
    flight.visible = False
    flight.silent.add(LocalPosition)
    flight.run(0.8)
    flight.silent.clear()
    began, highest = flight.height, 0.0
    while flight.lander.state is not State.SILENT:
        flight.tick()
        highest = max(highest, flight.height)
    assert highest - began == pytest.approx(5.0, abs=0.5)
