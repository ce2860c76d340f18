"""Shadows that are not the vehicle's: of leaves overhead, and of something tall beside the pad."""

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import RenderOptions
from hw.sim.picture.fractal import blotches
from hw.sim.picture.textured_plane import LEVELS, Tile
from hw.sim.picture.view import (
    F64,
    NO_SECOND_MAP,
    footprint,
    level_of_detail,
    plane_homography,
    rays_at,
)
from hw.sim.snapshot import CameraPose, PadPose
from landerd.camera_model import CameraModel
from landerd.geometry import IDENTITY

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

# ---- leaves ------------------------------------------------------------------------------------

SHADED = 0.5  # share of the ground in shade
PERIOD_M = 16.0  # distance after which the pattern repeats, about
FLECK = 4  # least number of samples along a fleck of shade
COARSEST = 16  # largest distance of samples on the pad, px of the picture


class LeafShade:
    """Dappled shade of leaves, which stays in place on the ground while a pad drives through it."""

    def __init__(
        self,
        options: RenderOptions,
        size_m: F64,
        corner_m: tuple[float, float],
        rng: np.random.Generator,
    ) -> None:
        """Make the pattern.

        Args:
            options: share of the light lost, and size of the flecks.
            size_m: north-south and east-west size of the ground's tile, m, (2,), which is a
                multiple of the pattern's.
            corner_m: north, east of the tile's first corner, local NED.
            rng: source of the pattern.
        """
        self._repeats = np.maximum(np.round(size_m / PERIOD_M), 1).astype(int)
        period_m = float(size_m[0] / self._repeats[0])
        flecks = period_m / options.leaf_m
        block, octaves = 2 ** (LEVELS - 1), 3
        while block > 1.4 * flecks * 2 ** (octaves - 1):
            octaves += 1
        size = block * max(round(flecks * 2 ** (octaves - 1) / block), 1)
        # Flecks lie in groups, as leaves do on twigs and boughs.
        amplitudes = [0.0] * (octaves - 3) + [0.2, 0.6, 1.0, 0.7, 0.5]
        # Each gap projects an image of the sun, so that small flecks have soft edges.
        leaves = blotches(rng, size, amplitudes, SHADED, 0.8)
        self._light = np.rint(255.0 * (1.0 - options.leaf_shade * leaves)).astype(np.uint8)
        self._tile = Tile(self._light, period_m / size, corner_m)
        self._leaf_m = options.leaf_m
        self._ground_down = options.ground_down_m

    def over(self, texture: U8) -> U8:
        """Return the texture of the ground's tile (rows, columns) in the shade."""
        light = np.tile(self._light, tuple(self._repeats))
        light = cast(U8, cv2.resize(light, texture.shape[::-1], interpolation=cv2.INTER_LINEAR))
        return cast(U8, cv2.multiply(texture, light, scale=1 / 255))

    def step(self, pose: CameraPose, pad: PadPose, focal: float) -> int:
        """Return the distance of samples on the pad, px: a few for each fleck are enough.

        Args:
            pose: of the camera.
            pad: its pose.
            focal: focal length, px.
        """
        apart_m = max(math.dist(pose.position, pad.position), 0.1) / focal
        return min(max(int(self._leaf_m / (FLECK * apart_m)), 1), COARSEST)

    def on_pad(
        self, pose: CameraPose, pad: PadPose, sunlight: F64, rays: F32, pitch: float
    ) -> U8 | None:
        """Return the light on a pad where rays meet it, (rows, columns), 255 is full light.

        The pad counts as level. None: the camera is not above it.

        Args:
            pose: of the camera.
            pad: its pose.
            sunlight: vector (3,) along which sunlight travels, local NED.
            rays: on z = 1, (rows, columns, 2).
            pitch: distance between neighbouring rays.
        """
        H = plane_homography(pose, self.plane(pad, sunlight))
        if H is None:
            return None
        x, y = rays[rays.shape[0] // 2, rays.shape[1] // 2].tolist()
        centre = H @ np.array([x, y, 1.0])
        centre[2] = max(centre[2], 0.02)
        apart_m = footprint(float(np.linalg.det(H)), centre[2], pitch)
        level = level_of_detail(apart_m, self._tile.texel_m, LEVELS)
        to_texels = self._tile.to_texels(level, centre[:2] / centre[2])
        light = cv2.remap(
            self._tile.levels[level],
            cv2.perspectiveTransform(rays, to_texels @ H),
            NO_SECOND_MAP,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_WRAP,
        )
        return cast(U8, light)

    def plane(self, pad: PadPose, sunlight: F64) -> PadPose:
        """Return a level plane at the pad's height.

        Its origin has the same leaves between it and the sun as the local frame's origin.

        Args:
            pad: its pose.
            sunlight: vector (3,) along which sunlight travels, local NED.
        """
        down = pad.position[2]
        way = (down - self._ground_down) / sunlight[2]
        north, east = (way * sunlight[:2]).tolist()
        return PadPose((north, east, down), IDENTITY)


# ---- the shadow's edge -------------------------------------------------------------------------

# Pixels of the picture along one of the shadow's, in order of preference: its edge is soft.
REDUCED = (8, 4, 2)
SPACING = 16  # distance of rays that are computed, px of the picture
SOFTEST = 4.0  # distance from a shadow's edge at which it is full, standard deviations
_PER_BYTE = SOFTEST / 128  # standard deviations per unit of a byte

# Darkness over that of the full shadow at -SOFTEST to SOFTEST standard deviations from its edge.
_KEPT_OFF = [0.5 * (1.0 + math.erf((i - 128) * _PER_BYTE / math.sqrt(2.0))) for i in range(256)]


class ShadowEdge:
    """The shadow of something tall that covers one side of the pad and moves with it."""

    def __init__(self, options: RenderOptions, camera: CameraModel) -> None:
        """Take the place, softness and darkness of the shadow, and the camera."""
        self._size = (camera.width, camera.height)
        self._focal = camera.fx
        self._softness_m = options.shadow_softness_m
        x, y = (
            (np.arange(-1.0, math.ceil(n / SPACING) + 1) + 0.5) * SPACING - 0.5 for n in self._size
        )
        self._rays = rays_at(camera, x, y)
        a = math.radians(options.shadow_edge_heading_deg)
        self._beyond = np.array([math.cos(a), math.sin(a), -options.shadow_edge_m])
        kept_off = options.shadow_darkness * np.array(_KEPT_OFF)
        self._light_of = np.rint(255.0 * (1.0 - kept_off)).astype(np.uint8)

    def darken(self, image: U8, pose: CameraPose, pad: PadPose) -> None:
        """Darken an image (height, width) in place where the shadow falls."""
        H = plane_homography(pose, pad)
        if H is None:
            return
        apart_m = max(math.dist(pose.position, pad.position), 0.1) / self._focal
        reduced = next((r for r in REDUCED if r * apart_m <= self._softness_m), REDUCED[-1])
        # An edge sharper than the shadow's pixels would be jagged.
        sigma_m = max(self._softness_m, 0.6 * reduced * apart_m)
        beyond, descent = (
            self._rays @ row[:2].astype(np.float32) + np.float32(row[2])
            for row in (self._beyond @ H, H[2])
        )
        per_byte = np.float32(sigma_m * _PER_BYTE)
        deviations = beyond / (per_byte * np.maximum(descent, np.float32(1e-3))) + 128
        shaded = cv2.boundingRect((deviations > 0.0).view(np.uint8))
        if not shaded[2]:
            return
        # One more value on each side, to interpolate up to the shadow's edge.
        left, top = max(shaded[0] - 1, 0), max(shaded[1] - 1, 0)
        right, bottom = shaded[0] + shaded[2] + 1, shaded[1] + shaded[3] + 1
        k = SPACING // reduced
        few = cv2.resize(deviations[top:bottom, left:right], None, fx=k, fy=k)
        light = cv2.LUT(cv2.convertScaleAbs(np.maximum(few, 0.0)), self._light_of)
        whole = cv2.resize(light, None, fx=reduced, fy=reduced)
        # The rays begin one spacing outside the image.
        y, x = (top - 1) * SPACING, (left - 1) * SPACING
        whole = whole[max(-y, 0) :, max(-x, 0) :]
        y, x = max(y, 0), max(x, 0)
        part = image[y : y + whole.shape[0], x : x + whole.shape[1]]
        cv2.multiply(part, whole[: part.shape[0], : part.shape[1]], dst=part, scale=1 / 255)
