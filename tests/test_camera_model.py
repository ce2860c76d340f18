import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.camera_model import (
    F64,
    CalibrationError,
    CameraModel,
    Window,
    camera_info,
    left_out,
    load_camera,
    used_part,
)

ROOT = Path(__file__).parents[1]
PINHOLE = CameraModel(640, 480, 400.0, 390.0, 319.5, 239.5)
GOOD = """\
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [400, 0, 319.5, 0, 390, 239.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.05, 0.001, -0.002, 0.0]}
"""


def camera(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    return path


def test_the_thesis_camera_is_that_of_its_section_3_1() -> None:
    model = load_camera(ROOT / "config/cameras/thesis.yaml")
    assert (model.width, model.height) == (640, 480)
    assert (model.fx, model.fy, model.cx, model.cy) == (398.2, 390.8, 299.9, 227.5)
    assert model.distortion == (0.0576, -0.0321, 0.0041, -0.0203, 0.0)


def test_a_point_45_degrees_to_the_right_is_one_focal_length_from_the_centre() -> None:
    (pixel,) = PINHOLE.pixels(np.array([[3.0, 0.0, 3.0]]))
    assert tuple(pixel) == pytest.approx((319.5 + 400.0, 239.5))
    (below,) = PINHOLE.pixels(np.array([[0.0, 1.0, 2.0]]))
    assert tuple(below) == pytest.approx((319.5, 239.5 + 195.0))


def test_distortion_is_that_of_the_brown_conrady_formula() -> None:
    # x' = x (1 + k1 r2 + k2 r4 + k3 r6) + 2 p1 x y + p2 (r2 + 2 x2), y' with p1 and p2 exchanged.
    k1, k2, p1, p2, k3 = 0.1, -0.05, 0.001, -0.002, 0.01
    model = CameraModel(640, 480, 400.0, 390.0, 319.5, 239.5, (k1, k2, p1, p2, k3))
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = 400.0 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 319.5
    v = 390.0 * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + 239.5
    (pixel,) = model.pixels(np.array([[2 * x, 2 * y, 2.0]]))
    assert tuple(pixel) == pytest.approx((u, v))


def test_rays_undo_the_lens_over_the_whole_picture() -> None:
    model = load_camera(ROOT / "config/cameras/thesis.yaml")
    pixels = np.array([[u, v] for u in (0.0, 200.0, 639.0) for v in (0.0, 200.0, 479.0)])
    rays = model.rays(pixels)
    points = np.column_stack([rays, np.ones(len(rays))])
    assert np.abs(model.pixels(7.0 * points) - pixels).max() < 0.01


@pytest.mark.parametrize(
    "distortion", [(0.0576, -0.0321, 0.0041, -0.0203, 0.0), (-0.35, 0.1, 0.0, 0.0, 0.0)]
)
def test_points_far_outside_the_field_of_view_are_not_projected_into_the_picture(
    distortion: tuple[float, ...],
) -> None:
    """The polynomials of both turn back 60 degrees aside: 80 degrees would be in the middle."""
    model = CameraModel(640, 480, 398.2, 390.8, 319.5, 239.5, distortion)
    for angle in np.linspace(0.0, 2.0 * math.pi, 12):
        tangent = np.linspace(0.1, 12.0, 300)
        aside = np.outer(tangent, (math.cos(angle), math.sin(angle)))
        pixels = model.pixels(np.column_stack([aside, np.ones(len(aside))]))
        out = np.hypot(*(pixels - (model.cx, model.cy)).T)
        assert (np.diff(out) > 0.0).all()


def test_a_fisheye_images_the_angle_by_its_polynomial() -> None:
    k1, k2, k3, k4 = 0.05, -0.01, 0.003, -0.001
    model = CameraModel(640, 480, 200.0, 210.0, 319.5, 239.5, (k1, k2, k3, k4), fisheye=True)
    a = math.radians(70.0)
    r = a + k1 * a**3 + k2 * a**5 + k3 * a**7 + k4 * a**9
    point = np.array([[math.sin(a) * 0.6, math.sin(a) * -0.8, math.cos(a)]])
    (pixel,) = model.pixels(5.0 * point)
    assert tuple(pixel) == pytest.approx((319.5 + 200.0 * r * 0.6, 239.5 - 210.0 * r * 0.8))
    (ray,) = model.rays(np.array([pixel]))
    assert tuple(ray) == pytest.approx((math.tan(a) * 0.6, math.tan(a) * -0.8), rel=1e-5)
    half = model.scaled(320, 240)
    assert half.rays(half.pixels(point)) == pytest.approx(model.rays(model.pixels(point)))


def test_at_twice_the_size_each_pixel_looks_where_its_own_quarter_did() -> None:
    large = PINHOLE.scaled(1280, 960)
    # The corner that four small pixels share lies between the same small and large pixels.
    ray_small = PINHOLE.rays(np.array([[99.5, 49.5]]))
    ray_large = large.rays(np.array([[199.5, 99.5]]))
    assert ray_small == pytest.approx(ray_large)
    assert (large.width, large.height, large.fx) == (1280, 960, 800.0)


def test_another_aspect_is_refused_with_both_sizes_named() -> None:
    with pytest.raises(CalibrationError, match=r"640x480.*1280x720"):
        PINHOLE.scaled(1280, 720)


@pytest.mark.parametrize(
    ("count", "model"),
    [
        (0, "plumb_bob"),
        (4, "plumb_bob"),
        (8, "rational_polynomial"),
        (4, "equidistant"),
        (4, "fisheye"),
    ],
)
def test_every_ros_distortion_model_is_read(tmp_path: Path, count: int, model: str) -> None:
    coefficients = [0.00001 * i for i in range(count)]  # 1e-05 is text to YAML, not a number
    text = GOOD.replace("plumb_bob", model).replace(
        "[0.1, -0.05, 0.001, -0.002, 0.0]", str([f"{k:.8f}" for k in coefficients]).replace("'", "")
    )
    read = load_camera(camera(tmp_path, text))
    assert read.distortion == pytest.approx(coefficients)
    assert read.fisheye == (model in ("equidistant", "fisheye"))
    # and what landerd writes is read back the same
    written = tmp_path / "written.yaml"
    written.write_text(camera_info(read, "mine"))
    assert load_camera(written) == read


@pytest.mark.parametrize(
    ("found", "instead", "key", "expected"),
    [
        ("image_width: 640\n", "", "image_width", "whole number"),
        ("image_width: 640", "image_width: 640.5", "image_width", "whole number"),
        ("image_height: 480", "image_height: yes", "image_height", "whole number"),
        ("image_height: 480", "image_height: -480", "image_height", "whole number"),
        ("0, 0, 1]", "0, 0]", "camera_matrix", "list of 9"),
        ("[400,", "[.nan,", "camera_matrix", "finite numbers"),
        ("[400,", "[-400,", "camera_matrix", "above 0"),
        ("[400, 0,", "[400, 3,", "camera_matrix", "fx 0 cx"),
        ("camera_matrix:", "camera_matrices:", "camera_matrix", "list of 9"),
        ("plumb_bob", "thin_prism", "distortion_model", "plumb_bob, rational_polynomial"),
        ("plumb_bob", "[plumb_bob]", "distortion_model", "plumb_bob, rational_polynomial"),
        ("plumb_bob", "equidistant", "distortion_coefficients", "list of 4"),
        ("plumb_bob", "rational_polynomial", "distortion_coefficients", "list of 8"),
        (", 0.0]}", ", wide]}", "distortion_coefficients", "finite numbers"),
    ],
)
def test_a_wrong_calibration_is_refused_with_file_key_and_what_was_expected(
    tmp_path: Path, found: str, instead: str, key: str, expected: str
) -> None:
    assert found in GOOD
    path = camera(tmp_path, GOOD.replace(found, instead))
    with pytest.raises(CalibrationError) as e:
        load_camera(path)
    line = str(e.value)
    assert str(path) in line
    assert key in line
    assert expected in line
    assert "\n" not in line


def test_a_file_that_is_no_calibration_is_refused_in_one_line(tmp_path: Path) -> None:
    def complaint(path: Path) -> str:
        with pytest.raises(CalibrationError) as e:
            load_camera(path)
        assert str(path) in str(e.value)
        assert "\n" not in str(e.value)
        return str(e.value)

    assert "No such file" in complaint(tmp_path / "missing.yaml")
    assert "cannot be read" in complaint(tmp_path)  # a folder
    assert "camera.yaml:2: not YAML" in complaint(camera(tmp_path, "image_width: 640\n:]["))
    assert "camera_info" in complaint(camera(tmp_path, "just text"))
    assert "camera_info" in complaint(camera(tmp_path, ""))
    assert "camera_info" in complaint(camera(tmp_path, "name: a pad\nmarkers: []\n"))
    lacking = camera(tmp_path, GOOD.replace("image_width: 640\n", ""))
    assert "image_width: missing, expected pixels" in complaint(lacking)
    picture = tmp_path / "camera.png"
    picture.write_bytes(b"\x89PNG\xff\xfe")
    assert "not text" in complaint(picture)


FILESTORAGE = """\
%YAML:1.0
---
image_width: 640
image_height: 480
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.1e+02, 0., 320., 0., 6.1e+02, 240., 0., 0., 1. ]
Distortion_Coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1e-02, -2e-02, 1e-05, 0., 0. ]
"""
KALIBR = """\
cam0:
  camera_model: pinhole
  distortion_model: radtan
  distortion_coeffs: [0.01, -0.02, 1e-05, 0.0]
  intrinsics: [610.0, 610.0, 320.0, 240.0]
  resolution: [640, 480]
"""


@pytest.mark.parametrize("text", [FILESTORAGE, KALIBR])
def test_opencvs_and_kalibrs_files_are_read(text: str, tmp_path: Path) -> None:
    read = load_camera(camera(tmp_path, text))
    assert (read.width, read.height, read.fx, read.cx) == (640, 480, 610.0, 320.0)
    assert read.distortion[:3] == (0.01, -0.02, 1e-05)


MESSAGE = """\
header: {frame_id: camera}
height: 480
width: 640
distortion_model: plumb_bob
D: [0.01, -0.02, 0.00001, 0.0, 0.0]
K: [610.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0]
"""
ROWS = """\
image_width: 640
image_height: 480
camera_matrix:
- [610.0, 0.0, 320.0]
- [0.0, 610.0, 240.0]
- [0.0, 0.0, 1.0]
dist_coeff: [[0.01, -0.02, 0.00001, 0.0, 0.0]]
"""
FOURTEEN = """\
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [610.0, 0, 320.0, 0, 610.0, 240.0, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 14
  data: [0.01, -0.02, 0.00001, 0.0, 0.0, 0.02, 0.01, 0.0, 0, 0, 0, 0, 0, 0]
"""


@pytest.mark.parametrize("text", [MESSAGE, ROWS, FOURTEEN])
def test_spellings_of_other_programs_are_read(text: str, tmp_path: Path) -> None:
    read = load_camera(camera(tmp_path, text))
    assert (read.width, read.height, read.fy, read.cy) == (640, 480, 610.0, 240.0)
    assert read.distortion[:3] == (0.01, -0.02, 1e-05)
    assert len(read.distortion) == (8 if text is FOURTEEN else 5)


def test_xml_is_refused_as_such(tmp_path: Path) -> None:
    path = tmp_path / "out_camera_data.xml"
    path.write_text('<?xml version="1.0"?><opencv_storage></opencv_storage>')
    with pytest.raises(CalibrationError, match="XML is not read"):
        load_camera(path)


@pytest.mark.parametrize(
    ("was", "instead", "said"),
    [
        ("[610.0, 610.0, 320.0, 240.0]", "[610.0, 610.0, 1224.0, 240.0]", "principal point"),
        ("[610.0, 610.0, 320.0, 240.0]", "[610.0, 610.0, 320.0, 375.0]", "principal point"),
        ("[610.0, 610.0, 320.0, 240.0]", "[61000.0, 610.0, 320.0, 240.0]", "focal lengths"),
        ("[610.0, 610.0, 320.0, 240.0]", "[5.0, 5.0, 320.0, 240.0]", "focal lengths"),
        ("[0.01, -0.02, 1e-05, 0.0]", "[-0.9, 0.0, 0.0, 0.0]", "no inverse in"),
        ("radtan", "fov", "expected pinhole with one of"),
    ],
)
def test_a_lens_that_cannot_be_is_refused_in_one_line(
    was: str, instead: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(KALIBR.replace(was, instead))
    with pytest.raises(CalibrationError, match=said) as refused:
        load_camera(path)
    assert "\n" not in str(refused.value)


# Of a public calibration (a Pi camera's): in a corner OpenCV's own iteration swings to and fro.
SWINGING = CameraModel(
    1280,
    960,
    552.127,
    550.424,
    661.411,
    507.079,
    (-0.283729, 0.0568559, -0.003467, -0.0022115, 0.0),
)
# Another's: its distortion folds within the right edge of the image.
FOLDING = """\
image_width: 1920
image_height: 1080
camera_matrix: {rows: 3, cols: 3, data: [3061.9, 0, 895.4, 0, 3072.2, 448, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.0981, -4.868, -0.01034, -0.00445, 0.0]}
"""


def off_px(model: CameraModel, part: Window) -> F64:
    """Return how far from it the ray of each pixel of a part of the image comes back to it."""
    x0, y0, x1, y1 = part
    grid = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1)
    at = grid.reshape(-1, 2).astype(np.float64)
    rays = model.rays(at)
    off: F64 = np.linalg.norm(
        model.pixels(np.column_stack([rays, np.ones(len(rays))])) - at, axis=1
    )
    return off


def test_the_ray_of_a_pixel_is_found_where_opencvs_iteration_does_not_converge() -> None:
    corner = Window(1150, 0, 1280, 140)
    assert off_px(SWINGING, corner).max() < 1e-3
    assert left_out(SWINGING) is None


def test_a_part_of_the_picture_whose_distortion_has_no_inverse_is_left_out_and_reported(
    tmp_path: Path,
) -> None:
    model = load_camera(camera(tmp_path, FOLDING))
    x0, y0, x1, y1 = used_part(model)
    assert off_px(model, Window(1900, 1060, 1920, 1080)).max() > 1.0
    assert off_px(model, Window(x1 - 200, y1 - 200, x1, y1)).max() < 1e-3
    assert (x1 - x0) * (y1 - y0) > 0.8 * 1920 * 1080
    said = left_out(model)
    assert said is not None
    assert "no inverse" in said
    assert "right" in said
    assert "\n" not in said
    assert left_out(load_camera(ROOT / "config/cameras/thesis.yaml")) is None


def test_every_pixel_of_a_wide_lens_comes_back_from_its_ray() -> None:
    wide = CameraModel(1280, 960, 800.0, 800.0, 640.0, 480.0, (-0.28, 0.09, 0.0, 0.0, -0.012))
    corners = np.array([[0.0, 0.0], [1279.0, 0.0], [0.0, 959.0], [1279.0, 959.0], [640.0, 0.0]])
    rays = wide.rays(corners)
    back = wide.pixels(np.column_stack([rays, np.ones(len(rays))]))
    assert np.abs(back - corners).max() < 1e-3


@pytest.mark.parametrize(
    ("distortion", "is_fisheye"),
    [
        ((), False),
        ((0.1, -0.05, 0.001, 0.002), False),
        ((0.0576, -0.0321, 0.0041, -0.0203, 0.01), False),
        ((0.1, -0.05, 0.001, 0.002, 0.01, 0.2, 0.05, 0.001), False),
        ((0.01, -0.02, 0.003, 0.001), True),
    ],
)
def test_points_are_imaged_where_opencv_has_them(
    distortion: tuple[float, ...], is_fisheye: bool
) -> None:
    camera = CameraModel(640, 480, 398.0, 390.0, 300.0, 227.0, distortion, is_fisheye)
    across = np.linspace(-0.7, 0.7, 7)
    x, y = np.meshgrid(across, across)
    points = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) * 3.0
    project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
    still = np.zeros(3)
    expected, _ = project(points.reshape(-1, 1, 3), still, still, camera.K, camera.D)
    assert np.abs(camera.pixels(points) - np.asarray(expected).reshape(-1, 2)).max() < 1e-9


def test_a_wrong_fisheye_calibration_is_not_refused_with_the_advice_to_use_a_fisheye(
    tmp_path: Path,
) -> None:
    text = GOOD.replace("plumb_bob", "equidistant").replace(
        "[400, 0, 319.5, 0, 390", "[160, 0, 319.5, 0, 160"
    )
    path = camera(
        tmp_path, text.replace("[0.1, -0.05, 0.001, -0.002, 0.0]", "[0.05, 0.04, -0.02, 0.004]")
    )
    with pytest.raises(CalibrationError, match="or with a lens of at most 160 degrees"):
        load_camera(path)


@pytest.mark.parametrize("line", ["date: 2024-30-06", "date: 2024-02-30 10:00:00", "serial: 0x_"])
def test_other_keys_in_a_calibration_file_may_look_like_impossible_dates(
    tmp_path: Path, line: str
) -> None:
    assert load_camera(camera(tmp_path, f"{GOOD}{line}\n")).fx == 400.0


@pytest.mark.parametrize("width", ["9" * 5000, "!!int wide", "1_000", "10:40", "yes"])
def test_a_width_that_is_no_number_is_refused_in_one_line(tmp_path: Path, width: str) -> None:
    path = camera(tmp_path, GOOD.replace("width: 640", f"width: {width}"))
    with pytest.raises(CalibrationError) as e:
        load_camera(path)
    assert str(path) in str(e.value)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("model", ["[radtan]", "{a: b}"])
def test_a_distortion_that_is_no_name_is_refused(tmp_path: Path, model: str) -> None:
    with pytest.raises(CalibrationError, match="expected pinhole with one of"):
        load_camera(camera(tmp_path, KALIBR.replace("radtan", model)))


def test_a_value_given_under_two_keys_is_refused_if_the_two_differ(tmp_path: Path) -> None:
    assert load_camera(camera(tmp_path, f"{GOOD}width: 640\n")).width == 640
    with pytest.raises(CalibrationError, match="width: image_width is given already"):
        load_camera(camera(tmp_path, f"{GOOD}width: 1280\n"))


def test_four_distortion_coefficients_need_a_distortion_model(tmp_path: Path) -> None:
    """OpenCV saves the four of a fisheye like the first four of any other lens."""
    k = [400.0, 0.0, 319.5, 0.0, 400.0, 239.5, 0.0, 0.0, 1.0]
    text = f"width: 640\nheight: 480\nK: {k}\nD: [0.01, 0.02, 0.0, 0.0]\n"
    with pytest.raises(CalibrationError, match="distortion_model: one of plumb_bob, equidistant"):
        load_camera(camera(tmp_path, text))
    assert load_camera(camera(tmp_path, f"{text}distortion_model: equidistant\n")).fisheye


def test_the_output_of_rostopic_echo_is_read(tmp_path: Path) -> None:
    assert load_camera(camera(tmp_path, f"{GOOD}---\n")).fx == 400.0
