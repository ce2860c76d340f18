"""What the gimballed camera sees: pad, ground, sky, shadows, and the vehicle's own legs.

Every picture is a pure function of its arguments and the seed. Edges of the pad are exact to a
few hundredths of a pixel, because that is what the pose at 20 to 30 m hangs on: rays of all
pixels are undistorted once, meet the pad's plane by a homography, and sample a texture of exact
area averages, several samples a pixel while the pad is small.
"""

import itertools
import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.ground import Ground
from hw.sim.picture.pad_texture import TextureLevel, pad_texture, plate_corners
from hw.sim.picture.sensor import Sensor
from hw.sim.picture.shutter import EVERYTHING, Block, Readout, RolledPlane, RowGrid
from hw.sim.picture.vehicle import Shadow, draw_legs, shade, vehicle_shadow
from hw.sim.picture.view import (
    F64,
    NO_SECOND_MAP,
    Frustum,
    in_camera,
    level_of_detail,
    middle,
    on_pad,
    plane_homography,
)
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import CameraModel
from landerd.geometry import IDENTITY
from landerd.pad import PadLayout

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

SAMPLE_BUDGET = 160_000  # of the pad's texture in one picture, unless one a pixel is more
SAMPLINGS = (4, 2, 1)  # samples a pixel along x and along y; averages over 3 would be slow
BAND_ROWS = 80  # of the pad's picture drawn from one level of detail
MOTION_SPOT_PX = 0.3  # least sigma of a spot that is drawn along a path on whole pixels
STILL_PX = 0.15  # motion during the exposure that is not worth a filter
EDGE_SOFTNESS_M = 0.02  # of the shadow's edge that something far away casts
ROLLED_MARGIN_PX = 2.0  # round a pad that is skewed by a rolling shutter


class Renderer:
    """Draws grey pictures of one pad through one camera."""

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        options: RenderOptions,
        seed: int,
        sensor: SimCameraOptions | None = None,
    ) -> None:
        """Prepare rays, textures and noise; takes about 0.2 s.

        Args:
            layout: of the pad.
            camera: the true one.
            options: of the scene, and of its light on the sensor.
            seed: of all that is random.
            sensor: how the light becomes a picture; None: the ideal one.

        Raises:
            ValueError: the layout names a marker that does not exist.
        """
        sensor = sensor or SimCameraOptions()
        self._camera = camera
        self._options = options
        self._seed = seed
        self._frustum = Frustum(camera)
        self._pad = pad_texture(layout)
        self._plate = np.array(plate_corners(layout))
        w, h = camera.width, camera.height
        # One ray beyond each border, so that rays between pixels can be interpolated there too.
        self._rays = _rays(camera, np.arange(-1.0, w + 1), np.arange(-1.0, h + 1))
        columns, rows = (w + 1) // 2, (h + 1) // 2
        half_x = (np.arange(columns) + 0.5) * w / columns - 0.5
        half_y = (np.arange(rows) + 0.5) * h / rows - 0.5
        self._ground = Ground(options.ground, _rays(camera, half_x, half_y), seed)
        if sensor.readout_s > 0.0 or sensor.vibration.deg > 0.0:
            self._grid = RowGrid(camera, np.arange(-1.0, w + 1), np.arange(-1.0, h + 1))
            self._ground_grid = RowGrid(camera, half_x, half_y)
        e, a = math.radians(options.sun_elevation_deg), math.radians(options.sun_azimuth_deg)
        self._sunlight = np.array(
            [-math.cos(e) * math.cos(a), -math.cos(e) * math.sin(a), math.sin(e)]
        )
        self._sensor = Sensor(camera, options, sensor, seed)

    def render(
        self,
        frame_index: int,
        start: CameraPose,
        end: CameraPose,
        pad: PadPose,
        vehicle: VehiclePose | None,
        exposure: Exposure | None = None,
        readout: Readout | None = None,
    ) -> U8:
        """Return the picture (height, width) of an exposure from pose start to pose end.

        The pad stands still meanwhile; the blur of a moving one is that of the camera's motion
        relative to it. Without a vehicle there are no legs and no shadow of it. Without an exposure
        the light is the illumination's; with a readout (of a renderer whose sensor has one) the
        exposure is the middle row's.
        """
        options = self._options
        pose = middle(start, end)
        motion = self._motion(start, end, pose, pad)
        moves = math.hypot(*motion) >= STILL_PX
        spot = MOTION_SPOT_PX if moves else 0.0
        blur = options.defocus_px
        if readout is not None:
            blur = math.hypot(blur, self._camera.fx * readout.shaking)
        defocus = math.sqrt(max(blur**2 - spot**2, 0.0))
        image, is_sharp = self._background(pose, pad, defocus, readout)
        if options.vehicle_shadow and vehicle is not None:
            plane = self._shaded_plane(vehicle, pad)
            shadow = vehicle_shadow(self._frustum, pose, vehicle, plane, self._sunlight)
            if shadow is not None:
                shade(image, shadow, options.shadow_darkness)
        if options.shadow_edge:
            shade(image, self._edge_shadow(pose, pad), options.shadow_darkness)
        sigma = blur if is_sharp else 0.0
        if moves:
            kernel = motion_kernel(max(sigma, MOTION_SPOT_PX), float(motion[0]), float(motion[1]))
            image = cast(U8, cv2.filter2D(image, -1, kernel))
        else:
            _defocus(image, sigma)
        if options.legs and vehicle is not None:
            draw_legs(image, self._frustum, pose, vehicle)
        return self._sensor.expose(image, frame_index, exposure)

    # ---- pad and ground ------------------------------------------------------------------------

    def _background(
        self, pose: CameraPose, pad: PadPose, defocus: float, readout: Readout | None
    ) -> tuple[U8, bool]:
        """Ground with the pad on it, and whether it has yet to be brought out of focus.

        defocus is the sigma in pixels that a small pad is drawn with.
        """
        w, h = self._camera.width, self._camera.height
        H = plane_homography(pose, pad)
        rolled = self._rolled_pad(H, readout, pad)
        box = self._pad_box(pose, pad, rolled) if H is not None else None
        everything = self._rays if rolled is None else rolled.corners(EVERYTHING)
        if H is not None and box == (0, 0, w, h) and self._covers(H, everything):
            image = np.empty((h, w), np.uint8)
            samples = _samples(box)
            self._draw_pad(image, H, box, samples, defocus, rolled)
            return image, samples == 1
        small = self._draw_ground(pose, readout)
        image = np.empty((h, w), np.uint8)
        cv2.resize(small, (w, h), dst=image, interpolation=cv2.INTER_LINEAR)
        if H is None or box is None:
            return image, True
        samples = _samples(box)
        if samples > 1:
            _defocus(image, defocus)
        self._draw_pad(image, H, box, samples, defocus, rolled)
        return image, samples == 1

    def _draw_ground(self, pose: CameraPose, readout: Readout | None) -> U8:
        """Draw the ground and the sky at half the resolution."""
        level = PadPose((0.0, 0.0, self._options.ground_down_m), IDENTITY)
        H = plane_homography(pose, level)
        if H is None or readout is None:
            return self._ground.draw(H)
        grid = self._ground_grid
        rolled = RolledPlane(grid, H, readout.homographies(grid, level, None))
        return self._ground.draw(H, rolled.rays(EVERYTHING))

    def _rolled_pad(
        self, H: F64 | None, readout: Readout | None, pad: PadPose
    ) -> RolledPlane | None:
        """The pad as a rolling shutter sees it, which H leads to from the pose that is drawn."""
        if H is None or readout is None:
            return None
        return RolledPlane(self._grid, H, readout.homographies(self._grid, pad, pad))

    def _pad_box(
        self, pose: CameraPose, pad: PadPose, rolled: RolledPlane | None
    ) -> tuple[int, int, int, int] | None:
        """Left, top, right, bottom of the pad in the image, None when it is out of sight."""
        corners = self._frustum.clip(in_camera(pose, on_pad(pad, self._plate)))
        if len(corners) < 3:
            return None
        # Between the corners the lens bends the plate's edges outwards.
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

    def _covers(self, H: F64, rays: F32) -> bool:
        """Tell whether a block of rays (rows, columns, 2) meets nothing but the plate."""
        corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
        n, e, descent = H[:, :2] @ corners.T + H[:, 2:]
        if descent.min() <= 0.0:
            return False
        # Between the corners the lens bends the block's edges a little.
        bend = 0.02 * float((self._plate[0] - self._plate[2]).max())
        north, east = n / descent, e / descent
        (n1, e0, _), _, (n0, e1, _), _ = self._plate.tolist()
        return bool(
            north.max() < n1 - bend
            and north.min() > n0 + bend
            and east.max() < e1 - bend
            and east.min() > e0 + bend
        )

    def _draw_pad(
        self,
        image: U8,
        H: F64,
        box: tuple[int, int, int, int],
        samples: int,
        defocus: float,
        rolled: RolledPlane | None,
    ) -> None:
        """Draw the pad, which lies within the box (left, top, right, bottom) of the image.

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
            block = slice(first, last + 2), slice(left, right + 2)
            x, y = self._rays[(first + last + 2) // 2, (left + right + 2) // 2].tolist()
            descent = max(float(H[2] @ (x, y, 1.0)), 0.05)
            level = level_of_detail(H, descent, pitch, self._pad[0].texel_m, len(self._pad))
            self._draw_band(part, H, block, self._pad[level], samples, defocus, rolled)

    def _draw_band(
        self,
        part: U8,
        H: F64,
        block: Block,
        texture: TextureLevel,
        samples: int,
        defocus: float,
        rolled: RolledPlane | None,
    ) -> None:
        """Draw the pad into part of the image, whose block of rays has one more on every side."""
        to_texels = texture.from_pad() @ H
        straight = None
        if rolled is not None and samples == 1:
            rows, columns = (slice(s.start + 1, s.stop - 1) for s in block)
            straight = rolled.texels((rows, columns), to_texels)
        where: F32
        second: F32 | F64
        if rolled is not None and straight is not None:
            where, second = straight
            covered = self._covers(H, rolled.corners(block))
        else:
            rays = self._rays[block] if rolled is None else rolled.rays(block)
            where, second = _texels(rays, H, to_texels, samples), NO_SECOND_MAP
            covered = self._covers(H, rays)

        def sampled(source: U8) -> U8:
            seen = cast(U8, cv2.remap(source, where, second, cv2.INTER_LINEAR))
            if samples > 1:
                _defocus(seen, defocus * samples)
                size = (part.shape[1] + 2, part.shape[0] + 2)
                seen = cast(U8, cv2.resize(seen, size, interpolation=cv2.INTER_AREA)[1:-1, 1:-1])
            return seen

        grey = sampled(texture.grey)
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
        return Shadow(outlines, [1.0], EDGE_SOFTNESS_M * self._camera.fx / depth)

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


def _texels(rays: F32, H: F64, to_texels: F64, samples: int) -> F32:
    """Return where samples meet the texture (rows, columns, 2), from a block of rays.

    H leads from rays to the pad. More than one sample a pixel fill the whole block, one a pixel the
    block without its border.
    """
    if samples == 1:
        rays = np.ascontiguousarray(rays[1:-1, 1:-1])
    where = cv2.perspectiveTransform(rays, to_texels)
    corners = rays[:: rays.shape[0] - 1, :: rays.shape[1] - 1].reshape(-1, 2)
    plane = H[2].astype(np.float32)
    if (corners @ plane[:2] + plane[2]).min() < 0.02:
        # Rays that miss the plane would meet its mirror image behind the camera.
        where[rays @ plane[:2] + plane[2] <= 0.0] = -1e6
    if samples > 1:
        # Within a pixel the way from ray to texel is straight.
        size = (rays.shape[1] * samples, rays.shape[0] * samples)
        where = cv2.resize(where, size, interpolation=cv2.INTER_LINEAR)
    return cast(F32, where)


def _samples(box: tuple[int, int, int, int]) -> int:
    """Return the samples a pixel, along x and along y, of a pad in a box of the image."""
    left, top, right, bottom = box
    area = (right - left) * (bottom - top)
    return next((s for s in SAMPLINGS if s * s * area <= SAMPLE_BUDGET), 1)


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


def _rays(camera: CameraModel, x: F64, y: F64) -> F32:
    """Rays (rows, columns, 2) of the pixels at columns x and rows y."""
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    return camera.rays(pixels.reshape(-1, 2)).reshape(*pixels.shape).astype(np.float32)
