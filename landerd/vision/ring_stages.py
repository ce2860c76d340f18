"""The stages of a ring's fit, from a rough one to those with shadow or motion in the model.

And what tells a ring from what looks like one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.geometry import Vec3
from landerd.pad import Ring
from landerd.vision.arrays import U8
from landerd.vision.patch import whole_in_picture
from landerd.vision.pyramid import Level
from landerd.vision.ring_edges import moved_px, points_on
from landerd.vision.ring_fit import RingFit, fit_ring
from landerd.vision.ring_light import evenly_lit
from landerd.vision.ring_pixels import pixels_near
from landerd.vision.ring_pose import CirclePose, mirrored, poses_through
from landerd.vision.ring_residuals import coherent_residual
from landerd.vision.ring_response import LINEAR_RESPONSE, is_cameras
from landerd.vision.ring_segment import Candidate


@dataclass(frozen=True)
class _Effort:
    """What a fit may cost: about so many pixels, so many steps at most."""

    pixels: int
    steps: int


_ROUGH = _Effort(180, 3)  # in a reduced image, to be fitted again
_FULL = _Effort(560, 8)
_RESPONSE = _Effort(560, 6)
_SHADED = _Effort(700, 8)
_MOVING = _Effort(560, 6)
# With three steps 53 of 60 rings were found from priors a pixel off, with four all.
_TRACKED = _Effort(200, 4)

# How far from an edge pixels are taken, px.
_ROUGH_BAND_PX = 3.0
_FULL_BAND_PX, _BAND_BLURS = 2.0, 2.0  # the wider of this and so many blurs
_SHADED_BAND_PX = 3.5  # wide enough to hold pixels that are white and nothing else
_MOVING_BAND_PX, _BAND_PATHS = 2.0, 0.6  # this and such a share of the motion's path
TRACKED_BAND_PX = 4.0  # so far edges may be from where they are expected

# What is started from where nothing is known.
_BLUR_PX, _MOVING_BLUR_PX = 1.0, 0.7
_PATH_PX, _PATH_BLURS = 3.0, 2.5  # of a motion: the longer of this and so many blurs
_PATH_DIRECTIONS = 4

MAX_TILT_COS = math.cos(math.radians(25.0))  # pads that lean more are not landed on
_SHADOW_ROUNDS = 2  # the better the pose, the better the shadow's edge
# What a rough fit must show to be worth a full one. Of 800 rings in all kinds of light three left
# more over than the first share of the contrast, seen with nearly all spokes across a shadow's
# edge, and none more than the second; of the outlines in textures two thirds do.
_MIN_ROUGH_CONTRAST = 10.0  # grey levels
_MAX_ROUGH_NOISE, _MAX_CLEAR_ROUGH_NOISE, _CLEAR_SHARE = 0.28, 0.4, 0.8
_MAX_ROUGH_RATIO = 0.25  # by which the ratio is off, and its sigma

# What a fit must show to be a ring. 350 true rings of `bench.vision_ring`, of 1.5 to 25 m at 0 to
# 60 degrees, gave a contrast of at least 101 grey levels, 99 % of them at least 38 noises and 0.975
# of inliers; a ratio within 1.1 % of the true one, known to 1.1 %. None of 2000 fits to its
# look-alikes kept all limits: squares, discs and rings of another ratio leave an eighth of the
# pixels unexplained, texture has little contrast. With 15 noises in motion and 0.91 of inliers 2 to
# 5 of 1000 images of look-alikes showed a ring, with these none.
_MIN_CONTRAST = 12.0  # grey levels
_MIN_CONTRAST_NOISES, _MIN_MOVING_CONTRAST_NOISES = 9.0, 20.0
_MIN_INLIERS = 0.93
_MIN_NOISY_CONTRAST_NOISES = 3.0  # of loud noise and nothing else
_LEAST_AROUND = 0.5  # of the hole's contrast, that of the surroundings, in it
# Of the surroundings' contrast, the hole's: both are one print's white. Of 1300 rings in all kinds
# of light all but two in the shade of leaves (0.57, 0.63) had 0.65 and more; hubs of wheels 0.4.
_LEAST_HOLE = 0.6
# Of a lens out of focus, 3.5 px of the thesis's; or near the pad, of the radius. Not of motion.
_MAX_BLUR_RAD, _MAX_BLUR_SHARE = 0.0065, 0.1
_MAX_COHERENT = 0.05  # of the contrast: gamma leaves 0.01, an S-curve 0.02, leaf shade 0.1
# Of the contrast, left over by plain fits to what responses did explain (300 pictures of the field
# world, 97 %: 0.09 and 0.10) and whose edges were a ring's (0.21); textures leave 0.16 and 0.19.
_MAX_PLAIN_COHERENT, _MAX_PLAIN_NOISE, _MAX_HIDDEN_NOISE = 0.13, 0.15, 0.25
_MAX_CLEAR_NOISE = 0.45  # where nearly all spokes are bright, dark and bright
_ALIKE_PIXELS = 4.0  # whose residuals have that in common
_RATIO_TOLERANCE, _RATIO_SIGMAS = 0.03, 2.0  # of the ratio, and of its sigma besides
_MAX_RATIO_SIGMA = 0.06  # of the ratio
_MAX_RATIO_OFF = 0.1  # of it: nearer to it than to one that is a fifth off

# A fit is worth another try with shadow and motion if it leaves more than a camera's noise or has
# outliers, but there is something dark in white (trial on the same images).
_PLAIN_NOISE, _PLAIN_NOISE_SHARE = 2.0, 0.025  # grey levels, and of the contrast
_PLAIN_INLIERS = 0.97
_PLAIN_COHERENT = 0.02  # of the contrast: below, all that is left over is noise
_MIN_POOR_CONTRAST, _MIN_POOR_CONTRAST_NOISES = 10.0, 2.5
# Sigma of the ratio over it: 400 rings that were explained in the end gave 0.05 at most, but in
# motion over 0.4 of a far one's diameter 0.12; half of what was tried in vain in photographs of the
# ground gave more.
_MAX_POOR_RATIO_SIGMA = 0.13
# Of rings that are cut: so far off, px, the pixels of the first pose are of another place. Two
# of 35 were 1 and 3 per cent of the range off, with a tenth of that as their sigma.
_REFIT_PX, _MOST_REFITS = 1.0, 3


@dataclass(frozen=True)
class Start:
    """Where the fit of a ring to the whole image starts."""

    pose: CirclePose
    blur_px: float  # of that image


def start_at_outline(level: Level, candidate: Candidate, ring: Ring) -> Start | None:
    """Return a pose that has the outline of a candidate; None if it is no ring's."""
    poses = poses_through(level.camera.rays(candidate.outline.points()), ring.radius_m)
    return None if poses is None else Start(poses[0], _BLUR_PX)


def start_at_pose(pose: CirclePose) -> Start:
    """Return what begins at a pose told by something else."""
    return Start(pose, _BLUR_PX)


def start_by_rough_fit(level: Level, candidate: Candidate, ring: Ring) -> Start | None:
    """Return the better pose of a candidate in a reduced image; None if it is no ring."""
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
    if not fits or not _may_be_ring(fits[0], candidate.share, ring):
        return None
    rough, k = fits[0], level.reduction
    blur = rough.blur_px * k
    if k > 1.0:
        blur = min(max(0.6, blur - 0.3 * k), 8.0)
    return Start((rough.position, rough.normal), blur)


def _may_be_ring(rough: RingFit, share: float, ring: Ring) -> bool:
    """Tell whether a rough fit to a candidate with such a share of spokes is worth a full one."""
    most_noise = _MAX_CLEAR_ROUGH_NOISE if share >= _CLEAR_SHARE else _MAX_ROUGH_NOISE
    return (
        rough.contrast > _MIN_ROUGH_CONTRAST
        and rough.noise < most_noise * rough.contrast
        and abs(rough.ratio - ring.inner_ratio) < _MAX_ROUGH_RATIO
        and rough.sigma_ratio < _MAX_ROUGH_RATIO
    )


def full_fits(
    image: U8, camera: CameraModel, ring: Ring, at: Start, response: F64 | None = None
) -> list[RingFit]:
    """Return both poses fitted to the image, the better first; empty if the fits fail.

    `response` is a first one of the camera's; None: it is linear.
    """
    start, blur = at.pose, at.blur_px
    band = max(_FULL_BAND_PX, _BAND_BLURS * blur)
    fits = _fits(image, camera, ring, _with_mirror(start, ring), band, _FULL, blur, response)
    if fits and fits[0].blur_px > band:
        # Pixels within the blur show neither black nor white: any contrast explains them.
        start, blur = (fits[0].position, fits[0].normal), fits[0].blur_px
        band = _BAND_BLURS * blur
        fits = _fits(image, camera, ring, _with_mirror(start, ring), band, _FULL, blur, response)
    for _ in range(_MOST_REFITS):
        if not fits or not is_dark_in_white(fits[0]):
            break
        if not is_off_cut(camera, ring, start, fits[0], _REFIT_PX):
            break
        start, blur = (fits[0].position, fits[0].normal), min(fits[0].blur_px, blur)
        fits = _fits(image, camera, ring, _with_mirror(start, ring), band, _FULL, blur, response)
    return fits


def is_off_cut(
    camera: CameraModel, ring: Ring, start: CirclePose, fit: RingFit, most_px: float
) -> bool:
    """Tell whether a ring that the image's edge cuts was fitted to pixels of another place.

    Those of the pose `start`, more than `most_px` from where it is now: of a whole ring most of
    them still serve, of one that is cut few do.
    """
    pose = fit.position, fit.normal
    is_off = moved_px(camera, ring, start, pose) > most_px
    return is_off and whole_in_picture(camera, points_on(ring, pose)) is None


def response_fits(image: U8, camera: CameraModel, ring: Ring, plain: RingFit) -> list[RingFit]:
    """Return the fits behind a response, from a plain one, best first; empty if they fail."""
    starts = _with_mirror((plain.position, plain.normal), ring)
    band = max(_FULL_BAND_PX, _BAND_BLURS * plain.blur_px)
    return _fits(image, camera, ring, starts, band, _RESPONSE, plain.blur_px, LINEAR_RESPONSE)


def expected_poses(ring: Ring, expected: CirclePose, down: Vec3 | None) -> list[CirclePose]:
    """Return an expected pose and, if a pad could lie so, the other one of the same ellipse.

    Where gravity is known (unit vector, camera frame) pads do not lean much.
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

    `response` is a first one of the camera's; None: it is linear.
    """
    fits = _fits(image, camera, ring, starts, TRACKED_BAND_PX, _TRACKED, _BLUR_PX, response)
    if fits and fits[0].blur_px > TRACKED_BAND_PX:  # out of focus: wider than what was looked at
        poses, blur = [(f.position, f.normal) for f in fits], fits[0].blur_px
        fits = _fits(image, camera, ring, poses, _BAND_BLURS * blur, _TRACKED, blur, response)
    return fits


def hard_fits(image: U8, camera: CameraModel, ring: Ring, plain: list[RingFit]) -> list[RingFit]:
    """Return the best of plain fits and those with a shadow's edge or motion in the model."""
    shaded = _shaded_fits(image, camera, ring, plain[0])
    moving = _moving_fits(image, camera, ring, plain[0])
    return min(
        (fits for fits in (plain, shaded, moving) if fits),
        key=lambda fits: fits[0].noise / max(fits[0].contrast, 1.0),
    )


def _shaded_fits(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> list[RingFit]:
    """Return the fits with a shadow's edge undone; empty if there is none."""
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
    return fits


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
    return fit_ring(pixels, starts, ring, best.blur_px, _MOVING.steps, [best.motion_px] * 2)


def _with_mirror(pose: CirclePose, ring: Ring) -> list[CirclePose]:
    """Return a pose and the other one that shows the same ellipse; empty if there is none."""
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
) -> list[RingFit]:
    """Return the fits from starts to the pixels near the first; empty if there is none."""
    if not starts:
        return []
    pixels = pixels_near(image, camera, starts[0], ring, band_px, effort.pixels, supersample=True)
    if pixels is None:
        return []
    fits = fit_ring(pixels, starts, ring, blur_px, effort.steps, response=response)
    if not fits or not is_dark_in_white(fits[0]):
        return fits
    coherence = cache(partial(coherent_residual, pixels, fits[0], ring))
    return [_judged(replace(f, coherence=coherence)) for f in fits]


def _judged(fit: RingFit) -> RingFit:
    """Return a fit that errs as its coherent residual says behind a response."""
    if fit.response is None:
        return fit
    noises = fit.coherent * fit.contrast / fit.noise
    inflation = 1.0 + _ALIKE_PIXELS * noises * noises
    return replace(fit, inflation=inflation * fit.inflation)


def is_dark_in_white(fit: RingFit) -> bool:
    """Tell whether a fit is of something dark in white, a ring or not: it is not hopeless."""
    return fit.contrast > max(_MIN_POOR_CONTRAST_NOISES * fit.noise, _MIN_POOR_CONTRAST)


def tells_ratio(fit: RingFit, ring: Ring) -> bool:
    """Tell whether a plain fit is of enough pixels that what hides a ring could be told."""
    return fit.sigma_ratio < _MAX_POOR_RATIO_SIGMA * ring.inner_ratio


def is_poor(fit: RingFit) -> bool:
    """Tell whether more is left over than a camera's noise, but the fit is not hopeless."""
    plain_noise = _PLAIN_NOISE + _PLAIN_NOISE_SHARE * fit.contrast
    noisy = fit.noise > plain_noise or fit.inliers < _PLAIN_INLIERS
    return noisy and is_dark_in_white(fit) and fit.coherent >= _PLAIN_COHERENT


def may_be_behind(plain: RingFit) -> bool:
    """Tell whether a camera's response may explain what a plain fit leaves over."""
    is_near = plain.noise < _MAX_PLAIN_NOISE * plain.contrast
    return plain.response is None and is_near and plain.coherent < _MAX_PLAIN_COHERENT


def may_have_edges(plain: RingFit, share: float) -> bool:
    """Tell whether a plain fit that fails is near enough for its edges to be looked at.

    `share` is that of the spokes that are bright, dark and bright: where nearly all are, clipped
    white or a spot of glare may have spoilt the fit.
    """
    limit = _MAX_HIDDEN_NOISE if share < _CLEAR_SHARE else _MAX_CLEAR_NOISE
    return plain.noise < limit * plain.contrast


def is_ring(fit: RingFit, ring: Ring, camera: CameraModel) -> bool:
    """Tell whether a fit describes a ring of this ratio well."""
    if is_blurred_away(fit, ring, camera) or is_dim_within(fit.inside, fit.black, fit.outside):
        return False
    if fit.response is not None:
        return _is_ring_behind(fit, fit.response, ring)
    moved = bool(np.any(fit.motion_px))
    noises = _MIN_MOVING_CONTRAST_NOISES if moved else _MIN_CONTRAST_NOISES
    is_clear = fit.contrast > noises * fit.noise and fit.inliers > _MIN_INLIERS
    is_explained = is_clear or (_is_noisy(fit) and fit.coherent < _PLAIN_COHERENT)
    return is_explained and fit.contrast > _MIN_CONTRAST and _has_ratio(fit, ring)


def is_dim_within(inside: float, black: float, outside: float) -> bool:
    """Tell whether the hole is too dark, beside the surroundings, to be of the same white."""
    return inside - black < _LEAST_HOLE * (outside - black)


def _is_noisy(fit: RingFit) -> bool:
    """Tell whether a fit is of evenly white and black, in loud noise."""
    is_even = fit.outside - fit.black > _LEAST_AROUND * (fit.inside - fit.black)
    return is_even and fit.contrast > _MIN_NOISY_CONTRAST_NOISES * fit.noise


def is_blurred_away(fit: RingFit, ring: Ring, camera: CameraModel) -> bool:
    """Tell whether the blur is so wide that anything would look like a ring."""
    focal = camera.focal
    radius = ring.radius_m / float(fit.position[2])
    return fit.blur_px / focal > max(_MAX_BLUR_RAD, _MAX_BLUR_SHARE * radius)


def _is_ring_behind(fit: RingFit, response: F64, ring: Ring) -> bool:
    """Tell the same of a fit behind a camera's response.

    Sharpened black is noisy, and white beside it is not: no limit to noise would hold for both.
    """
    return (
        fit.contrast > max(_MIN_CONTRAST, _MIN_NOISY_CONTRAST_NOISES * fit.noise)
        and fit.coherent < _MAX_COHERENT
        and fit.inliers > _MIN_INLIERS
        and is_cameras(response, min(fit.inside, fit.outside))
        and _has_ratio(fit, ring)
    )


def _has_ratio(fit: RingFit, ring: Ring) -> bool:
    ratio = ring.inner_ratio
    off = abs(fit.ratio - ratio)
    tolerated = _RATIO_TOLERANCE * ratio + _RATIO_SIGMAS * fit.sigma_ratio
    is_near = off < min(tolerated, _MAX_RATIO_OFF * ratio)
    return is_near and fit.sigma_ratio < _MAX_RATIO_SIGMA * ratio
