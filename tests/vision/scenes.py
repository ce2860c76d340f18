"""Test images of a pad: analytic, supersampled, slow and exact.

The image is formed as facts say a good small camera does it: reflectance times light, a Gaussian
point spread and the pixel's own box, then read-out noise. Nothing here is shared with the
detectors or with the simulator's renderer, so a mistake there cannot hide itself.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import CameraModel
from landerd.geometry import Vec3
from landerd.pad import Marker, PadLayout, Plate, Ring, Square, WhyCode

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
Mask = NDArray[np.bool_]
# Tells which points of a pad's plane (north, east, m) are on the plate, and which are white.
Paint = Callable[[F32, F32], tuple[Mask, Mask]]

_SAMPLES_AT_ONCE = 32768  # that fit in a core's cache
_KEPT = 4  # samples a pixel along each axis that are blurred; finer ones are averaged before
_RAYS_BEYOND_PX = 48  # round the image, kept from picture to picture

THESIS_PAD = PadLayout(
    name="thesis",
    markers=(
        Ring(kind="whycon", outer_diameter_m=1.0),
        Square(
            kind="apriltag",
            dictionary="APRILTAG_36h11",
            id=0,
            size_m=0.3125,
            position_m=(0.75, 0.0),
        ),
    ),
    plate=Plate(north_m=1.02, south_m=0.62, east_m=0.62, west_m=0.62),
)


def with_tag(**changes: object) -> PadLayout:
    """Return the thesis's pad with another tag."""
    ring, square = THESIS_PAD.markers
    return THESIS_PAD.model_copy(update={"markers": (ring, square.model_copy(update=changes))})


def alone(marker: Marker) -> PadLayout:
    """Return a pad of one marker, made exactly as its file says."""
    return PadLayout(
        name="alone",
        markers=(marker,),
        plate=THESIS_PAD.plate,
        print_scale_sigma=0.0,
        placement_sigma_m=0.0,
        flatness_deg=0.0,
    )


# The thesis camera's optics (eq. 3.1), and the same without distortion.
THESIS_CAMERA = CameraModel(
    640, 480, 398.2, 390.8, 299.9, 227.5, (0.0576, -0.0321, 0.0041, -0.0203, 0.0)
)
IDEAL_CAMERA = replace(THESIS_CAMERA, distortion=())


@dataclass(frozen=True)
class Shadow:
    """A straight shadow edge: light is multiplied by `factor` where (p - point) . normal > 0."""

    factor: float
    point_px: tuple[float, float]
    normal: tuple[float, float]


@dataclass(frozen=True)
class Bar:
    """A thin leg before the camera: a straight bar of one grey level through a point."""

    point_px: tuple[float, float]
    direction: tuple[float, float]
    width_px: float
    level: float


@dataclass(frozen=True)
class Optics:
    """Everything but geometry that forms the image."""

    white: float = 195.0
    black: float = 27.0
    noise: float = 3.0  # sigma, grey levels
    blur_px: float = 0.6  # sigma of the Gaussian point spread, besides the pixel's box
    gradient: tuple[float, float] = (0.0, 0.0)  # relative change of light across the image: x, y
    motion_px: tuple[float, float] = (0.0, 0.0)  # path of the image during exposure: x, y
    shadow: Shadow | None = None
    bar: Bar | None = None
    background: str = "fractal"  # "fractal", "grass", "asphalt" or "plain"


@dataclass(frozen=True)
class View:
    """Where the pad is: landing point (m) and axes (columns: north, east, down) in camera frame."""

    position: Vec3
    R_camera_pad: F64 = field(repr=False)

    @property
    def normal(self) -> F64:
        """Unit vector into the pad, (3,)."""
        return self.R_camera_pad[:, 2]


def look(
    camera: CameraModel,
    distance: float,
    tilt: float,
    *,
    pixel: tuple[float, float],
    tilt_towards: float = 0.0,
    heading: float = 0.0,
) -> View:
    """Return a view of a pad at a slant distance (m), its landing point at a pixel.

    `tilt` is the angle between the line of sight and the pad's normal, `tilt_towards` the
    direction in the image in which the pad recedes, `heading` turns the pad about its normal; rad.
    """
    x, y = _exact_rays(camera, np.array([pixel], dtype=np.float64))[0]
    sight = np.array([x, y, 1.0]) / math.sqrt(x * x + y * y + 1.0)
    across = np.array([math.cos(tilt_towards), math.sin(tilt_towards), 0.0])
    across -= sight * (across @ sight)
    across /= np.linalg.norm(across)
    normal = math.cos(tilt) * sight + math.sin(tilt) * across
    up = np.array([0.0, -1.0, 0.0])
    north = up - normal * (up @ normal)
    north /= np.linalg.norm(north)
    east = np.cross(normal, north)
    turned = math.cos(heading) * north + math.sin(heading) * east
    t = sight * distance
    axes = np.stack([turned, np.cross(normal, turned), normal], axis=1)
    return View((float(t[0]), float(t[1]), float(t[2])), axes)


def outline(view: View, camera: CameraModel, ring: Ring | WhyCode) -> F64:
    """Return 64 pixels (64, 2) on the outer edge of a ring."""
    a = np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False)
    r = ring.outer_diameter_m / 2
    p = np.stack([ring.position_m[0] + r * np.cos(a), ring.position_m[1] + r * np.sin(a)])
    points = np.array(view.position)[:, None] + view.R_camera_pad[:, :2] @ p
    return camera.pixels(points.T)


def in_view(view: View, camera: CameraModel, ring: Ring | WhyCode, margin_px: float = 2.0) -> bool:
    """Tell whether a ring lies wholly in the image."""
    p = outline(view, camera, ring)
    low, high = p.min(axis=0), p.max(axis=0)
    return bool(
        low.min() >= margin_px
        and high[0] <= camera.width - 1 - margin_px
        and high[1] <= camera.height - 1 - margin_px
    )


def render(
    view: View | None,
    camera: CameraModel,
    optics: Optics,
    rng: np.random.Generator,
    layout: PadLayout = THESIS_PAD,
    paint: Paint | None = None,
) -> U8:
    """Return the image (height, width) of a pad, or of its surroundings alone when view is None.

    What is on its plate is what the layout says, or what `paint` does.
    """
    h, w = camera.height, camera.width
    image = _background(optics, rng, (h, w))
    image *= _light(optics, *_pixels((h, w)))
    image = _blur(image, optics, 1.0, math.hypot(optics.blur_px, 0.29))
    if view is not None:
        _paint_pad(image, view, camera, optics, layout.plate, paint or partial(painted, layout))
    if optics.bar is not None:
        _paint_bar(image, optics.bar)
    image += rng.normal(0.0, optics.noise, (h, w))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def random_optics(rng: np.random.Generator) -> Optics:
    """Return light, contrast and background as the baselines' test set has them."""
    white = rng.uniform(150.0, 240.0)
    g = rng.uniform(0.0, 0.15) * np.array([math.cos(a := rng.uniform(0, 2 * math.pi)), math.sin(a)])
    return Optics(
        white=white,
        black=white * rng.uniform(0.08, 0.22),
        gradient=(float(g[0]), float(g[1])),
        background=str(rng.choice(["fractal", "grass", "asphalt", "plain"])),
    )


def random_view(
    rng: np.random.Generator,
    camera: CameraModel,
    distance: float,
    tilt: float,
    ring: Ring | WhyCode,
    *,
    centred: bool = False,
) -> View | None:
    """Return a random view with the ring wholly in the image; None where that seems impossible."""
    for attempt in range(200):
        if centred or attempt > 150:
            pixel = (camera.width / 2 + rng.uniform(-9, 9), camera.height / 2 + rng.uniform(-9, 9))
        else:
            pixel = (rng.uniform(0, camera.width - 1), rng.uniform(0, camera.height - 1))
        view = look(
            camera,
            distance,
            tilt,
            pixel=pixel,
            tilt_towards=rng.uniform(0, 2 * math.pi),
            heading=rng.uniform(0, 2 * math.pi),
        )
        if in_view(view, camera, ring):
            return view
    return None


def hard_negatives(
    rng: np.random.Generator, camera: CameraModel, ratio: float
) -> Iterator[tuple[str, U8]]:
    """Yield (what, image) without end: discs, ellipses, squares, and rings of another ratio."""
    h, w = camera.height, camera.width
    k = 8  # drawn k times too large
    while True:
        what = str(rng.choice(["disc", "square", "ring"]))
        size = float(np.exp(rng.uniform(math.log(10.0), math.log(200.0))))
        squeeze, angle = rng.uniform(0.4, 1.0), rng.uniform(0.0, 180.0)
        centre = rng.uniform([size, size], [w - size, h - size])
        # Another ratio is one that a person would tell apart: at least a fifth off.
        inner = rng.choice([rng.uniform(0.15, 0.8 * ratio), rng.uniform(1.25 * ratio, 0.85)])
        n = int(size * 1.8) + 4
        patch = np.zeros((n * k, n * k), np.uint8)
        c = n * k / 2

        def box(side: float, grey: int) -> None:
            corners = cv2.boxPoints(((c, c), (side * k, side * k * squeeze), angle))  # noqa: B023
            cv2.fillPoly(patch, [np.rint(corners).astype(np.int32)], grey)  # noqa: B023

        def ellipse(side: float, grey: int) -> None:
            cv2.ellipse(patch, ((c, c), (side * k, side * k * squeeze), angle), grey, -1)  # noqa: B023

        box(1.24 * size, 255)
        if what == "square":
            box(size, 1)
            if rng.random() < 0.5:
                box(ratio * size, 255)
        else:
            ellipse(size, 1)
            if what == "ring":
                ellipse(size * inner, 255)
        yield what, _stamp(patch, k, centre, random_optics(rng), rng, (h, w))


def _stamp(
    patch: U8,
    k: int,
    centre: F64,
    optics: Optics,
    rng: np.random.Generator,
    shape: tuple[int, int],
) -> U8:
    """Print a patch drawn k times too large on a random background, blur and add noise."""
    n = patch.shape[0] // k
    level = np.where(patch > 1, optics.white, np.where(patch > 0, optics.black, 0.0))
    few = (n * _KEPT, n * _KEPT)
    still = replace(optics, motion_px=(0.0, 0.0))
    cover, grey = (
        _seen(_few(layer.astype(np.float32), few), still, k, (n, n)) for layer in (patch > 0, level)
    )
    image = _background(optics, rng, shape)
    image = _blur(image, optics, 1.0, 0.66)
    x0, y0 = int(centre[0]) - n // 2, int(centre[1]) - n // 2
    ys, xs = slice(max(0, y0), min(shape[0], y0 + n)), slice(max(0, x0), min(shape[1], x0 + n))
    py, px = slice(ys.start - y0, ys.stop - y0), slice(xs.start - x0, xs.stop - x0)
    image[ys, xs] = image[ys, xs] * (1 - cover[py, px]) + grey[py, px]
    image *= _light(optics, *_pixels(shape))
    image += rng.normal(0.0, optics.noise, shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _pixels(shape: tuple[int, int]) -> tuple[F32, F32]:
    """Return x (1, columns) and y (rows, 1) of an image's pixels."""
    h, w = shape
    return np.arange(w, dtype=np.float32)[None, :], np.arange(h, dtype=np.float32)[:, None]


def _exact_rays(camera: CameraModel, pixels: F64) -> F64:
    """Undistort (n, 2) pixels by Newton-like iteration to convergence on camera.pixels."""
    centre, focal = np.array([camera.cx, camera.cy]), np.array([camera.fx, camera.fy])
    rays = (pixels - centre) / focal
    if camera.distortion:
        rays = camera.rays(pixels)
        for _ in range(20):
            seen = camera.pixels(np.column_stack([rays, np.ones(len(rays))]))
            rays = rays + (pixels - seen) / focal
            if float(np.abs(pixels - seen).max()) < 1e-6:
                break
    return cast(F64, rays)


def _light(optics: Optics, x: F32, y: F32) -> F32:
    light = 1.0 + optics.gradient[0] * (x / 320.0 - 1.0) + optics.gradient[1] * (y / 240.0 - 1.0)
    if optics.shadow is not None:
        (px, py), (nx, ny) = optics.shadow.point_px, optics.shadow.normal
        # A penumbra of about two pixels, as the sun's disc gives.
        side = 0.5 + 0.5 * np.tanh((x - px) * nx + (y - py) * ny)
        light = light * (1.0 - (1.0 - optics.shadow.factor) * side)
    return cast(F32, light.astype(np.float32))


def _blur(image: F32, optics: Optics, scale: float, sigma_px: float) -> F32:
    """Apply point spread and motion at `scale` samples a pixel."""
    out = cv2.GaussianBlur(image, (0, 0), sigma_px * scale, borderType=cv2.BORDER_REPLICATE)
    length = math.hypot(*optics.motion_px) * scale
    if length > 0.0:
        n = math.ceil(length) // 2 * 2 + 5
        kernel = np.zeros((n, n), np.float32)
        steps = np.linspace(-0.5, 0.5, 16 * n)
        xs = n // 2 + steps * optics.motion_px[0] * scale
        ys = n // 2 + steps * optics.motion_px[1] * scale
        x0, y0 = np.floor(xs).astype(int), np.floor(ys).astype(int)
        fx, fy = xs - x0, ys - y0
        for dx, dy, wgt in (
            (0, 0, (1 - fx) * (1 - fy)),
            (1, 0, fx * (1 - fy)),
            (0, 1, (1 - fx) * fy),
            (1, 1, fx * fy),
        ):
            np.add.at(kernel, (y0 + dy, x0 + dx), wgt)
        out = cv2.filter2D(out, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    return cast(F32, out)


def _seen(layer: F32, optics: Optics, drawn: int, size: tuple[int, int]) -> F32:
    """Return what a lens and pixels see of a layer of _KEPT samples a pixel, each a mean of more.

    Args:
        layer: as it was drawn with `drawn` samples a pixel along each axis, and averaged.
        optics: blur by their point spread, less what averaging did, and by their motion.
        drawn: samples a pixel.
        size: columns and rows of pixels.
    """
    averaged = (1.0 - (_KEPT / drawn) ** 2) / (12.0 * _KEPT**2)  # variance, pixels^2
    soft = _blur(layer, optics, _KEPT, math.sqrt(optics.blur_px**2 - averaged))
    return _few(soft, size)


def _few(layer: F32, size: tuple[int, int]) -> F32:
    """Return means of a layer's samples, so many columns and rows of them."""
    return cast(F32, cv2.resize(layer, size, interpolation=cv2.INTER_AREA))


def _background(optics: Optics, rng: np.random.Generator, shape: tuple[int, int]) -> F32:
    h, w = shape
    base = rng.uniform(40.0, 150.0)
    if optics.background == "plain":
        return np.full(shape, base, np.float32)
    if optics.background == "fractal":
        image = np.zeros(shape, np.float32)
        for octave in range(7):
            n = 2 ** (octave + 1)
            grid = rng.normal(0.0, 1.0, (n * 3 // 4 + 2, n + 2)).astype(np.float32)
            image += cv2.resize(grid, (w, h), interpolation=cv2.INTER_CUBIC) * 25.0 * 0.7**octave
        return cast(F32, np.clip(base + image, 5.0, 230.0).astype(np.float32))
    fine = rng.normal(0.0, 1.0, shape).astype(np.float32)
    if optics.background == "grass":
        blades = cv2.GaussianBlur(fine, (0, 0), sigmaX=0.7, sigmaY=2.2)
        image = base + 20.0 * blades / blades.std()
    else:
        patches = cv2.GaussianBlur(rng.normal(0.0, 1.0, shape).astype(np.float32), (0, 0), 12.0)
        image = base + 10.0 * fine + 8.0 * patches / patches.std()
    return cast(F32, np.clip(image, 5.0, 230.0).astype(np.float32))


def _paint_pad(
    image: F32, view: View, camera: CameraModel, optics: Optics, plate: Plate, paint: Paint
) -> None:
    """Lay the pad over the background, in place."""
    corners = np.array(
        [
            (n, e)
            for n in np.linspace(-plate.south_m, plate.north_m, 9)
            for e in np.linspace(-plate.west_m, plate.east_m, 9)
        ]
    )
    points = np.array(view.position) + corners @ view.R_camera_pad[:, :2].T
    points = points[points[:, 2] > 0.05 * np.linalg.norm(view.position)]
    px = camera.pixels(points)
    spread = 4.0 + 3.0 * optics.blur_px + math.hypot(*optics.motion_px)
    x0, y0 = np.maximum(np.floor(px.min(axis=0) - spread), 0).astype(int)
    x1, y1 = np.ceil(px.max(axis=0) + spread).astype(int) + 1
    x1, y1 = min(int(x1), camera.width), min(int(y1), camera.height)
    if x1 <= x0 or y1 <= y0:
        return
    extent = max(x1 - x0, y1 - y0)
    ss = 16 if extent < 60 else 8 if extent < 200 else 4
    pad = int(spread) + 1  # blur needs what lies just outside the image
    albedo, cover = _sample(
        view, camera, optics, paint, (x0 - pad, y0 - pad, x1 + pad, y1 + pad), ss
    )
    size = (x1 - x0 + 2 * pad, y1 - y0 + 2 * pad)
    grey, hidden = (_seen(layer, optics, ss, size)[pad:-pad, pad:-pad] for layer in (albedo, cover))
    region = image[y0:y1, x0:x1]
    region *= 1.0 - hidden
    region += grey


def _sample(
    view: View,
    camera: CameraModel,
    optics: Optics,
    paint: Paint,
    box: tuple[int, int, int, int],
    ss: int,
) -> tuple[F32, F32]:
    """Return lit grey level and cover of the pad, means of ss x ss samples a pixel of the box."""
    x0, y0, x1, y1 = box
    R = view.R_camera_pad
    to_plane = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], np.array(view.position)]))
    vx, vy = _ray_grid(camera, (x0 - 1, y0 - 1, x1 + 1, y1 + 1))
    # The lens map bends by 1e-7 over a pixel: linear between pixel centres is exact enough.
    planes = [h[0] * vx + h[1] * vy + h[2] for h in to_plane]
    px = (x0 + (np.arange((x1 - x0) * ss) + 0.5) / ss - 0.5).astype(np.float32)
    py = (y0 + (np.arange((y1 - y0) * ss) + 0.5) / ss - 0.5).astype(np.float32)
    is_lit_evenly = optics.gradient == (0.0, 0.0) and optics.shadow is None
    columns = (x1 - x0) * _KEPT
    grey = np.empty(((y1 - y0) * _KEPT, columns), np.float32)
    cover = np.empty_like(grey)
    strip = max(1, _SAMPLES_AT_ONCE // (len(px) * ss))
    for top in range(0, y1 - y0, strip):
        bottom = min(top + strip, y1 - y0)
        q = [_between(plane[top : bottom + 2], ss) for plane in planes]
        ahead = q[2] > 1e-9  # the inverse of the depth
        inverse = 1.0 / np.where(ahead, q[2], 1.0)
        north, east = (q[0] * inverse).astype(np.float32), (q[1] * inverse).astype(np.float32)
        on_plate, white = paint(north, east)
        covered = (on_plate & ahead).astype(np.float32)
        level = np.where(white, np.float32(optics.white), np.float32(optics.black)) * covered
        if not is_lit_evenly:
            level *= _light(optics, px[None, :], py[top * ss : bottom * ss, None])
        few, rows = (columns, (bottom - top) * _KEPT), slice(top * _KEPT, bottom * _KEPT)
        grey[rows] = _few(level, few)
        cover[rows] = _few(covered, few)
    return grey, cover


def _between(grid: F64, ss: int) -> F64:
    """Return ss x ss samples a pixel of what is linear between pixel centres, without the rim."""
    at = (np.arange((len(grid) - 2) * ss) + 0.5) / ss + 0.5
    i = np.floor(at).astype(int)
    f = (at - i)[:, None]
    rows = grid[i] * (1.0 - f) + grid[i + 1] * f
    wide = (grid.shape[1] * ss, len(rows))
    return cast(F64, cv2.resize(rows, wide, interpolation=cv2.INTER_LINEAR)[:, ss:-ss])


def painted(layout: PadLayout, north: F32, east: F32) -> tuple[Mask, Mask]:
    """Tell which points of the pad's plane (m) are on the plate, and which of those are white."""
    plate = layout.plate
    on_plate = (
        (north < plate.north_m)
        & (north > -plate.south_m)
        & (east < plate.east_m)
        & (east > -plate.west_m)
    )
    white = np.ones(north.shape, dtype=bool)
    for marker in layout.markers:
        dn, de = north - np.float32(marker.position_m[0]), east - np.float32(marker.position_m[1])
        if isinstance(marker, Ring):
            r2 = (dn * dn + de * de) / np.float32((marker.outer_diameter_m / 2) ** 2)
            # The inner disc is printed too: a ring inside a ring's disc stays visible.
            white &= ~((r2 < 1.0) & (r2 > marker.inner_ratio**2))
        elif isinstance(marker, WhyCode):
            white &= ~_whycode_black(marker, dn, de)
        else:
            white &= ~_square_black(marker, dn, de)
    return on_plate, white


def _ray_grid(camera: CameraModel, box: tuple[int, int, int, int]) -> F64:
    """Return the rays (2, rows, columns) of the pixels in a box that may reach out of the image."""
    x0, y0, x1, y1 = box
    m = _RAYS_BEYOND_PX
    if min(x0, y0) < -m or x1 > camera.width + m or y1 > camera.height + m:
        return _rays_in(camera, box)
    whole = _rays_in(camera, (-m, -m, camera.width + m, camera.height + m))
    return whole[:, y0 + m : y1 + m, x0 + m : x1 + m]


@lru_cache(maxsize=4)
def _rays_in(camera: CameraModel, box: tuple[int, int, int, int]) -> F64:
    gx, gy = np.meshgrid(np.arange(box[0], box[2]), np.arange(box[1], box[3]))
    grid = np.column_stack([gx.ravel(), gy.ravel()]).astype(np.float64)
    return _exact_rays(camera, grid).reshape(*gx.shape, 2).transpose(2, 0, 1)


def _square_black(marker: Square, north: F32, east: F32) -> Mask:
    black = (~marker_cells(marker)).astype(np.uint8)
    a = math.radians(marker.heading_deg)
    up = north * math.cos(a) + east * math.sin(a)
    right = east * math.cos(a) - north * math.sin(a)
    n = len(black)
    row = (0.5 - up / marker.size_m) * n - 0.5  # 0: the middle of the first cell
    column = (0.5 + right / marker.size_m) * n - 0.5
    return np.asarray(cv2.remap(black, column, row, cv2.INTER_NEAREST) > 0)


def _whycode_black(code: WhyCode, north: F32, east: F32) -> Mask:
    """Tell black from white as whycode-gen draws: radii of 240, 420 and 700 units, sectors."""
    radius = np.hypot(north, east) / (code.outer_diameter_m / 2) * 700.0
    black: Mask = (radius > 420.0) & (radius < 700.0)
    band = (radius > 240.0) & (radius <= 420.0)
    # Where the upright print has the point: its own angle from three o'clock, anticlockwise.
    turn = np.degrees(np.arctan2(north[band], east[band])) + code.heading_deg
    width = 360.0 / code.bits / 2.0
    half = np.floor(turn % 360.0 / width).astype(np.int64) % (2 * code.bits)
    bits = np.array([int(c) for c in f"{code.id:0{code.bits}b}"])
    black[band] = half % 2 == bits[half // 2]
    return black


def marker_cells(marker: Square) -> NDArray[np.bool_]:
    """Return the printed cells (n, n), True white, black border included, top row first."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{marker.dictionary}"))
    n = dictionary.markerSize + 2
    cells = cv2.aruco.generateImageMarker(dictionary, marker.id, n, borderBits=1) > 127
    # OpenCV draws AprilTags upside down against the AprilTag project's prints.
    return np.rot90(cells, 2) if marker.kind == "apriltag" else cells


def _paint_bar(image: F32, bar: Bar) -> None:
    h, w = image.shape
    x, y = _pixels((h, w))
    length = math.hypot(*bar.direction)
    off = (
        (x - bar.point_px[0]) * bar.direction[1] - (y - bar.point_px[1]) * bar.direction[0]
    ) / length
    cover = np.clip(0.5 + bar.width_px / 2 - np.abs(off), 0.0, 1.0)
    image += cover * (bar.level - image)
