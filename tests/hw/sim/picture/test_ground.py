"""The ground under the pad: kinds, photographs, and that effects which are off change nothing."""

from functools import cache
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from hw.sim.options import GroundKind, RenderOptions
from hw.sim.picture.ground import photograph
from hw.sim.snapshot import PadPose
from landerd.geometry import IDENTITY
from tests.hw.sim.picture.scenery import CAMERA, U8, down, looking, picture

KINDS = get_args(GroundKind)
AWAY = PadPose((1e4, 0.0, 0.0), IDENTITY)
LIT = {"wet": 0.3, "leaf_shade": 0.4, "look_alikes": 4}


@cache
def without_effects(kind: str) -> U8:
    return picture(down(6.0), {"ground": kind}, at=AWAY, seed=1)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plain"])
def test_a_ground_depends_on_its_seed_alone(kind: str) -> None:
    first = without_effects(kind)
    again, other = (picture(down(6.0), {"ground": kind}, at=AWAY, seed=seed) for seed in (1, 2))
    assert (first == again).all()
    assert (first != other).mean() > 0.2
    assert first.std() > 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_everything_lies_and_falls_on_every_kind_of_ground(kind: str) -> None:
    plain = without_effects(kind).astype(float)
    under = picture(down(6.0), {"ground": kind} | LIT, at=AWAY).astype(float)
    assert under.mean() < 0.95 * plain.mean()


@pytest.mark.parametrize("kind", ["grass", "gravel"])
def test_effects_that_are_off_leave_the_picture_as_it_was_to_the_bit(kind: str) -> None:
    pose = looking((-2.0, 0.3, -3.0), -55.0)
    usual = {"ground": kind, "noise_sigma": 3.0}
    off = {"look_alikes": 0, "wet": 0.0, "leaf_shade": 0.0, "glare": 0.0, "shadow_edge": False}
    idle = {"leaf_m": 1.0, "ground_m": 3.0, "shadow_softness_m": 0.5, "shadow_edge_m": 0.3}
    new = {"print_scale": 1.0, "marker_error_m": 0.0, "bend_deg": 0.0, "dirt": 0.0, "black": 0.12}
    assert (picture(pose, usual) == picture(pose, usual | off | idle, new)).all()


def test_an_effect_changes_no_other_ones_random_numbers() -> None:
    pose = down(5.0)
    plain = picture(pose, {"ground": "paving"}).astype(int)
    with_things = picture(pose, {"ground": "paving", "look_alikes": 2}).astype(int)
    # The paving is the same wherever no thing lies.
    assert (plain == with_things).mean() > 0.8
    wet = picture(pose, {"ground": "paving", "wet": 0.1}).astype(int)
    both = picture(pose, {"ground": "paving", "wet": 0.1, "look_alikes": 2}).astype(int)
    assert (wet[plain == with_things] == both[plain == with_things]).mean() > 0.99


# ---- photographs ---------------------------------------------------------------------------------


@pytest.fixture
def marked(tmp_path: Path) -> Path:
    """A photograph of 400x200 pixels, black dots a quarter of its width apart, dark at its top."""
    image = np.full((200, 400), 120, np.uint8)
    image[:20] = 60
    for x in (100, 200, 300):
        cv2.circle(image, (x, 100), 5, (0.0,), -1)
    path = tmp_path / "field.png"
    cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("ground_m", [4.0, 8.0])
def test_a_photograph_has_its_scale_on_the_ground_and_its_top_to_the_north(
    marked: Path, ground_m: float
) -> None:
    height_m = 0.8 * ground_m
    render = {"ground": marked, "ground_m": ground_m}
    seen = picture(down(height_m), render, at=AWAY)
    _, _, _, centres = cv2.connectedComponentsWithStats((seen < 30).view(np.uint8))
    dots = sorted(centres[1:].tolist())
    assert len(dots) == 3
    apart_px = 0.25 * ground_m * CAMERA.fx / height_m
    assert dots[1] == pytest.approx([CAMERA.cx, CAMERA.cy], abs=3.0)
    assert dots[1][0] - dots[0][0] == pytest.approx(apart_px, rel=0.03)
    assert dots[2][0] - dots[1][0] == pytest.approx(apart_px, rel=0.03)
    top = round(CAMERA.cy - 0.95 * apart_px)  # 95 of 100 pixels north of the dots
    assert seen[top, 160] == pytest.approx(60, abs=3)
    assert seen[240 - top, 160] == pytest.approx(120, abs=3)


def test_a_photograph_repeats_without_a_seam(marked: Path) -> None:
    texture, texel_m = photograph(marked, 20.0)
    h, w = texture.shape
    assert texel_m * w / 2 == pytest.approx(20.0)
    assert (texture == texture[::-1]).all()
    assert (texture == texture[:, ::-1]).all()
    assert h % 64 == w % 64 == 0


def test_a_ground_that_is_none_is_refused_in_one_line(tmp_path: Path) -> None:
    text = tmp_path / "notes.jpg"
    text.write_text("no picture")
    with pytest.raises(ValidationError, match="cannot be read as a picture"):
        RenderOptions(ground=text)
    with pytest.raises(ValidationError, match="expected one of grass, asphalt, plain, meadow"):
        RenderOptions.model_validate({"ground": "medow"})
