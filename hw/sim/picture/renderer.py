"""What the gimballed camera sees: pad, ground, sky, shadows, and the vehicle's own legs.

Every picture is a pure function of its arguments and the seed. Edges of the pad are exact to a
few hundredths of a pixel, because that is what the pose at 20 to 30 m hangs on: rays of all
pixels are undistorted once, meet the pad's plane by a homography, and sample a texture of exact
area averages, several samples a pixel while the pad is small.
"""

import itertools
import math
import random
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.fractal import generator
from hw.sim.picture.ground import Ground
from hw.sim.picture.leaf_shade import LeafShade
from hw.sim.picture.look_alikes import LookAlikes
from hw.sim.picture.pad_print import Panel, panels
from hw.sim.picture.pad_texture import TextureLevel, plate_corners
from hw.sim.picture.vehicle import Shadow, draw_legs, shade, vehicle_shadow
from hw.sim.picture.view import (
    F64,
    NO_SECOND_MAP,
    Frustum,
    footprint,
    in_camera,
    level_of_detail,
    middle,
    on_pad,
    plane_homography,
    rays_at,
)
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import CameraModel
from landerd.geometry import IDENTITY
from landerd.pad import PadLayout

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

SAMPLES = 160_000  # of the pad's texture in one picture, unless one a pixel is more
SAMPLINGS = (4, 2, 1)  # samples a pixel along x and along y; averages over 3 would be slow
BAND_ROWS = 80  # of the pad's picture drawn from one level of detail
MOTION_SPOT_PX = 0.3  # least sigma of a spot that is drawn along a path on whole pixels
STILL_PX = 0.15  # motion during the exposure that is not worth a filter
NOISE_MARGIN = 256  # offsets of the noise field to choose from, along x and along y


_Box = tuple[int, int, int, int]  # left, top, right, bottom in pixels


class Renderer:
    """Draws grey pictures of one pad through one camera."""

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        options: RenderOptions,
        seed: int,
        *,
        pad: PadOptions | None = None,
    ) -> None:
        """Prepare rays, textures and noise; takes about 0.2 s.

        Args:
            layout: of the pad as it was printed.
            camera: whose images are drawn.
            options: light and surroundings.
            seed: of all that is random.
            pad: where it starts, what has become of its print; None: a new one at the origin.

        Raises:
            ValueError: the layout names a marker that does not exist, or the ground's photograph
                cannot be read.
        """
        pad = pad or PadOptions(position_m=(0.0, 0.0))
        self._camera = camera
        self._options = options
        self._seed = seed
        self._frustum = Frustum(camera)
        self._panels = panels(layout, pad, options, seed)
        self._plate = np.array(plate_corners(layout))
        w, h = camera.width, camera.height
        # One ray beyond each border, so that rays between pixels can be interpolated there too.
        self._rays = rays_at(camera, np.arange(-1.0, w + 1), np.arange(-1.0, h + 1))
        self._ground = Ground(options, camera, seed, pad.position_m)
        self._look_alikes = None
        if options.look_alikes:
            rng = generator(seed, "look-alikes")
            down = options.ground_down_m
            self._look_alikes = LookAlikes(options.look_alikes, layout, pad.position_m, down, rng)
        e, a = math.radians(options.sun_elevation_deg), math.radians(options.sun_azimuth_deg)
        self._sunlight = np.array(
            [-math.cos(e) * math.cos(a), -math.cos(e) * math.sin(a), math.sin(e)]
        )
        self._leaves = None
        if options.leaf_shade > 0.0:
            self._leaves = LeafShade(options, camera, self._sunlight, seed)
        rng = np.random.default_rng([seed, 2])
        bearing = rng.uniform(0.0, 2.0 * math.pi)
        ramp = np.add.outer(
            math.sin(bearing) * np.linspace(-1.0, 1.0, h),
            math.cos(bearing) * np.linspace(-1.0, 1.0, w),
        )
        self._gain = (options.illumination * (1.0 + options.gradient * ramp)).astype(np.float32)
        noise = rng.standard_normal((h + NOISE_MARGIN, w + NOISE_MARGIN), dtype=np.float32)
        noise = np.clip(np.rint(options.noise_sigma * noise), -255, 255)
        # In two parts, each of the image's own type: a tenth of the time of signed noise.
        self._brighter = np.maximum(noise, 0.0).astype(np.uint8)
        self._darker = np.maximum(-noise, 0.0).astype(np.uint8)

    def render(
        self,
        frame_index: int,
        start: CameraPose,
        end: CameraPose,
        pad: PadPose,
        vehicle: VehiclePose | None,
    ) -> U8:
        """Return the picture (height, width) of an exposure from pose start to pose end.

        The pad stands still meanwhile; the blur of a moving one is that of the camera's motion
        relative to it. Without a vehicle there are no legs and no shadow of it.
        """
        options = self._options
        pose = middle(start, end)
        motion = self._motion(start, end, pose, pad)
        moves = math.hypot(*motion) >= STILL_PX
        spot = MOTION_SPOT_PX if moves else 0.0
        defocus = math.sqrt(max(options.defocus_px**2 - spot**2, 0.0))
        image, is_sharp = self._background(pose, pad, defocus)
        if self._leaves is not None:
            to_leaves = plane_homography(pose, self._leaves.falls_on(pad))
            if to_leaves is not None:
                self._leaves.darken(image, to_leaves)
        if options.vehicle_shadow and vehicle is not None:
            plane = self._shaded_plane(vehicle, pad)
            shadow = vehicle_shadow(self._frustum, pose, vehicle, plane, self._sunlight)
            if shadow is not None:
                shade(image, shadow, options.shadow_darkness)
        if options.shadow_edge:
            shade(image, self._edge_shadow(pose, pad), options.shadow_darkness)
        sigma = options.defocus_px if is_sharp else 0.0
        if moves:
            kernel = motion_kernel(max(sigma, MOTION_SPOT_PX), float(motion[0]), float(motion[1]))
            image = cast(U8, cv2.filter2D(image, -1, kernel))
        else:
            _defocus(image, sigma)
        if options.legs and vehicle is not None:
            draw_legs(image, self._frustum, pose, vehicle)
        cv2.multiply(image, self._gain, dst=image, dtype=cv2.CV_8U)
        offsets = random.Random(self._seed * 1_000_003 + frame_index)
        x, y = offsets.randrange(NOISE_MARGIN), offsets.randrange(NOISE_MARGIN)
        part = (slice(y, y + image.shape[0]), slice(x, x + image.shape[1]))
        cv2.add(image, self._brighter[part], dst=image)
        cv2.subtract(image, self._darker[part], dst=image)
        return image

    # ---- pad and ground ------------------------------------------------------------------------

    def _background(self, pose: CameraPose, pad: PadPose, defocus: float) -> tuple[U8, bool]:
        """Ground with the pad on it, and whether it has yet to be brought out of focus.

        defocus is the sigma in pixels that a small pad is drawn with.
        """
        w, h = self._camera.width, self._camera.height
        H = plane_homography(pose, pad)
        box = self._box(pose, pad, self._plate) if H is not None else None
        if H is not None and box == (0, 0, w, h) and _covers(self._plate, H, self._rays):
            image = np.zeros((h, w), np.uint8)
            samples = _samples(box)
            self._draw_pad(image, pose, pad, samples, defocus, covered=True)
            return image, samples == 1
        level = PadPose((0.0, 0.0, self._options.ground_down_m), IDENTITY)
        to_ground = plane_homography(pose, level)
        image = self._ground.draw(to_ground)
        if self._look_alikes is not None and to_ground is not None:
            seen = self._rays[1:-1, 1:-1]
            self._look_alikes.draw(image, self._frustum, pose, to_ground, seen)
        if H is None or box is None:
            return image, True
        samples = _samples(box)
        if samples > 1:
            _defocus(image, defocus)
        self._draw_pad(image, pose, pad, samples, defocus, covered=False)
        return image, samples == 1

    def _draw_pad(
        self,
        image: U8,
        pose: CameraPose,
        pad: PadPose,
        samples: int,
        defocus: float,
        *,
        covered: bool,
    ) -> None:
        """Draw the pad, flat or folded; covered: nothing else is in the image."""
        for i, panel in enumerate(self._panels):
            placed = panel.placed(pad)
            H = plane_homography(pose, placed)
            box = self._box(pose, placed, panel.outline) if H is not None else None
            if H is not None and box is not None:
                alone = covered and i == 0
                self._draw_panel(image, H, box, panel, samples, defocus, alone=alone)

    def _box(self, pose: CameraPose, plane: PadPose, outline: F64) -> _Box | None:
        """Return where an outline (n, 3) on a plane is in the image, None when out of sight."""
        corners = self._frustum.clip(in_camera(pose, on_pad(plane, outline)))
        if len(corners) < 3:
            return None
        # Between the corners the lens bends the plate's edges outwards.
        k = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None, None]
        outline = (corners + k * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 3)
        pixels = self._camera.pixels(outline)
        left, top = np.floor(pixels.min(axis=0)).astype(int) - 1
        right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + 2
        left, top = max(int(left), 0), max(int(top), 0)
        right = min(int(right), self._camera.width)
        bottom = min(int(bottom), self._camera.height)
        return (left, top, right, bottom) if left < right and top < bottom else None

    def _draw_panel(
        self,
        image: U8,
        H: F64,
        box: _Box,
        panel: Panel,
        samples: int,
        defocus: float,
        *,
        alone: bool,
    ) -> None:
        """Draw a part of the pad, which lies within the box (left, top, right, bottom).

        A small one is drawn out of focus: a lens blurs before the pixels average, and the other
        way round edges of a far ring would be off by some hundredths of a pixel.
        """
        left, top, right, bottom = box
        pitch = 1.0 / math.sqrt(self._camera.fx * self._camera.fy) / samples
        bands = max(round((bottom - top) / BAND_ROWS), 1)
        rows = [top + (bottom - top) * i // bands for i in range(bands + 1)]
        for first, last in itertools.pairwise(rows):
            part = image[first:last, left:right]
            # The array of rays begins one pixel outside the image.
            rays = self._rays[first : last + 2, left : right + 2]
            x, y = rays[rays.shape[0] // 2, rays.shape[1] // 2].tolist()
            apart_m = footprint(H, max(float(H[2] @ (x, y, 1.0)), 0.05), pitch)
            levels = panel.levels
            texture = levels[level_of_detail(apart_m, levels[0].texel_m, len(levels))]
            opaque = alone or _covers(panel.outline, H, rays)
            self._draw_band(part, H, rays, texture, samples, defocus, opaque=opaque)

    def _draw_band(
        self,
        part: U8,
        H: F64,
        rays: F32,
        texture: TextureLevel,
        samples: int,
        defocus: float,
        *,
        opaque: bool,
    ) -> None:
        """Draw the pad into part of the image, whose rays have one more on every side."""
        rows, columns = part.shape
        if samples == 1:
            rays = np.ascontiguousarray(rays[1:-1, 1:-1])
        where = cv2.perspectiveTransform(rays, texture.from_pad() @ H)
        corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
        plane = H[2].astype(np.float32)
        if (corners @ plane[:2] + plane[2]).min() < 0.02:
            # Rays that miss the plane would meet its mirror image behind the camera.
            where[rays @ plane[:2] + plane[2] <= 0.0] = -1e6
        if samples > 1:
            # Within a pixel the way from ray to texel is straight.
            size = (rays.shape[1] * samples, rays.shape[0] * samples)
            where = cv2.resize(where, size, interpolation=cv2.INTER_LINEAR)

        def sampled(source: U8) -> U8:
            seen = cast(U8, cv2.remap(source, where, NO_SECOND_MAP, cv2.INTER_LINEAR))
            if samples > 1:
                _defocus(seen, defocus * samples)
                size = (columns + 2, rows + 2)
                seen = cast(U8, cv2.resize(seen, size, interpolation=cv2.INTER_AREA)[1:-1, 1:-1])
            return seen

        grey = sampled(texture.grey)
        if opaque:
            part[:] = grey
            return
        cv2.multiply(part, cv2.bitwise_not(sampled(texture.alpha)), dst=part, scale=1 / 255)
        cv2.add(part, grey, dst=part)

    # ---- shadows and blur ----------------------------------------------------------------------

    def _shaded_plane(self, vehicle: VehiclePose, pad: PadPose) -> PadPose:
        """The plane that the vehicle's shadow falls on: the pad's, or the ground."""
        R = np.array(pad.R_local_pad).T
        light = R @ self._sunlight
        n, e, d = R @ (np.array(vehicle.position) - np.array(pad.position))
        (n1, e0, _), _, (n0, e1, _), _ = self._plate
        if light[2] > 0.05:
            n, e = n - d * light[0] / light[2], e - d * light[1] / light[2]
            if n0 < n < n1 and e0 < e < e1:
                return pad
        return PadPose((0.0, 0.0, self._options.ground_down_m), IDENTITY)

    def _edge_shadow(self, pose: CameraPose, pad: PadPose) -> Shadow:
        """The half of the pad's plane that lies beyond the shadow's edge."""
        a = math.radians(self._options.shadow_edge_heading_deg)
        beyond = np.array([math.cos(a), math.sin(a), 0.0])
        along = np.array([-math.sin(a), math.cos(a), 0.0])
        far, edge = 100.0, self._options.shadow_edge_m
        corners = np.stack(
            [
                edge * beyond - far * along,
                edge * beyond + far * along,
                far * beyond + far * along,
                far * beyond - far * along,
            ]
        )
        depth = max(float(in_camera(pose, np.array([pad.position]))[0, 2]), 0.1)
        outlines = self._frustum.outlines([in_camera(pose, on_pad(pad, corners))])
        return Shadow(outlines, [1.0], self._options.shadow_softness_m * self._camera.fx / depth)

    def _motion(self, start: CameraPose, end: CameraPose, pose: CameraPose, pad: PadPose) -> F64:
        """Path (2,) in pixels of the landing point, or of the image's middle, while exposed."""
        if start == end:
            return np.zeros(2)
        point = np.array([pad.position])
        if not self._frustum.contains(in_camera(pose, point)):
            ahead = np.array([[0.0, 0.0, max(-pose.position[2], 1.0)]])
            point = ahead @ np.array(pose.R_local_camera).T + np.array(pose.position)
        ends = np.concatenate([in_camera(start, point), in_camera(end, point)])
        if not (ends[:, 2] > 0.0).all():
            return np.zeros(2)
        first, last = self._camera.pixels(ends)
        return cast(F64, last - first)


def _covers(outline: F64, H: F64, rays: F32) -> bool:
    """Tell whether a block of rays (rows, columns, 2) meets nothing but a part of a plane.

    Its outline (n, 3) is convex and clockwise from above, H leads there.
    """
    corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
    n, e, descent = H[:, :2] @ corners.T + H[:, 2:]
    if descent.min() <= 0.0:
        return False
    # Between the corners the lens bends the block's edges a little.
    bend = 0.02 * float((outline.max(axis=0) - outline.min(axis=0)).max())
    north, east = n / descent, e / descent
    along = np.roll(outline, -1, axis=0) - outline
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # To the right of each edge, as north is up.
    inside = np.outer(along[:, 0], east) - np.outer(along[:, 1], north)
    inside -= (along[:, 0] * outline[:, 1] - along[:, 1] * outline[:, 0])[:, None]
    return bool(inside.min() > bend)


def _samples(box: _Box) -> int:
    """Return the samples a pixel, along x and along y, of a pad in a box of the image."""
    left, top, right, bottom = box
    area = (right - left) * (bottom - top)
    return next((s for s in SAMPLINGS if s * s * area <= SAMPLES), 1)


def _defocus(image: U8, sigma: float) -> None:
    """Blur an image in place."""
    if sigma >= 0.1:
        size = 2 * math.ceil(2.5 * sigma) + 1
        cv2.GaussianBlur(image, (size, size), sigma, dst=image, borderType=cv2.BORDER_REPLICATE)


def motion_kernel(sigma: float, dx: float, dy: float) -> F32:
    """Return the blur (odd, odd) of a Gaussian spot drawn along (dx, dy) pixels, sum 1."""
    steps = max(math.ceil(2 * math.hypot(dx, dy)), 2)
    t = (np.arange(steps) + 0.5) / steps - 0.5

    def spots(way: float) -> F64:
        # Beyond 2.2 sigma less than 0.5 % of a spot's light falls on a pixel.
        radius = max(round(2.2 * sigma + abs(way) / 2), 1)
        distances = np.arange(-radius, radius + 1.0)[:, None] - t * way
        return cast(F64, np.exp(-(distances**2) / (2 * sigma**2)))

    kernel = spots(dy) @ spots(dx).T
    return cast(F32, (kernel / kernel.sum()).astype(np.float32))
