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
from hw.sim.picture.ground import Ground
from hw.sim.picture.pad_print import fold, textures
from hw.sim.picture.pad_texture import TextureLevel, plate_corners
from hw.sim.picture.shade import ShadowEdge
from hw.sim.picture.vehicle import draw_legs, shade, vehicle_shadow
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
        self._pad = textures(layout, pad, options, seed)
        self._fold = fold(layout, pad.bend_deg)
        self._plate = np.array(plate_corners(layout))
        self._outline = self._plate if self._fold is None else self._fold.outline(self._plate)
        w, h = camera.width, camera.height
        # One ray beyond each border, so that rays between pixels can be interpolated there too.
        self._rays = rays_at(camera, np.arange(-1.0, w + 1), np.arange(-1.0, h + 1))
        self._ground = Ground(options, camera, layout, seed, pad.position_m)
        self._shadow_edge = ShadowEdge(options, camera) if options.shadow_edge else None
        e, a = math.radians(options.sun_elevation_deg), math.radians(options.sun_azimuth_deg)
        self._sunlight = np.array(
            [-math.cos(e) * math.cos(a), -math.cos(e) * math.sin(a), math.sin(e)]
        )
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
        if options.vehicle_shadow and vehicle is not None:
            plane = self._shaded_plane(vehicle, pad)
            shadow = vehicle_shadow(self._frustum, pose, vehicle, plane, self._sunlight)
            if shadow is not None:
                shade(image, shadow, options.shadow_darkness)
        if self._shadow_edge is not None:
            self._shadow_edge.darken(image, pose, pad)
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
        planes = self._planes(pose, pad)
        box = self._pad_box(pose, pad) if planes else None
        if planes and box == (0, 0, w, h) and self._covers(planes, self._rays):
            image = np.empty((h, w), np.uint8)
            samples = _samples(box)
            self._draw_pad(image, planes, box, samples, defocus, self._leaf_light(pose, pad, box))
            return image, samples == 1
        level = PadPose((0.0, 0.0, self._options.ground_down_m), IDENTITY)
        to_ground = plane_homography(pose, level)
        image = self._ground.draw(to_ground)
        if box is None:
            return image, True
        samples = _samples(box)
        if samples > 1:
            _defocus(image, defocus)
        self._draw_pad(image, planes, box, samples, defocus, self._leaf_light(pose, pad, box))
        return image, samples == 1

    def _leaf_light(self, pose: CameraPose, pad: PadPose, box: _Box) -> U8 | None:
        """Return the light under leaves in the pad's box of the image, 255 all; None: no leaves."""
        if self._ground.leaves is None:
            return None
        left, top, right, bottom = box
        rays = self._rays[top + 1 : bottom + 1, left + 1 : right + 1]
        return self._ground.leaves.on_pad(pose, pad, self._sunlight, rays, self._camera.fx)

    def _planes(self, pose: CameraPose, pad: PadPose) -> list[F64]:
        """Return the `plane_homography` to the pad, and to its far part if it is folded.

        Empty: the camera is not above the pad. From below the far part it is drawn flat.
        """
        H = plane_homography(pose, pad)
        if H is None:
            return []
        far = None
        if self._fold is not None:
            far = plane_homography(pose, self._fold.far_part(pad))
        return [H] if far is None else [H, far]

    def _pad_box(self, pose: CameraPose, pad: PadPose) -> _Box | None:
        """Left, top, right, bottom of the pad in the image, None when it is out of sight."""
        corners = self._frustum.clip(in_camera(pose, on_pad(pad, self._outline)))
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

    def _covers(self, planes: list[F64], rays: F32) -> bool:
        """Tell whether a block of rays (rows, columns, 2) meets nothing but the plate."""
        corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
        # Between the corners the lens bends the block's edges a little.
        bend = 0.02 * float((self._plate[0] - self._plate[2]).max())
        (n1, e0, _), _, (n0, e1, _), _ = self._plate.tolist()
        for H in planes:
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

    def _draw_pad(
        self,
        image: U8,
        planes: list[F64],
        box: _Box,
        samples: int,
        defocus: float,
        light: U8 | None,
    ) -> None:
        """Draw the pad, which lies within the box (left, top, right, bottom) of the image.

        A small one is drawn out of focus: a lens blurs before the pixels average, and the other
        way round edges of a far ring would be off by some hundredths of a pixel.
        """
        H = planes[0]
        left, top, right, bottom = box
        det = float(np.linalg.det(H))
        pitch = 1.0 / math.sqrt(self._camera.fx * self._camera.fy) / samples
        bands = max(round((bottom - top) / BAND_ROWS), 1)
        rows = [top + (bottom - top) * i // bands for i in range(bands + 1)]
        for first, last in itertools.pairwise(rows):
            part = image[first:last, left:right]
            # The array of rays begins one pixel outside the image.
            rays = self._rays[first : last + 2, left : right + 2]
            x, y = rays[rays.shape[0] // 2, rays.shape[1] // 2].tolist()
            descent = max(float(H[2] @ (x, y, 1.0)), 0.05)
            apart_m = footprint(det, descent, pitch)
            level = level_of_detail(apart_m, self._pad[0].texel_m, len(self._pad))
            shaded = None if light is None else light[first - top : last - top]
            self._draw_band(part, planes, rays, self._pad[level], samples, defocus, shaded)

    def _draw_band(
        self,
        part: U8,
        planes: list[F64],
        rays: F32,
        texture: TextureLevel,
        samples: int,
        defocus: float,
        light: U8 | None,
    ) -> None:
        """Draw the pad into part of the image, whose rays have one more on every side."""
        rows, columns = part.shape
        covered = self._covers(planes, rays)
        if samples == 1:
            rays = np.ascontiguousarray(rays[1:-1, 1:-1])
        where = cast(F32, cv2.perspectiveTransform(rays, texture.from_pad() @ planes[0]))
        corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
        plane = planes[0][2].astype(np.float32)
        if (corners @ plane[:2] + plane[2]).min() < 0.02:
            # Rays that miss the plane would meet its mirror image behind the camera.
            where[rays @ plane[:2] + plane[2] <= 0.0] = -1e6
        if self._fold is not None and len(planes) == 2:
            where = self._fold.bend(where, rays, planes[1], texture)
        if samples > 1:
            # Within a pixel the way from ray to texel is straight.
            size = (rays.shape[1] * samples, rays.shape[0] * samples)
            where = cast(F32, cv2.resize(where, size, interpolation=cv2.INTER_LINEAR))

        def sampled(source: U8) -> U8:
            seen = cast(U8, cv2.remap(source, where, NO_SECOND_MAP, cv2.INTER_LINEAR))
            if samples > 1:
                _defocus(seen, defocus * samples)
                size = (columns + 2, rows + 2)
                seen = cast(U8, cv2.resize(seen, size, interpolation=cv2.INTER_AREA)[1:-1, 1:-1])
            return seen

        grey = sampled(texture.grey)
        if light is not None:
            grey = cast(U8, cv2.multiply(grey, light, scale=1 / 255))
        if covered:
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
