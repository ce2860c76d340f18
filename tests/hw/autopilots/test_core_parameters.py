"""The autopilot's parameters that the core flies by."""

import math

import pytest

from hw.autopilots.core_parameters import change_of, untold


@pytest.mark.parametrize(
    ("name", "value", "key", "si"),
    [
        ("GUID_TIMEOUT", 1.0, "autopilot.guided_timeout_s", 1.0),
        ("WPNAV_ACCEL", 250.0, "autopilot.acceleration_mps2", 2.5),  # cm/s^2 up to ArduCopter 4.6
        ("WP_ACC", 2.5, "autopilot.acceleration_mps2", 2.5),
        ("WPNAV_ACCEL_Z", 9000.0, "autopilot.vertical_acceleration_mps2", 5.0),  # as allowed
        ("PSC_D_JERK", 0.1, "autopilot.vertical_jerk_mps3", 1.0),
    ],
)
def test_the_core_gets_them_in_its_units_and_within_what_may_be_configured(
    name: str, value: float, key: str, si: float
) -> None:
    change = change_of(name, value, 7.0)
    assert change is not None
    assert (change.t, change.key) == (7.0, key)
    assert change.value == pytest.approx(si)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_a_value_that_is_none_is_not_flown_by(value: float) -> None:
    assert change_of("WPNAV_ACCEL", value, 7.0) is None


def test_the_other_thousand_parameters_are_of_no_use_to_the_core() -> None:
    assert change_of("BATT_MONITOR", 4.0, 7.0) is None


def test_one_name_of_a_parameter_is_enough() -> None:
    names = untold([])
    assert {"PSC_JERK_XY", "PSC_NE_JERK", "GUID_TIMEOUT"} <= set(names)
    assert {"PSC_JERK_XY", "PSC_NE_JERK"}.isdisjoint(untold(["PSC_JERK_NE", "BATT_MONITOR"]))
    assert "GUID_TIMEOUT" in untold(["PSC_JERK_NE"])
