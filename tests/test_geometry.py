import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd.geometry import (
    IDENTITY,
    R_GIMBAL_CAMERA,
    Mat3,
    Vec3,
    angles_zxy,
    diagonal,
    heading_of,
    horizontal_sigma,
    inverse,
    is_finite,
    matadd,
    matmul,
    matmul_transposed,
    matsub,
    norm,
    rot_y,
    rot_z,
    rot_zxy,
    rot_zyx,
    rotate,
    rotate_covariance,
    rotation,
    sub,
    transpose,
    unit,
    wrap,
)

ANGLES = st.floats(-1e4, 1e4)
COORDINATES = st.floats(-1e3, 1e3)
VECTORS = st.tuples(COORDINATES, COORDINATES, COORDINATES)
DOWN: Vec3 = (0.0, 0.0, 1.0)
QUARTER = math.pi / 2.0


def close(a: Vec3, b: Vec3, tolerance: float = 1e-9) -> bool:
    return norm(sub(a, b)) <= tolerance


def determinant(m: Mat3) -> float:
    (a, b, c), (d, e, f), (g, h, i) = m
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


# Each turn is one a person can do with a hand: where do nose (x), right (y) and belly (z) point?
@pytest.mark.parametrize(
    ("yaw", "pitch", "roll", "nose", "right", "belly"),
    [
        (0.0, 0.0, 0.0, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        (QUARTER, 0.0, 0.0, (0, 1, 0), (-1, 0, 0), (0, 0, 1)),  # nose east
        (0.0, QUARTER, 0.0, (0, 0, -1), (0, 1, 0), (1, 0, 0)),  # nose up
        (0.0, 0.0, QUARTER, (1, 0, 0), (0, 0, 1), (0, -1, 0)),  # right side down
        (QUARTER, 0.0, QUARTER, (0, 1, 0), (0, 0, 1), (1, 0, 0)),  # turned, then rolled
    ],
)
def test_yaw_right_pitch_up_and_roll_right_are_positive(
    yaw: float, pitch: float, roll: float, nose: Vec3, right: Vec3, belly: Vec3
) -> None:
    R = rot_zyx(yaw, pitch, roll)
    assert close(rotate(R, (1.0, 0.0, 0.0)), nose)
    assert close(rotate(R, (0.0, 1.0, 0.0)), right)
    assert close(rotate(R, DOWN), belly)


def test_the_lens_looks_along_the_gimbals_x_with_the_pictures_top_up() -> None:
    assert rotate(R_GIMBAL_CAMERA, (0.0, 0.0, 1.0)) == (1.0, 0.0, 0.0)  # ahead
    assert rotate(R_GIMBAL_CAMERA, (1.0, 0.0, 0.0)) == (0.0, 1.0, 0.0)  # the picture's right
    assert rotate(R_GIMBAL_CAMERA, (0.0, 1.0, 0.0)) == (0.0, 0.0, 1.0)  # the picture's bottom


def test_straight_down_the_pictures_top_is_the_nose() -> None:
    R = matmul(rot_zyx(0.0, -QUARTER, 0.0), R_GIMBAL_CAMERA)
    assert close(rotate(R, (0.0, 0.0, 1.0)), DOWN)
    assert close(rotate(R, (0.0, -1.0, 0.0)), (1.0, 0.0, 0.0))
    assert close(rotate(R, (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0))


@given(ANGLES, ANGLES, ANGLES)
def test_rotations_are_orthonormal_and_right_handed(yaw: float, pitch: float, roll: float) -> None:
    R = rot_zyx(yaw, pitch, roll)
    product = matmul(R, transpose(R))
    assert all(close(product[i], IDENTITY[i]) for i in range(3))
    assert determinant(R) == pytest.approx(1.0)


@given(ANGLES, ANGLES, ANGLES, VECTORS)
def test_a_rotation_keeps_lengths_and_is_undone_by_its_transpose(
    yaw: float, pitch: float, roll: float, v: Vec3
) -> None:
    R = rot_zyx(yaw, pitch, roll)
    assert norm(rotate(R, v)) == pytest.approx(norm(v), abs=1e-9)
    assert close(rotate(transpose(R), rotate(R, v)), v, 1e-9 * (1.0 + norm(v)))


@given(ANGLES)
def test_wrap_keeps_the_direction_within_half_a_turn(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)
    assert math.sin(wrapped - angle) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-math.pi, math.pi), st.integers(-50, 50))
def test_whole_turns_do_not_change_a_wrapped_angle(angle: float, turns: int) -> None:
    difference = wrap(angle + 2.0 * math.pi * turns) - angle
    assert min(abs(difference), abs(abs(difference) - 2.0 * math.pi)) < 1e-9


def test_half_a_turn_is_always_plus_pi() -> None:
    assert wrap(-math.pi) == math.pi
    assert wrap(math.pi) == math.pi


@given(ANGLES, ANGLES)
def test_a_quarter_turn_of_yaw_carries_the_north_variance_to_east(a: float, b: float) -> None:
    north, east, down = abs(a) + 1.0, abs(b) + 1.0, 0.5
    covariance: Mat3 = ((north, 0.0, 0.0), (0.0, east, 0.0), (0.0, 0.0, down))
    turned = rotate_covariance(rot_zyx(QUARTER, 0.0, 0.0), covariance)
    assert (turned[0][0], turned[1][1], turned[2][2]) == pytest.approx((east, north, down))


@given(VECTORS, st.floats(0.5, 2.0), ANGLES, ANGLES)
def test_the_inverse_undoes_a_matrix(v: Vec3, size: float, yaw: float, pitch: float) -> None:
    R = rot_zyx(yaw, pitch, 0.3)
    m = rotate_covariance(R, ((size, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0)))
    assert close(rotate(inverse(m), rotate(m, v)), v, 1e-8 * (1.0 + norm(v)))


def test_a_singular_matrix_and_a_zero_vector_are_refused() -> None:
    with pytest.raises(ZeroDivisionError):
        inverse(((1.0, 2.0, 3.0), (2.0, 4.0, 6.0), (0.0, 0.0, 1.0)))
    with pytest.raises(ZeroDivisionError):
        unit((0.0, 0.0, 0.0))


def test_heading_is_counted_from_north_to_east() -> None:
    assert heading_of((1.0, 0.0, 5.0)) == 0.0
    assert heading_of((0.0, 1.0, 0.0)) == pytest.approx(QUARTER)
    assert heading_of((0.0, -2.0, 0.0)) == pytest.approx(-QUARTER)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_one_bad_component_makes_a_vector_not_finite(bad: float) -> None:
    assert is_finite((1.0, 2.0, 3.0))
    for i in range(3):
        v = [1.0, 2.0, 3.0]
        v[i] = bad
        assert not is_finite((v[0], v[1], v[2]))


@given(yaw=st.floats(-3.1, 3.1), pitch=st.floats(-3.1, 3.1), roll=st.floats(-0.3, 0.3))
def test_a_gimbals_angles_are_found_again_also_straight_down(
    yaw: float, pitch: float, roll: float
) -> None:
    R = rot_zxy(yaw, roll, pitch)
    product = matmul(matmul(rot_z(yaw), rot_zyx(0.0, 0.0, roll)), rot_y(pitch))
    assert all(close(a, b) for a, b in zip(R, product, strict=True))
    assert angles_zxy(R) == pytest.approx((yaw, pitch, roll), abs=1e-6)


@given(ANGLES, ANGLES)
def test_without_roll_the_order_of_the_axes_makes_no_difference(yaw: float, pitch: float) -> None:
    assert rot_zxy(yaw, 0.0, pitch) == rot_zyx(yaw, pitch, 0.0)  # to the bit: logs replay


def test_a_quaternion_is_a_rotation_only_at_length_one() -> None:
    half = math.sqrt(0.5)
    R = rotation((half, 0.0, 0.0, half))
    assert R is not None
    assert close(rotate(R, (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0))  # turned right
    assert rotation((0.0, 0.0, 0.0, 0.0)) is None
    assert rotation((math.nan, 0.0, 0.0, 0.0)) is None


@given(a=st.tuples(VECTORS, VECTORS, VECTORS), b=st.tuples(VECTORS, VECTORS, VECTORS))
def test_a_product_with_a_transpose_is_the_product_with_what_was_transposed(
    a: Mat3, b: Mat3
) -> None:
    assert matmul_transposed(a, b) == matmul(a, transpose(b))
    assert matmul_transposed(IDENTITY, b) == transpose(b)


@given(a=st.tuples(VECTORS, VECTORS, VECTORS), b=st.tuples(VECTORS, VECTORS, VECTORS))
def test_a_difference_and_what_was_subtracted_make_the_whole(a: Mat3, b: Mat3) -> None:
    whole = matadd(matsub(a, b), b)
    assert all(close(got, row, 1e-9) for got, row in zip(whole, a, strict=True))


@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0, 90.0, 200.0])
def test_the_largest_horizontal_sigma_does_not_depend_on_the_axes(degrees: float) -> None:
    covariance = rotate_covariance(rot_z(math.radians(degrees)), diagonal(9.0, 1.0, 25.0))
    assert horizontal_sigma(covariance) == pytest.approx(3.0)
