"""A pad's heading where its ring is seen and its square's code cannot be read."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.config.models import VisionSection
from landerd.messages import Frame, Sightings
from landerd.pad import PadLayout, load_pad
from landerd.vision import Vision
from landerd.vision.square import SquareFinder
from tests.vision.scenes import (
    THESIS_CAMERA,
    THESIS_PAD,
    U8,
    Bar,
    Optics,
    View,
    look,
    render,
    with_tag,
)

CAMERA = THESIS_CAMERA.scaled(320, 240)
VIEW = look(CAMERA, 3.0, 0.4, pixel=(170.0, 140.0), heading=2.5)


def shown(pad: PadLayout, width_px: float = 5.0, view: View = VIEW) -> U8:
    """Return a picture of a pad with something grey lying across the middle of its tag."""
    place = np.array([*pad.squares[0].position_m, 0.0])
    x, y = CAMERA.pixels((np.array(view.position) + view.R_camera_pad @ place)[None])[0]
    bar = Bar((float(x) + 2.0, float(y) + 2.0), (1.0, 0.3), width_px, 90.0)
    optics = replace(Optics(), bar=bar)
    return render(view, CAMERA, optics, np.random.default_rng(1), pad)


def seen(image: U8, pad: PadLayout = THESIS_PAD) -> tuple[Sightings, Vision]:
    vision = Vision(pad, CAMERA, VisionSection())
    return vision.process(Frame(0.0, 0, image)), vision


@pytest.mark.parametrize(
    "pad",
    [
        THESIS_PAD,
        with_tag(heading_deg=90.0, position_m=(-0.5, 0.55)),
        with_tag(size_m=0.25, position_m=(0.0, 0.0)),  # in the ring's heart
    ],
)
def test_heading_is_told_by_a_tag_that_cannot_be_read(pad: PadLayout) -> None:
    view = look(CAMERA, 2.0, 0.4, pixel=(170.0, 120.0), heading=2.5)
    image = shown(pad, view=view)
    assert SquareFinder(pad).find(image) == []
    found, vision = seen(image, pad)
    assert {m.kind: m.stage for m in found.markers}["apriltag"] == "beside"
    best = found.pad[0]
    assert best.north is not None
    assert best.sigma_yaw is not None
    error = math.acos(min(1.0, float(np.array(best.north) @ view.R_camera_pad[:, 0])))
    assert error < min(2.0 * best.sigma_yaw, math.radians(5.0))
    assert math.dist(best.position, view.position) < 0.02
    assert vision.disagreement() is None  # its place is the ring's: the two cannot contradict


def test_no_heading_without_a_tag() -> None:
    bare = PadLayout(**{**THESIS_PAD.model_dump(), "name": "ring", "markers": THESIS_PAD.rings})
    found, _ = seen(render(VIEW, CAMERA, Optics(), np.random.default_rng(2), bare))
    assert {m.kind for m in found.markers} == {"whycon"}
    assert found.pad[0].north is None


def test_no_heading_of_another_pads_tag() -> None:
    found, _ = seen(render(VIEW, CAMERA, Optics(), np.random.default_rng(2), with_tag(id=5)))
    assert found.pad == ()


NEAR_VIEW = look(THESIS_CAMERA, 2.2, 0.3, pixel=(300.0, 240.0), heading=2.5)
# Cells of the tag from its middle, to its top and right.
MUD = [(0.8, -1.3), (-2.6, -2.7), (1.8, 2.3), (0.6, 1.3), (0.2, 2.4), (1.8, -2.8)]


def muddy(pad: PadLayout) -> U8:
    """Return a picture of a pad with spots of mud, as dark as its black, on most of its code."""
    image = render(NEAR_VIEW, THESIS_CAMERA, Optics(), np.random.default_rng(1), pad)
    tag = THESIS_PAD.squares[0]
    cell = 0.125 * tag.size_m
    around = np.linspace(0.0, 2.0 * math.pi, 24)
    for top, right in MUD:
        spot = cell * np.stack(
            [top + 1.25 * np.cos(around), right + 1.25 * np.sin(around), 0.0 * around], axis=1
        )
        points = (spot + np.array([*tag.position_m, 0.0])) @ NEAR_VIEW.R_camera_pad.T
        px = THESIS_CAMERA.pixels(np.array(NEAR_VIEW.position) + points)
        cv2.fillPoly(image, [np.rint(px).astype(np.int32)], int(Optics().black))
    return image


@pytest.mark.parametrize(("shown_id", "told"), [(0, True), (5, False)])
def test_a_code_partly_covered_by_mud_gives_heading_and_id(shown_id: int, *, told: bool) -> None:
    vision = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection())
    pose = vision.process(Frame(0.0, 0, muddy(with_tag(id=shown_id)))).pad[0]
    assert (pose.north is not None) == told
    if pose.north is not None:
        to_north = float(np.array(pose.north) @ NEAR_VIEW.R_camera_pad[:, 0])
        assert to_north > math.cos(math.radians(3.0))


def test_next_picture_is_tracked_though_the_tag_is_hidden_in_part() -> None:
    vision = Vision(THESIS_PAD, CAMERA, VisionSection())
    image = shown(THESIS_PAD)
    first, second = (vision.process(Frame(k / 30.0, k, image)) for k in range(2))
    stages = [{m.kind: m.stage for m in s.markers}["apriltag"] for s in (first, second)]
    assert stages == ["beside", "edges"]
    north = second.pad[0].north
    assert north is not None
    assert float(np.array(north) @ VIEW.R_camera_pad[:, 0]) > math.cos(math.radians(1.0))


@pytest.mark.parametrize(
    ("width_px", "kinds"), [(0.0, {"apriltag"}), (12.0, {"apriltag", "whycon"})]
)
def test_beside_a_large_tag_the_ring_is_looked_for_if_the_tag_is_disturbed(
    width_px: float, kinds: set[str]
) -> None:
    view = look(CAMERA, 1.35, 0.3, pixel=(120.0, 125.0), heading=math.pi / 2.0)
    vision = Vision(THESIS_PAD, CAMERA, VisionSection())
    image = shown(THESIS_PAD, width_px, view)
    _, second = (vision.process(Frame(k / 30.0, k, image)) for k in range(2))
    assert {m.kind for m in second.markers} == kinds


NESTED = Path(__file__).parents[2] / "config/pads/nested.yaml"
OVER = look(THESIS_CAMERA, 2.3, 0.05, pixel=(305.0, 235.0), heading=2.1)


@pytest.mark.parametrize(("shown_id", "told"), [(1, True), (5, False), (40, False), (77, False)])
def test_an_unfocused_tag_with_mud_on_its_corner_tells_the_heading(
    shown_id: int, *, told: bool
) -> None:
    nested = load_pad(NESTED)
    ring, tag = nested.rings[0], nested.squares[0]
    other = tag.model_copy(update={"id": shown_id})
    printed = nested.model_copy(update={"markers": (ring, other)})
    optics = replace(Optics(), blur_px=2.4)
    image = render(OVER, THESIS_CAMERA, optics, np.random.default_rng(1), printed)
    around = np.linspace(0.0, 2.0 * math.pi, 24)
    corner = 0.5 * tag.size_m + 0.25 * tag.size_m * np.stack([np.cos(around), np.sin(around)], 1)
    points = np.column_stack([corner, np.zeros(24)]) @ OVER.R_camera_pad.T
    mud = np.zeros(image.shape, np.float32)
    px = THESIS_CAMERA.pixels(np.array(OVER.position) + points)
    cv2.fillPoly(mud, [np.rint(px).astype(np.int32)], 1.0)
    spot = np.asarray(cv2.GaussianBlur(mud, (0, 0), 2.4))
    image = np.rint(image * (1.0 - spot) + Optics().black * spot).astype(np.uint8)
    assert SquareFinder(nested).find(image) == []
    pose = Vision(nested, THESIS_CAMERA, VisionSection()).process(Frame(0.0, 0, image)).pad[0]
    assert (pose.north is not None) == told
    if pose.north is not None and pose.sigma_yaw is not None:
        error = math.acos(min(1.0, float(np.array(pose.north) @ OVER.R_camera_pad[:, 0])))
        assert error < 2.0 * pose.sigma_yaw < math.radians(6.0)
