import math

import pytest

from landerd.config.models import Config
from landerd.estimation.camera_pose import PoseHistory
from landerd.estimation.motion_filter import Jacobian
from landerd.estimation.observation import ObservationModel, PadObservation
from landerd.geometry import (
    R_GIMBAL_CAMERA,
    Vec3,
    matmul,
    norm,
    rot_y,
    rot_z,
    rot_zyx,
    rotate,
    sub,
    transpose,
)
from landerd.messages import Attitude, GimbalState, LocalPosition, PoseSolution, Reference
from tests.estimation.histories import AT_ORIGIN, DEGREES, history

SMALL = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))


def seen(
    position: Vec3,
    *,
    normal: Vec3 = (0.0, 0.0, 1.0),
    north: Vec3 | None = None,
    covariance: tuple[Vec3, Vec3, Vec3] = SMALL,
) -> PoseSolution:
    sigma_yaw = None if north is None else 0.01
    return PoseSolution(position, normal, north, covariance, sigma_yaw, 0.02, 1.0)


def model(made: PoseHistory) -> ObservationModel:
    return ObservationModel(Config().estimation, made)


def observed(made: PoseHistory, solution: PoseSolution, t: float = 1.0) -> PadObservation:
    found = model(made).observe(t, solution)
    assert found is not None
    return found


def test_ten_metres_ahead_of_a_camera_turned_left_is_ten_metres_to_the_left() -> None:
    # Thesis 2.3.6, with its yaw of -pi/2; facing north, left is west.
    made = history(gimbal_deg=(-90.0, 0.0, 0.0))
    assert observed(made, seen((0.0, 0.0, 10.0))).position == pytest.approx((0.0, -10.0, 0.0))
    facing_east = history(gimbal_deg=(-90.0, 0.0, 0.0), attitude_deg=(0.0, 0.0, 90.0))
    assert observed(facing_east, seen((0.0, 0.0, 10.0))).position == pytest.approx((10.0, 0.0, 0.0))


def test_a_camera_turned_left_and_45_degrees_down_sees_the_pad_left_and_below() -> None:
    made = history(gimbal_deg=(-90.0, -45.0, 0.0))
    side = 10.0 / math.sqrt(2.0)
    assert observed(made, seen((0.0, 0.0, 10.0))).position == pytest.approx((0.0, -side, side))


def test_straight_down_the_picture_is_a_map_with_the_nose_on_top() -> None:
    made = history(position=(100.0, 50.0, -8.0), gimbal_deg=(0.0, -90.0, 0.0))
    # 1 m right of the centre, 2 m above it, 8 m away.
    assert observed(made, seen((1.0, -2.0, 8.0))).position == pytest.approx((102.0, 51.0, 0.0))
    east = history(gimbal_deg=(0.0, -90.0, 0.0), attitude_deg=(0.0, 0.0, 90.0))
    assert observed(east, seen((1.0, -2.0, 8.0))).position == pytest.approx((-1.0, 2.0, 8.0))


def test_past_straight_down_the_camera_looks_behind() -> None:
    made = history(gimbal_deg=(0.0, -135.0, 0.0))
    back = 10.0 / math.sqrt(2.0)
    assert observed(made, seen((0.0, 0.0, 10.0))).position == pytest.approx((-back, 0.0, back))


def test_the_airframes_lean_is_taken_out() -> None:
    # Thesis chapter 5 asks for it. Nose 20 degrees up and a servo gimbal straight down in the
    # body: the lens looks 20 degrees ahead of the vertical.
    made = history(attitude_deg=(0.0, 20.0, 0.0), gimbal_deg=(0.0, -90.0, 0.0))
    expected = (10.0 * math.sin(20.0 * DEGREES), 0.0, 10.0 * math.cos(20.0 * DEGREES))
    assert observed(made, seen((0.0, 0.0, 10.0))).position == pytest.approx(expected)
    # Rolled 20 degrees to the right, straight down in the body is to the left of the vertical.
    rolled = history(attitude_deg=(20.0, 0.0, 0.0), gimbal_deg=(0.0, -90.0, 0.0))
    expected = (0.0, -10.0 * math.sin(20.0 * DEGREES), 10.0 * math.cos(20.0 * DEGREES))
    assert observed(rolled, seen((0.0, 0.0, 10.0))).position == pytest.approx(expected)


def test_the_airframes_lean_is_not_added_to_angles_measured_against_the_horizon() -> None:
    for roll, pitch in ((20.0, 0.0), (0.0, -15.0), (10.0, 12.0)):
        made = history(
            attitude_deg=(roll, pitch, 30.0),
            gimbal_deg=(0.0, -90.0, 0.0),
            reference=Reference.HORIZON,
        )
        assert observed(made, seen((0.0, 0.0, 10.0))).position == pytest.approx((0.0, 0.0, 10.0))
    # Its yaw is still counted from the nose.
    level = history(
        attitude_deg=(20.0, 0.0, 90.0), gimbal_deg=(0.0, 0.0, 0.0), reference=Reference.HORIZON
    )
    assert observed(level, seen((0.0, 0.0, 10.0))).position == pytest.approx((0.0, 10.0, 0.0))


def test_the_cameras_place_on_the_airframe_turns_with_it() -> None:
    config = Config.model_validate({"vehicle": {"camera_offset_m": (0.3, 0.1, 0.05)}})
    down = (0.0, -90.0, 0.0)
    north = history(config, gimbal_deg=down)
    assert observed(north, seen((0.0, 0.0, 10.0))).position == pytest.approx((0.3, 0.1, 10.05))
    south = history(config, gimbal_deg=down, attitude_deg=(0.0, 0.0, 180.0))
    assert observed(south, seen((0.0, 0.0, 10.0))).position == pytest.approx((-0.3, -0.1, 10.05))


def test_a_pads_heading_is_found_from_any_attitude() -> None:
    for attitude, gimbal in (
        ((0.0, 0.0, 0.0), (0.0, -90.0, 0.0)),
        ((12.0, -7.0, 130.0), (40.0, -60.0, 3.0)),
        ((-20.0, 9.0, -175.0), (-80.0, -120.0, 0.0)),
    ):
        made = history(attitude_deg=attitude, gimbal_deg=gimbal)
        # What the camera sees of a level pad that points to 170 degrees, by an independent chain.
        roll, pitch, yaw = (a * DEGREES for a in attitude)
        body = rot_zyx(yaw, pitch, roll)
        yaw, pitch, roll = (a * DEGREES for a in gimbal)
        turned = matmul(matmul(rot_z(yaw), rot_zyx(0.0, 0.0, roll)), rot_y(pitch))
        lens = matmul(turned, R_GIMBAL_CAMERA)
        camera_from_local = transpose(matmul(body, lens))
        north = rotate(camera_from_local, (math.cos(170 * DEGREES), math.sin(170 * DEGREES), 0.0))
        normal = rotate(camera_from_local, (0.0, 0.0, 1.0))
        found = observed(made, seen((0.2, 0.1, 5.0), normal=normal, north=north))
        assert found.heading == pytest.approx(170.0 * DEGREES)
        assert found.tilt == pytest.approx(0.0, abs=1e-6)


def test_a_ring_has_no_heading_and_a_leaning_pad_has_its_tilt() -> None:
    made = history(gimbal_deg=(0.0, -90.0, 0.0))
    normal = (0.0, math.sin(0.3), math.cos(0.3))
    found = observed(made, seen((0.0, 0.0, 5.0), normal=normal))
    assert found.heading is None
    assert found.tilt == pytest.approx(0.3)


def test_range_is_the_least_certain_direction_and_turns_with_the_lens() -> None:
    # The picture knows across far better than along; the gimbal's noise adds across.
    along = ((1e-6, 0.0, 0.0), (0.0, 1e-6, 0.0), (0.0, 0.0, 0.25))
    ahead = observed(history(), seen((0.0, 0.0, 10.0), covariance=along)).covariance
    down = observed(
        history(gimbal_deg=(0.0, -90.0, 0.0)), seen((0.0, 0.0, 10.0), covariance=along)
    ).covariance
    options = Config().estimation
    across = (10.0 * options.bearing_noise_deg * DEGREES) ** 2 + options.position_sigma_m**2 + 1e-6
    assert ahead[0][0] == pytest.approx(0.25 + options.position_sigma_m**2)
    assert (ahead[1][1], ahead[2][2]) == pytest.approx((across, across), rel=1e-2)
    assert down[2][2] == pytest.approx(0.25 + options.position_sigma_m**2)
    assert (down[0][0], down[1][1]) == pytest.approx((across, across), rel=1e-2)


def test_a_late_picture_is_observed_by_the_attitude_of_its_exposure() -> None:
    made = PoseHistory(AT_ORIGIN)
    # Turning right at 1 rad/s while flying north at 5 m/s.
    for i in range(21):
        t = 0.02 * i
        made.add(LocalPosition(t, (5.0 * t, 0.0, -10.0), (5.0, 0.0, 0.0)))
        made.add(Attitude(t, 0.0, 0.0, t, (0.0, 0.0, 1.0)))
        made.add(GimbalState(t, 0.0, 0.0, 0.0, Reference.BODY))
    found = observed(made, seen((0.0, 0.0, 10.0)), t=0.25)
    expected = (1.25 + 10.0 * math.cos(0.25), 10.0 * math.sin(0.25), -10.0)
    assert found.t == 0.25
    assert norm(sub(found.position, expected)) < 1e-6


@pytest.mark.parametrize("missing", [LocalPosition, Attitude, GimbalState])
def test_without_one_of_its_three_sources_nothing_is_observed(missing: type) -> None:
    messages = (
        LocalPosition(1.0, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0)),
        Attitude(1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)),
        GimbalState(1.0, 0.0, -1.0, 0.0, Reference.BODY),
    )
    made = PoseHistory(AT_ORIGIN)
    for message in messages:
        if not isinstance(message, missing):
            made.add(message)
    assert model(made).observe(1.0, seen((0.0, 0.0, 5.0))) is None


def test_a_picture_older_or_much_younger_than_the_telemetry_is_not_observed() -> None:
    made = history(t=1.0)
    assert model(made).observe(0.99, seen((0.0, 0.0, 5.0))) is None
    assert model(made).observe(1.1, seen((0.0, 0.0, 5.0))) is not None
    assert model(made).observe(1.25, seen((0.0, 0.0, 5.0))) is None  # attitude is fresh for 0.2 s


def jacobian(seen: PadObservation) -> Jacobian:
    """Return the derivatives of the pad's seen place by the biases."""
    return seen.biases.jacobian(seen.arm, seen.biases.range_share)


def test_an_error_of_the_lenss_direction_moves_the_pad_as_the_jacobian_says() -> None:
    # A lens that looks 1 degree farther right than the gimbal says, and one 1 degree farther up.
    true = seen((0.5, -1.0, 10.0))
    for gimbal_deg, error in (((31.0, -50.0, 0.0), (0.0, 1.0)), ((30.0, -49.0, 0.0), (1.0, 0.0))):
        said = observed(history(gimbal_deg=(30.0, -50.0, 0.0)), true)
        really = observed(history(gimbal_deg=gimbal_deg), true)
        about_x, about_y = error[0] * DEGREES, error[1] * DEGREES * math.cos(50.0 * DEGREES)
        expected = rotate(jacobian(said)[0], (about_x, about_y, 0.0))
        moved = sub(said.position, really.position)
        # Yaw also rolls the picture, which moves only what is off its middle.
        assert norm(sub(moved, expected)) < 0.02


def test_an_error_of_the_clock_moves_the_pad_by_the_vehicles_velocity() -> None:
    made = PoseHistory(AT_ORIGIN)
    for i in range(40):
        t = 0.02 * i
        made.add(LocalPosition(t, (5.0 * t, 0.0, -10.0), (5.0, 0.0, 0.0)))
        made.add(Attitude(t, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)))
        made.add(GimbalState(t, 0.0, -90.0 * DEGREES, 0.0, Reference.BODY))
    found = observed(made, seen((0.0, 0.0, 10.0)), t=0.5)
    assert [row[2] for row in jacobian(found)[0]] == pytest.approx([5.0, 0.0, 0.0])


def test_the_first_pictures_dependence_on_the_clock_comes_from_later_telemetry() -> None:
    """Once, it was taken to be zero, and the clock was learned 4 ms or 24 ms wrong for good."""

    def telling(first: int) -> Vec3:
        made = PoseHistory(AT_ORIGIN)
        for i in range(first, 40):
            t = 0.02 * i
            made.add(LocalPosition(t, (0.0, 0.0, -10.0), (0.0, 0.0, 0.0)))
            made.add(Attitude(t, 0.0, 0.0, 0.5 * t, (0.0, 0.0, 0.5)))
            made.add(GimbalState(t, t, -60.0 * DEGREES, 0.0, Reference.BODY))
        rows = jacobian(observed(made, seen((0.0, 0.0, 10.0)), t=0.5))[0]
        return rows[0][2], rows[1][2], rows[2][2]

    assert norm(telling(0)) > 5.0
    assert norm(sub(telling(25), telling(0))) < 0.2


def test_after_a_restart_of_the_autopilot_its_old_frame_is_not_used() -> None:
    made = history()
    made.forget_autopilot()
    assert model(made).observe(1.0, seen((0.0, 0.0, 5.0))) is None
