"""What the camera sees of its own vehicle: the legs, and the shadow on pad and ground.

The airframe is a small quadcopter whose legs spread from under the body to the feet at the corners
of the footprint. Legs and shadow hide the square marker if the heading is wrong (thesis 2.4.5).
"""

import functools
import math
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.view import F64, Frustum, in_camera, matrix
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose

U8 = NDArray[np.uint8]

LEG_GREY = 22  # grey level of the legs
LEG_RADIUS_M = 0.006
FOOT_RADIUS_M = 0.011
HULL_RADIUS_M = 0.09
ARM_RADIUS_M = 0.015
ROTOR_RADIUS_M = 0.12
ROTOR_OFFSET_M = 0.19  # of the hubs from the centre, along x and along y
ROTOR_SHARE = 0.35  # light that a turning rotor blocks, over that of a solid part
REACH_M = 0.6  # no part of the vehicle is farther from its centre
SUN_SPREAD = 0.0023  # standard deviation of the sun's disc of 0.53 degrees along one axis, rad
SUBPIXEL_BITS = 4  # fractional bits of the coordinates that OpenCV draws at

_CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
_OCTAGON = np.array([[math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)] for k in range(8)])
_HUBS = np.column_stack([ROTOR_OFFSET_M * _CORNERS, np.full(4, -0.03)])
_FLAT = np.column_stack([_OCTAGON, np.zeros(8)])
# Outlines of rotors and hull, then the hubs, in the body frame.
_DISCS = np.concatenate(
    [*(hub + ROTOR_RADIUS_M * _FLAT for hub in _HUBS), HULL_RADIUS_M * _FLAT, _HUBS]
)


@dataclass(frozen=True)
class Shadow:
    """The vehicle's shadow on a plane as the camera sees it."""

    polygons: list[F64]  # convex outlines (n, 2), px
    shares: list[float]  # share of the sun's light that each blocks, the smallest first
    sigma_px: float  # sigma of the blur of the edges


def draw_legs(image: U8, frustum: Frustum, pose: CameraPose, vehicle: VehiclePose) -> None:
    """Draw the legs, thick dark lines with rounded feet, into an image."""
    points = in_camera(pose, _in_local(vehicle, np.concatenate(_legs(vehicle))))
    hips, feet = points[:4], points[4:]
    # From the lens a thin rod looks like a flat strip across the line of sight, a ball like a disc.
    across = _unit(_cross(hips, feet))
    second = _unit(_cross(across, feet))
    r = LEG_RADIUS_M * across
    rods = np.stack([hips - r, hips + r, feet + r, feet - r], axis=1)
    discs = feet[:, None] + FOOT_RADIUS_M * (_OCTAGON @ np.stack([across, second], axis=1))
    for outline in frustum.outlines([*rods, *discs]):
        fill(image, outline, LEG_GREY)


def vehicle_shadow(
    frustum: Frustum, pose: CameraPose, vehicle: VehiclePose, plane: PadPose, sunlight: F64
) -> Shadow | None:
    """Return the vehicle's shadow on a plane; None: it is out of sight.

    Args:
        frustum: of the camera.
        pose: of the camera.
        vehicle: its pose and landing gear.
        plane: pose of the plane.
        sunlight: unit vector (3,) along which sunlight travels, local NED.
    """
    to_plane = matrix(plane.R_local_pad).T
    light = to_plane @ sunlight
    middle = to_plane @ (np.array(vehicle.position) - np.array(plane.position))
    if light[2] < 0.05 or middle[2] > 0.0:
        return None
    way = -middle[2] / light[2]
    foot = np.array(vehicle.position) + way * sunlight
    centre = in_camera(pose, foot[None])[0]
    if not frustum.touches(centre, REACH_M / light[2]):
        return None

    def thrown(points: F64) -> F64:
        """Return where points (n, 3) of the body throw their shadow on the plane, m, (n, 2)."""
        p = (_in_local(vehicle, points) - np.array(plane.position)) @ to_plane.T
        return cast(F64, p[:, :2] - p[:, 2:] * (light[:2] / light[2]))

    ends = thrown(np.concatenate([_DISCS, *_legs(vehicle)]))
    hub, hip, tip = ends[40:44], ends[44:48], ends[48:52]
    hull = np.broadcast_to(ends[32:40].mean(axis=0), hub.shape)
    strips = [_strips(hull, hub, ARM_RADIUS_M), _strips(hip, tip, LEG_RADIUS_M)]
    stacked = np.concatenate([ends[:40], *(each.reshape(-1, 2) for each in strips)])
    local = np.column_stack([stacked, np.zeros(len(stacked))]) @ to_plane
    seen = in_camera(pose, local + np.array(plane.position))
    # Five discs of eight corners, then eight strips of four.
    polygons = frustum.outlines([*seen[:40].reshape(5, 8, 3), *seen[40:].reshape(8, 4, 3)])
    shares = [ROTOR_SHARE] * 4 + [1.0] * (len(polygons) - 4)
    sigma = SUN_SPREAD * way * frustum.camera.fx / max(float(centre[2]), 0.1)
    return Shadow(polygons, shares, sigma)


def shade(image: U8, shadow: Shadow, darkness: float) -> None:
    """Darken an image where the shadow falls.

    Args:
        image: (height, width); changed.
        shadow: of the vehicle.
        darkness: the sun's share of the light, 0 to 1.
    """
    if not sum(len(p) for p in shadow.polygons):
        return
    everything = np.concatenate(shadow.polygons)
    rows, columns = image.shape
    sigma = min(max(shadow.sigma_px, 0.3), 12.0)
    margin = 3 * sigma + 2
    left, top = np.maximum(np.floor(everything.min(axis=0) - margin), 0).astype(int)
    right, bottom = np.ceil(everything.max(axis=0) + margin).astype(int) + 1
    part = image[top : min(bottom, rows), left : min(right, columns)]
    if not part.size:
        return
    light = np.full(part.shape, 255, np.uint8)
    for polygon, share in zip(shadow.polygons, shadow.shares, strict=True):
        fill(light, polygon - (left, top), round(255 * (1 - darkness * share)))
    size = 2 * math.ceil(2.5 * sigma) + 1
    cv2.GaussianBlur(light, (size, size), sigma, dst=light, borderType=cv2.BORDER_REPLICATE)
    cv2.multiply(part, light, dst=part, scale=1 / 255)


def fill(image: U8, polygon: F64, grey: int) -> None:
    """Fill a convex polygon (n, 2), px, with a grey level and smooth edges."""
    if len(polygon) >= 3:
        points = np.rint(polygon * 2**SUBPIXEL_BITS).astype(np.int32)
        cv2.fillConvexPoly(image, points, (float(grey),), cv2.LINE_AA, SUBPIXEL_BITS)


def _legs(vehicle: VehiclePose) -> tuple[F64, F64]:
    """Return the upper ends (4, 3) and the feet (4, 3) of the legs, body frame, m."""
    return _legs_of(vehicle.footprint_m, vehicle.gear_height_m)


@functools.cache
def _legs_of(footprint_m: tuple[float, float], gear_height_m: float) -> tuple[F64, F64]:
    size = np.array(footprint_m)
    feet = np.column_stack([_CORNERS * size / 2, np.full(4, gear_height_m)])
    hips = np.column_stack([_CORNERS * size / 5, np.full(4, 0.02)])
    return hips, feet


def _in_local(vehicle: VehiclePose, points: F64) -> F64:
    """Return points (n, 3) of the body frame in the local frame."""
    return cast(F64, points @ matrix(vehicle.R_local_body).T + np.array(vehicle.position))


def _strips(a: F64, b: F64, radius: float) -> F64:
    """Return rectangles (n, 4, 2) of the width 2 * radius from points a to points b, (n, 2)."""
    along = _unit(b - a)
    r = radius * np.column_stack([-along[:, 1], along[:, 0]])
    return np.stack([a - r, a + r, b + r, b - r], axis=1)


def _cross(a: F64, b: F64) -> F64:
    """Return the vector products (n, 3) of rows; np.cross takes four times as long for few."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _unit(vectors: F64) -> F64:
    """Return vectors (n, k) scaled to length 1; null vectors stay null."""
    lengths = np.sqrt((vectors * vectors).sum(axis=1, keepdims=True))
    return cast(F64, vectors / np.maximum(lengths, 1e-12))
