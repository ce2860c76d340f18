"""What a flight finds of camera and gimbal is offered, in words that say what to set."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from landerd.config.models import CameraSection, Config
from landerd.estimation.pad_filter import SensorErrors
from landerd.preflight.sensors import read_sensors, sensor_findings, write_sensors

FOUND = SensorErrors(-0.021, 0.002, 0.0, 0.003, 0.0, 0.0, 0.005, 0.005)


def test_pictures_that_are_stamped_early_are_told() -> None:
    (finding,) = sensor_findings(Config(), FOUND)
    assert finding.level == "warn"
    assert "21 ms earlier" in finding.what
    assert finding.mend == "set camera.clock_offset_s: -0.021"


def test_what_is_set_already_is_not_offered_again() -> None:
    config = Config(camera=CameraSection(clock_offset_s=-0.020))
    assert sensor_findings(config, FOUND) == []


def test_what_is_not_sure_is_not_offered() -> None:
    assert sensor_findings(Config(), replace(FOUND, sigma_clock_s=0.008)) == []


def test_a_lens_that_looks_low_is_told() -> None:
    low = replace(FOUND, clock_s=0.0, up=math.radians(-2.0))
    (finding,) = sensor_findings(Config(), low)
    assert "2.0 degrees lower" in finding.what
    assert finding.mend == "set pitch of gimbal.camera_rotation_deg to -2.0"


def test_it_is_kept_from_one_flight_to_the_next(tmp_path: Path) -> None:
    path = tmp_path / "sensors.json"
    write_sensors(path, FOUND)
    assert read_sensors(path) == FOUND


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"clock_s": "x"}'])
def test_a_damaged_file_is_no_news(tmp_path: Path, text: str) -> None:
    path = tmp_path / "sensors.json"
    path.write_text(text)
    assert read_sensors(path) is None
