import pytest

from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.preflight.parameters import parameter_findings

CONFIG = read_configuration(config_dir() / "default.yaml").config
SOUND = {"RC11_OPTION": 0.0, "GUID_TIMEOUT": 1.0, "WP_YAW_BEHAVIOR": 0.0, "FS_THR_ENABLE": 1.0}


@pytest.mark.parametrize("arming", [{"ARMING_CHECK": 1.0}, {"ARMING_SKIPCHK": 0.0}])
def test_arming_checks_are_known_by_the_names_of_4_6_and_of_4_7(arming: dict[str, float]) -> None:
    (finding,) = parameter_findings(CONFIG, SOUND | arming)
    assert (finding.level, finding.what) == ("ok", "5 looked at, none fights landerd")


def test_a_check_that_is_left_out_in_4_7_is_told() -> None:
    (finding,) = parameter_findings(CONFIG, SOUND | {"ARMING_SKIPCHK": 4.0})
    assert (finding.level, finding.mend) == ("warn", "set ARMING_SKIPCHK 0")


def test_arming_checks_that_nobody_told_of_are_told_by_both_names() -> None:
    (finding,) = parameter_findings(CONFIG, SOUND)
    assert "did not tell ARMING_CHECK, ARMING_SKIPCHK" in finding.what
