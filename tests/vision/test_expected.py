"""Where the pad is expected: by the estimate, else where it was just seen, else nowhere."""

import math

import numpy as np
import pytest

from landerd.geometry import Vec3
from landerd.messages import PadPrior, PoseSolution, Prior
from landerd.vision.expected import Expected, SeenPad, expected_pad
from landerd.vision.pose import rotation_from

FOCAL = 400.0
DOWN: Vec3 = (0.0, 0.6, 0.8)
NORTH: Vec3 = (1.0, 0.0, 0.0)
SEEN = PoseSolution(
    position=(0.1, 0.2, 5.0),
    normal=(0.0, 0.0, 1.0),
    north=(0.0, 1.0, 0.0),
    covariance=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    sigma_yaw=0.1,
    sigma_tilt=0.1,
    cost=0.0,
)
LAST = SeenPad(10.0, SEEN)


def expected(t: float, prior: Prior, last: SeenPad | None = LAST) -> Expected:
    found = expected_pad(t, prior, last, FOCAL)
    assert found is not None
    return found


def test_a_pad_that_nobody_knows_of_is_not_expected() -> None:
    assert expected_pad(10.0, Prior(down=DOWN), None, FOCAL) is None


def test_the_pad_is_expected_where_it_was_seen_the_less_surely_the_longer_ago() -> None:
    soon, late = expected(10.1, Prior()), expected(10.4, Prior())
    for found in (soon, late):
        assert found.position.tolist() == list(SEEN.position)
        assert found.normal.tolist() == list(SEEN.normal)
        assert found.north is not None
        assert found.north.tolist() == [0.0, 1.0, 0.0]
    assert (late.sigma_m, late.margin_px) == pytest.approx((4.0 * soon.sigma_m, 160.0))
    assert soon.margin_px == pytest.approx(40.0)


@pytest.mark.parametrize("t", [10.6, 9.9])
def test_a_sighting_of_long_ago_or_from_the_future_says_nothing(t: float) -> None:
    assert expected_pad(t, Prior(), LAST, FOCAL) is None


def test_the_estimates_prediction_goes_before_what_was_seen() -> None:
    pad = PadPrior(position=(1.0, 2.0, 6.0), sigma_m=0.3, north=NORTH, normal=DOWN)
    found = expected(10.1, Prior(down=(0.0, 0.0, 1.0), pad=pad))
    assert found.position.tolist() == [1.0, 2.0, 6.0]
    assert found.normal.tolist() == list(DOWN)
    assert found.north is not None
    assert found.north.tolist() == list(NORTH)
    assert (found.sigma_m, found.margin_px) == (0.3, 4.0)


def test_a_pad_not_yet_believed_is_searched_for_where_it_is_predicted() -> None:
    pad = PadPrior(position=(1.0, 2.0, 6.0), sigma_m=0.3, north=NORTH, normal=DOWN)
    assert expected(10.1, Prior(maybe=pad)).position.tolist() == [1.0, 2.0, 6.0]


def test_a_prediction_without_normal_takes_gravitys_or_else_that_last_seen() -> None:
    pad = PadPrior(position=(0.0, 3.0, 4.0), sigma_m=0.3, north=None)
    level = expected(10.1, Prior(down=DOWN, pad=pad))
    assert level.normal.tolist() == list(DOWN)
    assert level.north is not None
    assert level.north.tolist() == [0.0, 1.0, 0.0]
    assert expected(10.1, Prior(pad=pad)).normal.tolist() == list(SEEN.normal)


def test_a_lone_prediction_is_of_a_pad_that_faces_the_camera_and_has_no_north() -> None:
    pad = PadPrior(position=(0.0, 3.0, 4.0), sigma_m=0.3, north=None)
    found = expected(10.1, Prior(pad=pad), None)
    assert found.normal.tolist() == [0.0, 0.6, 0.8]
    assert found.north is None


def test_only_what_is_centred_on_the_landing_point_can_be_expected_without_north() -> None:
    centre, normal = np.array([0.0, 0.0, 4.0]), np.array([0.0, 0.0, 1.0])
    outline = np.array([[0.5, 0.0], [0.0, 0.5]])
    blind = Expected(centre, normal, None, 0.1, 4.0)
    assert blind.points((0.75, 0.0), outline) is None
    points = blind.points((0.0, 0.0), outline)
    assert points is not None
    assert np.linalg.norm(points - centre, axis=1) == pytest.approx([0.5, 0.5])
    north = Expected(centre, normal, np.array([0.0, -1.0, 0.0]), 0.1, 4.0)
    points = north.points((0.75, 0.0), outline)
    assert points is not None
    assert points[0].tolist() == pytest.approx([0.0, -1.25, 4.0])  # north is up in this image
    assert points[1].tolist() == pytest.approx([0.5, -0.75, 4.0])


def test_a_plane_has_axes_whichever_way_it_faces() -> None:
    for normal in ([1.0, 1.0, 1.0], [0.0, 0.0, 1.0], [-1.0, 1.0, 0.1], [1.0, 0.0, 0.0]):
        n = np.array(normal) / math.hypot(*normal)
        R = rotation_from(n)
        assert R[:, 2] == pytest.approx(n)
        assert pytest.approx(np.eye(3)) == R.T @ R
