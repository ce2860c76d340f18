"""Which way is north, where the origin is and which side is right makes no difference to a flight.

Recorded flights are turned about the vertical and moved, or seen in a mirror: the core must give
the same orders, turned or mirrored alike. That finds a wrong sign along an axis that one flight
does not use.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import pytest

from landerd.commands.replay import config_of
from landerd.flightlog.reader import read_log
from landerd.geometry import (
    Mat3,
    Vec3,
    add,
    diagonal,
    rot_z,
    rotate,
    rotate_covariance,
    wrap,
)
from landerd.lander import Lander
from landerd.messages import (
    Attitude,
    Command,
    GimbalCommand,
    GimbalState,
    Input,
    LocalPosition,
    PoseSolution,
    PressDown,
    Setpoint,
    Sightings,
)

FLIGHTS = sorted((Path(__file__).parent / "golden").glob("*.mcap"))
ORIGIN: Vec3 = (-60.0, 35.0, 7.0)  # m
TOLERANCE = 1e-6  # of rounding alone: rad, m/s
MIRROR: Mat3 = diagonal(-1.0, 1.0, 1.0)  # of the camera's frame, whose x is to the right


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


def east_west(v: Vec3) -> Vec3:
    north, east, down = v
    return north, -east, down


def mirrored_pose(pose: PoseSolution) -> PoseSolution:
    systematic = pose.systematic
    if systematic is not None:
        covariance = rotate_covariance(MIRROR, systematic.covariance)
        systematic = replace(systematic, covariance=covariance)
    return replace(
        pose,
        position=rotate(MIRROR, pose.position),
        normal=rotate(MIRROR, pose.normal),
        north=None if pose.north is None else rotate(MIRROR, pose.north),
        covariance=rotate_covariance(MIRROR, pose.covariance),
        systematic=systematic,
    )


def mirrored(message: Input) -> Input:
    """The message of the same flight in a mirror: what was on the right is on the left."""
    match message:
        case Attitude(rates=(p, q, r)):
            return replace(message, roll=-message.roll, yaw=-message.yaw, rates=(-p, q, -r))
        case LocalPosition(position=position, velocity=velocity):
            return replace(message, position=east_west(position), velocity=east_west(velocity))
        case GimbalState():
            return replace(message, yaw=-message.yaw, roll=-message.roll)
        case Sightings():
            markers = tuple(
                replace(m, solutions=tuple(map(mirrored_pose, m.solutions)))
                for m in message.markers
            )
            return replace(message, markers=markers, pad=tuple(map(mirrored_pose, message.pad)))
    return message


def mirrored_back(command: Command) -> Command:
    match command:
        case Setpoint(velocity=velocity):
            return replace(command, velocity=east_west(velocity), yaw_rate=-command.yaw_rate)
        case GimbalCommand():
            return replace(command, yaw=-command.yaw)
        case PressDown():
            return replace(command, heading=-command.heading)
    return command


def fields(command: Command) -> list[Any]:
    """The values of an order, vectors taken apart."""
    values = [v if isinstance(v, tuple) else (v,) for v in astuple(command)]
    return [part for value in values for part in value]


def compare(
    path: Path, changed: Callable[[Input], Input], back: Callable[[Command], Command]
) -> None:
    """Compare the orders of a recorded flight with those of the changed one."""
    log = read_log(path)
    config, _ = config_of(log, [])
    recorded, other = Lander(config, log.layout), Lander(config, log.layout)
    for step in log.steps:
        asked = recorded.step(step.message)
        given = [back(c) for c in other.step(changed(step.message))]
        assert [type(c) for c in given] == [type(c) for c in asked]
        for order, should in zip(given, asked, strict=True):
            assert fields(order) == pytest.approx(fields(should), abs=TOLERANCE)


def test_the_recorded_flights_are_found() -> None:
    assert FLIGHTS


@pytest.mark.parametrize("degrees", [90.0, -137.0])
@pytest.mark.parametrize("path", FLIGHTS, ids=[path.stem for path in FLIGHTS])
def test_a_flight_that_is_turned_and_moved_gets_the_same_orders(path: Path, degrees: float) -> None:
    angle = math.radians(degrees)
    compare(path, lambda m: turned(m, angle), lambda c: turned_back(c, angle))


@pytest.mark.parametrize("path", FLIGHTS, ids=[path.stem for path in FLIGHTS])
def test_a_flight_in_a_mirror_gets_the_same_orders_mirrored(path: Path) -> None:
    compare(path, mirrored, mirrored_back)
