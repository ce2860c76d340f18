"""The stages of a ring's fit: rough, full, behind a response, tracked, and with shadow or motion.

Each stage chooses the pixels, the starts (both poses of the ellipse) and the effort for
`ring_fit.fit_ring`. `ring_search` and `whycon.track_ring` decide which stage comes next, by the
checks of `ring_checks`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.pad import Ring
from landerd.vision.arrays import U8, Mask
from landerd.vision.patch import whole_in_picture
from landerd.vision.pyramid import Level
from landerd.vision.ring_checks import is_dark_in_white, may_be_ring
from landerd.vision.ring_edges import moved_px, points_on
from landerd.vision.ring_fit import RingFit, fit_ring
from landerd.vision.ring_light import evenly_lit
from landerd.vision.ring_pixels import edge_pixels, pixels_near
from landerd.vision.ring_pose import CirclePose, mirrored, poses_through
from landerd.vision.ring_residuals import coherent_residual
from landerd.vision.ring_response import LINEAR_RESPONSE
from landerd.vision.ring_segment import Candidate


@dataclass(frozen=True)
class _Effort:
    """What a fit may cost."""

    pixels: int  # about
    steps: int  # at most


_ROUGH = _Effort(180, 3)  # in a reduced image, to be fitted again
_FULL = _Effort(560, 8)
_RESPONSE = _Effort(560, 6)
_SHADED = _Effort(700, 8)
_MOVING = _Effort(560, 6)
# With three steps 53 of 60 rings were found from poses a pixel off, with four all.
_TRACKED = _Effort(200, 4)

# Half width of the band about an edge in which pixels are taken, px.
_ROUGH_BAND_PX = 3.0
_FULL_BAND_PX, _BAND_BLURS = 2.0, 2.0  # the larger of the first and the second times the blur
_SHADED_BAND_PX = 3.5  # wide enough to contain pixels that are purely white
_MOVING_BAND_PX, _BAND_PATHS = 2.0, 0.6  # the sum of the first and the second times the path
TRACKED_BAND_PX = 4.0  # how far edges may be from where they are expected

# Lines across a ring's edges on which a start is moved onto the outer one: their number, their
# reach to either side, a share of the stroke's width, and the least rise, a share of the median.
_SPOKES, _REACH, _LEAST_RISE = 16, 0.3, 0.5
# What a fit starts from where nothing is known.
_BLUR_PX, _MOVING_BLUR_PX = 1.0, 0.7  # sigma
_PATH_PX, _PATH_BLURS = 3.0, 2.5  # path of a motion: the longer of the first and so many blurs
_PATH_DIRECTIONS = 4

MAX_TILT_COS = math.cos(math.radians(25.0))  # pads that lean more are not landed on
# Number of pixels that have the coherent part of their residuals in common, behind a response, in
# shadow or in motion, or beside clipped white; motion adds those of its path.
_ALIKE_PIXELS = 4.0
_SHADOW_ROUNDS = 2  # the better the pose, the better the shadow's edge is found
# A ring that the image's edge cuts is fitted again, at most so many times, if it moved by more than
# this, px: the pixels were chosen for another pose. Without that two of 35 were 1 and 3 per cent of
# the range off, with a tenth of that as their sigma.
_REFIT_PX, _MOST_REFITS = 1.0, 3


@dataclass(frozen=True)
class Start:
    """Where the fit of a ring to the whole image starts."""

    pose: CirclePose
    blur_px: float  # of that image


def start_at_outline(
    image: U8, camera: CameraModel, level: Level, candidate: Candidate, ring: Ring
) -> Start | None:
    """Return the pose of a candidate's outline, moved onto the outer edge that is seen near it.

    None: no ring has such an outline.
    """
    poses = poses_through(level.camera.rays(candidate.outline.points()), ring.radius_m)
    if poses is None:
        return None
    if level.reduction == 1.0:
        return Start(poses[0], _BLUR_PX)
    (_, normal), edge = _on_edge(image, camera, ring, poses, level.reduction)
    moved = poses_through(camera.rays(edge), ring.radius_m)
    if moved is None:
        return None
    return Start(max(moved, key=lambda pose: float(pose[1] @ normal)), _BLUR_PX)


def _on_edge(
    image: U8, camera: CameraModel, ring: Ring, poses: Sequence[CirclePose], reach_px: float
) -> tuple[CirclePose, F64]:
    """Return the likelier pose of an ellipse, and points (n, 2), px, of the outer edge near it.

    Both poses have the same outer edge, but not the same inner one. A fit that starts from the
    wrong one, with pixels chosen about it, may keep to the outer edge alone, which a tone curve
    shifts.
    """
    radii = ring.radius_m, ring.radius_m * ring.inner_ratio
    circles = np.array([edge_pixels(camera, pose, radii, _SPOKES) for pose in poses])
    outer, inner = circles.swapaxes(0, 1)
    across = outer - inner
    width = np.sqrt((across * across).sum(axis=-1))
    across /= width[..., None]
    reach = min(reach_px, _REACH * float(width.min()))
    steps = np.linspace(-reach, reach, 2 * math.ceil(reach) + 1)
    lines = steps[:, None] * across[:, :, None]
    at = np.array([outer[:, :, None] + lines, inner[:, :, None] - lines], dtype=np.float32)
    u, v = np.moveaxis(at.reshape(-1, len(steps), 2), -1, 0).copy()
    levels = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rises, is_seen = _rises(np.asarray(levels, dtype=np.uint8), steps)
    of_outer, of_inner = rises.reshape(2, -1, _SPOKES)
    # A wrong inner edge makes the stroke wider on one side than on the other.
    wider = of_outer + of_inner
    wider -= wider.mean(axis=1, keepdims=True)
    missed = _SPOKES - is_seen.reshape(2, -1, _SPOKES).all(axis=0).sum(axis=1)
    best = int(((wider * wider).sum(axis=1) + missed * reach * reach).argmin())
    return poses[best], outer[best] + of_outer[best, :, None] * across[best]


def _rises(levels: U8, steps: F64) -> tuple[F64, Mask]:
    """Return where each row of levels (n, m) has risen half way, in `steps` (m,), and if it has.

    Both are (n,); the first is 0 where it has not.
    """
    low, high = levels.min(axis=1).astype(np.float64), levels.max(axis=1)
    middle, rise = 0.5 * (low + high), high - low
    is_after = levels > middle[:, None]
    is_after &= np.arange(len(steps)) > levels.argmin(axis=1)[:, None]
    after, each = is_after.argmax(axis=1), np.arange(len(levels))
    bright = levels[each, after].astype(np.float64)
    share = (bright - middle) / np.maximum(bright - levels[each, after - 1], 1.0)
    is_seen = is_after.any(axis=1) & (rise > _LEAST_RISE * np.sort(rise)[len(rise) // 2])
    return np.where(is_seen, steps[after] - share * (steps[1] - steps[0]), 0.0), is_seen


def start_at_pose(pose: CirclePose) -> Start:
    """Return a start at a pose that is known from something else."""
    return Start(pose, _BLUR_PX)


def start_by_rough_fit(level: Level, candidate: Candidate, ring: Ring) -> Start | None:
    """Return a start by a rough fit to a candidate in its level; None: it is no ring."""
    poses = poses_through(level.camera.rays(candidate.outline.points()), ring.radius_m)
    if poses is None:
        return None
    pixels = pixels_near(
        level.image,
        level.camera,
        poses[0],
        ring,
        _ROUGH_BAND_PX,
        _ROUGH.pixels,
        supersample=False,
    )
    fits = [] if pixels is None else fit_ring(pixels, poses, ring, _BLUR_PX, _ROUGH.steps)
    if not fits or not may_be_ring(fits[0], candidate.share, ring):
        return None
    rough, k = fits[0], level.reduction
    blur = rough.blur_px * k
    if k > 1.0:
        blur = min(max(0.6, blur - 0.3 * k), 8.0)
    return Start((rough.position, rough.normal), blur)


def full_fits(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    at: Start,
    response: F64 | None = None,
    *,
    clips: bool = True,
) -> list[RingFit]:
    """Return both poses fitted to the image, the better first; empty if the fits fail.

    `response` is the camera's response to start from; None: it is linear. With `clips` white over
    full scale is clipped in the model.
    """
    start, blur = at.pose, at.blur_px
    fitted = partial(_fits, image, camera, ring, effort=_FULL, response=response, clips=clips)
    band = max(_FULL_BAND_PX, _BAND_BLURS * blur)
    fits = fitted(_with_mirror(start, ring), band, blur_px=blur)
    if fits and fits[0].blur_px > band:
        # Pixels within the blur show neither black nor white: any contrast explains them.
        start, blur = (fits[0].position, fits[0].normal), fits[0].blur_px
        band = _BAND_BLURS * blur
        fits = fitted(_with_mirror(start, ring), band, blur_px=blur)
    for _ in range(_MOST_REFITS):
        if not fits or not is_dark_in_white(fits[0]):
            break
        if not is_off_cut(camera, ring, start, fits[0], _REFIT_PX):
            break
        start, blur = (fits[0].position, fits[0].normal), min(fits[0].blur_px, blur)
        fits = fitted(_with_mirror(start, ring), band, blur_px=blur)
    return fits


def is_off_cut(
    camera: CameraModel, ring: Ring, start: CirclePose, fit: RingFit, most_px: float
) -> bool:
    """Tell whether a ring that the image's edge cuts was fitted to pixels of another place.

    The pixels were chosen for the pose `start`, and the fit moved by more than `most_px` from it:
    most pixels still serve for a whole ring, few do for one that is cut.
    """
    pose = fit.position, fit.normal
    is_off = moved_px(camera, ring, start, pose) > most_px
    return is_off and whole_in_picture(camera, points_on(ring, pose)) is None


def response_fits(image: U8, camera: CameraModel, ring: Ring, plain: RingFit) -> list[RingFit]:
    """Return the fits behind a camera's response, started from a plain fit, best first.

    Empty if they fail.
    """
    starts = _with_mirror((plain.position, plain.normal), ring)
    band = max(_FULL_BAND_PX, _BAND_BLURS * plain.blur_px)
    fits = _fits(image, camera, ring, starts, band, _RESPONSE, plain.blur_px, LINEAR_RESPONSE)
    if len(fits) < 2:
        return fits
    # Each pose has found a response of its own, but there is one camera: both start from that of
    # the better one, or a descent that ended halfway would decide between them.
    starts, best = [(f.position, f.normal) for f in fits], fits[0]
    return _fits(image, camera, ring, starts, band, _RESPONSE, best.blur_px, best.response)


def expected_poses(ring: Ring, expected: CirclePose, down: Vec3 | None) -> list[CirclePose]:
    """Return an expected pose and, if a pad could lie that way, its mirrored one.

    `down` is the unit vector of gravity, camera frame: pads do not lean much. None: unknown, both
    poses are returned.
    """
    other = mirrored(*expected, ring.radius_m)
    if other is None or not (down is None or float(other[1] @ np.array(down)) > MAX_TILT_COS):
        return [expected]
    return [expected, other]


def tracked_fits(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    starts: list[CirclePose],
    response: F64 | None,
) -> list[RingFit]:
    """Return the fits near `expected_poses`, the better first; empty if they fail.

    `response` is the camera's response to start from; None: it is linear.
    """
    fits = _fits(image, camera, ring, starts, TRACKED_BAND_PX, _TRACKED, _BLUR_PX, response)
    if fits and fits[0].blur_px > TRACKED_BAND_PX:  # out of focus: blurred beyond the band
        poses, blur = [(f.position, f.normal) for f in fits], fits[0].blur_px
        fits = _fits(image, camera, ring, poses, _BAND_BLURS * blur, _TRACKED, blur, response)
    return fits


def hard_fits(image: U8, camera: CameraModel, ring: Ring, plain: list[RingFit]) -> list[RingFit]:
    """Return the best fits of the plain ones and those with a shadow's edge or with motion."""
    shaded = _shaded_fits(image, camera, ring, plain[0])
    moving = _moving_fits(image, camera, ring, plain[0])
    return min(
        (fits for fits in (plain, shaded, moving) if fits),
        key=lambda fits: fits[0].noise / max(fits[0].contrast, 1.0),
    )


def _shaded_fits(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> list[RingFit]:
    """Return the fits to pixels from which a shadow's edge is removed; empty if there is none."""
    fits = [fit]
    for _ in range(_SHADOW_ROUNDS):
        pose = (fits[0].position, fits[0].normal)
        pixels = pixels_near(
            image, camera, pose, ring, _SHADED_BAND_PX, _SHADED.pixels, supersample=True
        )
        lit = None if pixels is None else evenly_lit(pixels, fits[0], ring)
        starts = _with_mirror(pose, ring)
        if lit is None or not starts:
            return []
        fits = fit_ring(lit, starts, ring, fits[0].blur_px, _SHADED.steps)
        if not fits:
            return []
    assert lit is not None
    coherent = coherent_residual(lit, fits[0], ring)
    return [_inflated(f, coherent) for f in fits]


def _moving_fits(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> list[RingFit]:
    """Return the fits with straight motion during the exposure; empty if they fail."""
    path = max(_PATH_PX, _PATH_BLURS * fit.blur_px)
    pose = (fit.position, fit.normal)
    band = _MOVING_BAND_PX + _BAND_PATHS * path
    pixels = pixels_near(image, camera, pose, ring, band, _MOVING.pixels, supersample=True)
    if pixels is None:
        return []
    directions = np.arange(_PATH_DIRECTIONS) * math.pi / _PATH_DIRECTIONS
    paths = [path * np.array([math.cos(a), math.sin(a)]) for a in directions]
    starts = [pose] * _PATH_DIRECTIONS
    fits = fit_ring(pixels, starts, ring, _MOVING_BLUR_PX, _MOVING.steps, paths)
    if not fits:
        return []
    best = fits[0]
    starts = _with_mirror((best.position, best.normal), ring)
    if not starts:
        return []
    fits = fit_ring(pixels, starts, ring, best.blur_px, _MOVING.steps, [best.motion_px] * 2)
    coherent = coherent_residual(pixels, fits[0], ring) if fits else 0.0
    return [_inflated(f, coherent) for f in fits]


def _with_mirror(pose: CirclePose, ring: Ring) -> list[CirclePose]:
    """Return a pose and the mirrored one, which has the same ellipse; empty if there is none."""
    other = mirrored(*pose, ring.radius_m)
    return [] if other is None else [pose, other]


def _fits(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    starts: Sequence[CirclePose],
    band_px: float,
    effort: _Effort,
    blur_px: float,
    response: F64 | None = None,
    *,
    clips: bool = False,
) -> list[RingFit]:
    """Return the fits from some starts to the pixels near the first start; empty if all fail.

    Where white is over full scale and the model clips it, no response is fitted, which looks like
    another blur or another white.
    """
    if not starts:
        return []
    near = partial(
        pixels_near, image, camera, starts[0], ring, band_px, effort.pixels, supersample=True
    )
    pixels = near()
    is_clipped = pixels is not None and clips and pixels.is_clipped
    if is_clipped:
        pixels, response = near(dense=True), None  # about half of them tell nothing
    if pixels is None:
        return []

    def coherence(fit: RingFit) -> float:
        return coherent_residual(pixels, fit, ring) if is_dark_in_white(fit) else math.inf

    fits = fit_ring(
        pixels,
        starts,
        ring,
        blur_px,
        effort.steps,
        response=response,
        coherence=coherence,
        is_clipped=is_clipped,
    )
    is_plain = response is None and not is_clipped
    if is_plain or not fits or not is_dark_in_white(fits[0]):
        return fits
    return [_inflated(f, fits[0].coherent) for f in fits]


def _inflated(fit: RingFit, coherent: float) -> RingFit:
    """Return a fit with its covariance inflated by the coherent residual of the best one."""
    noises = coherent * fit.contrast / fit.noise
    alike = _ALIKE_PIXELS + math.hypot(*fit.motion_px)
    inflation = 1.0 + alike * noises * noises
    return replace(fit, inflation=inflation * fit.inflation)
