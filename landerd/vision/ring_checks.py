"""What a ring's fit to grey levels must show, so that no look-alike is taken for a ring.

`ring_search` asks whether a fit is worth the next stage, `ring_selection` whether it is of a ring.
Noise, here, is the robust sigma of a fit's residuals, grey levels.
"""

from landerd.camera_model import F64, CameraModel
from landerd.pad import Ring
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_response import is_cameras

# What a rough fit must show to be worth a full one: largest noise over contrast, and the same for
# candidates with at least the third share of spokes. Of 800 rings in all kinds of light three had
# more than the first, with nearly all spokes across a shadow's edge, and none more than the second;
# of the outlines in textures two thirds do.
_MAX_ROUGH_NOISE, _MAX_CLEAR_ROUGH_NOISE, _CLEAR_SHARE = 0.28, 0.4, 0.8
_MIN_ROUGH_CONTRAST = 10.0  # grey levels
_MAX_ROUGH_RATIO = 0.25  # largest error of the ratio, and its largest sigma


# What a fit must show to be a ring. 350 true rings of `bench.vision_ring`, of 1.5 to 25 m at 0 to
# 60 degrees, gave a contrast of at least 101 grey levels, 99 % of them at least 38 noises and 0.975
# of inliers; a ratio within 1.1 % of the true one, known to 1.1 %. None of 2000 fits to its
# look-alikes kept all limits: squares, discs and rings of another ratio leave an eighth of the
# pixels unexplained, texture has little contrast. With 15 noises in motion and 0.91 of inliers 2 to
# 5 of 1000 images of look-alikes showed a ring, with these none.
_MIN_CONTRAST = 12.0  # grey levels
_MIN_CONTRAST_NOISES, _MIN_MOVING_CONTRAST_NOISES = 9.0, 20.0  # contrast over noise; with motion
_MIN_INLIERS = 0.93  # share of the pixels
_MIN_NOISY_CONTRAST_NOISES = 3.0  # contrast over noise where only loud noise is left over
_LEAST_AROUND = 0.5  # contrast at the surroundings over that at the hole, in loud noise
# Contrast at the hole over that at the surroundings: both are one print's white. Of 1300 rings in
# all kinds of light all but two in the shade of leaves (0.57, 0.63) had 0.65 and more; hubs of
# wheels 0.4.
_LEAST_HOLE = 0.6
# Largest blur, the larger of both: an angle, of a lens out of focus (3.5 px of the thesis's); near
# the pad, a share of the radius. Motion is not part of it.
_MAX_BLUR_RAD, _MAX_BLUR_SHARE = 0.0065, 0.1
# Largest coherent residual behind a response, over the contrast: gamma leaves 0.01, an S-curve
# 0.02, leaf shade 0.1.
_MAX_COHERENT = 0.05
# Limits of what a plain fit leaves, over the contrast: coherent residual and noise for a response
# to be tried, and noise for edges to be. Rings that responses explained left 0.09 and 0.10 (97 % of
# 300 pictures of the field world), rings told by their edges 0.21; textures leave 0.16 and 0.19.
_MAX_PLAIN_COHERENT, _MAX_PLAIN_NOISE, _MAX_HIDDEN_NOISE = 0.13, 0.15, 0.25
_MAX_CLEAR_NOISE = 0.45  # the last one where nearly all spokes are bright, dark and bright
# Largest error of the ratio: a share of it plus sigmas, but no more than _MAX_RATIO_OFF of it,
# which is nearer to it than to one that is a fifth off. And its largest sigma, a share of it.
_RATIO_TOLERANCE, _RATIO_SIGMAS = 0.03, 2.0
_MAX_RATIO_SIGMA = 0.06
_MAX_RATIO_OFF = 0.1

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


def may_be_ring(rough: RingFit, share: float, ring: Ring) -> bool:
    """Tell whether a rough fit to a candidate with such a share of spokes is worth a full one."""
    most_noise = _MAX_CLEAR_ROUGH_NOISE if share >= _CLEAR_SHARE else _MAX_ROUGH_NOISE
    return (
        rough.contrast > _MIN_ROUGH_CONTRAST
        and rough.noise < most_noise * rough.contrast
        and abs(rough.ratio - ring.inner_ratio) < _MAX_ROUGH_RATIO
        and rough.sigma_ratio < _MAX_ROUGH_RATIO
    )


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
    is_plain = plain.response is None and plain.is_told is None
    return is_plain and is_near and plain.coherent < _MAX_PLAIN_COHERENT


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
    moved = bool(fit.motion_px.any())
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
