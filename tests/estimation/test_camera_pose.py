import math
from itertools import pairwise
from random import Random

import pytest

from landerd.estimation.camera_pose import PoseHistory
from landerd.geometry import Vec3, matmul, rot_zyx
from landerd.messages import Attitude, GimbalState, LocalPosition, Reference
from tests.estimation.histories import AT_ORIGIN, history


def test_after_a_jump_of_the_local_frame_positions_stay_in_the_old_one() -> None:
    made = PoseHistory(AT_ORIGIN)
    made.add(Attitude(1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)))
    made.add(GimbalState(1.0, 0.0, 0.0, 0.0, Reference.BODY))
    velocity = (5.0, 0.0, 0.0)
    made.add(LocalPosition(1.00, (0.0, 0.0, 0.0), velocity))
    made.add(LocalPosition(1.02, (0.1, 0.0, 0.0), velocity))
    made.add(LocalPosition(1.04, (2.2, -1.0, 0.5), velocity))
    made.add(LocalPosition(1.06, (2.3, -1.0, 0.5), velocity))
    for t, north in ((1.01, 0.05), (1.05, 0.25)):
        camera = made.camera_pose(t)
        assert camera is not None
        assert camera.position == pytest.approx((north, 0.0, 0.0))


def told(made: PoseHistory, velocities: list[float], yaws: list[float]) -> tuple[float, float]:
    """Return velocity (m/s) and heading (rad) as known after these reports, 50 a second."""
    for i, (velocity, yaw) in enumerate(zip(velocities, yaws, strict=True)):
        made.add(LocalPosition(1.0 + 0.02 * i, (0.0, 0.0, 0.0), (velocity, 0.0, 0.0)))
        made.add(Attitude(1.0 + 0.02 * i, 0.0, 0.0, yaw, (0.0, 0.0, 0.5)))
    position, attitude = made.position.newest, made.attitude.newest
    assert position is not None
    assert attitude is not None
    return position[1][3], attitude[1][2]


def test_an_impossible_jump_of_velocity_or_heading_is_ignored() -> None:
    turning = [0.0, 0.01, 0.4, 0.03, -2.9]
    velocity, heading = told(PoseHistory(AT_ORIGIN), [1.0, 1.1, 20.0, 1.2, -9.0], turning)
    assert velocity == 1.2
    assert heading == pytest.approx(0.04)  # as it turned


def test_headings_at_random_are_not_believed_though_two_in_a_row_agree() -> None:
    made, rng = PoseHistory(AT_ORIGIN), Random(1)
    for i in range(100):  # at 25 Hz, turning at 0.5 rad/s
        yaw = 0.02 * i + (rng.uniform(-0.5, 0.5) if i > 10 else 0.0)
        made.add(Attitude(1.0 + 0.04 * i, 0.0, 0.0, yaw, (0.0, 0.0, 0.5)))
        newest = made.attitude.newest
        assert newest is not None
        assert newest[0] == 1.0 + 0.04 * i  # roll and pitch are as fresh as ever
        assert newest[1][2] == pytest.approx(0.02 * i, abs=math.radians(1.0))


def test_a_heading_that_is_reset_is_believed_after_a_while() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(30):
        yaw = 0.02 * i + (0.4 if i > 10 else 0.0)
        made.add(Attitude(1.0 + 0.04 * i, 0.0, 0.0, yaw, (0.0, 0.0, 0.5)))
        newest = made.attitude.newest
        assert newest is not None
        assert newest[1][2] - 0.02 * i == pytest.approx(0.4 if i > 15 else 0.0)


def test_a_reset_of_the_heading_is_removed_while_the_old_one_is_kept() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(60):
        yaw = 0.02 * i + (0.4 if 10 < i <= 40 else 0.0)
        made.add(Attitude(1.0 + 0.04 * i, 0.0, 0.0, yaw, (0.0, 0.0, 0.5)), keeps_heading=True)
        newest = made.attitude.newest
        assert newest is not None
        assert newest[1][2] == pytest.approx(0.02 * i, abs=1e-6)
        if i in (10, 25, 59):
            assert made.heading_offset == pytest.approx(0.4 if i == 25 else 0.0, abs=1e-6)


def test_a_gimbal_that_goes_silent_is_not_taken_to_stand_still_for_long() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(20):
        t = 1.0 + 0.02 * i
        made.add(LocalPosition(t, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        made.add(Attitude(t, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)))
        if i <= 10:
            made.add(GimbalState(t, 0.1 * i, 0.0, 0.0, Reference.BODY))
    assert made.camera_pose(1.3) is not None
    assert made.camera_pose(1.38) is None


def test_a_velocity_that_jumps_is_believed_once_the_positions_move_with_it() -> None:
    """As after a reset of the autopilot's EKF, which may move its local frame, too."""
    made, x = PoseHistory(AT_ORIGIN), 0.0
    for i in range(20):
        velocity = 0.3 if i < 10 else 4.0
        x += 0.02 * velocity + (3.0 if i == 10 else 0.0)
        made.add(LocalPosition(1.0 + 0.02 * i, (x, 0.0, 0.0), (velocity, 0.0, 0.0)))
        newest = made.position.newest
        assert newest is not None
        assert newest[1][3] == (0.3 if i < 15 else 4.0)


def test_a_velocity_that_the_positions_contradict_is_not_believed_however_long_it_is_told() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(100):
        velocity = 1.3 if 10 <= i < 60 else 0.0  # for a second: it has long become stale
        made.add(LocalPosition(1.0 + 0.02 * i, (0.0, 0.0, 0.0), (velocity, 0.0, 0.0)))
        newest = made.position.newest
        assert newest is not None
        assert newest[1][3] == 0.0
        assert newest[0] == 1.0 + 0.02 * (9 if 10 <= i < 60 else i)


@pytest.mark.parametrize("hertz", [20, 50])
def test_a_velocity_biased_by_a_metre_a_second_is_not_believed(hertz: int) -> None:
    made, rng = PoseHistory(AT_ORIGIN), Random(3)
    for i in range(2 * hertz):
        t, bias = i / hertz, 0.6 if i >= hertz else 0.0  # of each axis
        noisy = (4.0 * t + rng.gauss(0.0, 0.01), rng.gauss(0.0, 0.01), rng.gauss(0.0, 0.01))
        made.add(LocalPosition(1.0 + t, noisy, (4.0 + bias, bias, bias)))
        newest = made.position.newest
        assert newest is not None
        assert newest[1][3] == 4.0


@pytest.mark.parametrize("hertz", [20, 50])
def test_a_knock_on_the_feet_is_believed_within_a_tenth_of_a_second(hertz: int) -> None:
    made, rng, x, last_s = PoseHistory(AT_ORIGIN), Random(4), 0.0, 0.0
    for i in range(hertz):
        velocity = 1.3 if 2 * i < hertz else 0.0
        x += velocity / hertz
        noisy = (x + rng.gauss(0.0, 0.01), rng.gauss(0.0, 0.01), rng.gauss(0.0, 0.01))
        made.add(LocalPosition(1.0 + i / hertz, noisy, (velocity, 0.0, 0.0)))
        newest = made.position.newest
        assert newest is not None
        if newest[1][3] > 0.0:
            last_s = i / hertz
    assert last_s < 0.6


def test_a_climb_rate_that_stays_wrong_is_dropped_once_and_then_told_as_wrong() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(20):
        climbs = -2.5 if i >= 10 else 0.0
        made.add(LocalPosition(1.0 + 0.02 * i, (0.0, 0.0, 0.0), (0.0, 0.0, climbs)))
        newest = made.position.newest
        assert newest is not None
        assert newest[1][5] == (-2.5 if i >= 11 else 0.0)


def test_a_hard_knock_is_no_jump() -> None:
    made = PoseHistory(AT_ORIGIN)
    assert told(made, [1.0, 1.0, 0.1], [3.12, 3.13, -3.12]) == (0.1, -3.12)


def tumbling(seconds: float, step_s: float = 0.001) -> list[tuple[Vec3, Vec3]]:
    """Roll, pitch and yaw (rad) of an airframe that swings about all axes, and its body rates."""
    R, flown = rot_zyx(0.4, -0.3, 0.5), []
    for i in range(round(seconds / step_s)):
        t = i * step_s
        rates = (2.0 * math.sin(9.0 * t), 1.5 * math.cos(8.0 * t), 0.7)
        roll, pitch = math.atan2(R[2][1], R[2][2]), -math.asin(R[2][0])
        flown.append(((roll, pitch, math.atan2(R[1][0], R[0][0])), rates))
        p, q, r = (rate * step_s for rate in rates)
        R = matmul(R, rot_zyx(r, q, p))
    return flown


def test_between_two_attitudes_the_vehicle_turns_by_their_rates() -> None:
    made, flown = PoseHistory(AT_ORIGIN), tumbling(0.6)
    for i in range(0, 600, 40):  # at 25 Hz
        angles, rates = flown[i]
        made.add(Attitude(1.0 + 0.001 * i, *angles, rates))
    for i in range(20, 560, 40):
        got = made.attitude.at(1.0 + 0.001 * i)
        assert got is not None
        assert got[:3] == pytest.approx(flown[i][0], abs=math.radians(0.05))
    ahead = made.attitude.at(1.580)  # 20 ms after the newest
    assert ahead is not None
    assert ahead[:3] == pytest.approx(flown[580][0], abs=math.radians(0.3))


def test_steps_of_the_position_that_the_velocity_contradicts_are_smoothed() -> None:
    """GPS moves it 3 cm to either side every 0.2 s, and the velocity shows nothing of it."""
    made, rng = PoseHistory(AT_ORIGIN), Random(2)
    told, places = 0.0, []
    for i in range(500):
        told += rng.choice((-0.03, 0.03)) if i % 10 == 0 else 0.0
        made.add(LocalPosition(1.0 + 0.02 * i, (0.1 * i + told, 0.0, 0.0), (5.0, 0.0, 0.0)))
        newest = made.position.newest
        assert newest is not None
        places.append(newest[1][0] - 0.1 * i)
    steps = [abs(b - a) for a, b in pairwise(places)]
    assert max(steps) < 0.005
    for i in range(500, 4000):
        made.add(LocalPosition(1.0 + 0.02 * i, (0.1 * i + told, 0.0, 0.0), (5.0, 0.0, 0.0)))
    newest = made.position.newest
    assert newest is not None
    assert newest[1][0] - 0.1 * 3999 == pytest.approx(told, abs=0.02)  # it goes along in the end


def test_over_a_short_gap_the_smoothed_position_goes_on_without_a_jump() -> None:
    # What the velocity has carried it off by is no jump of the pad.
    made = PoseHistory(AT_ORIGIN)
    for i in range(1000):
        made.add(LocalPosition(1.0 + 0.02 * i, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)))
    last = made.position.newest
    assert last is not None
    assert last[1][0] > 1.0
    made.add(LocalPosition(last[0] + 0.5, (0.03, 0.0, 0.0), (0.1, 0.0, 0.0)))
    newest = made.position.newest
    assert newest is not None
    assert newest[1][0] - last[1][0] == pytest.approx(0.03)


def test_after_a_long_gap_the_position_is_taken_as_reported() -> None:
    made = PoseHistory(AT_ORIGIN)
    made.add(LocalPosition(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    made.add(LocalPosition(3.0, (0.2, 0.0, 0.0), (0.0, 0.0, 0.0)))
    newest = made.position.newest
    assert newest is not None
    assert newest[1][0] == 0.2


def test_gravity_points_down_in_the_picture_as_the_camera_is_turned() -> None:
    ahead = history().down(1.0)
    assert ahead == pytest.approx((0.0, 1.0, 0.0))  # the picture's bottom
    down = history(gimbal_deg=(0.0, -90.0, 0.0)).down(1.0)
    assert down == pytest.approx((0.0, 0.0, 1.0))  # along the lens
    rolled = history(attitude_deg=(90.0, 0.0, 0.0)).down(1.0)
    assert rolled == pytest.approx((1.0, 0.0, 0.0))  # right side down


def test_a_gimbal_axis_that_reports_only_its_orders_follows_them_with_the_lag() -> None:
    """Without the lag, yaw would be 10 degrees off while it turns at 120 degrees/s."""
    made = PoseHistory(AT_ORIGIN)
    lag_s = AT_ORIGIN.gimbal.lag_s
    rate, start, dt = math.radians(120.0), math.radians(170.0), 0.02  # across the back
    for i in range(50):
        order = start + rate * dt * i
        yaw = math.remainder(order, 2.0 * math.pi)
        made.add(
            GimbalState(
                1.0 + dt * i,
                yaw,
                order - start - 1.5,
                0.0,
                Reference.BODY,
                pitch_measured=False,
                yaw_measured=False,
            )
        )
    newest = made.gimbal.newest
    assert newest is not None
    behind = [math.remainder(yaw - newest[1][0], 2.0 * math.pi), order - start - 1.5 - newest[1][1]]
    # What is ordered in steps is followed half a step sooner.
    assert behind == pytest.approx([rate * (lag_s - 0.5 * dt)] * 2, rel=0.02)


def test_a_gimbal_axis_that_is_measured_is_where_it_reports() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(3):
        made.add(GimbalState(1.0 + 0.02 * i, 0.1 * i, 0.0, 0.0, Reference.BODY, False))
    newest = made.gimbal.newest
    assert newest is not None
    assert newest[1][0] == 0.2
