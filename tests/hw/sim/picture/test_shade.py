"""Light that leaves and tall things keep off: how much, where, and how soft its edge is."""

import math

import cv2
import numpy as np
import pytest

from hw.sim.options import RenderOptions
from hw.sim.picture.fractal import generator
from hw.sim.picture.shade import LeafShade, ShadowEdge
from hw.sim.snapshot import PadPose
from landerd.geometry import IDENTITY, rot_zyx
from tests.hw.sim.picture.scenery import (
    AT_ORIGIN,
    BLANK,
    CAMERA,
    F64,
    down,
    picture,
    projected,
    render_options,
)

SIZE_M = np.array([16.0, 16.0])
CORNER_M = (-8.0, -8.0)
NOON = np.array([0.0, 0.0, 1.0])
PITCH = 1 / CAMERA.fx


# ---- leaves --------------------------------------------------------------------------------------


def leaves(share: float, leaf_m: float = 0.2, seed: int = 1, **options: float) -> LeafShade:
    render = render_options(leaf_shade=share, leaf_m=leaf_m, **options)
    return LeafShade(render, SIZE_M, CORNER_M, generator(seed, "leaf shade"))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_leaves_keep_off_their_share_of_the_light_over_half_of_the_ground(share: float) -> None:
    light = leaves(share).over(np.full((1000, 1000), 200, np.uint8)) / 200.0
    assert light.max() == pytest.approx(1.0, abs=0.01)
    assert light.min() == pytest.approx(1.0 - share, abs=0.01)
    assert light.mean() == pytest.approx(1.0 - 0.5 * share, abs=0.02)


def test_flecks_are_as_large_as_they_are_said_to_be() -> None:
    # Along any line a fleck begins where the light goes from dark to bright.
    def flecks(leaf_m: float) -> float:
        light = leaves(0.6, leaf_m).over(np.full((2000, 2000), 200, np.uint8))
        bright = light > 140
        return float((bright[:, 1:] & ~bright[:, :-1]).sum()) / (2000 * 16.0)  # to a metre

    coarse, fine = flecks(0.4), flecks(0.1)
    assert fine == pytest.approx(4.0 * coarse, rel=0.3)
    assert 0.5 / 0.4 / 3 < coarse < 1.5 / 0.4


def test_the_shade_on_a_pad_is_that_of_the_ground_round_it() -> None:
    shade = leaves(0.7, 0.4)
    ground = shade.over(np.full((1600, 1600), 255, np.uint8))  # 1 cm
    pose = down(3.0)
    x, y = np.meshgrid(np.arange(0.0, 320.0, 8.0), np.arange(0.0, 240.0, 8.0))
    rays = CAMERA.rays(np.column_stack([x.ravel(), y.ravel()])).reshape(*x.shape, 2)
    seen = shade.on_pad(pose, AT_ORIGIN, NOON, rays.astype(np.float32), 8 * PITCH)
    assert seen is not None
    # Rays to the north, east of where they meet the ground 3 m below.
    north, east = -3.0 * rays[..., 1], 3.0 * rays[..., 0]
    there = ground[((north + 8.0) * 100).astype(int), ((east + 8.0) * 100).astype(int)]
    difference = seen.astype(int) - there
    assert np.abs(difference).mean() < 6
    assert np.corrcoef(seen.ravel(), there.ravel())[0, 1] > 0.98


def test_a_raised_pad_is_under_the_leaves_the_sun_shines_through_to_it() -> None:
    shade = leaves(0.5)
    slant = np.array([1.0, 0.0, 1.0]) / math.sqrt(2.0)  # light travels north, 45 degrees down
    raised = PadPose((3.0, 1.0, -2.0), IDENTITY)
    # The light on a place 2 m up would have gone on to 2 m further north.
    assert shade.plane(raised, slant).position == pytest.approx((-2.0, 0.0, -2.0))
    assert shade.plane(raised, NOON).position == pytest.approx((0.0, 0.0, -2.0))


def test_a_pad_drives_through_shade_that_lies_still() -> None:
    pose = down(4.0)
    here, there = (
        picture(
            pose,
            {"leaf_shade": 0.6, "leaf_m": 0.5},
            layout=BLANK,
            at=PadPose((north, 0.0, 0.0), IDENTITY),
        ).astype(float)
        for north in (0.0, 0.3)
    )
    both = np.s_[110:140, 130:190]  # the plate fills it in either place
    assert here[both].std() > 10.0
    assert np.abs(here[both] - there[both]).mean() < 0.15 * here[both].std()


def test_the_shade_of_leaves_depends_on_its_seed() -> None:
    flat = np.full((400, 400), 200, np.uint8)
    first, again, other = (leaves(0.5, seed=s).over(flat) for s in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).mean() > 0.3


# ---- the shadow's edge ---------------------------------------------------------------------------


def edge(**options: float) -> ShadowEdge:
    return ShadowEdge(RenderOptions.model_validate(options), CAMERA)


def lit(height_m: float, pad: PadPose = AT_ORIGIN, **options: float) -> F64:
    """Share of the light that is left, (240, 320), seen straight from above."""
    image = np.full((240, 320), 250, np.uint8)
    edge(**options).darken(image, down(height_m), pad)
    return image / 250.0


@pytest.mark.parametrize("softness_m", [0.05, 0.2])
@pytest.mark.parametrize("height_m", [2.0, 6.0])
def test_the_penumbra_is_as_wide_as_it_is_said_to_be(softness_m: float, height_m: float) -> None:
    row = lit(height_m, shadow_softness_m=softness_m, shadow_darkness=0.8)[100]
    east = (np.arange(320) - CAMERA.cx) * height_m / CAMERA.fx
    beyond = [0.5 * (1.0 + math.erf(e / softness_m / math.sqrt(2.0))) for e in east]
    sharpest = 0.6 * 2 * height_m / CAMERA.fx  # what half the resolution can show
    assert softness_m > sharpest
    assert np.abs(row - (1.0 - 0.8 * np.array(beyond))).max() < 0.02


@pytest.mark.parametrize(("heading_deg", "at_m"), [(0.0, 0.3), (90.0, -0.4), (215.0, 0.2)])
def test_the_edge_lies_where_it_is_said_to(heading_deg: float, at_m: float) -> None:
    pad = PadPose((0.1, -0.2, -0.3), rot_zyx(0.6, 0.0, 0.0))
    light = lit(
        3.0,
        pad,
        shadow_edge_m=at_m,
        shadow_edge_heading_deg=heading_deg,
        shadow_softness_m=0.05,
        shadow_darkness=0.6,
    )
    a = math.radians(heading_deg) + 0.6
    for along in (-0.5, 0.0, 0.4):
        for beyond, share in ((-0.2, 1.0), (0.0, 0.7), (0.2, 0.4)):
            away = at_m + beyond
            place = (
                0.1 + away * math.cos(a) - along * math.sin(a),
                -0.2 + away * math.sin(a) + along * math.cos(a),
                -0.3,
            )
            x, y = projected(down(3.0), place)[0]
            if 1 < x < 318 and 1 < y < 238:
                seen = cv2.getRectSubPix(light.astype(np.float32), (1, 1), (x, y))[0, 0]
                assert seen == pytest.approx(share, abs=0.03)


def test_a_scene_without_an_edge_is_not_darkened() -> None:
    assert (lit(3.0, shadow_edge_m=50.0, shadow_darkness=0.8) == 1.0).all()
