from itertools import pairwise
from random import Random

import pytest

from landerd.estimation.camera_pose import PoseHistory
from landerd.messages import Attitude, GimbalState, LocalPosition, Reference
from tests.estimation.histories import AT_ORIGIN, history


def test_when_the_local_frame_jumps_the_past_goes_along() -> None:
    made = PoseHistory(AT_ORIGIN)
    made.add(Attitude(1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)))
    made.add(GimbalState(1.0, 0.0, 0.0, 0.0, Reference.BODY))
    velocity = (5.0, 0.0, 0.0)
    assert made.add(LocalPosition(1.00, (0.0, 0.0, 0.0), velocity)) is None
    assert made.add(LocalPosition(1.02, (0.1, 0.0, 0.0), velocity)) is None
    jump = made.add(LocalPosition(1.04, (2.2, -1.0, 0.5), velocity))
    assert jump == pytest.approx((2.0, -1.0, 0.5))
    camera = made.camera_pose(1.01)
    assert camera is not None
    assert camera.position == pytest.approx((2.05, -1.0, 0.5))


def test_a_position_that_wanders_is_no_motion() -> None:
    """As GPS has it: 3 cm to either side every 0.2 s, while the velocity says nothing of it."""
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


def test_over_a_gap_it_goes_on_from_where_it_was() -> None:
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


def test_after_a_gap_the_position_is_taken_as_it_is() -> None:
    made = PoseHistory(AT_ORIGIN)
    made.add(LocalPosition(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    made.add(LocalPosition(3.0, (0.2, 0.0, 0.0), (0.0, 0.0, 0.0)))
    newest = made.position.newest
    assert newest is not None
    assert newest[1][0] == 0.2


def test_gravity_in_the_picture() -> None:
    ahead = history().down(1.0)
    assert ahead == pytest.approx((0.0, 1.0, 0.0))  # the picture's bottom
    down = history(gimbal_deg=(0.0, -90.0, 0.0)).down(1.0)
    assert down == pytest.approx((0.0, 0.0, 1.0))  # along the lens
    rolled = history(attitude_deg=(90.0, 0.0, 0.0)).down(1.0)
    assert rolled == pytest.approx((1.0, 0.0, 0.0))  # right side down
