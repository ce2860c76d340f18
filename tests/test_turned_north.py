"""Which way is north, and where the local origin is, makes no difference to a flight.

Recorded flights are turned about the vertical and moved: the core must give the same orders, turned
alike. That finds a wrong sign along an axis that one flight does not use.
"""

import math
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import pytest

from landerd.commands.replay import config_of
from landerd.flightlog.reader import read_log
from landerd.geometry import Vec3, add, rot_z, rotate, wrap
from landerd.lander import Lander
from landerd.messages import Attitude, Command, Input, LocalPosition, PressDown, Setpoint

FLIGHTS = sorted((Path(__file__).parent / "golden").glob("*.mcap"))
ORIGIN: Vec3 = (-60.0, 35.0, 7.0)  # m
TOLERANCE = 1e-6  # of rounding alone: rad, m/s


def turned(message: Input, angle: float) -> Input:
    """The message as it is with the axes turned and the origin moved."""
    turn = rot_z(angle)
    match message:
        case Attitude():
            return replace(message, yaw=wrap(message.yaw + angle))
        case LocalPosition(position=position, velocity=velocity):
            position = add(rotate(turn, position), ORIGIN)
            return replace(message, position=position, velocity=rotate(turn, velocity))
    return message


def turned_back(command: Command, angle: float) -> Command:
    """The order as it would have been with the axes as recorded."""
    match command:
        case Setpoint(velocity=velocity):
            return replace(command, velocity=rotate(rot_z(-angle), velocity))
        case PressDown(heading=heading):
            return replace(command, heading=wrap(heading - angle))
    return command


def fields(command: Command) -> list[Any]:
    """The values of an order, vectors taken apart."""
    values = [v if isinstance(v, tuple) else (v,) for v in astuple(command)]
    return [part for value in values for part in value]


def test_the_recorded_flights_are_found() -> None:
    assert FLIGHTS


@pytest.mark.parametrize("degrees", [90.0, -137.0])
@pytest.mark.parametrize("path", FLIGHTS, ids=[path.stem for path in FLIGHTS])
def test_a_flight_that_is_turned_and_moved_gets_the_same_orders(path: Path, degrees: float) -> None:
    log = read_log(path)
    config, _ = config_of(log, [])
    recorded, moved = Lander(config, log.layout), Lander(config, log.layout)
    angle = math.radians(degrees)
    for step in log.steps:
        asked = recorded.step(step.message)
        given = [turned_back(c, angle) for c in moved.step(turned(step.message, angle))]
        assert [type(c) for c in given] == [type(c) for c in asked]
        for order, should in zip(given, asked, strict=True):
            assert fields(order) == pytest.approx(fields(should), abs=TOLERANCE)
