"""Damaged recordings and configurations: one clear line, never a traceback."""

import contextlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.replay.telemetry import TelemetryError, read_telemetry
from landerd.camera_model import CalibrationError, load_camera
from landerd.config.files import ConfigError, config_dir
from landerd.config.models import Config, LogSection
from landerd.drivers import read_configuration
from landerd.flightlog.reader import LogError, read_images, read_log
from landerd.flightlog.replay import replay
from landerd.pad import PadError, load_pad
from tests.fuzz.budget import examples
from tests.fuzz.damage import EDITS, damaged
from tests.recorded_flight import RecordedFlight, recorder
from tests.recordings import write_bin, write_tlog

pytestmark = pytest.mark.long


def one_line(error: Exception, path: Path) -> None:
    """Check that an error text names the file and has lines only."""
    for line in str(error).splitlines():
        assert path.name in line
        assert "Traceback" not in line


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    flight = RecordedFlight(recorder(path, LogSection(keep_free_mb=0.0, every_nth=4)))
    flight.run(0.5)
    flight.recorder.close()
    return path.read_bytes()


@pytest.fixture(scope="module", params=["a.tlog", "a.bin"])
def telemetry(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("log") / request.param
    return write_tlog(path, length_s=3.0) if path.suffix == ".tlog" else write_bin(path)


@examples(60)
@given(EDITS)
def test_mcap(tmp_path: Path, mcap: bytes, edits: list[tuple[str, float, bytes]]) -> None:
    path = tmp_path / "some.mcap"
    path.write_bytes(damaged(mcap, edits))
    try:
        log = read_log(path)
        list(read_images(path))
        replay(log, Config())
    except LogError as e:
        one_line(e, path)


@examples(60)
@given(EDITS)
def test_telemetry(tmp_path: Path, telemetry: Path, edits: list[tuple[str, float, bytes]]) -> None:
    path = tmp_path / f"some{telemetry.suffix}"
    path.write_bytes(damaged(telemetry.read_bytes(), edits))
    try:
        read_telemetry(path)
    except TelemetryError as e:
        one_line(e, path)


FILES = sorted(config_dir().rglob("*.yaml"))


@examples(60)
@given(st.sampled_from(FILES), EDITS)
def test_configuration(tmp_path: Path, file: Path, edits: list[tuple[str, float, bytes]]) -> None:
    path = tmp_path / "some.yaml"
    path.write_bytes(damaged(file.read_bytes(), edits))
    with contextlib.suppress(ConfigError):
        read_configuration(path)


@examples(40)
@given(st.sampled_from(FILES), EDITS)
def test_calibration_and_pad(
    tmp_path: Path, file: Path, edits: list[tuple[str, float, bytes]]
) -> None:
    path = tmp_path / "some.yaml"
    path.write_bytes(damaged(file.read_bytes(), edits))
    try:
        load_camera(path)
    except CalibrationError as e:
        one_line(e, path)
    try:
        load_pad(path)
    except PadError as e:
        one_line(e, path)


SETTINGS = st.text("abcdefghijklmnopqrstuvwxyz_.=[]{},:0123456789-+eE \"'#&*!|>%@`\n", max_size=40)


@examples(60)
@given(st.lists(SETTINGS | SETTINGS.map(lambda text: f"sim.{text}"), max_size=3))
def test_settings(settings: list[str]) -> None:
    with contextlib.suppress(ConfigError):
        read_configuration(config_dir() / "default.yaml", overrides=settings)
