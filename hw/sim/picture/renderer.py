"""Draws what the simulated camera sees: pad, ground, sky, shadows, and the vehicle's own legs.

Every picture is a pure function of its arguments and the seed. Edges of the pad are exact to a few
hundredths of a pixel, on which the pose at 20 to 30 m depends: the rays of all pixels are
undistorted once, mapped to the pad's plane by a homography, and sample a texture of exact area
averages, with several samples per pixel if the pad is small.
"""

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.camera_options import SimCameraOptions
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.ground import Ground
from hw.sim.picture.pad_view import PadView, SeenPad
from hw.sim.picture.sensor import Sensor
from hw.sim.picture.shade import ShadowEdge
from hw.sim.picture.shutter import EVERYTHING, Readout, RolledPlane, RowGrid
from hw.sim.picture.vehicle import draw_legs, shade, vehicle_shadow
from hw.sim.picture.view import (
    F64,
    Frustum,
    blur,
    in_camera,
    middle,
    plane_homography,
    rays_at,
)
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import CameraModel
from landerd.geometry import IDENTITY
from landerd.pad import PadLayout

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

# Least sigma of the spot that is moved along a motion's path, so that whole pixels sample it well.
MOTION_SPOT_PX = 0.3
STILL_PX = 0.15  # a shorter path of the image during the exposure is neglected
# Sigma from which on the image is blurred by rows and columns before the spot is moved.
WIDE_SPOT_PX = 1.5


class Renderer:
    """Draws grey pictures of one pad through one camera."""

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        options: RenderOptions,
        seed: int,
        sensor: SimCameraOptions | None = None,
        pad: PadOptions | None = None,
    ) -> None:
        """Prepare rays, textures and noise, in about 0.2 s.

        Args:
            layout: of the pad as it was printed.
            camera: the true camera.
            options: scene, light and noise.
            seed: of all that is random.
            sensor: from light to picture; None: an ideal sensor.
            pad: where the pad starts, and the state of its print; None: a clean one at the origin.

        Raises:
            ValueError: the layout names a marker that does not exist, or the ground's photograph
                cannot be read.
        """
        sensor = sensor or SimCameraOptions()
        pad = pad or PadOptions(position_m=(0.0, 0.0))
        self._camera = camera
        self._options = options
        self._frustum = Frustum(camera)
        # One more ray beyond each border, so that rays between pixels can be interpolated there.
        x, y = np.arange(-1.0, camera.width + 1), np.arange(-1.0, camera.height + 1)
        self._pad = PadView(layout, pad, options, self._frustum, rays_at(camera, x, y), seed)
        self._ground = Ground(options, camera, layout, seed, pad.position_m)
        self._grid: RowGrid | None = None
        if sensor.readout_s > 0.0 or sensor.vibration.deg > 0.0:
            self._grid = RowGrid(camera, x, y)
            self._ground_grid = RowGrid(camera, self._ground.plane.x, self._ground.plane.y)
        self._shadow_edge = ShadowEdge(options, camera) if options.shadow_edge else None
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
        """Return the picture (height, width) of one exposure.

        Args:
            frame_index: of the picture, which determines its noise.
            start: pose of the camera at the start of the exposure, relative to the pad where it is
                at the middle: the blur of a moving pad is that of the relative motion.
            end: the same for the end of the exposure.
            pad: its pose at the middle of the exposure.
            vehicle: for its legs and shadow; None: neither is drawn.
            exposure: time and gain; None: those that the illumination is set for.
            readout: poses while the rows are read, for a renderer whose sensor is read row by row
                or shakes; `start` and `end` are then those of the middle row. None: all rows are
                exposed at once.
        """
        options = self._options
        pose = middle(start, end)
        motion = self._motion(start, end, pose, pad)
        moves = math.hypot(*motion) >= STILL_PX
        spot = MOTION_SPOT_PX if moves else 0.0
        unsharp = options.defocus_px
        if readout is not None:
            unsharp = math.hypot(unsharp, self._camera.fx * readout.shaking)
        defocus = math.sqrt(max(unsharp**2 - spot**2, 0.0))
        image, is_sharp = self._background(pose, pad, defocus, readout)
        if options.vehicle_shadow and vehicle is not None:
            plane = self._shaded_plane(vehicle, pad)
            shadow = vehicle_shadow(self._frustum, pose, vehicle, plane, self._sunlight)
            if shadow is not None:
                shade(image, shadow, options.shadow_darkness)
        if self._shadow_edge is not None:
            self._shadow_edge.darken(image, pose, pad)
        sigma = unsharp if is_sharp else 0.0
        if moves:
            image = drawn_out(image, sigma, float(motion[0]), float(motion[1]))
        else:
            blur(image, sigma)
        if options.legs and vehicle is not None:
            draw_legs(image, self._frustum, pose, vehicle)
        return self._sensor.expose(image, frame_index, exposure)

    def brightness(self, image: U8) -> float:
        """Return the mean of a picture, share of full scale."""
        return cv2.mean(image)[0] / 255.0

    # ---- pad and ground ------------------------------------------------------------------------

    def _background(
        self, pose: CameraPose, pad: PadPose, defocus: float, readout: Readout | None
    ) -> tuple[U8, bool]:
        """Return the picture of the ground and the pad, and whether it is still to be blurred.

        `defocus` is the sigma of the blur, px, that is applied already if the pad is small.
        """
        seen = self._pad.seen(pose, pad, readout, self._grid)
        if seen is not None and seen.fills:
            image = np.empty((self._camera.height, self._camera.width), np.uint8)
        else:
            image = self._draw_ground(pose, readout)
            if seen is None:
                return image, True
            if seen.samples > 1:
                blur(image, defocus)
        self._pad.draw(image, seen, defocus, self._leaf_light(pose, pad, seen))
        return image, seen.samples == 1

    def _draw_ground(self, pose: CameraPose, readout: Readout | None) -> U8:
        """Draw the ground and the sky."""
        level = PadPose((0.0, 0.0, self._options.ground_down_m), IDENTITY)
        H = plane_homography(pose, level)
        if H is None or readout is None:
            return self._ground.draw(H)
        grid = self._ground_grid
        rolled = RolledPlane(grid, H, readout.homographies(grid, level, None))
        return self._ground.draw(H, rolled.rays(EVERYTHING))

    def _leaf_light(self, pose: CameraPose, pad: PadPose, seen: SeenPad) -> U8 | None:
        """Return the light under leaves in the pad's box, (rows, columns), 255 is full light.

        None: there are no leaves, or the camera is not above the pad.
        """
        leaves = self._ground.leaves
        if leaves is None:
            return None
        left, top, right, bottom = seen.box
        step = leaves.step(pose, pad, self._camera.fx)
        light = leaves.on_pad(pose, pad, self._sunlight, seen.rays(step), step / self._camera.fx)
        if light is None:
            return None
        whole = cv2.resize(light, None, fx=step, fy=step, interpolation=cv2.INTER_LINEAR)
        return cast(U8, whole[: bottom - top, : right - left])

    # ---- shadows and blur ----------------------------------------------------------------------

    def _shaded_plane(self, vehicle: VehiclePose, pad: PadPose) -> PadPose:
        """Return the plane on which the vehicle's shadow falls: the pad's, or the ground."""
        R = np.array(pad.R_local_pad).T
        light = R @ self._sunlight
        n, e, d = R @ (np.array(vehicle.position) - np.array(pad.position))
        if light[2] > 0.05 and self._pad.holds(
            n - d * light[0] / light[2], e - d * light[1] / light[2]
        ):
            return pad
        return PadPose((0.0, 0.0, self._options.ground_down_m), IDENTITY)

    def _motion(self, start: CameraPose, end: CameraPose, pose: CameraPose, pad: PadPose) -> F64:
        """Return the path (2,), px, of the landing point in the image during the exposure.

        If the landing point is out of view, it is the path of a point in the middle of the image.
        """
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


def drawn_out(image: U8, sigma: float, dx: float, dy: float) -> U8:
    """Return an image blurred by a Gaussian and by motion along (dx, dy), px; may change the image.

    A `sigma` of the Gaussian below MOTION_SPOT_PX counts as that.
    """
    if sigma >= WIDE_SPOT_PX:
        # Variances of blurs add up; one kernel for a wide spot would take ten times as long.
        blur(image, math.sqrt(sigma**2 - MOTION_SPOT_PX**2))
        sigma = MOTION_SPOT_PX
    kernel = motion_kernel(max(sigma, MOTION_SPOT_PX), dx, dy)
    return cast(U8, cv2.filter2D(image, -1, kernel))


def motion_kernel(sigma: float, dx: float, dy: float) -> F32:
    """Return the kernel of a Gaussian blur, sigma in px, and motion along (dx, dy), px.

    Both its sides are odd, and its sum is 1.
    """
    steps = max(math.ceil(2 * math.hypot(dx, dy)), 2)
    t = (np.arange(steps) + 0.5) / steps - 0.5

    def spots(way: float) -> F64:
        # Pixels beyond 2.2 sigma would each get less than 0.5 % of the spot's light.
        radius = max(round(2.2 * sigma + abs(way) / 2), 1)
        distances = np.arange(-radius, radius + 1.0)[:, None] - t * way
        return cast(F64, np.exp(-(distances**2) / (2 * sigma**2)))

    kernel = spots(dy) @ spots(dx).T
    return cast(F32, (kernel / kernel.sum()).astype(np.float32))
