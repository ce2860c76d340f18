import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd.config.models import Config, GuidanceSection, PidGains, PidSection
from landerd.guidance.pid import Pid
from landerd.guidance.pid_method import PidMethod
from landerd.messages import Phase
from tests.guidance.situations import situation

DT = 0.025
ERRORS = st.floats(-50.0, 50.0)


def pid(kp: float = 0.0, ki: float = 0.0, kd: float = 0.0, *, limit: float = 1.0) -> Pid:
    return Pid(PidGains(kp=kp, ki=ki, kd=kd), integral_limit=limit)


def step(controller: Pid, error: float, rate: float = 0.0, *, saturated: bool = False) -> float:
    return controller.step(error, rate, DT, saturated=saturated)


def test_each_gain_acts_on_its_own_term() -> None:
    assert step(pid(kp=0.7), 3.0) == pytest.approx(2.1)
    assert step(pid(kd=0.4), 3.0, rate=-2.0) == pytest.approx(-0.8)
    controller = pid(ki=0.2)
    for _ in range(40):  # 1 s
        output = step(controller, 3.0)
    assert output == pytest.approx(0.6)


@given(st.lists(ERRORS, min_size=1, max_size=50), st.floats(0.0, 3.0))
def test_the_integral_never_adds_more_than_its_limit(errors: list[float], limit: float) -> None:
    controller = pid(ki=1.5, limit=limit)
    for error in errors:
        for _ in range(20):
            assert abs(step(controller, error)) <= limit


def test_the_limit_is_of_the_output_whatever_the_gain() -> None:
    for ki in (0.01, 0.5, 3.0):
        controller = pid(ki=ki, limit=0.8)
        for _ in range(8000):
            output = step(controller, 20.0)
        assert output == pytest.approx(0.8)


def test_after_a_long_error_the_output_changes_sign_at_once() -> None:
    controller = pid(kp=1.0, ki=0.5, limit=1.0)
    for _ in range(4000):
        step(controller, 10.0)
    # At most the clamp is left to work off: 1.0 at 0.5 x 2.0 a second.
    outputs = [step(controller, -2.0) for _ in range(round(1.0 / DT))]
    assert outputs[0] < 0.0
    assert outputs[-1] < -2.0 + 0.05


def test_while_the_output_is_cut_the_integral_only_shrinks() -> None:
    controller = pid(ki=1.0, limit=5.0)
    for _ in range(40):
        grown = step(controller, 1.0)
    for _ in range(40):
        assert step(controller, 1.0, saturated=True) == pytest.approx(grown)
    assert step(controller, -1.0, saturated=True) < grown


def test_new_gains_do_not_step_the_output() -> None:
    controller = pid(kp=0.7, ki=0.1, kd=0.4)
    for _ in range(200):
        before = step(controller, 4.0, rate=-1.0)
    controller.set_gains(PidGains(kp=0.3, ki=0.05, kd=0.9))
    outputs = [before]
    for _ in range(80):
        outputs.append(step(controller, 4.0, rate=-1.0))
    steps = [abs(b - a) for a, b in itertools.pairwise(outputs)]
    # 4 x 0.4 + 1 x 0.5 to change over a second: 0.05 a step, not 2.1 at once.
    assert max(steps) < 0.06
    # After 2 s the new gains hold, and the integral has gone on growing from where it was.
    assert outputs[-1] == pytest.approx(0.3 * 4.0 - 0.9 + 1.0, abs=1e-6)


def test_gains_changed_again_while_fading_do_not_step_either() -> None:
    controller = pid(kp=1.0)
    step(controller, 1.0)
    controller.set_gains(PidGains(kp=0.0))
    for _ in range(20):
        before = step(controller, 1.0)
    controller.set_gains(PidGains(kp=1.0))
    assert step(controller, 1.0) == pytest.approx(before, abs=0.03)


def test_reset_forgets_the_integral() -> None:
    controller = pid(ki=1.0)
    step(controller, 10.0)
    controller.reset()
    assert step(controller, 0.0) == 0.0


# ---- the four controllers together -------------------------------------------------------------


def method(**pid_options: object) -> PidMethod:
    return PidMethod(Config(guidance=GuidanceSection(pid=PidSection.model_validate(pid_options))))


def test_it_flies_towards_the_pad_and_down_to_it() -> None:
    north, east, down = method().step(Phase.APPROACH, situation(error=(4.0, -2.0, 8.0)), 0.0, DT)[0]
    kp = PidSection().approach.kp
    assert (north, east) == pytest.approx((4.0 * kp, -2.0 * kp))
    assert down > 0.0


def test_it_brakes_with_the_closing_speed() -> None:
    still = method().step(Phase.APPROACH, situation(4.0), 0.0, DT)[0]
    closing = method().step(Phase.APPROACH, situation(4.0, rate=(-2.0, 0.0, 0.0)), 0.0, DT)[0]
    assert closing[0] == pytest.approx(still[0] - 2.0 * PidSection().approach.kd)


def test_down_stays_within_the_limit_and_does_not_creep() -> None:
    options = GuidanceSection()
    for height in (100.0, 5.0, 1.0, 0.3, 0.05):
        down = method().step(Phase.DESCENT, situation(0.0, height), 0.0, DT)[0][2]
        assert options.descent.slowest_mps <= down <= options.limits.descent_mps


@pytest.mark.parametrize("height", [2.1, 1.0, 0.2])
def test_at_or_below_the_floor_it_orders_no_descent(height: float) -> None:
    down = method().step(Phase.YAW_CORRECTION, situation(0.0, height), 2.1, DT)[0][2]
    assert down == 0.0


@pytest.mark.parametrize("phase", list(Phase)[1:])
def test_only_yaw_correction_turns_and_the_short_way(phase: Phase) -> None:
    for heading_deg in (20.0, -20.0):
        turn = method().step(phase, situation(heading_deg=heading_deg), 0.0, DT)[1]
        if phase is Phase.YAW_CORRECTION:
            assert turn == pytest.approx(1.5 * math.radians(heading_deg))
        else:
            assert turn == 0.0


def test_a_heading_not_known_is_not_turned_to() -> None:
    assert method().step(Phase.YAW_CORRECTION, situation(heading_deg=None), 0.0, DT)[1] == 0.0


def test_a_steady_wind_is_worked_off_by_the_integral_but_the_approach_winds_nothing_up() -> None:
    windy = method(approach={"kp": 0.7, "ki": 0.1}, final={"kp": 0.3, "ki": 0.1})
    for _ in range(400):  # 10 s, far away: the order is cut to the speed limit
        windy.step(Phase.APPROACH, situation(30.0), 0.0, DT)
    assert windy.step(Phase.APPROACH, situation(0.0), 0.0, DT)[0][0] < 0.1
    for _ in range(400):
        north = windy.step(Phase.DESCENT, situation(0.2), 0.0, DT)[0][0]
    assert north > 0.3 * 0.2 + 0.1


def test_a_new_landing_starts_without_the_old_ones_integral() -> None:
    controller = method(final={"kp": 0.3, "ki": 0.5})
    for _ in range(400):
        controller.step(Phase.DESCENT, situation(1.0), 0.0, DT)
    controller.restart()
    assert controller.step(Phase.DESCENT, situation(0.0), 0.0, DT)[0][0] == 0.0
