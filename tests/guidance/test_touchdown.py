import math
from dataclasses import replace

import numpy as np
import pytest

from landerd.config.models import AutopilotSection, Config
from landerd.guidance.states import Event
from landerd.guidance.touchdown import ContactMotion, Touchdown
from landerd.messages import Landed

DT = 0.025
GENTLE = 0.3  # m/s


def make_touchdown(**autopilot: float) -> Touchdown:
    return Touchdown(Config(autopilot=AutopilotSection.model_validate(autopilot)))


class Descent:
    """A touch-down that is stepped at the control rate from commit on."""

    def __init__(self) -> None:
        self.touchdown = make_touchdown()
        self.t = 50.0
        self.touchdown.begin(self.t)

    def go_on(
        self,
        seconds: float,
        *,
        sink_rate: float = 0.3,
        ordered: float = 0.3,
        sighting_age: float = 0.05,
        clearance: float = 0.02,
        landed: Landed = Landed.IN_AIR,
    ) -> Event | None:
        """Sink for some time; return the event that ends the descent, None without one."""
        for _ in range(round(seconds / DT)):
            self.t += DT
            self.touchdown.watch(self.t, (sink_rate, ordered))
            event = self.touchdown.step(self.t, sighting_age, clearance, landed)
            if event is not None:
                return event
        return None

    def to_contact(self) -> "Descent":
        self.go_on(0.5)
        assert self.go_on(0.5, sink_rate=0.0) is Event.CONTACT
        return self


def test_sinking_as_ordered_is_no_contact() -> None:
    assert Descent().go_on(3.0) is None


def test_a_vehicle_that_is_slow_to_answer_a_quicker_order_has_not_touched() -> None:
    descent = Descent()
    assert descent.go_on(1.0, sink_rate=0.1, ordered=0.1) is None
    for i in range(16):  # 1 m/s^2 of the order, answered 0.4 s late
        assert descent.go_on(DT, sink_rate=0.1, ordered=0.1 + i * DT) is None
    assert descent.go_on(2.0, sink_rate=0.4, ordered=0.5) is None


def test_on_a_deck_of_uncertain_heave_less_slowing_down_counts_as_contact() -> None:
    # It stands; the deck is believed to come up by 0.1 m/s more than it does.
    touchdown = make_touchdown()
    touchdown.begin(0.0)
    for i in range(50):
        touchdown.watch(i * DT, (0.0, 0.3), -0.1, unsure=0.1)
    assert touchdown.step(50 * DT, 0.05, 0.0, Landed.IN_AIR) is Event.CONTACT
    # In the air nothing makes contact of what sinks as ordered.
    descent = Descent()
    for _ in range(80):
        descent.t += DT
        descent.touchdown.watch(descent.t, (0.28, 0.3), unsure=0.5)
        assert descent.touchdown.step(descent.t, 0.05, 0.0, Landed.IN_AIR) is None


def test_much_slower_than_ordered_for_a_fifth_of_a_second_is_contact() -> None:
    descent = Descent()
    descent.go_on(0.6)
    start = descent.t
    assert descent.go_on(1.0, sink_rate=0.05) is Event.CONTACT
    assert 0.2 <= descent.t - start <= 0.2 + 2 * DT
    assert descent.touchdown.has_touched


def test_a_deck_that_comes_up_just_after_commit_is_known_to_touch_as_soon() -> None:
    """Once, contact was awaited for 0.4 s; sight was lost, and it climbed off the deck."""
    descent = Descent()
    assert descent.go_on(0.1) is None
    assert descent.go_on(0.25, sink_rate=0.0) is Event.CONTACT


def test_a_short_slow_moment_is_no_contact() -> None:
    descent = Descent()
    descent.go_on(0.6)
    for _ in range(10):
        assert descent.go_on(0.15, sink_rate=0.0) is None
        assert descent.go_on(0.1, sink_rate=0.3) is None


def test_a_vehicle_that_committed_from_a_hover_is_not_thought_to_stand_on_the_pad() -> None:
    # How ArduCopter answers an order of 0.3 m/s: measured share of the order after each 0.1 s.
    answer = (0.0, 0.011, 0.148, 0.388, 0.597, 0.759, 0.881, 0.95, 1.028, 1.05, 1.087)
    descent = Descent()
    for share in answer:
        assert descent.go_on(0.1, sink_rate=0.3 * share, ordered=0.3) is None


def test_on_ground_from_the_autopilot_is_contact_as_soon_as_it_sinks_slower() -> None:
    descent = Descent()
    descent.go_on(0.6)
    assert descent.go_on(DT, sink_rate=0.05, landed=Landed.ON_GROUND) is Event.CONTACT


def test_on_ground_is_not_believed_while_it_sinks_as_ordered() -> None:
    assert Descent().go_on(3.0, landed=Landed.ON_GROUND) is None


def test_blind_after_commit_it_goes_on_for_less_than_a_second_and_then_aborts() -> None:
    descent = Descent()
    assert descent.go_on(DT, sighting_age=0.7) is None
    assert descent.go_on(DT, sighting_age=1.0) is Event.SIGHT_LOST
    assert not descent.touchdown.has_touched


def test_blind_in_the_air_it_aborts_while_contact_could_still_have_been_noticed_in_time() -> None:
    assert Descent().go_on(DT, sighting_age=0.8) is Event.SIGHT_LOST


def test_contact_is_not_believed_more_than_a_legs_length_above_the_pad() -> None:
    descent = Descent()
    descent.go_on(0.6)
    assert descent.go_on(0.5, sink_rate=0.0, clearance=0.15) is None
    assert descent.go_on(0.5, clearance=0.15, landed=Landed.ON_GROUND) is None
    assert descent.go_on(0.3, sink_rate=0.0, clearance=0.09) is Event.CONTACT


def test_above_the_largest_contact_height_a_slow_moment_is_no_contact() -> None:
    touchdown = Descent().touchdown
    for i in range(40):
        t = 50.0 + i * DT
        touchdown.watch(t, (0.0, GENTLE))
        assert touchdown.step(t, 0.05, 0.08, Landed.IN_AIR, highest_m=0.04) is None
    assert touchdown.step(t, 0.05, 0.03, Landed.IN_AIR, highest_m=0.04) is Event.CONTACT


def test_blind_on_the_pad_is_contact_all_the_same() -> None:
    descent = Descent()
    descent.go_on(0.5)
    for age in (0.6, 0.7, 0.8, 0.9, 1.0, 1.1):
        event = descent.go_on(2 * DT, sink_rate=0.0, sighting_age=age - 0.1)
        if event is not None:
            break
    assert event is Event.CONTACT


def test_disarm_is_asked_for_only_on_the_ground_and_until_it_is_done() -> None:
    touchdown = Descent().to_contact().touchdown
    for landed in (Landed.UNDEFINED, Landed.IN_AIR, Landed.TAKEOFF, Landed.LANDING):
        assert not touchdown.disarm_due(60.0, landed)
    asked = [
        60.0 + i * DT for i in range(81) if touchdown.disarm_due(60.0 + i * DT, Landed.ON_GROUND)
    ]
    assert asked == pytest.approx([60.0, 60.5, 61.0, 61.5, 62.0])


def test_an_autopilot_that_says_it_is_in_the_air_again_has_not_refused_to_disarm() -> None:
    touchdown = Descent().to_contact().touchdown
    assert touchdown.disarm_due(60.0, Landed.ON_GROUND)
    assert touchdown.is_refused(61.1)
    assert not touchdown.disarm_due(61.2, Landed.IN_AIR)
    assert not touchdown.is_refused(61.2)
    assert touchdown.disarm_due(63.0, Landed.ON_GROUND)
    assert not touchdown.is_refused(63.5)
    assert touchdown.is_refused(64.1)


def test_on_ground_reported_sooner_than_the_autopilot_can_know_does_not_disarm() -> None:
    # ArduCopter's land detector takes a second; what was taken for contact may be a gust.
    descent = Descent().to_contact()
    assert not descent.touchdown.disarm_due(descent.t + 0.4, Landed.ON_GROUND)
    assert descent.touchdown.disarm_due(descent.t + 0.6, Landed.ON_GROUND)


def test_five_seconds_without_on_ground_is_unconfirmed() -> None:
    descent = Descent().to_contact()
    touchdown, contact = descent.touchdown, descent.t
    assert not touchdown.unconfirmed(contact + 4.9, Landed.IN_AIR)
    assert touchdown.unconfirmed(contact + 5.1, Landed.IN_AIR)
    assert not touchdown.unconfirmed(contact + 5.1, Landed.ON_GROUND)


STILL = ContactMotion(
    feet_down=0.0,
    foot_down=0.0,
    pad_down=0.0,
    sink_rate=0.0,
    slip=0.0,
    lean=0.0,
    tilt=0.0,
    roll_pitch_rate=0.0,
    pad_speed=0.0,
    heave=0.0,
    sigma_heave=0.0,
    fastest_heave=0.0,
)


class Standing:
    """A touch-down with contact at 10 s, stepped at the control rate."""

    def __init__(self, **autopilot: float) -> None:
        self.touchdown = make_touchdown(**autopilot)
        self.touchdown.begin(0.0)
        self.t, self.down, self.pad_down = 10.0, -0.5, -0.5
        self.touchdown.watch(self.t - DT, (GENTLE, GENTLE))
        self.touchdown.watch(self.t, (0.0, GENTLE))
        self.touchdown.step(self.t, 0.0, 0.0, Landed.ON_GROUND)

    def level(
        self,
        seconds: float,
        *,
        sinks: float = 0.0,
        landed: Landed = Landed.IN_AIR,
        tips: bool = False,
        released: bool = False,
        **motion: float,
    ) -> list[bool]:
        """Return for each step of this time whether it is to stand level; motion: not STILL."""
        due = []
        moves = replace(STILL, **motion)
        for _ in range(round(seconds / DT)):
            self.t += DT
            self.down += sinks * DT
            self.pad_down += moves.heave * DT
            feet = {"feet_down": self.down, "foot_down": self.down}
            moves = replace(moves, **feet, pad_down=self.pad_down)
            ordered = GENTLE + max(0.0, moves.heave)
            due.append(
                self.touchdown.level_due(
                    self.t, moves, ordered, landed, tips=tips, released=released
                )
            )
        return due


def test_a_vehicle_that_rises_gently_as_its_thrust_comes_back_is_not_levelled_in_the_air() -> None:
    standing = Standing()
    assert not any(standing.level(0.6, roll_pitch_rate=1.0))
    assert not any(standing.level(0.7, sinks=-0.2, sink_rate=-0.2))
    assert not any(standing.level(0.2, sinks=-0.1, sink_rate=-0.1))


def test_a_levelled_vehicle_goes_up_by_its_thrust_for_a_moment_and_later_with_its_pad() -> None:
    """Once, a pad that was lifted gave it thrust again, and it was not disarmed for two seconds."""
    standing = Standing()
    assert standing.level(0.75)[-1]
    assert not standing.level(0.3, sinks=-0.5, sink_rate=-0.5)[-1]  # its thrust came back just then
    standing = Standing()
    assert standing.level(1.5)[-1]
    assert all(standing.level(1.9, sinks=-0.5, sink_rate=-0.5, landed=Landed.ON_GROUND))
    assert standing.touchdown.disarm_due(standing.t, Landed.ON_GROUND)


def test_a_deck_that_heaves_carries_a_vehicle_up_and_it_is_levelled_all_the_same() -> None:
    standing = Standing()
    assert any(standing.level(1.0, sinks=-0.2, sink_rate=-0.2, heave=-0.2, fastest_heave=0.2))


def test_a_deck_that_begins_to_heave_after_the_touch_carries_it_up_too() -> None:
    """Once, it counted as lifted off every half second, and was disarmed 1.5 s late."""
    standing = Standing()
    assert any(standing.level(1.0, sinks=-0.2, sink_rate=-0.2, heave=-0.2, sigma_heave=0.09))
    assert standing.touchdown.disarm_due(standing.t, Landed.ON_GROUND)


def test_it_stands_level_soon_after_contact_and_stays_so() -> None:
    standing = Standing()
    assert not any(standing.level(0.5))
    assert all(standing.level(1.0)[10:])
    assert all(standing.level(1.0, slip=1.0, roll_pitch_rate=1.0))
    assert all(standing.level(1.0, landed=Landed.ON_GROUND))


@pytest.mark.parametrize(
    ("slip", "roll_pitch_rate"),
    [(0.3, 0.0), (0.0, 0.8), (math.inf, math.inf), (math.nan, math.nan)],
)
def test_a_vehicle_that_slips_or_tips_is_levelled_only_if_on_ground_is_late(
    slip: float, roll_pitch_rate: float
) -> None:
    # With thrust left and one edge down, levelling would let the wind carry it away.
    standing = Standing()
    assert not any(standing.level(2.4, slip=slip, roll_pitch_rate=roll_pitch_rate))
    assert all(standing.level(1.0, slip=slip, roll_pitch_rate=roll_pitch_rate)[8:])


@pytest.mark.parametrize(("slip", "waits_s"), [(0.2, 0.6), (0.5, 0.35), (0.9, 2.5)])
def test_a_vehicle_that_leaned_and_then_slides_lying_flat_is_levelled(
    slip: float, waits_s: float
) -> None:
    """Once, half lifted by its thrust, it slid on in the wind for 2 s, and off the plate."""
    standing = Standing()
    standing.touchdown.descent(math.radians(20.0))
    assert not any(standing.level(0.25, slip=slip, lean=0.2, roll_pitch_rate=0.8))
    assert not any(standing.level(waits_s - 0.3, slip=slip))
    assert all(standing.level(1.0, slip=slip)[4:])


def test_a_vehicle_that_slides_down_a_tilted_plate_is_levelled_as_soon_as_on_a_level_one() -> None:
    """Once, each centimetre down the slope counted as settling, and it slid off the plate."""
    slope, slip = math.radians(10.0), 0.28
    standing = Standing()
    standing.touchdown.descent(math.radians(20.0))
    down = slip * math.tan(slope)
    standing.level(0.25, slip=slip, lean=0.2, roll_pitch_rate=0.8)
    sliding = standing.level(1.0, slip=slip, tilt=slope, sinks=down, sink_rate=down)
    assert all(sliding[18:])


def test_a_rocking_vehicle_that_is_dragged_off_is_levelled_once_it_lies_on_the_plate() -> None:
    """Once, landerd waited until it rocked no more: it was dragged off the plate and tipped."""
    standing = Standing()
    standing.touchdown.descent(math.radians(20.0))
    assert not any(standing.level(0.5, slip=0.5, lean=math.radians(9.0), roll_pitch_rate=1.2))
    assert all(standing.level(0.5, slip=0.5, lean=math.radians(4.0), roll_pitch_rate=1.2)[6:])


def test_what_drags_across_a_fast_pad_is_no_error_of_its_speed() -> None:
    """Once, up to 0.8 m/s across a pad of 10 m/s passed for one, and it slid off the plate."""
    standing = Standing()
    standing.touchdown.descent(math.radians(20.0))
    standing.level(0.3, slip=0.4, lean=math.radians(9.0), roll_pitch_rate=1.2, pad_speed=10.0)
    lies = math.radians(4.0)
    assert all(standing.level(0.5, slip=0.4, lean=lies, roll_pitch_rate=1.2, pad_speed=10.0)[6:])


def test_a_vehicle_that_rocks_on_the_plate_without_being_dragged_is_not_levelled() -> None:
    standing = Standing()
    assert not any(standing.level(2.4, slip=0.5, roll_pitch_rate=1.2))
    standing = Standing()
    standing.touchdown.descent(math.radians(20.0))
    assert not any(standing.level(2.4, slip=0.25, roll_pitch_rate=1.2))


def test_a_vehicle_that_may_not_fly_on_and_slides_lying_flat_is_levelled() -> None:
    # A velocity that is off by a constant looks like a slide: it was never levelled, but stopped.
    assert not any(Standing().level(2.4, slip=0.15))
    assert all(Standing().level(1.0, slip=0.15, released=True)[26:])
    assert not any(Standing().level(2.4, slip=0.5, released=True))


def test_a_vehicle_that_the_pad_tips_over_is_levelled_before_it_stands_still() -> None:
    standing = Standing()
    assert not any(standing.level(0.25, roll_pitch_rate=0.8, tips=True))
    assert all(standing.level(0.5, roll_pitch_rate=0.8, tips=True)[4:])


def test_a_vehicle_that_leans_ever_more_where_it_stands_is_levelled() -> None:
    """Once, it rose over its rear feet for 1.5 s before the latest time, and tipped over."""
    standing = Standing()

    def leans(seconds: float, slip: float = 0.0, lean: float = 0.2, more: float = 0.1) -> bool:
        due = standing.level(seconds, slip=slip, lean=lean, tilt=more, roll_pitch_rate=0.5)
        return due[-1]

    assert not leans(0.25)  # it rocks as it touches
    assert leans(0.2)
    standing = Standing()
    assert not leans(2.4, more=0.0)  # it leaned as much in the air
    standing = Standing()
    assert not leans(2.4, slip=0.5)  # the edge slides
    standing = Standing()
    assert not leans(2.4, lean=0.05)  # it lies on a plate that slopes


def test_released_it_is_left_level_as_soon_as_on_ground_is_reported() -> None:
    # It was stopped there, on a pad that moved, when that was taken back a moment later.
    standing = Standing()
    assert not any(standing.level(0.55, slip=0.2, landed=Landed.ON_GROUND))
    assert standing.level(DT, slip=0.2, landed=Landed.ON_GROUND, released=True)[-1]
    assert all(standing.level(0.2, slip=0.2, released=True))


def test_a_vehicle_that_sinks_slowly_on_an_air_cushion_is_not_levelled() -> None:
    # Its sink rate alone might be an error of the autopilot's.
    standing = Standing()
    assert not any(standing.level(2.0, sinks=0.06, sink_rate=0.06))
    assert any(standing.level(0.5))


def test_the_uncertainty_of_a_fast_pads_speed_does_not_count_as_slip() -> None:
    assert Standing().level(1.5, slip=0.45, pad_speed=15.0)[-1]
    assert not any(Standing().level(1.5, slip=0.45, pad_speed=5.0))


def test_on_a_deck_that_sinks_it_stands_level_as_on_any_other() -> None:
    standing = Standing()
    assert standing.level(1.5, sinks=0.3, sink_rate=0.3, heave=0.3, sigma_heave=0.03)[-1]
    # Over a still one it flies.
    assert not any(Standing().level(4.0, sinks=0.3, sink_rate=0.3, heave=0.0, sigma_heave=0.03))


def test_a_slow_vehicle_over_a_deck_that_begins_to_sink_is_not_levelled_in_the_air() -> None:
    """Once, it hovered 4 cm over the deck for 1 s: by height and sink rate it seemed to stand."""
    standing = Standing(vertical_acceleration_mps2=1.6, vertical_jerk_mps3=2.1)  # 0.8 s late
    heave, sinks = 0.0, GENTLE
    while heave < 0.3:
        heave += 0.2 * DT
        sinks += (heave + GENTLE - sinks) * DT / 1.0
        # It keeps so near to the deck as nobody can tell.
        assert not any(
            standing.level(DT, sinks=sinks, sink_rate=sinks, heave=heave, sigma_heave=0.1)
        )
    # Now the deck has it, and carries it on.
    assert standing.level(2.0, sinks=0.3, sink_rate=0.3, heave=0.3, sigma_heave=0.1)[-1]


def test_a_vehicle_that_rose_late_with_a_deck_is_not_levelled_over_it_as_both_turn() -> None:
    """Field day 452: it stayed 4 cm over the deck for a second, and sank later than predicted."""
    touchdown = make_touchdown(vertical_acceleration_mps2=1.6, vertical_jerk_mps3=2.3)
    touchdown.begin(0.0)
    t = 0.0
    while not touchdown.has_touched:
        t += DT
        touchdown.watch(t, (_sinks(t), _ordered(t)), _heaves(t), unsure=0.2)
        touchdown.step(t, 0.2, -0.03, Landed.IN_AIR)
        assert t < 0.8
    feet = pad = 0.0
    while _sinks(t) < _heaves(t) + 0.2:
        t += DT
        feet, pad = feet + _sinks(t) * DT, pad + _heaves(t) * DT
        moves = replace(
            STILL,
            feet_down=feet,
            pad_down=pad,
            sink_rate=_sinks(t),
            heave=_heaves(t),
            sigma_heave=0.1,
        )
        assert not touchdown.level_due(t, moves, _ordered(t), Landed.IN_AIR)


def _sinks(t: float) -> float:
    measured = (0.0, -0.13, -0.18, -0.18, -0.1, 0.0, 0.15, 0.4)
    return float(np.interp(t, (0.0, 0.2, 0.4, 0.8, 0.95, 1.25, 1.6, 2.0), measured))


def _ordered(t: float) -> float:
    return float(np.interp(t, (0.0, 0.25, 0.65, 1.0), (-0.2, 0.05, 0.05, 0.3)))


def _heaves(t: float) -> float:
    return float(np.interp(t, (0.0, 0.6, 1.25, 1.6), (-0.34, -0.27, -0.13, 0.0)))


def test_a_vehicle_that_flew_on_after_a_false_contact_is_not_levelled_on_one_edge() -> None:
    """Once, it was levelled 0.2 s after the touch, which came 2.4 s after the false contact."""
    standing = Standing()
    assert not any(standing.level(3.0, sinks=GENTLE, sink_rate=GENTLE, sigma_heave=0.1))
    assert not any(standing.level(0.55, slip=0.5))


def test_levelled_it_stays_so_on_a_deck_that_heaves_out_of_sight() -> None:
    # It heaves at 0.3 m/s. Without thrust what is in the air falls.
    standing = Standing()
    assert standing.level(
        1.5, sinks=-0.2, sink_rate=-0.2, heave=-0.2, sigma_heave=0.03, fastest_heave=0.14
    )[-1]
    assert all(standing.level(1.0, sinks=0.35, sink_rate=0.35, heave=0.0, sigma_heave=0.3))
    assert not any(standing.level(0.5, sinks=1.0, sink_rate=1.0, heave=0.0, sigma_heave=0.3))


def test_it_is_levelled_once_it_has_stood_still_for_a_moment() -> None:
    standing = Standing()
    standing.level(1.2, slip=0.5)
    assert not any(standing.level(0.5))
    assert all(standing.level(0.5)[4:])


def test_standing_still_counts_from_the_real_touch_and_not_from_a_false_contact() -> None:
    standing = Standing()
    standing.level(0.3, sinks=0.15, sink_rate=0.1)  # slowed by the air cushion
    assert not any(standing.level(0.45))
    assert all(standing.level(0.5)[6:])


def test_a_vehicle_that_settles_slowly_to_the_end_has_stood_still_for_as_long_all_the_same() -> (
    None
):
    """Once, the last centimetre on a strong air cushion counted: it was levelled 0.1 s too soon."""
    standing = Standing()
    standing.level(0.425, sinks=0.07, sink_rate=0.07)
    assert not any(standing.level(0.5))
    assert all(standing.level(0.5)[6:])


def test_it_does_not_stand_level_before_contact_nor_when_on_ground_came_in_time() -> None:
    touchdown = make_touchdown()
    touchdown.begin(0.0)
    due = [touchdown.level_due(5.0 + i * DT, STILL, GENTLE, Landed.IN_AIR) for i in range(200)]
    assert not any(due)
    assert not any(Standing().level(4.0, landed=Landed.ON_GROUND))


@pytest.mark.parametrize("sink_rate", [0.3, 0.15, math.inf, math.nan])
def test_a_vehicle_that_sinks_or_may_sink_is_never_left_without_thrust(sink_rate: float) -> None:
    # The contact was none: a gust held it up, and now it comes down as ordered.
    sinks = sink_rate if math.isfinite(sink_rate) else 0.1
    assert not any(Standing().level(5.0, sinks=sinks, sink_rate=sink_rate))


def test_a_vehicle_that_stands_is_levelled_whatever_its_autopilot_says_of_its_velocity() -> None:
    """With velocities 0.35 m/s off it was not for 12 s, and wind dragged it 0.9 m."""
    assert any(Standing().level(1.5, sink_rate=0.35))


def test_thrust_comes_back_as_soon_as_it_sinks_without() -> None:
    standing = Standing()
    assert standing.level(1.2)[-1]
    assert not any(standing.level(0.5, sinks=0.2, sink_rate=0.2)[4:])


def test_levelled_for_a_second_it_goes_down_with_its_deck_but_does_not_fall() -> None:
    """Once, on a deck that began to sink out of sight, it was told to climb away."""
    standing = Standing()
    assert standing.level(2.2)[-1]
    assert all(standing.level(1.0, sinks=0.2, sink_rate=0.2))
    assert not any(standing.level(0.5, sinks=0.5, sink_rate=0.5)[4:])


def test_a_rebound_from_the_plate_does_not_bring_the_thrust_back() -> None:
    """It did, as all feet came down again; the vehicle leaned into the wind and tipped over."""
    standing = Standing()
    standing.touchdown.descent(math.radians(28.0))

    def level(seconds: float, climbs: float = 0.0) -> list[bool]:
        return standing.level(
            seconds,
            sinks=-climbs,
            sink_rate=-climbs,
            slip=0.5,
            lean=math.radians(4.0),
            roll_pitch_rate=2.0,
        )

    assert level(0.4)[-1]
    assert all(level(0.05, climbs=0.3))
    assert all(level(0.05, climbs=-0.3))
    assert all(level(1.0))
    # What sinks lower than where it lay never touched.
    assert not any(level(0.3, climbs=-0.3)[4:])


def test_the_more_it_leans_the_quicker_all_feet_are_to_be_down() -> None:
    touchdown = make_touchdown()
    touchdown.begin(0.0)
    speeds = [touchdown.descent(math.radians(tilt)) for tilt in (0.0, 5.0, 10.0, 25.0, 80.0)]
    assert speeds[:2] == [GENTLE, GENTLE]
    assert GENTLE < speeds[2] < speeds[3] <= speeds[4] <= 0.6
    # The pad has levelled it by now; it still slides.
    assert touchdown.descent(0.0) == speeds[4]
    touchdown.begin(10.0)
    assert touchdown.descent(0.0) == GENTLE


def test_a_vehicle_that_is_lifted_and_pressed_down_again_is_unconfirmed_as_soon() -> None:
    touchdown = Touchdown(Config())
    touchdown.begin(10.0)
    touchdown.touch(11.0)
    for k in range(4):
        touchdown.press(12.0 + k)
    assert not touchdown.unconfirmed(15.9, Landed.IN_AIR)
    assert touchdown.unconfirmed(16.1, Landed.IN_AIR)


def test_a_commit_that_shows_no_contact_for_long_is_unconfirmed_too() -> None:
    touchdown = make_touchdown()
    touchdown.begin(10.0)
    assert not touchdown.unconfirmed(14.9, Landed.IN_AIR)
    assert touchdown.unconfirmed(15.1, Landed.IN_AIR)
    assert touchdown.unconfirmed(15.1, Landed.ON_GROUND)  # it would have been disarmed at contact


def test_the_next_landing_begins_in_the_air() -> None:
    descent = Descent().to_contact()
    descent.touchdown.begin(descent.t)
    assert not descent.touchdown.has_touched
    assert descent.go_on(1.0) is None
