"""The limit on the work of a ring's search in one image, and its continuation in the next."""

import math

import cv2
import numpy as np
import pytest

from landerd.vision import ring_work
from landerd.vision.ring_work import (
    EDGE_COST,
    FULL_COST,
    HARD_COST,
    ROUGH_COST,
    Part,
    Place,
    RingWork,
)
from landerd.vision.whycon import find_rings
from tests.vision import scenes

CAMERA = scenes.THESIS_CAMERA
RING = scenes.THESIS_PAD.rings[0]
MOST_IMAGES = 60


def place(x: float, reduction: float = 1.0) -> Place:
    return Place(np.array([x, 100.0]), 40.0, reduction)


def look_alikes() -> scenes.U8:
    """Return a picture full of rings of another ratio and of discs."""
    rng = np.random.default_rng(7)
    image = rng.normal(150.0, 3.0, (CAMERA.height, CAMERA.width))
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    for row in range(5):
        for column in range(7):
            off = np.hypot(x - (50 + 90 * column), y - (50 + 95 * row))
            hole = rng.uniform(0.5, 0.75) * 28.0
            image[(off < 28.0) & (off > hole)] -= 100.0
    return np.clip(image, 0, 255).astype(np.uint8)


def with_ring(ground: scenes.U8, view: scenes.View) -> scenes.U8:
    """Return a picture of ground with a ring, in the white around it."""
    optics = scenes.Optics(background="plain")
    pad = scenes.render(view, CAMERA, optics, np.random.default_rng(3))
    edge = scenes.outline(view, CAMERA, RING)
    margin = 0.15 * float(np.ptp(edge, axis=0).max())
    low = np.floor(edge.min(axis=0) - margin).astype(int)
    high = np.ceil(edge.max(axis=0) + margin).astype(int)
    part = np.s_[max(low[1], 0) : high[1], max(low[0], 0) : high[0]]
    image = ground.copy()
    image[part] = pad[part]
    return image


def test_an_image_costs_no_more_than_it_may() -> None:
    work = RingWork()
    work.begin()
    spent = 0
    while work.affords(ROUGH_COST):
        spent += ROUGH_COST
    assert work.was_cut
    work.begin()
    told = 0
    while work.affords_search(FULL_COST, HARD_COST):
        told += FULL_COST
    assert 0 < told < spent <= ring_work._FRAME_COST
    assert work.affords(HARD_COST)


def test_outlines_that_no_fit_explains_are_not_tried_again() -> None:
    work = RingWork()
    work.begin()
    work.leave_unexplained(place(10.0))
    work.cut()
    work.begin()
    assert work.is_unexplained(place(12.0))
    assert not work.is_refused(place(12.0))  # shadow and motion may explain it
    work.begin()
    assert not work.is_unexplained(place(12.0))


def test_refused_places_are_forgotten_when_a_search_has_ended() -> None:
    work = RingWork()
    work.begin()
    work.refuse(place(10.0))
    work.cut()
    work.begin()
    assert work.is_continued
    assert work.is_refused(place(12.0))
    assert work.is_done(place(12.0))
    assert not work.is_done(place(12.0, reduction=2.0))
    assert not work.is_done(place(200.0))
    work.begin()
    assert not work.is_continued
    assert not work.is_refused(place(12.0))
    assert not work.is_done(place(12.0))


def test_a_search_takes_an_image_for_each_part_and_what_was_cut_short_another_turn() -> None:
    work = RingWork()
    work.begin()
    assert work.part is Part.MOST
    work.cut()
    work.leave(Part.REST)
    work.begin()
    assert (work.part, work.is_continued) == (Part.REST, False)
    work.begin()
    assert (work.part, work.is_continued) == (Part.MOST, True)
    work.leave(Part.REST)  # was done already
    assert not work.was_cut
    work.begin()
    assert (work.part, work.is_continued) == (Part.MOST, False)
    work.leave(Part.OTHERS, Part.FINEST)
    work.begin()
    assert (work.part, work.is_continued) == (Part.OTHERS, False)
    work.end()
    assert not work.was_cut


def test_a_search_that_comes_to_nothing_new_ends() -> None:
    work = RingWork()
    work.begin()
    work.refuse(place(100.0))
    work.cut()
    work.begin()
    assert work.is_continued
    work.cut()
    assert not work.was_cut
    work.begin()
    assert not work.is_continued


def test_new_outlines_in_every_image_do_not_keep_the_other_parts_of_a_search_waiting() -> None:
    work = RingWork()
    parts = []
    for k in range(8):
        work.begin()
        if work.part is Part.MOST:
            work.leave(Part.REST)
        work.refuse(place(20.0 * k))
        work.cut()
        parts.append(work.part)
    assert parts == 4 * [Part.MOST, Part.REST]
    assert not work.is_continued
    assert work.is_done(place(100.0))  # the next search goes on from there


@pytest.mark.parametrize("moved", [(0, 24), (-16, 8)])
def test_refused_places_are_recognised_where_they_have_moved_to(moved: tuple[int, int]) -> None:
    image = np.ascontiguousarray(look_alikes()[::4, ::4])
    work = RingWork()
    work.begin()
    work.follow(image, 4.0)
    where = np.array([320.0, 240.0])
    work.refuse(Place(where, 56.0))
    work.leave_unexplained(Place(where, 56.0))
    work.cut()
    work.begin()
    work.follow(np.roll(image, (moved[1] // 4, moved[0] // 4), axis=(0, 1)), 4.0)
    now = Place(where + moved, 56.0)
    assert work.is_done(now)
    assert work.is_unexplained(now)
    assert not work.is_done(Place(where, 56.0))


def test_a_part_of_a_search_of_texture_costs_less_and_shadow_and_motion_wait() -> None:
    work = RingWork()
    work.begin()
    assert work.has(FULL_COST + EDGE_COST + HARD_COST)
    work.leave(Part.REST, Part.PLATE)
    assert not work.is_spread
    work.end()
    work.begin()
    work.leave(Part.OTHERS)
    work.leave(Part.BROKEN, Part.FINEST)
    assert work.is_spread
    work.begin()
    assert work.has(ROUGH_COST + FULL_COST + EDGE_COST)
    assert not work.has(FULL_COST + HARD_COST)
    work.cut()
    for part in (Part.BROKEN, Part.FINEST, Part.OTHERS):
        work.begin()
        assert (work.part, work.is_spread) == (part, True)
    assert work.is_continued
    assert work.has(ROUGH_COST + FULL_COST + HARD_COST)
    work.begin()
    assert not work.is_spread


def leaves() -> scenes.U8:
    """Return a picture full of texture."""
    rng = np.random.default_rng(5)
    spots = cv2.GaussianBlur(rng.normal(size=(CAMERA.height, CAMERA.width)), (0, 0), 1.6)
    grey: scenes.U8 = np.clip(110.0 + 60.0 * spots / spots.std(), 0, 255).astype(np.uint8)
    return grey


@pytest.mark.parametrize(
    ("ground", "distance", "image"),
    [
        (leaves(), 10.0, 0),
        (leaves(), 37.0, 4),
        (np.full((CAMERA.height, CAMERA.width), 110, np.uint8), 37.0, 0),
    ],
)
def test_in_texture_far_rings_are_looked_for_in_an_image_of_their_own(
    ground: scenes.U8, distance: float, image: int
) -> None:
    view = scenes.look(CAMERA, distance, math.radians(20.0), pixel=(300.0, 250.0))
    picture = with_ring(ground, view)
    work = RingWork()
    found = [bool(find_rings(picture, RING, CAMERA, work=work)) for _ in range(image + 1)]
    assert found == [False] * image + [True]


def test_the_search_of_a_still_comes_to_an_end() -> None:
    image, work = look_alikes(), RingWork()
    for _ in range(MOST_IMAGES):
        assert not find_rings(image, RING, CAMERA, work=work)
        if not work.was_cut:
            break
    assert not work.was_cut


@pytest.mark.parametrize("pixel", [(95.0, 97.5), (545.0, 382.0)])
def test_a_ring_among_look_alikes_is_found_in_one_of_the_next_images(
    pixel: tuple[float, float],
) -> None:
    view = scenes.look(CAMERA, 8.0, math.radians(20.0), pixel=pixel)
    edge = scenes.outline(view, CAMERA, RING)
    image = with_ring(look_alikes(), view)
    work = RingWork()
    for _ in range(MOST_IMAGES):
        found = find_rings(image, RING, CAMERA, work=work)
        if found:
            break
    assert found
    middle = np.array(found[0].outline_px).mean(axis=0)
    assert np.hypot(*(middle - edge.mean(axis=0))) < 1.0
