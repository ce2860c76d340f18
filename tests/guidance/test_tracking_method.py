import math

import pytest

from hw.sim.options import ResponseOptions
from hw.sim.physics.response import STEP_S, HorizontalResponse, MeasuredYawResponse
from landerd.config.models import Config
from landerd.config.parameters import with_value
from landerd.geometry import Vec3, add, clamp, horizontal, scale, sub
from landerd.guidance.limits import Limiter, flyable_limits
from landerd.guidance.tracking_method import TrackingMethod
from landerd.messages import Phase
from tests.guidance.situations import situation

DT = 0.025
CONFIG = Config()
OPTIONS = CONFIG.guidance


def order(
    distance: float = 0.0,
    height: float = 5.0,
    *,
    rate: Vec3 = (0.0, 0.0, 0.0),
    heading_deg: float | None = 0.0,
    floor_m: float = 0.0,
) -> tuple[Vec3, float]:
    r = situation(distance, height, rate=rate, heading_deg=heading_deg)
    return TrackingMethod(CONFIG).step(Phase.APPROACH, r, floor_m, DT)


def test_far_away_it_closes_in_at_the_approach_speed_and_no_faster() -> None:
    velocity, _ = order(40.0)
    assert velocity[0] == pytest.approx(OPTIONS.tracking.approach_mps)
    assert velocity[1] == 0.0


def test_it_closes_in_no_faster_than_it_can_brake() -> None:
    tracking = OPTIONS.tracking
    for distance in (1.0, 2.0, 4.0, 8.0):
        speed = order(distance)[0][0]
        assert speed <= math.sqrt(2.0 * tracking.brake_mps2 * distance)


@pytest.mark.parametrize("pad_velocity", [(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (-3.0, 8.0, 0.0)])
def test_a_vehicle_that_lags_comes_to_rest_over_any_pad_without_overshoot(
    pad_velocity: Vec3,
) -> None:
    # First-order velocity response of 0.5 s, from 12 m away.
    method, limiter = TrackingMethod(CONFIG), Limiter(OPTIONS.limits)
    limiter.reset(pad_velocity)
    error, velocity = (12.0, 0.0, 5.0), pad_velocity
    beyond = 0.0
    for _ in range(round(15.0 / DT)):
        rate = sub(pad_velocity, velocity)
        seen = situation(error=error, rate=rate, pad_velocity=pad_velocity)
        wanted, _ = method.step(Phase.APPROACH, seen, 4.9, DT)
        flown = limiter.step(wanted, 0.0, DT, may_descend=False).velocity
        velocity = add(velocity, scale(sub(flown, velocity), DT / 0.5))
        error = add(error, scale(sub(pad_velocity, velocity), DT))
        beyond = max(beyond, -error[0])
    assert horizontal(error) < 0.03
    assert horizontal(sub(pad_velocity, velocity)) < 0.03
    assert beyond < 0.3


def test_a_gust_does_not_push_it_out_of_the_descent_region() -> None:
    # 1 m/s^2 for half a second on a vehicle that answers an order after 0.5 s.
    method, limiter = TrackingMethod(CONFIG), Limiter(OPTIONS.limits)
    position = velocity = farthest = 0.0
    for i in range(round(8.0 / DT)):
        seen = situation(error=(-position, 0.0, 2.0), rate=(-velocity, 0.0, 0.0))
        wanted, _ = method.step(Phase.DESCENT, seen, 2.0, DT)
        flown = limiter.step(wanted, 0.0, DT, may_descend=False).velocity[0]
        gust = 1.0 if i * DT < 0.5 else 0.0
        velocity += DT * ((flown - velocity) / 0.5 + gust)
        position += DT * velocity
        farthest = max(farthest, abs(position))
    assert farthest < OPTIONS.descent.k1_m
    assert abs(position) < 0.01


def test_it_sinks_only_to_the_height_whose_region_contains_it() -> None:
    assert order(0.0, 5.0)[0][2] > 1.0
    assert order(0.3, 5.0)[0][2] < order(0.0, 5.0)[0][2]
    assert order(0.6, 3.0)[0][2] == 0.0


def test_it_brakes_its_descent_before_the_ground_and_before_a_floor() -> None:
    heights = [5.0, 2.0, 1.0, 0.5, 0.2]
    speeds = [order(0.0, h)[0][2] for h in heights]
    assert speeds == sorted(speeds, reverse=True)
    at_commit = order(0.0, OPTIONS.descent.commit_height_m)[0][2]
    assert at_commit == pytest.approx(OPTIONS.touchdown_descent_mps)
    assert order(0.0, 2.1, floor_m=2.1)[0][2] == 0.0


def test_it_turns_the_short_way_as_soon_as_it_looks_down_on_the_pad() -> None:
    assert order(0.5, 5.0, heading_deg=120.0)[1] > 0.0
    assert order(0.5, 5.0, heading_deg=-120.0)[1] < 0.0
    assert order(20.0, 5.0, heading_deg=120.0)[1] == 0.0  # it would turn the camera away
    assert order(0.5, 5.0, heading_deg=None)[1] == 0.0
    most = math.radians(OPTIONS.limits.yaw_rate_deg_s)
    assert abs(order(0.0, 5.0, heading_deg=170.0)[1]) <= most


@pytest.mark.parametrize("beside_deg_s", [-5.0, 5.0])
def test_a_vehicle_that_turns_beside_its_order_still_comes_to_the_pads_heading(
    beside_deg_s: float,
) -> None:
    method = TrackingMethod(CONFIG)
    heading = rate = 0.0
    for _ in range(round(15.0 / DT)):
        off_deg = 20.0 - math.degrees(heading)
        seen = situation(height=3.0, heading_deg=off_deg, yaw_rate=rate)
        _, wanted = method.step(Phase.YAW_CORRECTION, seen, 2.0, DT)
        rate = wanted + math.radians(beside_deg_s)
        heading += DT * rate
    assert math.degrees(heading) == pytest.approx(20.0, abs=0.2)


def test_a_large_heading_gain_does_not_make_the_heading_swing() -> None:
    method = TrackingMethod(with_value(CONFIG, "guidance.tracking.yaw_kp", 5.0))
    vehicle, heading = MeasuredYawResponse(), 0.0
    seen_late, off = [situation(height=3.0, heading_deg=20.0)] * 2, []
    for _ in range(round(30.0 / DT)):
        off_deg = 20.0 - math.degrees(heading)
        seen_late.append(situation(height=3.0, heading_deg=off_deg, yaw_rate=vehicle.rate))
        _, wanted = method.step(Phase.YAW_CORRECTION, seen_late.pop(0), 2.0, DT)
        for _ in range(round(DT / STEP_S)):
            vehicle.step(wanted)
            heading += STEP_S * vehicle.rate
        off.append(abs(off_deg))
    assert max(off[2 * len(off) // 3 :]) < 0.5 * OPTIONS.descent.align_deg


def test_braking_its_descent_leaves_room_for_the_decks_own_acceleration() -> None:
    # Half of what the vehicle can do: the rest is for a deck that turns from falling to rising.
    most = 0.55 * OPTIONS.limits.vertical_acceleration_mps2
    above = OPTIONS.descent.commit_height_m
    for to_go in (0.05, 0.2, 0.5, 1.0):
        speed, lower = (order(height=above + x)[0][2] for x in (to_go, to_go - 0.02))
        assert (speed**2 - lower**2) / (2 * 0.02) < most


def test_a_vehicle_that_answers_late_up_and_down_brakes_its_descent_sooner() -> None:
    """Once, it sank at 0.6 m/s 0.3 m over a deck that came up, and was struck at 0.8 m/s."""
    late = {"vertical_acceleration_mps2": 2.0, "vertical_jerk_mps3": 2.5}  # 0.8 s
    config = CONFIG.model_copy(update={"autopilot": CONFIG.autopilot.model_copy(update=late)})
    sinking = situation(height=1.0, rate=(0.0, 0.0, -0.8))
    quick, slow = (
        TrackingMethod(each).step(Phase.DESCENT, sinking, 0.0, DT)[0][2]
        for each in (CONFIG, config)
    )
    assert slow < quick - 0.2


class LateAttitude:
    """One level axis of ArduCopter, its attitude a first-order lag behind what its loops ask for.

    Its shaper orders velocity and acceleration, its position controller corrects them with SITL's
    gains: PSC_POSXY_P 1, PSC_VELXY_P 2, _I 1 and _D 0.5.
    """

    def __init__(self, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._shaped = HorizontalResponse()
        self._behind = self._integral = self._lean = 0.0  # m, m/s^2, m/s^2
        self.velocity = 0.0

    def step(self, order: float) -> None:
        self._shaped.step(order, 0.0)
        self._behind += STEP_S * (self._shaped.vn - self.velocity)
        error = self._shaped.vn - self.velocity + self._behind
        self._integral += STEP_S * error
        asked = self._shaped.an + 2.0 * error + self._integral
        asked += 0.5 * (self._shaped.an - self._lean)
        self._lean += STEP_S / self._time_constant_s * (clamp(asked, -5.6, 5.6) - self._lean)
        self.velocity += STEP_S * self._lean


def test_a_vehicle_that_its_autopilot_lets_answer_slowly_comes_to_rest_too() -> None:
    """Over a pad at 10 m/s, with lags of 1.75 and 2.5 s; uncompensated it takes twice the time."""
    for acceleration, jerk in ((3.5, 2.0), (5.0, 2.0)):
        shaping = {"acceleration_mps2": acceleration, "jerk_mps3": jerk}
        config = CONFIG.model_copy(
            update={"autopilot": CONFIG.autopilot.model_copy(update=shaping)}
        )
        vehicle = HorizontalResponse(ResponseOptions(delay_s=0.1, **shaping))
        vehicle.settle(10.0, 0.0)
        method, limiter = TrackingMethod(config), Limiter(flyable_limits(config))
        pad_velocity = (10.0, 0.0, 0.0)
        limiter.reset(pad_velocity)
        error, beyond = (6.0, 0.0, 5.0), 0.0
        for _ in range(round(6.0 / DT)):
            rate = sub(pad_velocity, (vehicle.vn, vehicle.ve, 0.0))
            seen = situation(error=error, rate=rate, pad_velocity=pad_velocity)
            wanted, _ = method.step(Phase.APPROACH, seen, 4.9, DT)
            north, east, _ = limiter.step(wanted, 0.0, DT, may_descend=False).velocity
            for _ in range(round(DT / STEP_S)):
                vehicle.step(north, east)
            error = add(error, scale(sub(pad_velocity, (vehicle.vn, vehicle.ve, 0.0)), DT))
            beyond = max(beyond, -error[0])
        assert abs(error[0]) < 0.3, shaping
        assert beyond < 0.3, shaping


def test_a_vehicle_whose_attitude_follows_late_comes_to_rest_over_the_pad() -> None:
    """ArduCopter's own velocities then swing: once it flew to and fro over the pad for ever."""
    slow = CONFIG.autopilot.model_copy(update={"attitude_time_constant_s": 0.4})
    method = TrackingMethod(CONFIG.model_copy(update={"autopilot": slow}))
    limiter, vehicle, position = Limiter(OPTIONS.limits), LateAttitude(0.4), -6.0
    seen_late, off = [situation(6.0, 5.0)] * 2, []
    for _ in range(round(20.0 / DT)):
        error, rate = (-position, 0.0, 5.0), (-vehicle.velocity, 0.0, 0.0)
        seen_late.append(situation(error=error, rate=rate))
        wanted, _ = method.step(Phase.DESCENT, seen_late.pop(0), 4.9, DT)
        north, _, _ = limiter.step(wanted, 0.0, DT, may_descend=False).velocity
        for _ in range(round(DT / STEP_S)):
            vehicle.step(north)
            position += STEP_S * vehicle.velocity
        off.append(abs(position))
    assert max(off[3 * len(off) // 4 :]) < OPTIONS.descent.k1_m


def test_a_pad_that_stops_is_not_flown_after_as_if_it_drove_on() -> None:
    """For a slow vehicle the pad's velocity is smoothed for long: once it overran the pad."""
    shaping = {"acceleration_mps2": 2.0, "jerk_mps3": 2.0}
    config = CONFIG.model_copy(update={"autopilot": CONFIG.autopilot.model_copy(update=shaping)})
    method = TrackingMethod(config)
    for _ in range(round(2.0 / DT)):
        driving = situation(height=3.0, pad_velocity=(3.0, 0.0, 0.0))
        method.step(Phase.DESCENT, driving, 0.0, DT)
    stands = situation(height=3.0, rate=(-3.0, 0.0, 0.0))
    assert method.step(Phase.DESCENT, stands, 0.0, DT)[0][0] < 0.0


def test_a_pad_that_sways_is_followed_closely_enough_to_land_on() -> None:
    """Once, 0.3 m to and fro in 5 s was smoothed away: always 0.3 m off, it never landed."""
    method, limiter = TrackingMethod(CONFIG), Limiter(OPTIONS.limits)
    vehicle, position = HorizontalResponse(ResponseOptions(delay_s=0.1)), 0.0
    omega, off = 2.0 * math.pi * 0.2, []
    for i in range(round(20.0 / DT)):
        pad, pad_mps = 0.3 * math.sin(omega * i * DT), 0.3 * omega * math.cos(omega * i * DT)
        seen = situation(
            error=(pad - position, 0.0, 2.0),
            rate=(pad_mps - vehicle.vn, 0.0, 0.0),
            pad_velocity=(pad_mps, 0.0, 0.0),
        )
        wanted, _ = method.step(Phase.DESCENT, seen, 2.0, DT)
        north, east, _ = limiter.step(wanted, 0.0, DT, may_descend=False).velocity
        for _ in range(round(DT / STEP_S)):
            vehicle.step(north, east)
        position += DT * vehicle.vn
        off.append(abs(pad - position))
    assert max(off[len(off) // 2 :]) < 0.7 * OPTIONS.descent.commit_miss_m


def swung(method: TrackingMethod, *, seconds: float, by_m: float) -> float:
    """Swing this far for this long, whatever is ordered; return the speed ordered 0.2 m off."""
    for i in range(round(seconds / DT)):
        phase = 3.8 * i * DT
        error = (by_m * math.cos(phase), by_m * math.sin(phase), 3.0)
        rate = (-3.8 * error[1], 3.8 * error[0], 0.0)
        method.step(Phase.DESCENT, situation(error=error, rate=rate), 0.0, DT)
    return method.step(Phase.DESCENT, situation(0.2, 3.0), 0.0, DT)[0][0]


def test_a_swing_that_smaller_gains_do_not_calm_is_the_winds_and_wants_the_gains_it_had() -> None:
    """Once, gusts moved a vehicle with its smallest gains by 0.2 m, and it never came down."""
    fresh = swung(TrackingMethod(CONFIG), seconds=0.0, by_m=0.0)
    calmed = swung(TrackingMethod(CONFIG), seconds=11.0, by_m=0.2)
    assert calmed < 0.6 * fresh
    method = TrackingMethod(CONFIG)
    assert swung(method, seconds=16.0, by_m=0.2) > 0.8 * fresh
    assert swung(method, seconds=16.0, by_m=0.2) > 0.8 * fresh  # nor are they lowered again


def test_a_swing_that_grows_as_the_gains_are_lowered_is_the_winds_at_once() -> None:
    """Once, in gusts, the gains were back only after 10 s of ever larger swings."""
    fresh = swung(TrackingMethod(CONFIG), seconds=0.0, by_m=0.0)
    method = TrackingMethod(CONFIG)
    assert swung(method, seconds=4.2, by_m=0.1) < 0.8 * fresh
    assert swung(method, seconds=4.0, by_m=0.2) > 0.9 * fresh


def test_a_pad_that_stops_under_a_calmed_vehicle_is_no_gust() -> None:
    """Once, the error that this causes restored the gains by which it swings, for good."""
    fresh = swung(TrackingMethod(CONFIG), seconds=0.0, by_m=0.0)
    method = TrackingMethod(CONFIG)
    assert swung(method, seconds=4.2, by_m=0.1) < 0.8 * fresh
    for i in range(round(2.0 / DT)):  # it brakes at 1 m/s^2, and is overrun by 0.3 m
        pad_mps = max(0.0, 1.0 - i * DT)
        off = situation(error=(-0.3, 0.0, 3.0), rate=(0.7, 0.0, 0.0), pad_velocity=(pad_mps, 0, 0))
        method.step(Phase.DESCENT, off, 0.0, DT)
    for _ in range(round(2.0 / DT)):
        method.step(Phase.DESCENT, situation(0.0, 3.0), 0.0, DT)
    assert swung(method, seconds=0.0, by_m=0.0) < 0.85 * fresh


def test_gains_that_were_restored_are_reduced_again_if_the_vehicle_swings_more() -> None:
    """Once, it swung in gusts, got its gains back, and swung by itself until the end."""
    fresh = swung(TrackingMethod(CONFIG), seconds=0.0, by_m=0.0)
    method = TrackingMethod(CONFIG)
    swung(method, seconds=4.2, by_m=0.1)
    swung(method, seconds=4.0, by_m=0.2)
    assert swung(method, seconds=4.2, by_m=0.4) < 0.8 * fresh


def test_gains_that_end_a_swing_are_kept() -> None:
    method = TrackingMethod(CONFIG)
    fresh = swung(TrackingMethod(CONFIG), seconds=0.0, by_m=0.0)
    for by_m in (0.3, 0.25, 0.15, 0.08, 0.04):
        left = swung(method, seconds=4.0, by_m=by_m)
    assert left < 0.6 * fresh


@pytest.mark.parametrize(
    ("height", "leaves_mps", "climbs"),
    [
        (3.0, 5.0, True),  # by the time that it is caught up with it is 20 m away
        (8.0, 5.0, False),
        (3.0, -1.0, False),  # it comes nearer
    ],
)
def test_a_pad_that_drives_away_is_kept_in_sight_by_climbing(
    height: float, leaves_mps: float, climbs: bool
) -> None:
    velocity, _ = order(12.0, height, rate=(leaves_mps, 0.0, 0.0))
    assert (velocity[2] < -0.5) is climbs
    assert velocity[2] >= -OPTIONS.limits.climb_mps


@pytest.mark.parametrize(
    ("key", "value", "is_kept"),
    [
        ("guidance.descent.alignment_height_m", 1.2, True),
        ("guidance.tracking.ki", 0.1, True),
        ("guidance.tracking.kp", 0.5, False),
        ("autopilot.jerk_mps3", 2.0, False),
    ],
)
def test_reduced_gains_are_kept_when_an_unrelated_parameter_changes(
    key: str, value: float, is_kept: bool
) -> None:
    changed = with_value(CONFIG, key, value)
    method, fresh = TrackingMethod(CONFIG), TrackingMethod(changed)
    swung(method, seconds=11.0, by_m=0.2)
    method.configure(changed)
    method.restart()
    left = swung(method, seconds=0.0, by_m=0.0) / swung(fresh, seconds=0.0, by_m=0.0)
    assert left == (pytest.approx(0.5, abs=0.2) if is_kept else pytest.approx(1.0))
