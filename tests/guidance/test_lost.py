import pytest

from landerd.config.models import LostSection
from landerd.guidance.lost import LostPlan

OPTIONS = LostSection(hold_s=3.0, climb_mps=0.5, climb_m=5.0, give_up_s=30.0)


def plan(options: LostSection = OPTIONS) -> LostPlan:
    made = LostPlan(options)
    made.begin(100.0)
    return made


def test_after_a_loss_it_first_holds_and_searches() -> None:
    for now in (100.0, 101.5, 102.9):
        assert plan().step(now, -4.0) == ((0.0, 0.0, 0.0), "holding")


def test_after_holding_it_climbs_straight_up_by_the_configured_height() -> None:
    made, down, climbed = plan(), -4.0, []
    for i in range(260):
        step = made.step(103.0 + 0.1 * i, down)
        assert step is not None
        assert step[0][:2] == (0.0, 0.0)
        assert step[0][2] in (0.0, -0.5)
        down += 0.1 * step[0][2]
        climbed.append(-4.0 - down)
    assert climbed[-1] == pytest.approx(5.0, abs=0.1)


def test_without_a_climb_it_only_holds() -> None:
    step = plan(LostSection(climb_m=0.0)).step(110.0, -4.0)
    assert step is not None
    assert step[0] == (0.0, 0.0, 0.0)


def test_after_the_configured_time_it_hands_back() -> None:
    assert plan().step(129.9, -9.0) is not None
    assert plan().step(130.1, -9.0) is None


def test_every_loss_has_the_whole_time_again() -> None:
    made = plan()
    assert made.step(130.1, -4.0) is None
    made.begin(200.0)
    assert made.step(200.1, -4.0) == ((0.0, 0.0, 0.0), "holding")


def test_a_pad_lost_again_and_again_does_not_take_it_ever_higher() -> None:
    made, now, down = LostPlan(OPTIONS), 100.0, -4.0
    for _ in range(5):
        made.begin(now)
        for _ in range(200):
            step = made.step(now, down)
            assert step is not None
            now, down = now + 0.1, down + 0.1 * step[0][2]
        now += 3.0  # sight came back for a moment
    assert -4.0 - down == pytest.approx(5.0, abs=0.1)


def test_the_climb_of_losses_that_follow_one_another_is_from_the_lowest() -> None:
    made = plan()
    made.step(110.0, -4.0)
    made.begin(115.0)
    assert made.step(119.0, -1.0) == ((0.0, 0.0, -0.5), "climbing")
    assert made.step(120.0, -5.9) == ((0.0, 0.0, -0.5), "climbing")
    assert made.step(121.0, -6.1) == ((0.0, 0.0, 0.0), "searching")  # 5 m over the lowest


def test_just_over_the_pad_it_climbs_at_once() -> None:
    made = LostPlan(OPTIONS)
    made.begin(100.0, low=True)
    assert made.step(100.1, -0.3) == ((0.0, 0.0, -0.5), "climbing")
