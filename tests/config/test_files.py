"""What a user reads when a configuration is wrong, and what landerd gets when it is right."""

import re
from pathlib import Path
from textwrap import dedent
from typing import Annotated, Literal

import pytest
import yaml
from pydantic import BaseModel, Field

from landerd.camera_model import load_camera
from landerd.config.files import ConfigError, Loaded, config_dir, load
from landerd.config.models import Config
from landerd.drivers import read_configuration
from landerd.pad import load_pad
from landerd.section import Section


class Pad(Section):
    speed_mps: Annotated[float, Field(ge=0)] = 0.0


class World(Section):
    pad: Pad = Pad()
    vehicle: Literal["standard", "fast"] = "standard"


class Servo(Section):
    device: Path


OPTIONS: dict[str, type[Section]] = {"sim": World, "gimbal.servo": Servo}
DRIVERS = {"gimbal": ["sim", "servo"]}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(dedent(text))
    return path


def read(path: Path, *overrides: str) -> Loaded:
    return load(path, options_models=OPTIONS, drivers=DRIVERS, overrides=overrides)


def faults(path: Path, *overrides: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        read(path, *overrides)
    return caught.value.lines


def test_every_fault_is_reported_with_line_key_value_and_what_was_expected(
    folder: Path,
) -> None:
    path = write(
        folder / "broken.yaml",
        """\
        guidance:
          limits:
            speed_mps: 5 m/s
            climb_mps: "1"
            jerk_mps3: .nan
            jerk_mps3: 3
          methd: pid
          descent: {align_deg: 5, realign_deg: 4}
        gimbal:
          driver: srvo
          yaw_limits_deg: [1, 2, 3]
          pitch_limits_deg: [true, 0]
          servo: {}
        rc:
          gate_channel: 11.0
        freshness: {rc_s: -.inf}
        vehicle:
        sim: {pad: {sped_mps: 1}, vehicle: quick}
        speed_mps: 1e3
        """,
    )
    assert faults(path) == [
        "broken.yaml:3: guidance.limits.speed_mps: found '5 m/s', expected a number "
        "at least 0.5 and at most 20",
        "broken.yaml:4: guidance.limits.climb_mps: found '1', expected a number "
        "at least 0.3 and at most 5",
        "broken.yaml:5: guidance.limits.jerk_mps3: found '.nan', expected a number "
        "at least 2 and at most 50",
        "broken.yaml:6: guidance.limits.jerk_mps3: given twice, first on line 5",
        "broken.yaml:7: guidance.methd: unknown key; nearest known key: guidance.method",
        "broken.yaml:8: guidance.descent: expected align_deg < realign_deg <= 5",
        "broken.yaml:10: gimbal.driver: found 'srvo', expected one of servo, sim",
        "broken.yaml:11: gimbal.yaw_limits_deg: found a list of 3, expected a list of 2 values",
        "broken.yaml:12: gimbal.pitch_limits_deg.0: found true, expected a number "
        "at least -360 and at most 360",
        "broken.yaml:13: gimbal.servo.device: missing, expected a file name",
        "broken.yaml:15: rc.gate_channel: found 11.0, expected a whole number "
        "at least 5 and at most 18",
        "broken.yaml:16: freshness.rc_s: found '-.inf', expected a number above 0 and at most 1",
        "broken.yaml:17: vehicle: found nothing, expected a block of keys",
        "broken.yaml:18: sim.pad.sped_mps: unknown key; nearest known key: sim.pad.speed_mps",
        "broken.yaml:18: sim.vehicle: found 'quick', expected one of standard, fast",
        "broken.yaml:19: speed_mps: unknown key; nearest known key: sim.pad.speed_mps",
    ]


@pytest.mark.parametrize("land_us", [1300, 1499])
def test_the_positions_of_a_switch_must_lie_apart(folder: Path, land_us: int) -> None:
    text = f"rc: {{gate_threshold_us: 1300, land_threshold_us: {land_us}}}"
    assert faults(write(folder / "a.yaml", text)) == [
        "a.yaml:1: rc: expected land_threshold_us 200 above gate_threshold_us, or 0"
    ]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("guidance: {tracking: {kp: 1e-200}}", "guidance.tracking.kp: found 1e-200"),
        ("estimation: {position_sigma_m: 1e200}", "estimation.position_sigma_m: found 1e+200"),
        ("sim: {pad: {speed_mps: 1e12}}", "sim.pad.speed_mps: found 1e+12"),
        ("vehicle: {camera_offset_m: [0, 1e-20, 0]}", "vehicle.camera_offset_m: found 1e-20"),
    ],
)
def test_numbers_whose_squares_and_quotients_would_end_a_flight_are_refused(
    folder: Path, text: str, found: str
) -> None:
    assert faults(write(folder / "a.yaml", text)) == [
        f"a.yaml:1: {found}, expected 0 or 1e-09 to 1e+09"
    ]


@pytest.mark.parametrize("value", ["'5'", "five", "true", "[5]", "{a: 5}", ".inf", "1e999", ""])
def test_texts_and_truth_values_are_not_converted_to_numbers(folder: Path, value: str) -> None:
    path = write(folder / "a.yaml", f"aim: {{idle_yaw_deg: {value} }}")
    (line,) = faults(path)
    assert line.startswith("a.yaml:1: aim.idle_yaw_deg: found ")
    assert line.endswith(", expected a number")


@pytest.mark.parametrize(
    ("key", "fault"),
    [
        ("vehicle: {gear_height_m: 20}", "gear_height_m: found 20, expected .* at most 3"),
        ("vehicle: {footprint_m: [44, 26]}", "footprint_m.0: found 44, expected .* at most 5"),
        ("vehicle: {camera_offset_m: [100, 0, 40]}", "camera_offset_m.0: found 100, expected"),
    ],
)
def test_lengths_typed_in_another_unit_are_refused(folder: Path, key: str, fault: str) -> None:
    found = faults(write(folder / "a.yaml", key))
    assert re.search(fault, found[0])


def test_limits_of_a_gimbal_the_wrong_way_round_are_refused(folder: Path) -> None:
    assert faults(write(folder / "a.yaml", "gimbal: {pitch_limits_deg: [0, -90]}")) == [
        "a.yaml:1: gimbal.pitch_limits_deg: found 0 to -90, expected the lower one first"
    ]


@pytest.mark.parametrize(
    ("value", "number"), [("5", 5.0), ("-5.5", -5.5), ("1e1", 10.0), ("010", 10.0), (".5", 0.5)]
)
def test_numbers_are_decimal_whatever_their_spelling(
    folder: Path, value: str, number: float
) -> None:
    path = write(folder / "a.yaml", f"aim: {{idle_yaw_deg: {value}}}")
    assert read(path).config.aim.idle_yaw_deg == number


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("aim: [", "a.yaml:1: not YAML: "),
        ("aim:\n\tgain: 1", "a.yaml:2: not YAML: "),
        ("aim: &x {gain: 0.5}\ncontrol: *x", "a.yaml:2: not YAML: an alias"),
        ("aim: {gain: !!float 1}", "a.yaml:1: aim.gain: found "),
        ("- 1", "a.yaml:1: found a list of 1, expected a block of keys"),
        ("{}\n---\n{}", "a.yaml:2: not YAML: "),
        ("aim: \x01", "a.yaml: not YAML: unprintable characters"),
    ],
)
def test_text_that_is_no_configuration_is_refused_with_its_line(
    folder: Path, text: str, fault: str
) -> None:
    assert faults(write(folder / "a.yaml", text))[0].startswith(fault)


def test_files_that_cannot_be_read_are_faults(folder: Path) -> None:
    (folder / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    assert faults(folder / "none.yaml") == ["none.yaml: cannot be read: No such file or directory"]
    assert faults(folder) == [".: cannot be read: Is a directory"]
    assert faults(folder / "bytes.yaml") == ["bytes.yaml: cannot be read: not text"]


def test_an_empty_file_gives_the_defaults_with_paths_into_the_packaged_configuration(
    folder: Path,
) -> None:
    loaded = read(write(folder / "a.yaml", "# nothing\n"))
    assert loaded.config.guidance == Config().guidance
    assert loaded.options == {"sim": World()}
    assert loaded.config.pad.layout == config_dir() / "pads" / "thesis.yaml"
    assert load_pad(loaded.config.pad.layout).name == "thesis"
    assert load_camera(loaded.config.camera.calibration).width == 640


def test_later_files_win_key_by_key_and_keep_their_places(folder: Path) -> None:
    write(folder / "parts" / "low.yaml", "aim: {gain: 0.1, idle_yaw_deg: 1}\nrc: {gate_channel: 7}")
    write(folder / "parts" / "high.yaml", "\n\naim:\n  gain: 0.2\n  idle_pitch_deg: wrong\n")
    path = write(
        folder / "a.yaml",
        "include: [parts/low.yaml, parts/high.yaml]\naim: {idle_pitch_deg: -30}\n",
    )
    config = read(path).config
    assert (config.aim.gain, config.aim.idle_yaw_deg, config.aim.idle_pitch_deg) == (0.2, 1, -30)
    assert config.rc.gate_channel == 7

    path.write_text("include: [parts/low.yaml, parts/high.yaml]\naim: {gain: 2}\n")
    assert faults(path) == [
        "a.yaml:2: aim.gain: found 2, expected a number above 0 and at most 1",
        "parts/high.yaml:5: aim.idle_pitch_deg: found 'wrong', expected a number",
    ]


def test_overlays_lie_over_the_file_and_under_the_overrides(folder: Path) -> None:
    path = write(folder / "a.yaml", "sim: {pad: {speed_mps: 1}, vehicle: fast}")
    scenario = write(folder / "b.yaml", "sim: {pad: {speed_mps: 2}}")
    loaded = load(path, options_models=OPTIONS, overlays=[scenario])
    assert loaded.options["sim"] == World(pad=Pad(speed_mps=2), vehicle="fast")
    loaded = load(
        path, options_models=OPTIONS, overlays=[scenario], overrides=["sim.pad.speed_mps=3"]
    )
    assert loaded.options["sim"] == World(pad=Pad(speed_mps=3), vehicle="fast")


def test_includes_that_cannot_be_used_are_faults_at_their_line(folder: Path) -> None:
    path = write(folder / "a.yaml", "aim: {}\ninclude: [none.yaml, a.yaml, 3]\n")
    assert faults(path) == [
        "a.yaml:2: include: found 3, expected a list of file names",
        "a.yaml:2: include: a.yaml: cannot be read: it includes itself",
        "a.yaml:2: include: none.yaml: cannot be read: No such file or directory",
    ]
    path.write_text("include: b.yaml")
    assert faults(path) == ["a.yaml:1: include: found 'b.yaml', expected a list of file names"]


def test_relative_paths_start_from_the_file_they_are_written_in(folder: Path) -> None:
    write(folder / "parts" / "camera.yaml", "camera: {calibration: mine.yaml}")
    mine = write(folder / "parts" / "mine.yaml", "")
    pad = write(folder / "x.yaml", "")
    path = write(
        folder / "a.yaml",
        f"include: [parts/camera.yaml]\npad: {{layout: {pad}}}\ngimbal: {{servo: {{device: d}}}}",
    )
    loaded = read(path)
    assert loaded.config.camera.calibration == mine
    assert loaded.config.pad.layout == pad
    assert loaded.options["gimbal.servo"] == Servo(device=folder / "d")
    assert read(path, "pad.layout=x.yaml").config.pad.layout == pad
    packaged = config_dir() / "pads" / "nested.yaml"
    assert read(path, "pad.layout=pads/nested.yaml").config.pad.layout == packaged
    # A folder is made where it is written, though landerd's own files have one of that name.
    assert read(path, "log.folder=campaigns").config.log.folder == folder / "campaigns"
    own = write(folder / "pads" / "nested.yaml", "")
    assert read(path, "pad.layout=pads/nested.yaml").config.pad.layout == own


def test_a_pad_and_a_calibration_that_do_not_exist_are_faults_at_their_lines(folder: Path) -> None:
    path = write(folder / "a.yaml", "pad: {layout: nested}\ncamera:\n  calibration: lens.yaml\n")
    pad, camera = faults(path)
    assert pad.startswith("a.yaml:1: pad.layout: no such file: 'nested'; landerd's own: pads/")
    assert "pads/nested.yaml" in pad
    assert camera.startswith("a.yaml:3: camera.calibration: no such file: 'lens.yaml'; ")
    (told,) = faults(path, "pad.layout=pads/nested.yaml", "camera.calibration=lens")
    assert told.startswith("--set camera.calibration=lens: no such file: 'lens'; landerd's own: ")


def test_overrides_are_read_as_yaml_and_the_last_wins(folder: Path) -> None:
    path = write(folder / "a.yaml", "sim: {pad: {speed_mps: 1}}")
    loaded = read(
        path, "sim.pad.speed_mps=2", "sim.pad.speed_mps=3", "sim.vehicle=fast",
        "vehicle.footprint_m=[0.4, 0.2]",
    )  # fmt: skip
    assert loaded.options["sim"] == World(pad=Pad(speed_mps=3), vehicle="fast")
    assert loaded.config.vehicle.footprint_m == (0.4, 0.2)


@pytest.mark.parametrize(
    ("override", "fault"),
    [
        ("sim.pad.speed_mps=-1", "found -1, expected a number at least 0"),
        ("sim.pad.speed_mps=", "found nothing, expected a number at least 0"),
        ("sim.pad.sped_mps=1", "unknown key; nearest known key: sim.pad.speed_mps"),
        ("sim.pad=1", "found 1, expected a block of keys"),
        ("sim.vehicle.mass=1", "found a block of keys, expected one of standard, fast"),
        ("sim.pad.speed_mps", "expected KEY=VALUE, as in sim.pad.speed_mps=1"),
        ("sim..speed_mps=1", "expected KEY=VALUE, as in sim.pad.speed_mps=1"),
        ("gimbal.driver=x", "found 'x', expected one of servo, sim"),
    ],
)
def test_faults_of_overrides_name_the_override(folder: Path, override: str, fault: str) -> None:
    path = write(folder / "a.yaml", "")
    assert faults(path, override) == [f"--set {override}: {fault}"]


@pytest.mark.parametrize(
    ("override", "fault"),
    [
        ("sim.pad={speed_mps: -1}", "sim.pad.speed_mps: found -1, expected a number at least 0"),
        ("sim={pad: {sped_mps: 1}}", "sim.pad.sped_mps: unknown key; nearest known key: "),
        ("vehicle.footprint_m=[0.4, x]", "vehicle.footprint_m.1: found 'x', expected a number"),
        ("vehicle.footprint_m=[!a 1, 1]", "vehicle.footprint_m.0: found the tag !a, expected none"),
        ("gimbal={driver: x}", "gimbal.driver: found 'x', expected one of servo, sim"),
        ("sim.pad={speed_mps: 1, speed_mps: 2}", "sim.pad.speed_mps: given twice"),
        ("sim.pad.speed_mps={uniform: [2, 1]}", "sim.pad.speed_mps.uniform: found a list of 2"),
    ],
)
def test_faults_inside_the_value_of_an_override_name_the_inner_key(
    folder: Path, override: str, fault: str
) -> None:
    path = write(folder / "a.yaml", "")
    (line,) = faults(path, override)
    assert line.startswith(f"--set {override}: {fault}")


def test_a_chosen_driver_must_have_the_options_it_needs(folder: Path) -> None:
    path = write(folder / "a.yaml", "gimbal: {driver: servo}")
    assert faults(path) == ["a.yaml: gimbal.servo: missing, driver servo needs it"]
    assert "gimbal.servo" not in read(path, "gimbal.driver=sim").options


def read_with_drivers(path: Path, *overlays: Path) -> Loaded:
    return read_configuration(path, overlays=overlays)


def test_the_default_file_states_every_default_as_it_is(folder: Path) -> None:
    path = config_dir() / "default.yaml"
    assumed = read_with_drivers(write(folder / "empty.yaml", "")).config
    assert read_with_drivers(path).config.model_dump(exclude={"sim"}) == assumed.model_dump(
        exclude={"sim"}
    )
    written = yaml.safe_load(path.read_text())
    for name, field in Config.model_fields.items():
        assert isinstance(field.default, BaseModel)
        assert written[name].keys() == type(field.default).model_fields.keys()


@pytest.mark.parametrize("name", ["stationary", "hover", "moving", "radial", "wind-thesis"])
def test_every_scenario_lies_over_the_default(name: str) -> None:
    scenario = config_dir() / "scenarios" / f"{name}.yaml"
    assert read_with_drivers(config_dir() / "default.yaml", scenario).options["sim"]


def test_an_include_that_is_not_beside_the_file_is_landerds_own(folder: Path) -> None:
    file = write(folder / "mine.yaml", "include: [default.yaml]\nrc: {gate_channel: 9}\n")
    assert read_configuration(file).config.rc.gate_channel == 9
    write(folder / "default.yaml", "rc: {gate_channel: 8, gate_threshold_us: 1600}\n")
    assert read_configuration(file).config.rc.gate_threshold_us == 1600


def test_an_include_that_is_no_file_name_or_leads_in_a_circle_is_a_fault(folder: Path) -> None:
    (folder / "circle.yaml").symlink_to("circle.yaml")
    for name in (r'"a\0b"', "circle.yaml"):
        (folder / "mine.yaml").write_text(f"include: [{name}]\n")
        with pytest.raises(ConfigError, match=r"mine\.yaml:1: include: .*: cannot be read"):
            load(folder / "mine.yaml", options_models=OPTIONS)
