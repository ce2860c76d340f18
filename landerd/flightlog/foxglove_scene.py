"""Pad and vehicle as a foxglove.SceneUpdate, for the 3D panels of Foxglove and Lichtblick.

Both stand still in frames of their own, `pad` and `body`, which the log's transforms move. The
vehicle is drawn as what the configuration knows of it: a box, a red nose, and the feet's plane.
"""

import math
from typing import Any

from landerd.config.models import VehicleSection
from landerd.flightlog.foxglove import timestamp
from landerd.pad import WHYCODE_CORE, Marker, PadLayout, Ring, Square

_WHITE, _BLACK, _GREY, _RED = (1.0, 1.0, 1.0), (0.05, 0.05, 0.05), (0.4, 0.45, 0.5), (0.8, 0.1, 0.1)
_PLATE_M, _PRINT_M, _BODY_M, _SKID_M = 0.01, 0.002, 0.08, 0.015  # thicknesses

_Shape = dict[str, Any]
_Place = tuple[float, float, float]


def pad_and_vehicle(ns: int, layout: PadLayout, vehicle: VehicleSection) -> dict[str, Any]:
    """Return a foxglove.SceneUpdate with the pad in frame `pad` and the vehicle in `body`."""
    return {
        "deletions": [],
        "entities": [
            _entity(ns, "pad", *_pad(layout)),
            _entity(ns, "body", _vehicle(vehicle), []),
        ],
    }


def _pad(layout: PadLayout) -> tuple[list[_Shape], list[_Shape]]:
    """Return cubes and cylinders; x north, y east, z down."""
    plate = layout.plate
    middle = (
        0.5 * (plate.north_m - plate.south_m),
        0.5 * (plate.east_m - plate.west_m),
        0.5 * _PLATE_M,
    )
    size = (plate.north_m + plate.south_m, plate.east_m + plate.west_m, _PLATE_M)
    cubes, cylinders = [_cube(middle, size, _WHITE)], []
    for marker in layout.markers:
        if isinstance(marker, Square):
            print_m = (marker.size_m, marker.size_m, _PRINT_M)
            turn = math.radians(marker.heading_deg)
            cubes.append(_cube(_on_top(marker, 1), print_m, _BLACK, turn))
        else:
            inner = marker.inner_ratio if isinstance(marker, Ring) else WHYCODE_CORE
            for layer, share, colour in ((1, 1.0, _BLACK), (2, inner, _WHITE)):
                cylinders.append(
                    _cylinder(_on_top(marker, layer), share * marker.outer_diameter_m, colour)
                )
    return cubes, cylinders


def _on_top(marker: Marker, layer: int) -> _Place:
    """Return the middle of a marker's print, the next layer on the one before."""
    north, east = marker.position_m
    return (north, east, -_PRINT_M * (layer - 0.5))


def _vehicle(vehicle: VehicleSection) -> list[_Shape]:
    """Return cubes; x forward, y right, z down from the autopilot's position."""
    along, across = vehicle.footprint_m
    down, skid = vehicle.gear_height_m - 0.5 * _SKID_M, (along, _SKID_M, _SKID_M)
    skids = [_cube((0.0, side * across, down), skid, _GREY) for side in (-0.5, 0.5)]
    nose = _cube((0.5 * along, 0.0, 0.0), (0.2 * along, 0.2 * across, 0.5 * _BODY_M), _RED)
    return [_cube((0.0, 0.0, 0.0), (0.8 * along, 0.6 * across, _BODY_M), _GREY), nose, *skids]


def _entity(ns: int, name: str, cubes: list[_Shape], cylinders: list[_Shape]) -> dict[str, Any]:
    return {
        "timestamp": timestamp(ns),
        "frame_id": name,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},  # for ever
        "frame_locked": True,  # it goes where its frame goes
        "cubes": cubes,
        "cylinders": cylinders,
    }


def _cube(at: _Place, size: _Place, colour: _Place, turn: float = 0.0) -> _Shape:
    return {"pose": _pose(at, turn), "size": _xyz(size), "color": _rgba(colour)}


def _cylinder(at: _Place, diameter: float, colour: _Place) -> _Shape:
    size = (diameter, diameter, _PRINT_M)
    return {**_cube(at, size, colour), "bottom_scale": 1.0, "top_scale": 1.0}


def _pose(at: _Place, turn: float) -> dict[str, Any]:
    """Return a pose turned about z, rad."""
    half = 0.5 * turn
    turned = {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}
    return {"position": _xyz(at), "orientation": turned}


def _xyz(v: _Place) -> dict[str, float]:
    return {"x": v[0], "y": v[1], "z": v[2]}


def _rgba(colour: _Place) -> dict[str, float]:
    return {"r": colour[0], "g": colour[1], "b": colour[2], "a": 1.0}
