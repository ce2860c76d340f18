import math

import pytest

from landerd.campaigns.plan import Poses, Row
from landerd.campaigns.pool import Run
from landerd.campaigns.poses import as_text, make_pose_row
from landerd.config.files import config_dir, config_files
from landerd.drivers import read_configuration
from landerd.simulation import poses


def test_pictures_along_the_approach_tell_where_the_markers_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(poses, "PICTURES", 6)
    loaded = read_configuration(
        config_dir() / "default.yaml", overlays=[config_files("scenarios")["stationary"]], seed=1
    )
    result = poses.see_poses(loaded, "stationary # poses", 1)
    distances = [picture["distance_m"] for picture in result["poses"]]
    assert distances[0] == pytest.approx(math.hypot(16.0, 10.0), abs=1.0)
    assert distances[-1] == pytest.approx(0.5, abs=0.1)
    for picture in result["poses"][1:-1]:
        assert math.hypot(*picture["markers"]["whycon"]["error_m"]) < 0.1
        assert picture["flipped"] is False
    (tag, *_) = [p["markers"]["apriltag"] for p in result["poses"] if "apriltag" in p["markers"]]
    assert abs(tag["yaw_error_rad"]) < 0.1

    asked = Poses(marker="whycon", error_m=(0.0, 0.0, 0.0, 2.0))
    row = Row(scenario="stationary", goal="poses", poses=asked)
    made = make_pose_row(row, [Run(row.name, 1, result)])
    assert made["pictures"] == 6
    assert {b["thesis_error_m"] for b in made["bins"]} == {2.0}
    assert "of the pad flipped, with gravity: 0 of" in as_text(made)
