"""A texture on the ground as a camera sees it: every texel where perspective puts it."""

import cv2
import numpy as np
import pytest

from hw.sim.picture.textured_plane import TexturedPlane, Tile
from hw.sim.picture.view import plane_homography
from tests.hw.sim.picture.scenery import AT_ORIGIN, CAMERA, F64, U8, looking

TEXEL_M = 0.02
CORNER_M = (-5.12, -5.12)
BEYOND = 205


def squares() -> U8:
    """A tile (512, 512) of squares of 0.64 m, no two neighbours alike."""
    rng = np.random.default_rng(1)
    cells = rng.permutation(256).reshape(16, 16).astype(np.uint8)
    return np.repeat(np.repeat(cells, 32, axis=0), 32, axis=1)


def level_at(pixels: F64, pitch_deg: float, height_m: float) -> tuple[F64, F64]:
    """Grey of the tile that pixels (n, 2) look at, and the distance to a square's border, m."""
    pose = looking((0.7, -0.4, -height_m), pitch_deg)
    H = plane_homography(pose, AT_ORIGIN)
    assert H is not None
    rays = np.column_stack([CAMERA.rays(pixels), np.ones(len(pixels))])
    north, east, descent = H @ rays.T
    texels = (np.column_stack([north, east]) / descent[:, None] - CORNER_M) / TEXEL_M
    grey = squares()[tuple(np.floor(texels).astype(int).T % 512)].astype(float)
    inside = np.abs((texels / 32 + 0.5) % 1.0 - 0.5).min(axis=1) * 32 * TEXEL_M
    grey[descent <= 0] = BEYOND
    inside[descent <= 0.03] = 0.0
    return grey, inside


@pytest.mark.parametrize("fine", [False, True])
@pytest.mark.parametrize(("height_m", "pitch_deg"), [(2.0, -90.0), (5.0, -60.0), (8.0, -30.0)])
def test_texels_lie_where_perspective_puts_them(
    fine: bool, height_m: float, pitch_deg: float
) -> None:
    plane = TexturedPlane(Tile(squares(), TEXEL_M, CORNER_M), CAMERA, fine=fine)
    H = plane_homography(looking((0.7, -0.4, -height_m), pitch_deg), AT_ORIGIN)
    assert H is not None
    seen = cv2.resize(plane.draw(H, BEYOND), (320, 240), interpolation=cv2.INTER_LINEAR)
    rows = np.arange(2, 238, 5)
    if pitch_deg > -45.0:
        rows = rows[rows > 120]  # further away squares are smaller than what pixels average over
    x, y = np.meshgrid(np.arange(2, 318, 5), rows)
    pixels = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    grey, inside = level_at(pixels, pitch_deg, height_m)
    clear = inside > 0.16
    assert clear.sum() > 200
    difference = np.abs(seen[y.ravel(), x.ravel()] - grey)[clear]
    assert np.quantile(difference, 0.98) < 3


@pytest.mark.parametrize("fine", [False, True])
def test_a_plane_is_not_drawn_beyond_the_horizon(fine: bool) -> None:
    plane = TexturedPlane(Tile(squares(), TEXEL_M, CORNER_M), CAMERA, fine=fine)
    H = plane_homography(looking((0.0, 0.0, -5.0), 0.0), AT_ORIGIN)
    assert H is not None
    seen = plane.draw(H, BEYOND)
    middle = len(seen) // 2
    assert (seen[: middle - 1] == BEYOND).all()
    assert (seen[-10:] != BEYOND).mean() > 0.9


def test_far_away_a_plane_has_its_mean_level_and_does_not_glitter() -> None:
    board = np.indices((512, 512)).sum(axis=0) // 4 % 2
    texture = np.where(board == 1, 180, 60).astype(np.uint8)
    plane = TexturedPlane(Tile(texture, TEXEL_M, CORNER_M), CAMERA, fine=True)
    H = plane_homography(looking((0.0, 0.0, -100.0), -60.0), AT_ORIGIN)
    assert H is not None
    seen = plane.draw(H, BEYOND)
    assert seen.mean() == pytest.approx(120, abs=1)
    assert seen.std() < 2


def test_a_plane_repeats_its_texture_without_end() -> None:
    # 15 m up more of it is to be seen than the tile of 10 m, or two of it.
    noise = np.random.default_rng(2).integers(60, 180, (512, 512))
    blobs = cv2.blur(noise.astype(np.uint8), (25, 25)).astype(np.uint8)
    tile = Tile(blobs, TEXEL_M, CORNER_M)
    plane = TexturedPlane(tile, CAMERA, fine=True)
    for north in (0.0, 2.5, 5.0, 7.5):
        H = plane_homography(looking((north, north, -15.0), -60.0), AT_ORIGIN)
        assert H is not None
        seen = plane.draw(H, BEYOND)
        blocks = seen.reshape(12, 20, 16, 20).std(axis=(1, 3))
        assert blocks.min() > 0.3 * np.median(blocks)
