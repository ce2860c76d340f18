"""`landerd detect`: what it prints, draws and refuses."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.cli import main
from landerd.commands.detect import yaw_deg
from landerd.geometry import Vec3
from landerd.pad import Plate, load_pad
from landerd.vision.pose import vec3
from tests.tiffs import tiff
from tests.vision.scenes import (
    THESIS_CAMERA,
    THESIS_PAD,
    Optics,
    View,
    alone,
    look,
    render,
    with_tag,
)

CONFIG = Path(__file__).parents[2] / "config"
FILES = [
    "--camera",
    str(CONFIG / "cameras" / "thesis.yaml"),
    "--pad",
    str(CONFIG / "pads" / "thesis.yaml"),
]
VIEW = look(THESIS_CAMERA, 4.0, 0.4, pixel=(300, 260), heading=math.radians(30))


def picture(view: View | None = VIEW) -> np.ndarray:
    return render(view, THESIS_CAMERA, Optics(), np.random.default_rng(1))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    images = tmp_path / "images"
    images.mkdir()
    cv2.imwrite(str(images / "a.png"), picture())
    cv2.imwrite(str(images / "b.png"), picture(None))
    return images


def test_json_is_one_object_an_image(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["detect", str(folder), *FILES, "--json"]) == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert first["image"].endswith("a.png")
    assert {(m["kind"], m["id"]) for m in first["markers"]} == {("whycon", None), ("apriltag", 0)}
    assert math.dist(first["pad"]["position_m"], VIEW.position) < 0.02
    assert len(first["pad"]["sigma_m"]) == 3
    assert first["pad"]["yaw_deg"] == pytest.approx(
        yaw_deg(vec3(VIEW.normal), vec3(VIEW.R_camera_pad[:, 0])), abs=0.5
    )
    assert all(m["yaw_deg"] is None for m in first["markers"] if m["kind"] == "whycon")
    assert first["ms"] > 0
    assert (second["markers"], second["pad"]) == ([], None)


def test_no_image_of_a_folder_is_left_out_in_silence_for_its_format(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("c.gif", "d.jp2"):
        cv2.imwrite(str(folder / name), picture())
    assert main(["detect", str(folder), *FILES, "--json"]) == 2
    out, err = capsys.readouterr()
    _, _, other = (json.loads(line) for line in out.splitlines())
    assert Path(other["image"]).name == "d.jp2"
    assert other["pad"] is not None
    assert "c.gif: not read; save it as PNG or JPEG" in err


@pytest.mark.parametrize("orientation", [3, 6])
def test_a_jpeg_is_not_rotated_by_its_orientation_tag(
    orientation: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """EXIF tells viewers to turn the picture; principal point and distortion do not turn."""
    _, jpeg = cv2.imencode(".jpg", picture())
    held = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0" + bytes([orientation]) + bytes(7)
    exif = b"Exif\0\0" + held
    app1 = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    file = folder / "held.jpg"
    file.write_bytes(jpeg.tobytes()[:2] + app1 + jpeg.tobytes()[2:])
    shown, stored = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), cv2.imdecode(jpeg, 0)
    assert shown is not None
    assert stored is not None
    assert not np.array_equal(shown, stored)
    assert main(["detect", str(file), *FILES, "--json"]) == 0
    pad = json.loads(capsys.readouterr().out)["pad"]
    assert math.dist(pad["position_m"], VIEW.position) < 0.02


def test_a_tiff_is_not_rotated_by_its_orientation_tag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """OpenCV rotates a TIFF by its tag even if told not to."""
    file = tmp_path / "held.tif"
    file.write_bytes(tiff(picture(), orientation=3))
    assert main(["detect", str(file), *FILES, "--json"]) == 0
    pad = json.loads(capsys.readouterr().out)["pad"]
    assert math.dist(pad["position_m"], VIEW.position) < 0.02


def test_a_picture_of_a_few_pixels_does_not_end_the_search(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = np.array([[0, 255, 0, 255], [255, 0, 255, 0], [0, 0, 255, 255]], np.uint8)
    cv2.imwrite(str(folder / "a-small.png"), few)
    assert main(["detect", str(folder), *FILES]) == 0
    said = capsys.readouterr().out.splitlines()
    assert ["nothing found" in line for line in said] == [True, False, True]


def test_another_pad_is_named_by_its_tag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    cv2.imwrite(str(tmp_path / "a.png"), render(VIEW, THESIS_CAMERA, Optics(), rng, with_tag(id=7)))
    assert main(["detect", str(tmp_path), *FILES]) == 0
    assert "another pad: tag 7" in capsys.readouterr().out


def test_markers_that_are_not_the_pads_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A pad file with the wrong ratio or id must not look like a picture of grass."""
    ring = THESIS_PAD.rings[0].model_copy(update={"inner_ratio": 0.55})
    image = render(VIEW, THESIS_CAMERA, Optics(), np.random.default_rng(1), alone(ring))
    cv2.imwrite(str(tmp_path / "a.png"), image)
    assert main(["detect", str(tmp_path), *FILES]) == 0
    assert "not the pad's: a ring whose inner ratio is about 0.5" in capsys.readouterr().out
    assert main(["detect", str(tmp_path), *FILES, "--json"]) == 0
    (text,) = json.loads(capsys.readouterr().out)["other_markers"]
    assert text.endswith("(the pad file has 0.41)")


def test_a_ring_whose_plate_is_not_as_the_pad_file_says_is_shown_but_not_taken_for_the_pad(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ring on a larger white sheet than the pad file's must not look like a picture of grass."""
    ring = alone(THESIS_PAD.rings[0])
    sheet = Plate(north_m=1.6, south_m=1.6, east_m=1.6, west_m=1.6)
    view = look(THESIS_CAMERA, 16.0, 0.3, pixel=(300.0, 240.0))
    optics = Optics(background="grass")
    for name, pad in (("a.png", ring.model_copy(update={"plate": sheet})), ("b.png", ring)):
        image = render(view, THESIS_CAMERA, optics, np.random.default_rng(1), pad)
        cv2.imwrite(str(tmp_path / name), image)
    file = tmp_path / "pad.yaml"
    file.write_text(
        "name: ring\nmarkers: [{kind: whycon, outer_diameter_m: 1.0}]\n"
        "plate: {north_m: 1.02, south_m: 0.62, east_m: 0.62, west_m: 0.62}\n"
    )
    assert main(["detect", str(tmp_path), *FILES[:3], str(file), "--json"]) == 0
    lacking, plain = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (lacking["pad"], lacking["lacks_plate"], plain["lacks_plate"]) == (None, True, False)
    (marker,) = lacking["markers"]
    assert math.dist(marker["position_m"], view.position) < 0.1
    assert math.dist(plain["pad"]["position_m"], view.position) < 0.1
    assert main(["detect", str(tmp_path), *FILES[:3], str(file)]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert "not taken for the pad: its plate is not seen about it" in first
    assert "not taken" not in second


def test_tags_in_texture_are_looked_for_in_a_still_with_all_thresholds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = CONFIG / "pads" / "bundle.yaml"
    view = look(THESIS_CAMERA, 8.5, 0.2, pixel=(300, 240), heading=0.5)
    optics = Optics(background="grass", noise=8.0, motion_px=(3.0, 1.0))
    image = render(view, THESIS_CAMERA, optics, np.random.default_rng(3), load_pad(file))
    cv2.imwrite(str(tmp_path / "a.png"), image)
    assert main(["detect", str(tmp_path / "a.png"), *FILES[:3], str(file), "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert math.dist(seen["pad"]["position_m"], view.position) < 0.5


@pytest.mark.parametrize(("distance", "heading"), [(4.0, 0.3), (5.0, 0.7), (5.0, 1.3)])
def test_all_tags_of_a_still_are_told_not_only_those_that_show_the_pad_first(
    distance: float, heading: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each search looks in another way, and the one that finds the pad misses the small tag."""
    file = CONFIG / "pads" / "bundle.yaml"
    view = look(THESIS_CAMERA, distance, 0.5, pixel=(300, 240), heading=heading)
    rng = np.random.default_rng(round((heading - 0.3) / 0.2))
    image = render(view, THESIS_CAMERA, Optics(background="grass"), rng, load_pad(file))
    cv2.imwrite(str(tmp_path / "a.png"), image)
    assert main(["detect", str(tmp_path / "a.png"), *FILES[:3], str(file), "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert sorted(m["id"] for m in seen["markers"]) == [10, 11, 12, 13, 14]


def test_a_whycode_is_printed_with_number_and_yaw(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = CONFIG / "pads" / "whycode.yaml"
    image = render(VIEW, THESIS_CAMERA, Optics(), np.random.default_rng(1), load_pad(file))
    cv2.imwrite(str(tmp_path / "code.png"), image)
    source = ["detect", str(tmp_path / "code.png"), *FILES[:2], "--pad", str(file)]
    assert main([*source, "--json"]) == 0
    (marker,) = json.loads(capsys.readouterr().out)["markers"]
    assert (marker["kind"], marker["id"]) == ("whycode", 5)
    assert marker["yaw_deg"] == pytest.approx(
        yaw_deg(vec3(VIEW.normal), vec3(VIEW.R_camera_pad[:, 0])), abs=0.5
    )
    assert main(source) == 0
    assert "whycode 5 at" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("north", "degrees"),
    [((0.0, -1.0, 0.0), 0.0), ((1.0, 0.0, 0.0), 90.0), ((-1.0, 0.0, 0.0), -90.0)],
)
def test_yaw_is_clockwise_from_image_up(north: Vec3, degrees: float) -> None:
    assert yaw_deg((0.0, 0.0, 1.0), north) == pytest.approx(degrees)


def test_a_video_is_followed_frame_by_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "v.avi"
    fourcc = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(video), fourcc, 30.0, (640, 480), isColor=True)
    frame = cv2.cvtColor(picture(), cv2.COLOR_GRAY2BGR)
    for _ in range(3):
        writer.write(frame)
    writer.release()
    assert main(["detect", str(video), *FILES, "--json"]) == 0
    objects = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [o["image"][-2:] for o in objects] == ["#0", "#1", "#2"]
    assert all(len(o["markers"]) == 2 for o in objects)


def test_drawn_pictures_mark_the_tag_and_leave_the_rest(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "drawn"
    assert main(["detect", str(folder / "a.png"), *FILES, "--draw", str(out)]) == 0
    drawn = cv2.imread(str(next(out.iterdir())))
    assert drawn is not None
    coloured = np.ptp(drawn.astype(np.int16), axis=2) > 30
    tag = np.array(VIEW.position) + 0.75 * VIEW.R_camera_pad[:, 0]
    x, y = THESIS_CAMERA.pixels(tag[None])[0].astype(int)
    assert coloured[y - 25 : y + 25, x - 25 : x + 25].any()
    assert not coloured[:, 600:].any()
    assert not coloured[360:].any()


def test_a_file_is_no_folder_for_drawn_pictures(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = folder / "a.png"
    assert main(["detect", str(picture), *FILES, "--draw", str(picture)]) == 2
    assert capsys.readouterr().err == f"--draw {picture}: found a file, expected a folder\n"


def test_pictures_of_one_name_are_all_drawn(folder: Path, tmp_path: Path) -> None:
    out, other = tmp_path / "drawn", tmp_path / "other"
    other.mkdir()
    cv2.imwrite(str(other / "a.png"), picture(None))
    sources = [str(folder / "a.png"), str(other / "a.png")]
    assert main(["detect", *sources, *FILES, "--draw", str(out)]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["a.png-2.png", "a.png.png"]


def test_a_sensors_twelve_bits_in_a_file_of_sixteen_are_seen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(tmp_path / "raw.png"), picture().astype(np.uint16) << 4)
    assert main(["detect", str(tmp_path / "raw.png"), *FILES, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["markers"]) == 2


@pytest.mark.parametrize("name", ["missing.png", "text.png", "missing.mp4", "text.mp4", "empty"])
def test_a_bad_source_is_one_clear_line(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "text.png").write_text("not an image")
    (folder / "text.mp4").write_text("not a video")
    (folder / "empty").mkdir()
    assert main(["detect", str(folder / name), *FILES, "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert name in printed.err


def test_an_empty_source_is_not_taken_for_the_working_folder(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["detect", "", *FILES]) == 2
    assert "expected an image" in capsys.readouterr().err


def test_heic_files_in_a_folder_are_reported_as_not_read(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "IMG_1.HEIC").write_text("not read")
    assert main(["detect", str(folder), *FILES, "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.err.splitlines()[0].endswith("IMG_1.HEIC: not read; save it as PNG or JPEG")
    assert "a.png" in printed.out


def test_landerds_own_pad_and_calibration_are_taken_by_name(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ["--camera", "cameras/thesis.yaml", "--pad"]
    assert main(["detect", str(folder), *own, "thesis"]) == 0
    assert "whycon at" in capsys.readouterr().out
    assert main(["detect", str(folder), *own, "thesys"]) == 2
    told = capsys.readouterr().err
    assert "thesys: no such file, and none of landerd's own pads: bundle, nested, thesis" in told
    assert main(["detect", "http://127.0.0.1:1/none", *own, "thesis"]) == 2
    assert "no video comes from there" in capsys.readouterr().err


def test_an_image_of_another_aspect_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(folder / "c.png"), np.zeros((400, 640), np.uint8))
    assert main(["detect", str(folder / "c.png"), *FILES]) == 2
    assert "640x400" in capsys.readouterr().err


def test_the_part_of_the_picture_that_is_left_out_is_reported_once(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (CONFIG / "cameras" / "thesis.yaml").read_text()
    (folder / "mine.yaml").write_text(text.replace("-0.0321", "-0.1"))
    assert main(["detect", str(folder), "--camera", str(folder / "mine.yaml"), *FILES[2:]]) == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert "mine.yaml: distortion has no inverse" in told[0]
    assert "left out" in told[0]


def test_an_image_of_half_the_size_shows_the_pad_in_the_same_place(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    half = cv2.resize(picture(), (320, 240), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "h.png"), half)
    assert main(["detect", str(folder / "h.png"), *FILES, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert math.dist(found["pad"]["position_m"], VIEW.position) < 0.05


def test_a_pad_with_an_unknown_dictionary_is_refused(
    tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pad = tmp_path / "pad.yaml"
    text = (CONFIG / "pads" / "thesis.yaml").read_text()
    pad.write_text(text.replace("APRILTAG_36h11", "APRILTAG_99h9"))
    assert main(["detect", str(folder), *FILES[:2], "--pad", str(pad)]) == 2
    assert "APRILTAG_99h9" in capsys.readouterr().err


def test_the_other_images_of_a_folder_are_searched_besides_a_bad_one(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "aa.png").write_bytes(bytes(100))
    cv2.imwrite(str(folder / "ab.png"), picture()[:, :300])
    assert main(["detect", str(folder), *FILES]) == 2
    told = capsys.readouterr()
    assert [Path(line.split(": ")[0]).name for line in told.out.splitlines()] == ["a.png", "b.png"]
    damaged, narrow = told.err.splitlines()
    assert damaged == f"{folder}/aa.png: not an image that can be read"
    assert "ab.png" in narrow
    assert "another aspect" in narrow
