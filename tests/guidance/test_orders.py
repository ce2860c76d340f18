"""The commands of one control step: their order, and texts that are not repeated."""

import pytest

from landerd.config.models import LimitsSection
from landerd.guidance import pilot_texts
from landerd.guidance.orders import Orders
from landerd.messages import (
    Disarm,
    Phase,
    PhaseChange,
    PressDown,
    Setpoint,
    Severity,
    StatusText,
)

DT = 0.025


def begun(now: float = 10.0) -> Orders:
    orders = Orders(LimitsSection())
    orders.begin(now, DT)
    return orders


def test_commands_come_in_the_order_they_were_given_and_belong_to_one_step() -> None:
    orders = begun()
    orders.disarm()
    orders.stop()
    orders.enter(Phase.APPROACH, "pad in sight")
    first = orders.commands
    assert first == [
        Disarm(),
        Setpoint((0.0, 0.0, 0.0), 0.0),
        PhaseChange(Phase.APPROACH, "pad in sight"),
        StatusText(Severity.NOTICE, "landerd: approach: pad in sight"),
    ]
    orders.begin(10.0 + DT, DT)
    assert orders.commands == []
    assert len(first) == 4


def test_a_phase_is_told_when_it_begins_and_its_reason_kept_up_to_date() -> None:
    orders = begun()
    orders.enter(Phase.DESCENT, "0.1 m away, 2.0 m up")
    orders.begin(10.0 + DT, DT)
    orders.enter(Phase.DESCENT, "0.1 m away, 1.9 m up")
    assert orders.commands == []
    assert (orders.phase, orders.reason) == (Phase.DESCENT, "0.1 m away, 1.9 m up")


@pytest.mark.parametrize(
    "reason",
    [
        pilot_texts.OFF_CLIMBING.format(distance=0.63),
        pilot_texts.NO_HEADING_CLIMBING,
        pilot_texts.UNSURE.format(known=1.2, radius=0.4),
    ],
)
def test_a_phase_whose_reason_is_long_is_not_told_cut_off(reason: str) -> None:
    orders = begun()
    orders.enter(Phase.CLOSE_APPROACH, reason)
    told = [c.text for c in orders.commands if isinstance(c, StatusText)]
    assert told == [f"landerd: {reason}"]


def test_out_of_a_landing_every_new_reason_is_told() -> None:
    orders = begun()
    for reason in ("not armed", "RC 11 is low"):
        orders.enter(Phase.NOT_LANDING, reason)
        orders.enter(Phase.NOT_LANDING, reason)
    told = [c.text for c in orders.commands if isinstance(c, StatusText)]
    assert told == ["landerd: not armed", "landerd: RC 11 is low"]


@pytest.mark.parametrize(("after", "times"), [(0.9, 1), (1.1, 2)])
def test_the_same_line_is_told_once_a_second_at_most(after: float, times: int) -> None:
    orders = begun(10.0)
    orders.say(Severity.CRITICAL, "take over")
    told = list(orders.commands)
    orders.begin(10.0 + after, DT)
    orders.say(Severity.CRITICAL, "take over")
    assert len(told + orders.commands) == times


@pytest.mark.parametrize(("pause", "goes_on"), [(0.3, True), (0.7, False)])
def test_after_a_pause_set_points_begin_at_the_vehicles_velocity(
    pause: float, goes_on: bool
) -> None:
    orders = begun(10.0)
    orders.fly((0.0, 0.0, 0.0), 0.0, may_descend=False)
    orders.begin(10.0 + pause, DT)
    orders.go_on_from((3.0, 0.0, 0.0))
    assert orders.velocity[0] == (0.0 if goes_on else 3.0)


def test_after_a_stop_orders_go_on_from_the_velocity_still_flown() -> None:
    orders = begun(10.0)
    orders.stop()
    orders.begin(10.0 + DT, DT)
    orders.go_on_from((3.0, 0.0, 0.0))
    assert orders.velocity[0] == 3.0


def test_stopped_for_a_moment_it_goes_on_braking_its_descent() -> None:
    """Once, with a switch that flickered, it came down at 1 m/s to 1.4 m: each stop sped it up."""
    orders = begun(10.0)
    orders.go_on_from((0.0, 0.0, 1.0))
    orders.fly((0.0, 0.0, 0.5), 0.0, may_descend=True)
    ordered = orders.velocity[2]
    for tick in range(1, 20, 2):
        orders.begin(10.0 + tick * DT, DT)
        orders.stop()
        orders.begin(10.0 + (tick + 1) * DT, DT)
        orders.go_on_from((0.0, 0.0, 1.0))  # it lags behind
        orders.fly((0.0, 0.0, 0.5), 0.0, may_descend=True)
        assert orders.velocity[2] < ordered
        ordered = orders.velocity[2]


def test_stopped_for_long_it_goes_on_from_the_descent_still_flown() -> None:
    orders = begun(10.0)
    orders.fly((0.0, 0.0, 0.0), 0.0, may_descend=False)
    orders.begin(10.0 + DT, DT)
    orders.stop()
    orders.begin(11.0, DT)
    orders.go_on_from((0.0, 0.0, 0.3))
    assert orders.velocity[2] == 0.3


def test_the_order_to_stand_level_sets_the_velocity_to_zero() -> None:
    orders = begun()
    orders.go_on_from((3.0, 0.0, 0.5))
    orders.stand_level(0.7, (0.0, 0.0, 0.0))
    assert orders.commands == [PressDown(0.7)]
    assert orders.velocity == (0.0, 0.0, 0.0)


def test_after_standing_level_on_a_moving_pad_set_points_begin_at_its_velocity() -> None:
    # From rest it would be two seconds late, and tip over.
    orders = begun()
    orders.stand_level(0.7, (5.0, 1.0, 0.2))
    orders.fly((5.0, 1.0, 0.3), 0.0, may_descend=True)
    assert orders.velocity[:2] == (5.0, 1.0)
    assert 0.0 < orders.velocity[2] < 0.1


def test_the_request_to_move_the_switch_is_repeated_every_10_s() -> None:
    orders, told = begun(), []
    for tick in range(round(25.0 / DT)):
        orders.begin(10.0 + tick * DT, DT)
        orders.enter(Phase.NOT_LANDING, "move RC 11 low, then high")
        told += [tick * DT for c in orders.commands if isinstance(c, StatusText)]
    assert told == pytest.approx([0.0, 10.0, 20.0])
    for tick in range(round(25.0 / DT)):
        orders.begin(40.0 + tick * DT, DT)
        orders.enter(Phase.NOT_LANDING, "RC 11 is low")
        told += [tick * DT for c in orders.commands if isinstance(c, StatusText)]
    assert len(told) == 4


def test_a_loss_that_repeats_within_a_second_is_told_again_when_it_lasts() -> None:
    """Once, of a pad lost, found and lost within a second, the last text said "approach"."""
    orders = begun()
    now, told = 10.0, []
    for phase, reason, seconds in (
        (Phase.NOT_LANDING, "pad not in sight, climbing", 0.2),
        (Phase.APPROACH, "pad in sight", 0.3),
        (Phase.NOT_LANDING, "pad not in sight, climbing", 3.0),
    ):
        for _ in range(round(seconds / DT)):
            now += DT
            orders.begin(now, DT)
            orders.enter(phase, reason)
            told += [(now, c.text) for c in orders.commands if isinstance(c, StatusText)]
    again = [t for t, text in told if text == "landerd: pad not in sight, climbing"]
    assert again == pytest.approx([10.0 + DT, 11.0 + DT], abs=2 * DT)


def test_a_phase_that_begins_again_within_a_second_is_told_again_when_it_lasts() -> None:
    """Otherwise the last text says that it holds, while it flies."""
    orders = begun()
    told = []
    for i in range(80):
        now = 10.0 + i * DT
        orders.begin(now, DT)
        if 20 <= i < 24:
            orders.enter(Phase.NOT_LANDING, "pad not in sight, holding")
        else:
            orders.enter(Phase.APPROACH, "pad in sight")
        told += [(now, c.text) for c in orders.commands if isinstance(c, StatusText)]
    assert told == [
        (10.0, "landerd: approach: pad in sight"),
        (10.5, "landerd: pad not in sight, holding"),
        (11.0, "landerd: approach: pad in sight"),
    ]
