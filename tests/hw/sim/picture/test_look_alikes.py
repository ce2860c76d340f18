"""Look-alikes: how many, where, what they are not, and that only they change the ground."""

import itertools
import math

import cv2
import numpy as np
import pytest

from hw.sim.picture.fractal import generator
from hw.sim.picture.look_alikes import LookAlike, painted, scattered
from hw.sim.picture.view import F64
from tests.hw.sim.picture.scenery import CAMERA, PAD, down, picture, projected

PLACE_M = (35.0, 12.0)
REACH_M = 8.0
TEXEL_M = 0.016


def things(count: int, seed: int = 1) -> list[LookAlike]:
    return scattered(count, PAD, PLACE_M, REACH_M, generator(seed, "look-alikes"))


def corners(thing: LookAlike) -> F64:
    """North, east of the square that it fills, (4, 2)."""
    half = thing.side_m / math.sqrt(2.0)
    a = thing.heading + math.pi * np.array([0.25, 0.75, 1.25, 1.75])
    return np.array(thing.place_m) + half * np.column_stack([np.cos(a), np.sin(a)])


@pytest.mark.parametrize("seed", range(1, 7))
@pytest.mark.parametrize("count", [1, 6, 12])
def test_look_alikes_are_as_many_as_asked_and_lie_apart_from_the_pad_and_each_other(
    count: int, seed: int
) -> None:
    made = things(count, seed)
    assert len(made) == count
    plate = PAD.plate
    for thing in made:
        north, east = (corners(thing) - PLACE_M).T
        # A circle: the pad may be turned.
        assert np.hypot(north, east).min() > math.hypot(plate.north_m, plate.east_m)
        assert np.abs([north, east]).max() < REACH_M
    for one, other in itertools.combinations(made, 2):
        assert math.dist(one.place_m, other.place_m) > 0.5 * (one.side_m + other.side_m)


def test_look_alikes_depend_on_their_seed() -> None:
    first, again, other = things(5, 1), things(5, 1), things(5, 2)
    assert [t.place_m for t in first] == [t.place_m for t in again]
    assert [t.place_m for t in first] != [t.place_m for t in other]


def test_more_than_there_is_room_for_are_left_out() -> None:
    made = scattered(30, PAD, PLACE_M, 3.0, generator(1, "look-alikes"))
    assert 0 < len(made) < 30


def test_no_tag_among_them_is_the_pads() -> None:
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(family)
    read = []
    for seed in range(1, 25):
        for thing in things(5, seed):
            sheet = cv2.resize(thing.levels[0][0], None, fx=2.0, fy=2.0)
            ids = detector.detectMarkers(sheet)[1]
            read += [] if ids is None else ids.ravel().tolist()
    assert len(read) > 3
    assert set(read).isdisjoint(square.id for square in PAD.squares)


def test_the_ground_is_changed_where_they_lie_and_nowhere_else() -> None:
    made = things(8)
    n = round(2 * REACH_M / TEXEL_M)
    texture = np.full((n, n), 70, np.uint8)
    corner = (PLACE_M[0] - REACH_M, PLACE_M[1] - REACH_M)
    seen = painted(texture, TEXEL_M, corner, made)
    assert (texture == 70).all()
    under = np.zeros((n, n), np.uint8)
    for thing in made:
        row, column = ((corners(thing) - corner) / TEXEL_M - 0.5).T
        outline = np.rint(np.column_stack([column, row])).astype(np.int32)
        mask = cv2.fillConvexPoly(np.zeros((n, n), np.uint8), outline, 1)
        assert (seen[mask == 1] != 70).mean() > 0.05
        under = np.maximum(under, mask)
    near = cv2.dilate(under, np.ones((5, 5), np.uint8))
    assert (seen[near == 0] == 70).all()


def test_a_tag_on_the_ground_is_seen_where_and_as_large_as_it_lies() -> None:
    made = scattered(12, PAD, (0.0, 0.0), 7.68, generator(4, "look-alikes"))
    thing = max(made, key=lambda t: t.side_m)
    north, east = thing.place_m
    pose = down(6.0, north, east)
    with_it = picture(pose, {"look_alikes": 12}, seed=4).astype(int)
    without = picture(pose, {"wet": 1e-9}, seed=4).astype(int)
    y, x = np.nonzero(np.abs(with_it - without) > 20)
    near = np.hypot(x - CAMERA.cx, y - CAMERA.cy) < 0.75 * thing.side_m * CAMERA.fx / 6.0
    outline = projected(pose, *((float(n), float(e), 0.0) for n, e in corners(thing)))
    seen = np.column_stack([x, y])[near].astype(np.float32)
    (cx, cy), radius = cv2.minEnclosingCircle(seen)
    assert (cx, cy) == pytest.approx(tuple(outline.mean(axis=0)), abs=1.5)
    side_px = thing.side_m * CAMERA.fx / 6.0
    assert 0.9 * side_px / 2 < radius < 1.05 * side_px / math.sqrt(2.0) + 1.0
