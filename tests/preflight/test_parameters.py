import pytest

from landerd.config.files import config_dir
from landerd.config.parameters import with_value
from landerd.drivers import read_configuration
from landerd.preflight.parameters import parameter_findings

CONFIG = read_configuration(config_dir() / "default.yaml").config
SOUND = {
    "RC11_OPTION": 0.0,
    "GUID_TIMEOUT": 1.0,
    "GUID_OPTIONS": 0.0,
    "WP_YAW_BEHAVIOR": 0.0,
    "FS_THR_ENABLE": 1.0,
}


@pytest.mark.parametrize("arming", [{"ARMING_CHECK": 1.0}, {"ARMING_SKIPCHK": 0.0}])
def test_arming_checks_are_known_by_the_names_of_4_6_and_of_4_7(arming: dict[str, float]) -> None:
    (finding,) = parameter_findings(CONFIG, SOUND | arming)
    assert (finding.level, finding.what) == ("ok", "6 looked at, none fights landerd")


def test_an_arming_check_that_4_7_skips_is_reported() -> None:
    (finding,) = parameter_findings(CONFIG, SOUND | {"ARMING_SKIPCHK": 4.0})
    assert (finding.level, finding.mend) == ("warn", "set ARMING_SKIPCHK 0")


def test_unknown_arming_checks_are_reported_with_both_parameter_names() -> None:
    (finding,) = parameter_findings(CONFIG, SOUND)
    assert "did not tell ARMING_CHECK, ARMING_SKIPCHK" in finding.what


@pytest.mark.parametrize(
    ("shaping", "late_s"),
    [
        ({"WPNAV_ACCEL": 250.0, "PSC_JERK_XY": 2.0}, 1.25),  # to 4.6
        ({"WP_ACC": 2.5, "PSC_JERK_NE": 2.0}, 1.25),  # 4.7.0
        ({"WP_ACC": 5.0, "PSC_NE_JERK": 5.0}, 1.0),  # after it
        ({"WPNAV_ACCEL": 0.0, "PSC_JERK_XY": 2.0}, 1.25),  # ArduPilot's own default then
    ],
)
def test_slow_velocity_shaping_is_reported(shaping: dict[str, float], late_s: float) -> None:
    values = SOUND | {"ARMING_CHECK": 1.0} | shaping
    (finding,) = parameter_findings(CONFIG, values)
    assert (finding.level, f"{late_s:.1f} s late" in finding.what) == ("warn", True)
    _, name, jerk = finding.mend.split()
    (again,) = parameter_findings(CONFIG, values | {name: float(jerk)})
    assert again.level == "ok"


@pytest.mark.parametrize("shaping", [{}, {"WPNAV_ACCEL": 250.0, "PSC_JERK_XY": 5.0}])
def test_velocity_shaping_by_ardupilots_defaults_or_of_an_old_version_is_no_finding(
    shaping: dict[str, float],
) -> None:
    (finding,) = parameter_findings(CONFIG, SOUND | {"ARMING_CHECK": 1.0} | shaping)
    assert finding.level == "ok"


@pytest.mark.parametrize(("timeout_s", "height_m"), [(1.1, 0.6), (3.0, 1.4)])
def test_a_long_timeout_fails_with_the_height_from_which_it_strikes(
    timeout_s: float, height_m: float
) -> None:
    values = SOUND | {"ARMING_CHECK": 1.0, "GUID_TIMEOUT": timeout_s}
    (finding,) = parameter_findings(CONFIG, values)
    assert finding.level == "fail"
    assert f"below {height_m} m to the ground" in finding.what


@pytest.mark.parametrize(("channel", "level"), [(5, "fail"), (6, "ok")])
def test_a_switch_that_selects_flight_modes_too_is_a_failure(channel: int, level: str) -> None:
    config = with_value(CONFIG, "rc.gate_channel", channel)
    values = {name: value for name, value in SOUND.items() if name != "RC11_OPTION"}
    values |= {f"RC{channel}_OPTION": 0.0, "ARMING_CHECK": 1.0, "FLTMODE_CH": 5.0}
    (finding,) = parameter_findings(config, values)
    assert finding.level == level


@pytest.mark.parametrize("options", [32.0, 48.0, float("nan")])
def test_guid_options_that_let_velocities_drift_are_a_failure(options: float) -> None:
    """ArduCopter in SITL drifted at 0.1 m/s beside every order, and never reached the pad."""
    values = SOUND | {"ARMING_CHECK": 1.0, "GUID_OPTIONS": options}
    (finding,) = parameter_findings(CONFIG, values)
    assert (finding.level, finding.mend) == ("fail", "set GUID_OPTIONS 0")


@pytest.mark.parametrize("options", [1.0, 8.0, 16.0, 65.0])
def test_options_of_guided_that_do_not_matter_are_no_finding(options: float) -> None:
    values = SOUND | {"ARMING_CHECK": 1.0, "GUID_OPTIONS": options}
    (finding,) = parameter_findings(CONFIG, values)
    assert finding.level == "ok"


@pytest.mark.parametrize(("time_s", "level"), [(0.15, "ok"), (0.3, "ok"), (0.5, "warn")])
def test_a_slow_attitude_controller_is_reported(time_s: float, level: str) -> None:
    """ArduCopter in SITL then overshoots its velocities by a fifth, to and fro for ten seconds."""
    values = SOUND | {"ARMING_CHECK": 1.0, "ATC_INPUT_TC": time_s}
    (finding,) = parameter_findings(CONFIG, values)
    assert finding.level == level
    if level == "warn":
        (again,) = parameter_findings(CONFIG, values | {"ATC_INPUT_TC": float(finding.mend[-3:])})
        assert again.level == "ok"
