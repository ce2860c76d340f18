"""Draws the pad, flat or folded, into a picture: where it is, and how finely it is sampled.

Its edges are exact to a few hundredths of a pixel, on which the pose at 20 to 30 m depends.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.pad_print import fold, textures
from hw.sim.picture.pad_texture import TextureLevel, plate_corners
from hw.sim.picture.shutter import EVERYTHING, Block, Readout, RolledPlane, RowGrid
from hw.sim.picture.view import (
    F64,
    NO_SECOND_MAP,
    Frustum,
    blur,
    footprint,
    in_camera,
    level_of_detail,
    on_pad,
    plane_homography,
)
from hw.sim.snapshot import CameraPose, PadPose
from landerd.pad import PadLayout

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Box = tuple[int, int, int, int]  # left, top, right, bottom in pixels

# Largest number of samples of the pad's texture in one picture, unless one per pixel is more.
SAMPLE_BUDGET = 160_000
SAMPLINGS = (4, 2, 1)  # samples per pixel along x and along y; averages over 3 would be slow
BAND_ROWS = 80  # rows of the pad's picture that are drawn from one level of detail, about
ROLLED_MARGIN_PX = 2.0  # width of the margin round a pad that a rolling shutter distorts


@dataclass(frozen=True)
class _Plane:
    """A plane of the pad as the pixels see it."""

    H: F64  # `plane_homography` from the camera's pose at the middle of the exposure
    rolled: RolledPlane | None  # the same for rows exposed at other times; None: all at once
    all_rays: F32  # of all pixels, and of one more on each side, (rows, columns, 2)

    def rays(self, block: Block) -> F32:
        """Return the rays (rows, columns, 2) on which a block of pixels sees the plane.

        They are those of the pose at the middle of the exposure.
        """
        return self.all_rays[block] if self.rolled is None else self.rolled.rays(block)

    def corners(self, block: Block) -> F32:
        """Return the rays at the corners of a block, (2, 2, 2)."""
        if self.rolled is not None:
            return self.rolled.corners(block)
        rays = self.all_rays[block]
        return rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1]

    def straight(self, block: Block, texture: TextureLevel) -> tuple[F32, F32] | None:
        """Return columns and rows of the texture that a block sees, without the block's border.

        Both are (rows, columns) of the block. None: they must be computed from `rays`.
        """
        if self.rolled is None:
            return None
        rows, columns = (slice(s.start + 1, s.stop - 1) for s in block)
        return self.rolled.texels((rows, columns), texture.from_pad() @ self.H)

    def texels(self, block: Block, texture: TextureLevel, *, border: bool) -> F32:
        """Return column and row of the texture that each pixel of a block sees, (n, m, 2).

        Args:
            block: of pixels.
            texture: of the pad.
            border: whether the block's outermost pixels are included.
        """
        straight = None if border else self.straight(block, texture)
        if straight is not None:
            return cast(F32, cv2.merge(straight))
        rays = self.rays(block)
        if not border:
            rays = np.ascontiguousarray(rays[1:-1, 1:-1])
        where = cv2.perspectiveTransform(rays, texture.from_pad() @ self.H)
        corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
        plane = self.H[2].astype(np.float32)
        if (corners @ plane[:2] + plane[2]).min() < 0.02:
            # Rays that miss the plane would meet its mirror image behind the camera.
            where[rays @ plane[:2] + plane[2] <= 0.0] = -1e6
        return cast(F32, where)


@dataclass(frozen=True)
class SeenPad:
    """Where the pad is in one picture."""

    planes: tuple[_Plane, ...]  # that of the landing point, and of a folded plate's far part
    box: Box  # of pixels that contains the pad
    fills: bool  # whether the pad covers the whole picture

    @property
    def samples(self) -> int:
        """Number of samples per pixel along x and along y."""
        left, top, right, bottom = self.box
        area = (right - left) * (bottom - top)
        return next((s for s in SAMPLINGS if s * s * area <= SAMPLE_BUDGET), 1)

    def rays(self, step: int) -> F32:
        """Return the rays (rows, columns, 2) of every `step`-th pixel of the box."""
        left, top, right, bottom = self.box
        return self.planes[0].rays(
            (slice(top + 1, bottom + 1, step), slice(left + 1, right + 1, step))
        )


class PadView:
    """Draws the pad into pictures of one camera."""

    def __init__(
        self,
        layout: PadLayout,
        pad: PadOptions,
        options: RenderOptions,
        frustum: Frustum,
        rays: F32,
        seed: int,
    ) -> None:
        """Draw the textures.

        Args:
            layout: of the pad as it was printed.
            pad: ink, dirt and fold of the print.
            options: wetness and glare on it.
            frustum: of the camera.
            rays: of all pixels and of one more on each side, (rows, columns, 2).
            seed: of all that is random on the print.

        Raises:
            ValueError: the layout names a marker that does not exist.
        """
        self._frustum, self._camera, self._rays = frustum, frustum.camera, rays
        self._levels = textures(layout, pad, options, seed)
        self._fold = fold(layout, pad.bend_deg)
        self._plate = np.array(plate_corners(layout))
        self._outline = self._plate if self._fold is None else self._fold.outline(self._plate)

    def holds(self, north: float, east: float) -> bool:
        """Tell whether a point of the pad's plane (north, east; m) is on the plate."""
        (n1, e0, _), _, (n0, e1, _), _ = self._plate
        return bool(n0 < north < n1 and e0 < east < e1)

    def seen(
        self, pose: CameraPose, pad: PadPose, readout: Readout | None, grid: RowGrid | None
    ) -> SeenPad | None:
        """Return where the pad is in the picture; None: it is out of sight.

        Args:
            pose: of the camera at the middle of the exposure.
            pad: its pose at that time.
            readout: poses while the rows are read; None: all rows are exposed at once.
            grid: the pixels' rows; None likewise.
        """
        places = [pad]
        if self._fold is not None:
            places.append(self._fold.far_part(pad))
        planes = []
        for place in places:
            H = plane_homography(pose, place)
            if H is None:
                break  # the camera is below the far part: the plate is drawn flat
            rolled = None
            if readout is not None and grid is not None:
                rolled = RolledPlane(grid, H, readout.homographies(grid, place, pad))
            planes.append(_Plane(H, rolled, self._rays))
        box = self._box(pose, pad, planes[0].rolled) if planes else None
        if box is None:
            return None
        w, h = self._camera.width, self._camera.height
        fills = box == (0, 0, w, h) and self._covers(planes, EVERYTHING)
        return SeenPad(tuple(planes), box, fills)

    def _box(self, pose: CameraPose, pad: PadPose, rolled: RolledPlane | None) -> Box | None:
        """Return the box of pixels that contains the pad; None: it is out of sight."""
        corners = self._frustum.clip(in_camera(pose, on_pad(pad, self._outline)))
        if len(corners) < 3:
            return None
        # The lens may bend the plate's edges outwards between the corners.
        k = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None, None]
        outline = (corners + k * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 3)
        pixels = self._camera.pixels(outline)
        if rolled is not None:
            pixels = rolled.moved(pixels)
            pixels = np.concatenate([pixels - ROLLED_MARGIN_PX, pixels + ROLLED_MARGIN_PX])
        left, top = np.floor(pixels.min(axis=0)).astype(int) - 1
        right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + 2
        left, top = max(int(left), 0), max(int(top), 0)
        right = min(int(right), self._camera.width)
        bottom = min(int(bottom), self._camera.height)
        return (left, top, right, bottom) if left < right and top < bottom else None

    def _covers(self, planes: Sequence[_Plane], block: Block) -> bool:
        """Tell whether all pixels of a block see the plate."""
        # The lens bends the block's edges a little between the corners.
        bend = 0.02 * float((self._plate[0] - self._plate[2]).max())
        (n1, e0, _), _, (n0, e1, _), _ = self._plate.tolist()
        for plane in planes:
            H, corners = plane.H, plane.corners(block).reshape(-1, 2)
            n, e, descent = H[:, :2] @ corners.T + H[:, 2:]
            if descent.min() <= 0.0:
                return False
            north, east = n / descent, e / descent
            if not (
                north.max() < n1 - bend
                and north.min() > n0 + bend
                and east.max() < e1 - bend
                and east.min() > e0 + bend
            ):
                return False
        return True

    def draw(self, image: U8, seen: SeenPad, defocus: float, light: U8 | None) -> None:
        """Draw the pad into a picture.

        A small pad is drawn out of focus: a lens blurs before pixels average, and in the reverse
        order edges of a distant ring would be off by some hundredths of a pixel.

        Args:
            image: the picture of everything else, (height, width); changed.
            seen: where the pad is.
            defocus: sigma of the blur of a small pad, px.
            light: on the box, (rows, columns), 255 is full light; None: full light everywhere.
        """
        left, top, right, bottom = seen.box
        H, levels = seen.planes[0].H, self._levels
        det = float(np.linalg.det(H))
        pitch = 1.0 / math.sqrt(self._camera.fx * self._camera.fy) / seen.samples
        bands = max(round((bottom - top) / BAND_ROWS), 1)
        rows = [top + (bottom - top) * i // bands for i in range(bands + 1)]
        for first, last in itertools.pairwise(rows):
            part = image[first:last, left:right]
            # The array of rays begins one pixel outside the image.
            block = slice(first, last + 2), slice(left, right + 2)
            x, y = self._rays[(first + last + 2) // 2, (left + right + 2) // 2].tolist()
            descent = max(float(H[2] @ (x, y, 1.0)), 0.05)
            apart_m = footprint(det, descent, pitch)
            texture = levels[level_of_detail(apart_m, levels[0].texel_m, len(levels))]
            shaded = None if light is None else light[first - top : last - top]
            self._draw_band(part, seen, block, texture, defocus, shaded)

    def _draw_band(
        self,
        part: U8,
        seen: SeenPad,
        block: Block,
        texture: TextureLevel,
        defocus: float,
        light: U8 | None,
    ) -> None:
        """Draw the pad into some rows of its box.

        Args:
            part: these rows of the picture, within the box; changed.
            seen: where the pad is.
            block: of rays, with one more than `part` on each side.
            texture: level of detail to draw from.
            defocus: see `draw`.
            light: on these rows; None: full light.
        """
        samples = seen.samples
        where, second = self._texels(seen, block, texture)

        def sampled(source: U8) -> U8:
            grey = cast(U8, cv2.remap(source, where, second, cv2.INTER_LINEAR))
            if samples > 1:
                blur(grey, defocus * samples)
                size = (part.shape[1] + 2, part.shape[0] + 2)
                grey = cast(U8, cv2.resize(grey, size, interpolation=cv2.INTER_AREA)[1:-1, 1:-1])
            return grey

        grey = sampled(texture.grey)
        if light is not None:
            grey = cast(U8, cv2.multiply(grey, light, scale=1 / 255))
        if self._covers(seen.planes, block):
            part[:] = grey
            return
        cv2.multiply(part, cv2.bitwise_not(sampled(texture.alpha)), dst=part, scale=1 / 255)
        cv2.add(part, grey, dst=part)

    def _texels(self, seen: SeenPad, block: Block, texture: TextureLevel) -> tuple[F32, F32 | F64]:
        """Return the texels that the samples of a block see, as cv2.remap takes them.

        More than one sample per pixel fill the whole block; one per pixel, the block without its
        border.
        """
        near, *far = seen.planes
        samples = seen.samples
        straight = near.straight(block, texture) if samples == 1 and not far else None
        if straight is not None:
            return straight
        where = near.texels(block, texture, border=samples > 1)
        if self._fold is not None and far and self._fold.reaches(far[0].H, far[0].corners(block)):
            beyond = far[0].texels(block, texture, border=samples > 1)
            self._fold.bend(where, beyond, texture)
        if samples > 1:
            # Within a pixel the map from rays to texels is linear enough.
            size = (where.shape[1] * samples, where.shape[0] * samples)
            where = cast(F32, cv2.resize(where, size, interpolation=cv2.INTER_LINEAR))
        return where, NO_SECOND_MAP
