"""The configuration is cut to what the chosen gimbal reaches."""

import pytest

from landerd.config.files import ConfigError, Loaded, config_dir
from landerd.drivers import read_configuration


def loaded(*overrides: str) -> Loaded:
    return read_configuration(config_dir() / "default.yaml", overrides=overrides)


def test_limits_beyond_the_gimbals_reach_are_reduced_and_reported() -> None:
    made = loaded("gimbal.driver=siyi", "gimbal.pitch_limits_deg=[-120, 20]")
    assert made.config.gimbal.pitch_limits_deg == (-90.0, 20.0)
    assert made.config.gimbal.yaw_limits_deg == (-90.0, 90.0)  # it reaches more
    assert made.remarks == (
        "gimbal.pitch_limits_deg: -120 to 20 is cut: siyi reaches -90 to 25",
    )  # fmt: skip


def test_servos_reach_the_angles_in_their_tables() -> None:
    table = "gimbal.servo_sysfs.pitch={channel: 0, table: [[-95, 1000], [10, 2000]]}"
    made = loaded("gimbal.driver=servo_sysfs", "gimbal.pitch_limits_deg=[-180, 20]", table)
    assert made.config.gimbal.pitch_limits_deg == (-95.0, 10.0)
    assert made.config.gimbal.yaw_limits_deg == (0.0, 0.0)


def test_limits_within_the_gimbals_reach_are_left_as_they_are() -> None:
    assert loaded().remarks == ()
    assert loaded("gimbal.driver=siyi", "gimbal.pitch_limits_deg=[-90, 0]").remarks == ()


def test_a_range_wholly_beyond_the_gimbals_reach_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"gimbal.pitch_limits_deg: found 50 to 60, but siyi"):
        loaded("gimbal.driver=siyi", "gimbal.pitch_limits_deg=[50, 60]")


@pytest.mark.parametrize(
    ("overrides", "sigma_deg"),
    [
        (["gimbal.driver=storm32"], 1.0),
        (["gimbal.driver=servo_pca9685"], 1.5),
        (["gimbal.driver=mavlink", "gimbal.mavlink.feedback=false"], 1.5),
        (["gimbal.driver=servo_pca9685", "estimation.gimbal_sigma_deg=2.0"], 2.0),
    ],
)
def test_unmeasured_gimbal_angles_count_as_less_certain(
    overrides: list[str], sigma_deg: float
) -> None:
    assert loaded(*overrides).config.estimation.gimbal_sigma_deg == pytest.approx(sigma_deg)
