import math
from pathlib import Path

import cv2
import pytest

from landerd.pad import DICTIONARIES, PadError, PadLayout, Plate, Square, load_pad

ROOT = Path(__file__).parents[1]
PLATE = "plate: {north_m: 1, south_m: 1, east_m: 1, west_m: 1}\n"
RING = "  - {kind: whycon, outer_diameter_m: 1.0}\n"
ASIDE = "  - {kind: whycon, outer_diameter_m: 0.5, position_m: [0.7, 0]}\n"
TAG = "  - {kind: apriltag, dictionary: APRILTAG_36h11, id: 0, size_m: 0.3}\n"
CODE = "  - {kind: whycode, outer_diameter_m: 1.0, bits: 6, id: 5}\n"
GOOD = "name: test\nmarkers:\n" + RING + TAG + PLATE


def pad(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "pad.yaml"
    path.write_text(text)
    return path


def load(tmp_path: Path, text: str) -> PadLayout:
    return load_pad(pad(tmp_path, text))


def test_the_thesis_pad_is_that_of_its_section_2_3_5() -> None:
    layout = load_pad(ROOT / "config/pads/thesis.yaml")
    (ring,), (tag,) = layout.rings, layout.squares
    assert ring.outer_diameter_m == 1.0
    assert ring.inner_ratio == pytest.approx(50 / 122)
    assert ring.position_m == (0.0, 0.0)
    assert (tag.dictionary, tag.id, tag.size_m) == ("APRILTAG_36h11", 0, 0.3125)
    assert tag.position_m == (0.75, 0.0)
    assert layout.plate.north_m == 1.02
    assert layout.plate.south_m == layout.plate.east_m == layout.plate.west_m == 0.62


@pytest.mark.parametrize(
    ("markers", "has_heading"),
    [
        (RING, False),
        (TAG, True),
        (RING + TAG, True),
        (RING + RING, False),
        (RING + ASIDE, True),
        (CODE, True),
    ],
)
def test_a_pad_has_a_heading_unless_it_is_plain_rings_about_one_place(
    tmp_path: Path, markers: str, has_heading: bool
) -> None:
    assert load(tmp_path, f"name: test\nmarkers:\n{markers}{PLATE}").has_heading is has_heading


@pytest.mark.parametrize(
    ("found", "instead", "key", "expected"),
    [
        ("diameter_m: 1.0", "diameter_m: 0", "outer_diameter_m", "more than 0"),
        ("diameter_m: 1.0", "diameter_m: .inf", "outer_diameter_m", "finite"),
        (
            *("diameter_m: 1.0", "diameter_m: wide"),
            *("markers.0.outer_diameter_m", "found 'wide', expected a number"),
        ),
        ("kind: whycon, ", "", "markers.0.kind", "is missing"),
        ("outer_diameter_m: 1.0", "inner_ratio: 0.5", "outer_diameter_m", "is missing"),
        ("id: 0", "id: -1", "id", "found -1, expected at least 0"),
        ("size_m: 0.3", "size_m: 0.3, colour: red", "colour", "unknown key"),
        (
            *("kind: whycon", "kind: circle"),
            *("markers.0.kind", "found 'circle', expected 'whycon', 'whycode'"),
        ),
        ("west_m: 1", "wst_m: 1", "plate.wst_m", "unknown key"),
        (PLATE, "", "plate", "is missing"),
        ("markers:\n" + RING + TAG, "markers: []\n", "markers", "at least 1"),
    ],
)
def test_a_wrong_pad_file_is_refused_with_file_key_and_what_was_expected(
    tmp_path: Path, found: str, instead: str, key: str, expected: str
) -> None:
    assert found in GOOD
    path = pad(tmp_path, GOOD.replace(found, instead))
    with pytest.raises(PadError) as e:
        load_pad(path)
    line = str(e.value)
    assert str(path) in line
    assert key in line
    assert expected in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("bits: 6, id: 21", "looks the same"),  # 010101
        ("bits: 6, id: 9", "180 degrees"),  # 001001
        ("bits: 6, id: 0", "looks the same"),
        ("bits: 6, id: 63", "looks the same"),
        ("bits: 6, id: 2", "id 1 turned"),
        ("bits: 8, id: 254", "id 127 turned"),
        ("bits: 6, id: 64", "more than 6 bits"),
        ("bits: 2, id: 1", "at least 3"),
        ("id: 1", "bits"),
    ],
)
def test_an_ambiguous_whycode_is_refused_in_one_line(
    tmp_path: Path, code: str, expected: str
) -> None:
    text = f"name: test\nmarkers:\n{CODE.replace('bits: 6, id: 5', code)}{PLATE}"
    with pytest.raises(PadError) as e:
        load(tmp_path, text)
    line = str(e.value)
    assert expected in line
    assert "markers.0" in line
    assert "\n" not in line


def test_nine_whycodes_of_six_bits_can_be_told_apart_at_every_rotation(tmp_path: Path) -> None:
    usable = []
    for number in range(64):
        text = f"name: test\nmarkers:\n{CODE.replace('id: 5', f'id: {number}')}{PLATE}"
        try:
            usable.append(load(tmp_path, text).whycodes[0].id)
        except PadError:
            continue
    # As many as there are aperiodic necklaces: (2^6 - 2^3 - 2^2 + 2) / 6.
    assert usable == [1, 3, 5, 7, 11, 13, 15, 23, 31]


def test_a_ring_alone_beside_the_landing_point_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PadError, match=r"pad.yaml: a ring alone .* \[0, 0\], or another marker"):
        load(tmp_path, f"name: test\nmarkers:\n{ASIDE}{PLATE}")


def test_a_whycode_twice_on_a_pad_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PadError, match="id 5 with 6 bits is on the pad twice"):
        load(tmp_path, f"name: test\nmarkers:\n{CODE}{CODE}{PLATE}")


def test_all_faults_of_a_pad_file_are_reported_together(tmp_path: Path) -> None:
    with pytest.raises(PadError, match=r"outer_diameter_m.*size_m"):
        load(tmp_path, GOOD.replace("1.0", "-1.0").replace("0.3", "-0.3"))


def test_a_file_that_is_no_pad_file_is_refused_in_one_line(tmp_path: Path) -> None:
    def complaint(path: Path) -> str:
        with pytest.raises(PadError) as e:
            load_pad(path)
        assert str(path) in str(e.value)
        assert "\n" not in str(e.value)
        return str(e.value)

    assert "No such file" in complaint(tmp_path / "missing.yaml")
    assert "cannot be read" in complaint(tmp_path)  # a folder
    assert "pad.yaml:2: not YAML" in complaint(pad(tmp_path, "name: x\n:]["))
    assert complaint(pad(tmp_path, "camera: {driver: sim}\nvehicle: {}\n")).endswith(
        "pad.yaml: expected a pad: a mapping with name, markers and plate"
    )
    assert "mapping" in complaint(pad(tmp_path, ""))
    picture = tmp_path / "pad.png"
    picture.write_bytes(b"\x89PNG\xff\xfe")
    assert "not text" in complaint(picture)


@pytest.mark.parametrize("name", ["tag36h11", "DICT_APRILTAG_36h11", "APRILTAG_36H11"])
def test_other_spellings_of_a_dictionary_are_understood(name: str) -> None:
    square = Square(kind="apriltag", dictionary=name, id=0, size_m=0.2)
    assert square.dictionary == "APRILTAG_36h11"


def test_opencv_has_every_dictionary_with_as_many_ids() -> None:
    for name, ids in DICTIONARIES.items():
        number = getattr(cv2.aruco, f"DICT_{name}")
        assert len(cv2.aruco.getPredefinedDictionary(number).bytesList) == ids


@pytest.mark.parametrize(
    ("dictionary", "number", "said"),
    [("36h99", 0, "no dictionary '36h99'"), ("4X4_50", 50, "has no id 50: 0 to 49")],
)
def test_a_marker_that_does_not_exist_is_refused(dictionary: str, number: int, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Square(kind="aruco", dictionary=dictionary, id=number, size_m=0.2)


def test_a_square_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pad.yaml"
    marker = "{kind: apriltag, dictionary: tag36h11, id: 3, size_m: 0.2, position_m: [%s, 0.0]}"
    path.write_text(
        f"name: two\nmarkers:\n  - {marker % 0.0}\n  - {marker % 0.5}\n"
        "plate: {north_m: 1.0, south_m: 1.0, east_m: 1.0, west_m: 1.0}\n"
    )
    with pytest.raises(PadError, match="id 3 of APRILTAG_36h11 is on the pad twice"):
        load_pad(path)


@pytest.mark.parametrize(
    ("was", "instead"),
    [
        ("diameter_m: 1.0", "diameter_m: yes"),
        ("diameter_m: 1.0", "diameter_m: 1:30"),
        ("diameter_m: 1.0", "diameter_m: 1_0"),
        ("diameter_m: 1.0", "diameter_m: '1.0'"),
        ("diameter_m: 1.0", "diameter_m: 2024-02-30"),
        ("diameter_m: 1.0", f"diameter_m: {'9' * 5000}"),
        ("diameter_m: 1.0", "diameter_m: !!int wide"),
        ("id: 0", "id: true"),
        ("id: 0", "id: '0'"),
        ("id: 0", "id: 0.0"),
    ],
)
def test_texts_dates_and_truth_values_are_not_converted_to_numbers(
    tmp_path: Path, was: str, instead: str
) -> None:
    with pytest.raises(PadError, match=r"pad\.yaml") as e:
        load(tmp_path, GOOD.replace(was, instead))
    assert "\n" not in str(e.value)


def test_an_id_is_decimal_and_a_name_like_a_date_is_text(tmp_path: Path) -> None:
    text = GOOD.replace("id: 0", "id: 010").replace("name: test", "name: 2024-02-30")
    layout = load(tmp_path, text)
    assert layout.squares[0].id == 10
    assert layout.name == "2024-02-30"


def test_a_marker_with_a_fault_is_not_reported_as_missing_besides(tmp_path: Path) -> None:
    with pytest.raises(PadError, match="looks the same") as e:
        load(tmp_path, f"name: test\nmarkers:\n{CODE.replace('id: 5', 'id: 21')}{PLATE}")
    assert "at least" not in str(e.value)


@pytest.mark.parametrize(
    ("heading_deg", "white_m"), [(0.0, 0.2), (45.0, 0.3 * math.sqrt(0.5) - 0.1)]
)
def test_the_white_round_a_square_ends_at_the_plates_nearest_side(
    heading_deg: float, white_m: float
) -> None:
    square = Square(
        kind="aruco",
        dictionary="4X4_50",
        id=1,
        size_m=0.2,
        position_m=(0.1, -0.2),
        heading_deg=heading_deg,
    )
    plate = Plate(north_m=0.4, south_m=0.5, east_m=0.6, west_m=0.7)
    assert plate.white_round(square) == pytest.approx(white_m)
