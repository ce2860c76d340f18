"""Days that are beyond the vehicle."""

from typing import Any

import pytest

from hw.sim.judge.feasible import infeasible
from hw.sim.options import SimOptions


def why(**options: Any) -> str | None:
    return infeasible(SimOptions.model_validate(options))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"pad": {"speed_mps": 5.0}, "wind": {"speed_mps": 3.0, "from_deg": 180.0}},
        # 15 m/s with 8 m/s from behind: 7 m/s of airspeed.
        {"pad": {"speed_mps": 15.0}, "wind": {"speed_mps": 8.0, "from_deg": 180.0}},
        {"pad": {"speed_mps": 15.0}, "vehicle": "fast"},
        {"pad": {"heave_m": 0.3, "heave_hz": 0.2}},
        {"pad": {"speed_mps": 5.0, "brake_mps2": 2.0}},
        # It slopes up with the wind, and stands where a level plate would not hold it.
        {
            "wind": {"speed_mps": 10.0, "from_deg": 60.0},
            "pad": {"heading_deg": 90.0, "tilt_azimuth_deg": -30.0, "tilt_deg": 5.0},
            "airframe": {"angle_max_deg": 45.0},
        },
        # The thesis's wind is what it is: what is said of another one does not count.
        {"wind": {"model": "thesis", "speed_mps": 11.0}, "airframe": {"angle_max_deg": 45.0}},
        # A plate that slopes nobody knows which way may slope with the lean.
        {
            "wind": {"speed_mps": 6.0, "from_deg": 0.0},
            "pad": {"tilt_azimuth_deg": None, "tilt_deg": 30.0},
        },
        {"pad": {"sway_m": 0.5, "sway_hz": 0.2}},
        # It leans by as much only for a part of each turn.
        {
            "pad": {"speed_mps": 5.0, "turn_rate_deg_s": 8.0},
            "wind": {"speed_mps": 6.0},
            "airframe": {"angle_max_deg": 45.0},
        },
    ],
)
def test_the_worlds_that_landerd_lands_in_count_as_feasible(options: dict[str, Any]) -> None:
    assert why(**options) is None


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"pad": {"speed_mps": 12.0}}, "airspeed of 12.0 m/s"),
        ({"pad": {"speed_mps": 5.0}, "wind": {"speed_mps": 6.0, "from_deg": 0.0}}, "airspeed"),
        ({"wind": {"speed_mps": 6.0, "turbulence_mps": 2.0}}, "airspeed of 10.0"),
        ({"wind": {"speed_mps": 6.0}, "airframe": {"angle_max_deg": 12.0}}, "more lean"),
        # It has that lean, but cannot stand in that wind,
        (
            {"wind": {"speed_mps": 10.0, "model": "steady"}, "airframe": {"angle_max_deg": 45.0}},
            "leans by 29 degrees",
        ),
        # nor in less of it on a plate that slopes down with the wind.
        (
            {
                "wind": {"speed_mps": 9.5, "from_deg": 60.0},
                "pad": {"heading_deg": 90.0, "tilt_azimuth_deg": 150.0, "tilt_deg": 5.0},
                "airframe": {"angle_max_deg": 45.0},
            },
            "leans by 32 degrees",
        ),
        ({"pad": {"speed_mps": 5.0, "brake_mps2": 3.0}}, "accelerates by 3.0"),
        ({"pad": {"speed_mps": 10.0, "turn_rate_deg_s": 20.0}}, "accelerates by 3.5"),
        ({"pad": {"heave_m": 0.5, "heave_hz": 0.3}}, "heaves with 1.8"),
        # Whichever way it slopes, and whatever wind there is that does not lean it as far.
        ({"pad": {"tilt_azimuth_deg": None, "tilt_deg": 30.0}}, "leans by 30 degrees"),
        (
            {
                "wind": {"speed_mps": 1.0, "from_deg": 0.0},
                "pad": {"tilt_azimuth_deg": None, "tilt_deg": 30.0},
            },
            "leans by 28 degrees",
        ),
        ({"wind": {"model": "thesis"}, "pad": {"tilt_deg": 30.0}}, "leans by 28 degrees"),
        ({"pad": {"sway_m": 1.0, "sway_hz": 1.0}}, "accelerates by 39.5"),
        # It stands on it, but ArduCopter's land detector never says so.
        (
            {
                "pad": {"speed_mps": 10.0, "turn_rate_deg_s": 8.0},
                "vehicle": "fast",
                "airframe": {"angle_max_deg": 44.0},
            },
            "turns with 1.4 m/s2",
        ),
    ],
)
def test_a_pad_that_the_vehicle_cannot_follow_is_reported_as_infeasible(
    options: dict[str, Any], said: str
) -> None:
    found = why(**options)
    assert found is not None
    assert said in found
