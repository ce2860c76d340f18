"""What a 3D panel draws of a log: the pad and the vehicle, where the transforms put them."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from landerd.config.files import config_files
from landerd.config.models import VehicleSection
from landerd.flightlog.foxglove_scene import pad_and_vehicle
from landerd.pad import Square, load_pad
from tests.recorded_flight import RecordedFlight, recorder


def at(shape: dict[str, Any]) -> tuple[float, float]:
    return shape["pose"]["position"]["x"], shape["pose"]["position"]["y"]


def test_a_log_draws_the_pad_and_the_vehicle_in_frames_that_it_moves(tmp_path: Path) -> None:
    flight = RecordedFlight(recorder(tmp_path / "a.mcap"))
    flight.run(1.0)
    flight.recorder.close()
    with (tmp_path / "a.mcap").open("rb") as file:
        said = [
            (schema.name, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages(["/scene", "/tf"])
            if schema is not None
        ]
    (scene,) = [data for name, data in said if name == "foxglove.SceneUpdate"]
    moved = {data["child_frame_id"] for name, data in said if name == "foxglove.FrameTransform"}
    assert {e["frame_id"] for e in scene["entities"]} == {"pad", "body"} <= moved
    assert all(e["frame_locked"] and e["lifetime"]["sec"] == 0 for e in scene["entities"])


@pytest.mark.parametrize("name", sorted(config_files("pads")))
def test_every_marker_lies_on_the_plate_where_its_file_says(name: str) -> None:
    layout = load_pad(config_files("pads")[name])
    pad = pad_and_vehicle(0, layout, VehicleSection())["entities"][0]
    plate, *squares = pad["cubes"]
    p = layout.plate
    assert plate["size"]["x"] == pytest.approx(p.north_m + p.south_m)
    assert at(plate)[0] + 0.5 * plate["size"]["x"] == pytest.approx(p.north_m)
    assert [at(s) for s in squares] == [m.position_m for m in layout.squares]
    rings = [m for m in layout.markers if not isinstance(m, Square)]
    black = pad["cylinders"][::2]
    assert [at(c) for c in black] == [m.position_m for m in rings]
    assert [c["size"]["x"] for c in black] == [2.0 * m.radius_m for m in rings]
    for outer, inner in zip(black, pad["cylinders"][1::2], strict=True):
        assert inner["size"]["x"] < outer["size"]["x"]
        assert inner["pose"]["position"]["z"] < outer["pose"]["position"]["z"]  # z is down: above


def test_the_feet_are_drawn_where_the_vehicle_stands_on_them() -> None:
    vehicle = VehicleSection(gear_height_m=0.3, footprint_m=(0.5, 0.4))
    layout = load_pad(config_files("pads")["thesis"])
    body = pad_and_vehicle(0, layout, vehicle)["entities"][1]
    feet = [c for c in body["cubes"] if c["pose"]["position"]["z"] > 0.1]
    assert [at(c)[1] for c in feet] == [-0.2, 0.2]
    lowest = [c["pose"]["position"]["z"] + 0.5 * c["size"]["z"] for c in feet]
    assert lowest == pytest.approx([0.3, 0.3])
    assert all(math.isclose(c["size"]["x"], 0.5) for c in feet)
