"""Procedural grounds: meadow, gravel, paving, tree canopy, flat roof, car park, water.

Each is one texture that repeats without a seam. Reflectances are relative to the pad's white; grey
levels are proportional to them (a camera's tone curve brightens dark ones later). Means, contrasts
and spectra were set by photographs of such grounds with 5 to 50 mm per pixel. The reflectances are
those of photographs with a white pad in them (grass 0.14 of the white), and of Oke, "Boundary Layer
Climates" (1987), table 1.1. `ground` draws them.
"""

import math
from collections.abc import Callable, Mapping
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.fractal import FRAYED, blotches, cloud, enlarged
from hw.sim.picture.pad_texture import WHITE

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
Rng = np.random.Generator
Point = tuple[float, float]  # x, y in texels

SIZE = 2048  # texels along a side
TEXEL_M = 0.008  # side of a texel
_PER_BYTE = 1 / 64  # logarithm of a reflectance per unit of a byte
_BITS = 4  # fractional bits of the coordinates that OpenCV draws at
_SHADE = 0.35  # share of the light left in the shadow of things on the ground


def meadow(rng: Rng) -> U8:
    """Return uncut grass: tangled blades, bright straw over dark gaps, green and dry patches."""
    field = cloud(rng, SIZE, (0.25, 0.27, 0.22, 0.15, 0.12, 0.12, 0.12, 0.12, 0.12))
    blades = _bytes(field)
    for log in np.linspace(-0.75, 1.0, 12):
        blades = _rolled(blades, rng)
        _strokes(blades, rng, 4000, (3.0, 22.0), log)
    return _developed(blades, 0.14)


def gravel(rng: Rng) -> U8:
    """Return crushed stone, with larger stones on it and finer patches."""
    field = cloud(rng, SIZE, (0.2, 0.24, 0.18, 0.12, 0.09, 0.1, 0.1, 0.12, 0.12))
    texture = _developed(_bytes(field), 0.28)
    for _ in range(4):
        texture = _rolled(texture, rng)
        for x, y in rng.uniform(20, SIZE - 20, (400, 2)):
            _stone(texture, (x, y), rng)
    return texture


def paving(rng: Rng) -> U8:
    """Return slabs or bricks of concrete of different greys in a bond; dark joints, stains."""
    rows, columns = ((32, 32), (64, 64), (128, 64))[rng.integers(3)]
    height, width = SIZE // rows, SIZE // columns
    slabs = rng.normal(0.0, 0.1, (rows, columns)).astype(np.float32)
    field = slabs.repeat(height, axis=0).repeat(width, axis=1)
    field[:, ::width] -= 0.45
    for row in range(1, rows, 2):
        course = slice(row * height, (row + 1) * height)
        field[course] = np.roll(field[course], width // 2, axis=1)
    field[::height] -= 0.45
    field += cloud(rng, SIZE, (0.08, 0.06, 0.04, 0.03, 0.03, 0.03, 0.04, 0.05, 0.06))
    return _developed(_bytes(field), 0.35)


def canopy(rng: Rng) -> U8:
    """Return tree crowns from above: lit clusters of leaves, their shadows, black gaps between."""
    small = SIZE // 16
    crowns = np.zeros((small, small), np.float32)
    y, x = np.indices((small, small), np.float32)
    for _ in range(60):
        radius = rng.uniform(8.0, 20.0)  # 1 to 2.6 m
        at = rng.uniform(0.0, small, 2).astype(np.float32)
        dy, dx = ((d + small / 2) % small - small / 2 for d in (y - at[0], x - at[1]))
        dome = 1.0 - (dy * dy + dx * dx) / np.float32(radius * radius)
        np.maximum(crowns, rng.uniform(0.6, 1.3) * np.maximum(dome, 0.0), out=crowns)
    boughs = crowns + cloud(rng, small, (0.12, 0.2, 0.2, 0.1))
    leaves = cloud(rng, SIZE // 2, (0.45, 0.6, 0.6, 0.4, 0.2))
    # Leaves are brighter where the crown rises towards the light, and where they see more sky.
    lit = 1.5 * (boughs - np.roll(boughs, (1, 1), axis=(0, 1))) + 1.0 * boughs
    lit_leaves = 0.25 * leaves + 0.3 * (leaves - np.roll(leaves, (2, 1), axis=(0, 1)))
    field = enlarged(enlarged(enlarged(lit - lit.mean())))
    field = enlarged(field + lit_leaves) + cloud(rng, SIZE, (0.25,))
    return _developed(_bytes(field), 0.07)


def roof(rng: Rng) -> U8:
    """Return a flat roof: sheets with laps, repairs, stains of puddles, vents and skylights."""
    mean, grain = ((0.5, 0.04), (0.16, 0.1))[rng.integers(2)]  # a light membrane, or bitumen
    field = cloud(rng, SIZE, (grain, grain, grain / 2, 0.03, 0.03, 0.05, 0.06, 0.08, 0.1))
    sheet = 128  # 1.02 m
    field += rng.normal(0.0, 0.05, SIZE // sheet).astype(np.float32).repeat(sheet)[:, None]
    field[::sheet] -= 0.35
    field[1::sheet] += 0.15
    field -= 0.3 * blotches(rng, SIZE, (0.0,) * 4 + FRAYED, 0.12, 0.3)
    texture = _developed(_bytes(field), mean)
    for left, top in rng.integers(0, SIZE - 260, (5, 2)):
        height, width = rng.integers(40, 250, 2)
        repair = texture[top : top + height, left : left + width]
        cv2.convertScaleAbs(repair, dst=repair, alpha=rng.uniform(0.75, 1.25))
    for x, y in rng.uniform(100, SIZE - 100, (4, 2)):  # skylights
        half = rng.uniform(40, 70, 2)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        middle = np.array([x, y])
        _polygon(texture, middle + 25 + corners, mean * _SHADE)
        _polygon(texture, middle + corners, 0.6)
        _polygon(texture, middle + 0.85 * corners, rng.uniform(0.05, 0.5))
    for x, y in rng.uniform(40, SIZE - 40, (10, 2)):  # vents
        radius = rng.uniform(6.0, 22.0)
        _disc(texture, (x + radius, y + radius), radius, mean * _SHADE)
        _disc(texture, (x, y), radius, rng.uniform(0.2, 0.6))
        _disc(texture, (x, y), 0.6 * radius, rng.uniform(0.03, 0.3))
    return texture


def car_park(rng: Rng) -> U8:
    """Return asphalt with painted bays on both sides of a lane, cars, manholes, a tyre, oil.

    The lane is in the middle of the texture.
    """
    field = cloud(rng, SIZE, (0.1, 0.06, 0.04, 0.03, 0.03, 0.05, 0.06, 0.06, 0.05))
    _cracks(field, rng)
    texture = _developed(_bytes(field), 0.2)
    depth = round(5.2 / TEXEL_M)  # of a bay, texels; two bays leave 6 m for the lane
    edges = np.linspace(0.0, SIZE, 8).astype(int)  # sides of bays of 2.3 m, texels
    worn = _developed(_bytes(0.2 * cloud(rng, SIZE, (1.0, 0.8, 0.6, 0.5, 0.4))), 0.5)
    for x in edges[:-1]:
        for row in (slice(0, depth), slice(SIZE - depth, SIZE)):
            texture[row, x : x + 13] = worn[row, x : x + 13]
    texture[:13] = worn[:13]
    for y in (depth / 2, SIZE - depth / 2):
        for x in (edges[:-1] + edges[1:]) / 2:
            chance = rng.random()
            if chance < 0.5:
                _car(texture, (x + rng.normal(0, 10), y + rng.normal(0, 20)), rng)
            elif chance < 0.75:
                _disc(texture, (x, y), rng.uniform(10, 40), 0.1)  # oil
    _tyre(texture, (float(rng.uniform(60, SIZE - 60)), depth + 90.0))
    for x in rng.uniform(60, SIZE - 60, 2):
        _manhole(texture, (x, SIZE / 2 + rng.choice((-220, 220))))
    return texture


def water(rng: Rng) -> U8:
    """Return water in a breeze: dark, with faint waves and a few glints of the sky."""
    swell = cloud(rng, SIZE, (0.1, 0.25, 0.4, 0.5, 0.5, 0.4, 0.3))
    waves = swell - np.roll(swell, (2, 5), axis=(0, 1))
    waves += 0.5 * (swell - np.roll(swell, (6, 15), axis=(0, 1)))
    waves *= np.float32(0.08 / waves.std())
    waves += 0.1 * cloud(rng, SIZE, (0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4))
    # The steepest facets reflect brighter parts of the sky.
    np.add(waves, 1.2, out=waves, where=waves > np.quantile(waves[::4, ::4], 0.9993))
    return _developed(_bytes(waves), 0.055)


TERRAINS: Mapping[str, Callable[[Rng], U8]] = {
    "meadow": meadow,
    "gravel": gravel,
    "paving": paving,
    "canopy": canopy,
    "roof": roof,
    "car_park": car_park,
    "water": water,
}


# ---- tone --------------------------------------------------------------------------------------


def _bytes(field: F32) -> U8:
    """Return logarithms of reflectances (over any factor) as bytes: 128 is 0, see `_PER_BYTE`."""
    scaled = cv2.convertScaleAbs(np.clip(field, -1.99, 1.98), alpha=1 / _PER_BYTE, beta=128.0)
    return cast(U8, scaled)


def _developed(logs: U8, mean: float) -> U8:
    """Return grey levels by `_bytes` of reflectances, which get a given mean."""
    reflectance = np.exp((np.arange(256) - 128) * _PER_BYTE)
    counts = cv2.calcHist([logs], [0], None, [256], [0, 256]).ravel()
    reflectance *= mean * counts.sum() / (counts @ reflectance)
    levels = np.clip(np.rint(WHITE * reflectance), 1, 255).astype(np.uint8)
    return cast(U8, cv2.LUT(logs, levels))


# ---- things ------------------------------------------------------------------------------------


def _rolled(texture: U8, rng: Rng) -> U8:
    """Return the texture shifted at random, so that drawing spares another border each time."""
    return np.roll(texture, rng.integers(0, SIZE, 2), axis=(0, 1))


def _strokes(logs: U8, rng: Rng, count: int, lengths: tuple[float, float], log: float) -> None:
    """Draw straight blades of one brightness.

    Args:
        logs: `_bytes` of reflectances; changed.
        rng: source of places, directions and lengths.
        count: number of blades.
        lengths: the least and the largest, texels.
        log: logarithm of their reflectance.
    """
    length = rng.uniform(*lengths, count)
    angle = rng.uniform(0.0, math.pi, count)
    half = 0.5 * length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    middle = rng.uniform(lengths[1], SIZE - lengths[1], (count, 2))
    ends = np.rint(np.stack([middle - half, middle + half], axis=1) * 2**_BITS).astype(np.int32)
    grey = float(np.clip(128 + log / _PER_BYTE, 0, 255))
    cv2.polylines(logs, list(ends), False, (grey,), 1, cv2.LINE_AA, _BITS)


def _stone(texture: U8, at: Point, rng: Rng) -> None:
    """Draw a stone with a shadow to its lower right."""
    axes = tuple((rng.uniform(1.0, 5.0) * rng.uniform(0.6, 1.0, 2) * 2**_BITS).astype(int))
    turn, grey = float(rng.uniform(0, 180)), float(rng.uniform(0.15, 0.6) * WHITE)
    for (x, y), level in (((at[0] + 1.5, at[1] + 1.5), 0.2 * grey), (at, grey)):
        centre = (round(x * 2**_BITS), round(y * 2**_BITS))
        cv2.ellipse(texture, centre, axes, turn, 0, 360, (level,), -1, cv2.LINE_AA, _BITS)


def _disc(texture: U8, at: Point, radius: float, reflectance: float, line: int = -1) -> None:
    """Draw a disc or a circle.

    Args:
        texture: grey levels; changed.
        at: centre, texels.
        radius: texels.
        reflectance: of the disc.
        line: width of a circle's line, texels; -1: a disc.
    """
    centre = (round(at[0] * 2**_BITS), round(at[1] * 2**_BITS))
    grey = (float(reflectance * WHITE),)
    cv2.circle(texture, centre, round(radius * 2**_BITS), grey, line, cv2.LINE_AA, _BITS)


def _polygon(texture: U8, corners: NDArray[np.float64], reflectance: float) -> None:
    """Draw a convex polygon by its corners (n, 2), texels."""
    points = np.rint(corners * 2**_BITS).astype(np.int32)
    cv2.fillConvexPoly(texture, points, (float(reflectance * WHITE),), cv2.LINE_AA, _BITS)


def _manhole(texture: U8, at: Point) -> None:
    """Draw a manhole cover 0.6 m across in its frame."""
    radius = 0.3 / TEXEL_M
    _disc(texture, at, 1.13 * radius, 0.14)
    _disc(texture, at, radius, 0.05)
    _disc(texture, at, 0.94 * radius, 0.11)
    for share in (0.75, 0.5, 0.25):
        _disc(texture, at, share * radius, 0.06, 2)


def _tyre(texture: U8, at: Point) -> None:
    """Draw a wheel with a bright rim, 0.64 m across, that lies on the ground."""
    radius = 0.32 / TEXEL_M
    _disc(texture, (at[0] + 8, at[1] + 8), radius, 0.06)
    _disc(texture, at, radius, 0.03)
    _disc(texture, at, 0.6 * radius, 0.4)
    for angle in np.linspace(0.0, 2 * math.pi, 5, endpoint=False):
        spot = (at[0] + 0.38 * radius * math.cos(angle), at[1] + 0.38 * radius * math.sin(angle))
        _disc(texture, spot, 0.11 * radius, 0.04)
    _disc(texture, at, 0.1 * radius, 0.1)


def _car(texture: U8, at: Point, rng: Rng) -> None:
    """Draw a car of about 4.4 by 1.8 m from above, along y: body, windows, shadow."""
    half = np.array([0.9, 2.2]) / TEXEL_M * rng.uniform(0.93, 1.07)
    paint = float(rng.choice((0.03, 0.06, 0.12, 0.3, 0.55, 0.8)))
    nose = rng.choice((-1.0, 1.0))
    shape = np.array([[-0.8, -1], [0.8, -1], [1, -0.85], [1, 0.9], [0.85, 1], [-0.85, 1]])
    shape = np.concatenate([shape, [[-1, 0.9], [-1, -0.85]]])

    def part(corners: NDArray[np.float64], reflectance: float, aside: float = 0.0) -> None:
        _polygon(texture, np.array(at) + aside + corners * half * (1.0, nose), reflectance)

    part(shape, 0.2 * _SHADE, 40.0)
    part(shape, paint)
    pane = np.array([[-0.85, -0.5], [0.85, -0.5], [0.7, -0.22], [-0.7, -0.22]])
    part(pane, 0.04)
    part(pane * (1.0, -1.2) + (0.0, 0.08), 0.05)
    for side in (-1.0, 1.0):
        part(np.array([[0.92, -0.4], [0.92, 0.6], [0.78, 0.5], [0.78, -0.2]]) * (side, 1.0), 0.05)
        _disc(texture, (at[0] + side * 0.75 * half[0], at[1] - 0.93 * nose * half[1]), 7.0, 0.7)


def _cracks(field: F32, rng: Rng) -> None:
    """Draw dark winding cracks into logarithms of reflectances."""
    for _ in range(12):
        steps = rng.normal(0.0, 9.0, (60, 2)) + rng.normal(0.0, 7.0, 2)
        way = rng.uniform(300, SIZE - 300, 2) + np.cumsum(steps, axis=0)
        cv2.polylines(field, [np.rint(way).astype(np.int32)], False, (-0.5,), 1)
