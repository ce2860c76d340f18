"""ardupilot/*.param as a ground station and `landerd check` read them."""

from pathlib import Path

import pytest

from hw.gimbals.servo_mavlink import ServoMavlinkOptions
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.installation.service import BOARDS, parameter_file
from landerd.preflight.parameters import parameter_findings

FILES = [
    file.with_name(f"{file.stem}{release}.param")
    for file in map(parameter_file, BOARDS)
    for release in ("", "-4.7")
]


def values(file: Path) -> dict[str, float]:
    """Read a file as Mission Planner and MAVProxy do: two words a line, # begins a remark."""
    read = {}
    for line in file.read_text("ascii").splitlines():
        if not line.startswith("#"):
            name, value = line.split(",")
            assert name not in read
            assert len(name) <= 16  # as MAVLink carries it
            read[name] = float(value)
    return read


def test_each_board_has_its_files_and_there_are_no_others() -> None:
    assert sorted(FILES[0].parent.iterdir()) == sorted(FILES)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_check_is_content_with_an_autopilot_that_has_loaded_it(file: Path) -> None:
    board = file.stem.removesuffix("-4.7")
    config = read_configuration(config_dir() / "vehicles" / f"{board}.yaml").config
    (finding,) = parameter_findings(config, values(file))
    assert finding.level == "ok"


@pytest.mark.parametrize("board", ["pixhawk-uart", "jetson"])
def test_the_ports_baud_rate_is_that_of_the_example(board: str) -> None:
    config = read_configuration(config_dir() / "vehicles" / f"{board}.yaml").config
    baud = values(parameter_file(board))["SERIAL2_BAUD"]  # 921: 921600
    assert config.autopilot.url.endswith(f"?baud={baud:.0f}600")


def test_the_outputs_left_to_landerd_are_those_of_the_examples_servos() -> None:
    options = read_configuration(config_dir() / "vehicles/navio2.yaml").options[
        "gimbal.servo_mavlink"
    ]
    assert isinstance(options, ServoMavlinkOptions)
    assert options.yaw is not None
    assert options.pitch is not None
    channels = {options.yaw.channel, options.pitch.channel}
    freed = {name for name in values(parameter_file("navio2")) if name.startswith("SERVO")}
    assert freed == {f"SERVO{channel}_FUNCTION" for channel in channels}
