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


def test_gravity_in_the_picture() -> None:
    ahead = history().down(1.0)
    assert ahead == pytest.approx((0.0, 1.0, 0.0))  # the picture's bottom
    down = history(gimbal_deg=(0.0, -90.0, 0.0)).down(1.0)
    assert down == pytest.approx((0.0, 0.0, 1.0))  # along the lens
    rolled = history(attitude_deg=(90.0, 0.0, 0.0)).down(1.0)
    assert rolled == pytest.approx((1.0, 0.0, 0.0))  # right side down
