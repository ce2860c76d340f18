"""Rings whose grey levels the model does not explain: told by where their edges are.

A tone curve, clipped white, sharpening, shadow, leaves, legs, dirt and glare leave larger residuals
than a camera's noise, but all or most edges stay in place. If a fit to the edges (`ring_edges`)
shows a ring, its pose is that of the fit to grey levels if both agree within their errors, else
that of the edges with their larger covariance. `ring_selection` and `ring_search` turn to this
module when a plain fit fails; tracking does so if the last rings needed it.

If the edges show nearly a ring, other evidence decides (`Vouches`): the pad's plate is seen about
it, or the pad is known to be there.

A ray, here, is a direction from the ring's centre along which `ring_edges` looks for an outer and
an inner edge. Shift is how far a tone curve has moved both edges into the black (negative: into the
white).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import cv2
import numpy as np

from landerd.camera_model import F64, CameraModel, Window
from landerd.messages import EDGES
from landerd.pad import Ring
from landerd.vision.arrays import U8
from landerd.vision.edge_profile import edge_cost
from landerd.vision.linear import solved
from landerd.vision.pose import px_per_m
from landerd.vision.ring_checks import is_blurred_away, is_dim_within
from landerd.vision.ring_covariance import frontal_inflation
from landerd.vision.ring_edges import RingEdgeFit, edge_fit, points_on
from landerd.vision.ring_fit import RingFit
from landerd.vision.ring_pixels import pose_axes
from landerd.vision.ring_pose import CirclePose, mirrored

# ---- what edges must show to be a ring's -------------------------------------------------------
# Five shares: of the rays with an outer edge, of those with an inner edge, of the stroke that is
# dark, of hole and surroundings that are bright, and of the rays that are in the image. Each is
# spoilt by something else, so their product counts. Its limit is the first of these plus the second
# over the shorter radius, px: small rings have fewer pixels, and texture shows more that is like
# them. Of 700 photographs of the ground the likest outline had 0.7 below 5 px, 0.62 below 6.5, 0.43
# below 12 and 0.23 above; nine of ten rings of the field world had 0.93 there, 0.57 and 0.6.
_MIN_PRODUCT, _PRODUCT_PX = 0.27, 2.7
_MIN_RADIUS_PX = 4.0  # shorter radius
MIN_COS = 0.3  # of the angle between normal and sight: flatter rings are bands of few pixels
_MAX_RIDGE = 0.2  # height of a brighter circle within the stroke, over the contrast
_MIN_EITHER = 0.5  # least share of the rays with an outer edge, and of those with an inner edge
_MIN_SHARE = 0.6  # least share that is dark, and that is bright
_MIN_VISIBLE = 0.35  # least share in the image: just over the pad a ring is cut
_MIN_CONTRAST = 12.0  # grey levels
# Contrast at the hole over that around the ring, or the reverse, below which something must vouch
# for it: of 1300 rings on 19 field days 99 in 100 have 0.71 and more, wheels taken for rings 0.4 to
# 0.6. Rings with a shorter radius above the second, px, are told by their ratio.
_EVEN_CONTRAST, _EVEN_PX = 0.65, 20.0
# A ring that is expected there and is as large as just over the pad: its shorter radius exceeds the
# first, px. Then a smaller share of it need be visible, if its edges are in place and tell the
# shift apart from the range. Limits of the share visible, of the product of the other four, and of
# sigma of the shift, px. Of 190 rings under all kinds of shade these two were 0.47 and more, 0.4
# and less; fits from starts 0.1 m away that were centimetres off had 0.55 at most or 0.56 at least.
_NEAR_PX, _MIN_NEAR_VISIBLE, _MIN_NEAR_PRODUCT, _MAX_NEAR_SIGMA_PX = 40.0, 0.2, 0.45, 0.45
# Least share of the outer edge over that of the inner one: the loop of a letter is round only
# inside. Asked of rings not larger than _EVEN_PX, and of all in `matched_fits`. 36 looks at a P on
# a round white sign have 0.56 to 0.79, 710 rings in leaf shade, shadow, dirt, glare and motion,
# behind a leg and S-curves 0.77 and more, a ring of 19 px in a screenshot 0.7.
_EVEN = 0.7
# A fit is given up, the mirrored pose untried, if the shares of both edges add up to less than
# this.
_HOPELESS_SUPPORT = 0.9
# A pose with less than this share of the edges that the other one shows is no rival of it.
_RIVAL_SHARE = 0.5
# Both poses of a small ring show about the same edges. One whose shorter radius is below the first,
# px, is given up below the second share of the limit: of 800 such that edges showed to be rings in
# the end, none had less than 0.75 of the limit under the first pose; of 21 textures 20 did, and
# half of them had 0.39.
_ALIKE_PX, _HOPELESS_SHARE = 20.0, 0.6

# ---- what they must show if something vouches --------------------------------------------------
# Factor on the limit of the product if something vouches for the ring. The pad's whole plate about
# it: in leaf shade as fine as the stroke 51 of the 65 rings below the limit have that; of 884 tiles
# of photographs no fit does. The pad known to be there: at 1610 places in photographs there was
# none.
_VOUCHED = 0.7
# The same for the place that correlates best with a level ring: a hard shadow across it leaves 0.6.
# But the share of either edge must be at least _EVEN times that of the other, as in shadows. (Dirt
# in the hole may hide the inner edge of a ring.)
_MATCHED = 0.6
# Factor on the covariance then: without it, of 53 such rings in leaf shade only 62 in 100 lay
# within the region of 99 %.
_VOUCHED_INFLATION = 4.0
# What the fit to grey levels of a ring must show whose edges show too little, small or shaded as it
# is: largest noise over contrast, least share of inliers, least ratio of the contrasts at hole and
# surroundings; largest error of the ratio relative to it, its largest sigma, and the radius, px,
# up to which this counts: larger rings' edges show enough. Of 4300 looks at rings on 205 field days
# 100 were of rings that nothing else showed, within 8 % of the range, and two of other rings.
_GREY_NOISE, _GREY_INLIERS, _GREY_EVEN = 0.25, 0.35, 0.7
_GREY_RATIO, _GREY_RATIO_SIGMA, _GREY_PX = 0.22, 0.032, 20.0
# Largest coherent residual (`ring_residuals`) then, over the contrast: squares with a hole leave
# 0.13 to 0.38; so do half of those hundred rings.
_GREY_COHERENT = 0.12

# ---- how far a tone curve may move edges -------------------------------------------------------
# Largest shift: the first in px, plus the second times the blur, plus a share of the radius, the
# error of a print. Gamma 2.4 moves the edge of a blurred black on white by 0.7 sigma.
_MAX_SHIFT_PX, _MAX_SHIFT_BLURS, _PRINT_SHARE = 0.15, 0.75, 0.009
# White over full scale leaves only the darkest part of each edge, which looks sharper than it was
# and is further off (`_clipped_shift_blurs`). How far over, its black tells: no ink reflects less
# than the first share of what white does. Letters of drawings are black as no overexposed ink is.
# The last is a margin, as the blurs of both edges of a stroke overlap.
_BLACKEST_INK, _MAX_EXPOSURE, _OVERLAP = 0.02, 6.0, 1.15
_NORMAL = NormalDist()
# Least shift, in px and in blurs. White grows behind any of these curves. It shrinks by the errors
# of print (ink spreads, too) and fit, and behind the toe of an S-shaped curve: where white is far
# below full scale, grey levels follow the square of the light.
_MIN_SHIFT_PX, _MIN_SHIFT_BLURS, _MIN_CLIPPED_SHIFT_BLURS = -0.1, 0.6, 0.15
# Least shift of rings with a shorter radius below the first, px, as a share of the radius: a larger
# one could be that of another ratio's edges.
_SMALL_PX, _MIN_SMALL_SHIFT = 6.5, -0.015
# Largest blur of a fit to grey levels beside clipped white, over that of the edges: what is left of
# an edge looks sharper than it is. White 1.05 to 4 times over full scale reaches 1.5; rings of
# ratio 0.46 to 0.52 there need 1.6 to 3 to look like ours.
_CLIPPED_BLURS = 1.55
# Grey level from which on white counts as clipped: full scale is 255, in video of limited range
# 235, and tone mapping compresses it.
_CLIPPED = 230.0
# Black above this says nothing of clipped white: ink of 3 % is as bright only behind white so far
# over full scale that all of a stroke has bloomed. White twelve times over leaves black of 204, of
# 44 rings on blown-out paper in photographs the brightest had 185; thin circles there, 228 to 230.
_CLIPPED_BLACK = 215.0
# A shift outside these shares of the radius could as well be that of a ring whose ratio is a fifth
# off; something must vouch for the ring then. Not so if white is near full scale or the blur
# explains the shift: below this white no gamma to 2.4 and no S-curve over it moves the edges of ink
# of 3 % and more by more than 0.51 of their blur.
_RATIO_KEPT, _KEPT_BLURS, _KEPT_WHITE = (-0.025, 0.06), 0.6, 225.0
# Edges are of another ring if a ratio that is off by more than the first, relative to the true one,
# explains them with a noise smaller by more than the second, a factor, and with less shift. None of
# 1400 rings in 14 kinds of light were; white six times over full scale reaches a factor of 1.25,
# tilted rings of another ratio 1.5 to 3.5. Of 108 rings of ratio 0.46 to 0.48 beside clipped white
# it refuses 67; most of the others face the camera, where shift and ratio look alike.
# Beside a motion, which explains edges too, the last one is the factor: of 20 tilted rings of ratio
# 0.48 to 0.6 in clipped white one reached more, of 150 rings in motion none that has a ratio so far
# off and less shift.
_ANOTHER_RATIO, _ANOTHER_NOISE, _ANOTHER_MOVING_NOISE = 0.12, 1.5, 1.0
# Edges are taken to stand still if their noise is below the sum of these (px, and a share of the
# radius), and the blur of the broadest quarter of them below the third, px.
_CLEAR_NOISE_PX, _CLEAR_NOISE_SHARE = 0.15, 0.001
_SHARP_PX = 1.15

# ---- noisy pictures ----------------------------------------------------------------------------
# If the picture's noise exceeds this share of the contrast and no ring is seen, edges are looked
# for again in a picture that is smoothed, with this sigma, px, about the ring: in its bounding box
# and a margin, a share of its size.
_NOISY, _SMOOTH_MARGIN, _SMOOTH_PX = 0.15, 0.5, 0.8
_NOISE_MASK = np.array([(1, -2, 1), (-2, 4, -2), (1, -2, 1)], np.float32)

# ---- errors of edges that their scatter does not show ------------------------------------------
# Common to all edges, and different from side to side, px; and as a share of the shift.
_EDGE_BIAS_PX, _LATERAL_BIAS_PX, _SHIFT_BIAS = 0.02, 0.01, 0.1
# Of a ring seen flat, edges bend sharply at either end, and blur takes most of the stroke between:
# the range comes out too short. The error of the radius, px, is this times the blur squared, over
# the radius and the 2.5th power of the cosine of the tilt: 600 exact pictures of rings of 14 to 57
# px at 45 to 70 degrees had 0.8 to 1.4 times that.
_FLAT_BIAS, _FLAT_POWER = 0.22, 2.5
# Light that changes across an edge moves it, and the opposite one the same way: by this, px, if
# light changes by as much as its own level about the ring. Of 47 rings in soft shadow the edges'
# errors were twice what their scatter showed, 0.06 px aside and 0.05 px of the radius.
_UNEVEN_BIAS_PX = 0.05
# Light that adds to black and white alike, as a highlight on a glossy print, moves an edge towards
# black where it grows that way: by sqrt(pi / 2) blurs times what it adds from the one edge to the
# other, over the contrast that is left. If it covers only one of the two edges, the range errs. A
# highlight in the hole took up to 1.5 blurs of the inner edge.
_SHINE_BLURS, _SHINE_ASIDE = math.sqrt(math.pi / 2.0), 0.5
# Share of the edges' noise: averaging does not remove what shade does to a whole side. This and the
# shift count more if less of the ring is visible.
_NOISE_BIAS = 0.3
# Motion displaces the edges on two sides, and broadens them: of 32 rings that moved by 0.4 of their
# diameter edges scattered by 0.3 to 0.7 px, and the radius was off by as much. The error is the
# edges' noise in full where their blur exceeds the second, px, none below the first; aside it is
# this share of that.
_SPREAD_PX, _SPREAD_ASIDE = (1.0, 1.5), 0.25
# Out of focus, black and white of a stroke mix, and the range comes out too long: by 0.5 to 7 per
# cent for 46 rings with a blur of a fifth to half of the stroke. The error is _BLUR_BIAS of the
# radius times the blur, in strokes, beyond _BLURRED_SHARE; aside it is _BLUR_ASIDE of that.
_BLURRED_SHARE, _BLUR_BIAS, _BLUR_ASIDE = 0.17, 0.18, 0.2
# Edges themselves show no more blur than a fifth of the stroke, nor than 2.6 px. Up to these limits
# (strokes, px) their blur is believed. Above, the fit to grey levels tells it, at most
# _MOST_SHARE strokes; without such a fit _UNTOLD_SHARE is assumed.
_TOLD_SHARE, _TOLD_PX, _TOLD_WIDE_PX = 0.155, 1.3, 1.8
_UNTOLD_SHARE, _MOST_SHARE = 0.4, 0.5

# ---- whether grey levels and edges agree -------------------------------------------------------
# Largest chi-square of their difference. Both use the same pixels: behind legs, dirt and glare,
# which take away some of them, 97 of 100 differ by less. In leaf shade and soft shadow, where all
# grey levels are wrong, two thirds differ by more, and the edges are two to ten times as exact.
_AGREE_CHI2 = 3.0
_AGREE_SHIFT_PX, _AGREE_SIGMAS = 0.04, 3.0  # largest shift of the edges: px, plus sigmas
_AGREE_RATIO = 0.003  # largest error of the ratio relative to it, plus sigmas
_AGREE_COS = math.cos(math.radians(8.0))  # of the angle between both normals


# Tells whether a ring with this centre (3,), m, and normal (3,), both in the camera frame, and this
# contrast, grey levels, is the pad's although its edges alone do not show it: the pad's plate is
# seen about it, or the pad is known to be there.
Vouches = Callable[[F64, F64, float], bool]


@dataclass(frozen=True)
class Explained:
    """The fits of a ring that its edges show to be one."""

    fits: list[RingFit]  # best first
    # A tone curve has moved edges that are sharp: motion or shadow would explain them no better.
    is_toned: bool


def explained(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    fits: list[RingFit],
    vouches: Vouches | None = None,
) -> Explained | None:
    """Return the fits of a ring whose grey levels `fits` do not explain; None: it is none.

    Args:
        image: grey image (height, width).
        camera: the lens.
        ring: its true size and ratio.
        fits: to grey levels, best first, at least one; if there is only one, the mirrored pose is
            known to be wrong.
        vouches: see `Vouches`; None: nothing vouches.
    """
    found = _explained(image, camera, ring, fits, vouches)
    smooth = _smoothed(image, camera, ring, fits[0]) if found is None else None
    if smooth is not None:
        found = _explained(smooth, camera, ring, fits, vouches)
    if found is None and (vouched := vouched_grey(camera, ring, fits, vouches)):
        return Explained(vouched, is_toned=False)
    return found


def vouched_grey(
    camera: CameraModel, ring: Ring, fits: list[RingFit], vouches: Vouches | None
) -> list[RingFit]:
    """Return the fits to grey levels of a small ring whose edges show too little.

    Empty: nothing vouches for it, or its grey levels are no ring's either.
    """
    best = fits[0]
    inside, outside = best.inside - best.black, best.outside - best.black
    is_near = (
        px_per_m(camera, best.position, best.normal) * ring.radius_m < _GREY_PX
        and best.contrast > _MIN_CONTRAST
        and best.noise < _GREY_NOISE * best.contrast
        and best.inliers > _GREY_INLIERS
        and best.contrast > _GREY_EVEN * max(inside, outside)
        and abs(best.ratio - ring.inner_ratio) < _GREY_RATIO * ring.inner_ratio
        and best.sigma_ratio < _GREY_RATIO_SIGMA
        and not is_blurred_away(best, ring, camera)
        and best.coherent < _GREY_COHERENT
    )
    if vouches is None or not is_near:
        return []
    if not vouches(best.position, best.normal, best.contrast):
        return []
    return [replace(f, inflation=_VOUCHED_INFLATION * f.inflation) for f in fits]


def _smoothed(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> U8 | None:
    """Return the image smoothed about a ring; None: it is not so noisy that edges are lost.

    Noise is measured as in Immerkaer, "Fast noise variance estimation", CVIU 1996: with a mask
    that hardly responds to edges.
    """
    px = camera.pixels(points_on(ring, (fit.position, fit.normal)))
    if not np.isfinite(px).all():
        return None
    low, high = px.min(axis=0), px.max(axis=0)
    margin = _SMOOTH_MARGIN * (high - low)
    (x0, y0), (x1, y1) = (low - margin).tolist(), (high + margin).tolist()
    w = Window(int(x0), int(y0), int(x1), int(y1)).within(camera.width, camera.height)
    about = image[w.y0 : w.y1, w.x0 : w.x1]
    if min(about.shape) < len(_NOISE_MASK):
        return None
    left = cv2.filter2D(about, cv2.CV_32F, _NOISE_MASK)[1:-1, 1:-1]
    if math.sqrt(0.5 * math.pi) / 6.0 * float(np.abs(left).mean()) < _NOISY * fit.contrast:
        return None
    smooth = image.copy()
    smooth[w.y0 : w.y1, w.x0 : w.x1] = cv2.GaussianBlur(about, (0, 0), _SMOOTH_PX)
    return smooth


def _explained(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    fits: list[RingFit],
    vouches: Vouches | None,
) -> Explained | None:
    best = fits[0]
    starts = [(best.position, best.normal)]
    other = mirrored(*starts[0], ring.radius_m)
    if other is not None and len(fits) > 1:
        starts.append(other)
    found = _fits_from(image, camera, ring, starts)
    if not found:
        return None
    found, noise = _best_first(found)
    edges = found[0]
    inflation = _told(edges, ring, vouches)
    if inflation is None:
        return None
    toned = (
        edges.noise_px < _CLEAR_NOISE_PX + _CLEAR_NOISE_SHARE * edges.radius_px
        and edges.broad_px < _SHARP_PX
        and _is_shifted(edges)
    )
    if _agree(edges, best, ring, camera):
        # Residuals of the grey levels are as correlated along the ring as those of the edges.
        wider = [replace(f, inflation=inflation * edges.dependence * f.inflation) for f in fits]
        return Explained(wider, toned)
    told = [_ring_fit(e, ring, camera, noise, inflation, best.blur_px) for e in found]
    return Explained(told, toned)


def _fits_from(
    image: U8, camera: CameraModel, ring: Ring, starts: Sequence[CirclePose]
) -> list[RingEdgeFit]:
    """Return the fits to edges from some poses; empty if the first one is hopeless."""
    found: list[RingEdgeFit] = []
    for start in starts:
        edges = edge_fit(image, camera, ring, start)
        if edges is not None:
            found.append(edges)
        if not found or _is_hopeless(found[0]):
            return []
    return found


def _is_hopeless(e: RingEdgeFit) -> bool:
    """Tell whether edges are no ring's, so that the mirrored pose need not be tried either.

    Under the wrong one of two poses half of a large ring's edges are in place; in texture few are.
    """
    is_small = _shorter_px(e) < _ALIKE_PX
    return sum(e.support) < _HOPELESS_SUPPORT or (is_small and _share(e) < _HOPELESS_SHARE)


def edge_fits(
    image: U8,
    camera: CameraModel,
    ring: Ring,
    starts: Sequence[CirclePose],
    vouches: Vouches | None = None,
) -> list[RingFit]:
    """Return the fits to edges near expected poses, best first; empty if they are no ring's."""
    found = _fits_from(image, camera, ring, starts)
    if not found:
        return []
    found, noise = _best_first(found)
    inflation = 1.0 if _is_expected_ring(found[0]) else _told(found[0], ring, vouches)
    if inflation is None:
        return []
    return [_ring_fit(e, ring, camera, noise, inflation) for e in found]


def matched_fits(
    image: U8, camera: CameraModel, ring: Ring, start: CirclePose, vouches: Vouches | None
) -> list[RingFit]:
    """Return the fit to edges at a place that correlates with a level ring; empty: it is none."""
    e = edge_fit(image, camera, ring, start)
    if e is None:
        return []
    outer, inner = e.support
    if outer < _EVEN * inner or (inner < _EVEN * outer and not is_ring_by_edges(e)):
        return []
    inflation = _told(e, ring, vouches, _MATCHED)
    return [] if inflation is None else [_ring_fit(e, ring, camera, e.noise_px, inflation)]


def _best_first(fits: list[RingEdgeFit]) -> tuple[list[RingEdgeFit], float]:
    """Return fits in order of their cost, and the least noise of their edges, px.

    Their costs are compared with one number of independent edges, the smallest of them. Under the
    wrong one of two poses half of a large ring's edges may be in place to a tenth of the noise that
    motion leaves under the true one: fits with a much smaller share than the other's are left out.
    """
    most = max(map(_share, fits))
    fits = [e for e in fits if _share(e) >= _RIVAL_SHARE * most]
    noise = min(e.noise_px for e in fits)
    dependence = max(e.dependence for e in fits)
    fits = [replace(e, dependence=dependence) for e in fits]
    return sorted(fits, key=lambda e: edge_cost(e.residual, noise, e.dependence)), noise


def _is_shifted(e: RingEdgeFit) -> bool:
    """Tell whether a tone curve has moved the edges."""
    most = _AGREE_SHIFT_PX + _AGREE_SIGMAS * e.sigma_shift + _flat_bias_px(e)
    return abs(e.shift_px) > most


def is_toned(fit: RingFit, ring: Ring) -> bool:
    """Tell whether the ratio is off as if a tone curve shifted both edges: the range errs then."""
    off = abs(fit.ratio - ring.inner_ratio)
    return off > _AGREE_SIGMAS * fit.sigma_ratio + _AGREE_RATIO * ring.inner_ratio


def edges_contradict(image: U8, camera: CameraModel, ring: Ring, fit: RingFit) -> bool:
    """Tell whether the edges show that it is no ring, whatever motion or a response explain.

    That is a brighter circle within the stroke, or a product of shares below `_VOUCHED` times its
    limit: of 900 rings in all kinds of light none had less than 0.76 of the limit, small squares
    with a hole 0.6.
    """
    e = edge_fit(image, camera, ring, (fit.position, fit.normal))
    if e is None or _share(e) < _VOUCHED or (min(e.support) > _MIN_EITHER and e.ridge > _MAX_RIDGE):
        return True
    return fit.is_told is not None and fit.blur_px > _CLIPPED_BLURS * e.blur_px


def is_ring_by_edges(e: RingEdgeFit, share: float = 1.0) -> bool:
    """Tell whether edges are those of a ring, or reach this share of the limits for one."""
    return (
        _has_edges(e, share)
        and e.visible > _MIN_VISIBLE
        and _share(e) > share
        and not _is_dim_within(e)
    )


def _is_dim_within(e: RingEdgeFit) -> bool:
    """Tell whether even the brightest of the hole is too dark to be of the white around.

    Neither of the white around on the whole, nor of its darkest part, where a shadow may lie. The
    brightest part of the hole counts, as dirt may cover the rest.
    """
    _, black, outside = e.levels
    return is_dim_within(e.clean, black, outside) and is_dim_within(e.clean, black, e.shaded)


def _told(
    e: RingEdgeFit, ring: Ring, vouches: Vouches | None, least: float = _VOUCHED
) -> float | None:
    """Return the factor on the covariance of a ring told by its edges; None: they show none.

    If something vouches, edges need reach only the share `least` of the limits, and may look like
    those of a ring of another ratio.
    """
    outer, inner = e.support
    if _shorter_px(e) < _EVEN_PX and outer < _EVEN * inner:
        return None
    is_ring = is_ring_by_edges(e)
    is_even = _shorter_px(e) > _EVEN_PX or min(e.contrast) > _EVEN_CONTRAST * max(e.contrast)
    if is_ring and is_even and _keeps_ratio(e) and not _has_another_ratio(e, ring):
        return 1.0
    if vouches is None or not is_ring_by_edges(e, least):
        return None
    if not vouches(e.position, e.normal, min(e.contrast)):
        return None
    return 1.0 if is_ring else _VOUCHED_INFLATION


def _keeps_ratio(e: RingEdgeFit) -> bool:
    """Tell whether shifted edges are more likely a ring's of this ratio than of another."""
    least, most = _RATIO_KEPT
    share = e.shift_px / _shorter_px(e)
    is_white = min(e.levels[0], e.levels[2]) > _KEPT_WHITE
    return share > least and (share < most or is_white or e.shift_px < _KEPT_BLURS * e.blur_px)


def _has_another_ratio(e: RingEdgeFit, ring: Ring) -> bool:
    """Tell whether another ratio explains the edges better: with less shift and less noise."""
    freed = e.freed()
    is_off = abs(freed.ratio / ring.inner_ratio - 1.0) > _ANOTHER_RATIO
    is_plainer = abs(freed.shift_px) < abs(e.shift_px)
    least = _ANOTHER_MOVING_NOISE if e.motion_px > 0.0 else _ANOTHER_NOISE
    return is_off and is_plainer and freed.noise_px * least < e.noise_px


def _is_expected_ring(e: RingEdgeFit) -> bool:
    """Tell whether edges are those of a large ring where one is expected, shadows across it."""
    outer, inner = e.depth
    return (
        _has_edges(e)
        and _shorter_px(e) > _NEAR_PX
        and e.visible > _MIN_NEAR_VISIBLE
        and _edges_in_place(e) > _MIN_NEAR_PRODUCT
        and e.sigma_shift < _MAX_NEAR_SIGMA_PX
        and not is_dim_within(inner, 0.0, outer)
    )


def _has_edges(e: RingEdgeFit, share: float = 1.0) -> bool:
    """Tell whether there are edges all around, black on one side and white on the other.

    `share` is a factor on the shares of dark and bright that are required: dirt may cover some.
    """
    return (
        _shorter_px(e) > _MIN_RADIUS_PX
        and e.cos_tilt > MIN_COS
        and min(e.support) > _MIN_EITHER
        and min(e.dark, e.bright) > share * _MIN_SHARE
        and e.ridge < _MAX_RIDGE
        and min(e.contrast) > _MIN_CONTRAST
        and _min_shift_px(e) < e.shift_px < _max_shift_px(e)
    )


def _share(e: RingEdgeFit) -> float:
    """Return the product of all five shares over its limit."""
    return e.visible * _edges_in_place(e) / (_MIN_PRODUCT + _PRODUCT_PX / _shorter_px(e))


def _edges_in_place(e: RingEdgeFit) -> float:
    return math.prod((*e.support, e.dark, e.bright))


def _shorter_px(e: RingEdgeFit) -> float:
    return e.radius_px * e.cos_tilt


def _is_clipped(e: RingEdgeFit) -> bool:
    inside, black, outside = e.levels
    return min(inside, outside) > _CLIPPED and black < _CLIPPED_BLACK


def _min_shift_px(e: RingEdgeFit) -> float:
    """Return the least shift, px: negative, as the toe of a tone curve moves edges to the white."""
    if e.radius_px * e.cos_tilt < _SMALL_PX:
        return _MIN_SMALL_SHIFT * e.radius_px
    blurs = _MIN_CLIPPED_SHIFT_BLURS if _is_clipped(e) else _MIN_SHIFT_BLURS
    return min(_MIN_SHIFT_PX, -_PRINT_SHARE * e.radius_px) - blurs * e.blur_px


def _max_shift_px(e: RingEdgeFit) -> float:
    """Return the largest shift by a tone curve and an inexact print, px."""
    blurs = _MAX_SHIFT_BLURS
    if _is_clipped(e):
        black = min(e.darkest, _CLIPPED_BLACK) / 255.0
        blurs = max(blurs, _OVERLAP * _clipped_shift_blurs(black))
    return _MAX_SHIFT_PX + blurs * e.blur_px + _PRINT_SHARE * e.radius_px


def _clipped_shift_blurs(black: float) -> float:
    """Return how far white over full scale moves an edge at most, over the blur its slope shows.

    With white `exposure` times over full scale and ink of `black / exposure`, half-way from black
    to full scale is reached q sigmas off an edge blurred by a Gaussian, and the slope over the
    contrast is there `over * exp(-q^2 / 2)` times that of the unclipped edge.

    Args:
        black: level of the ink over full scale, below 1.
    """
    exposure = min(black / _BLACKEST_INK, _MAX_EXPOSURE)
    over = (exposure - black) / (1.0 - black)
    if over <= 1.0:
        return 0.0
    q = _NORMAL.inv_cdf(0.5 / over)
    return -q * over * math.exp(-0.5 * q * q)


def _agree(e: RingEdgeFit, fit: RingFit, ring: Ring, camera: CameraModel) -> bool:
    """Tell whether a fit to grey levels agrees with edges that no tone curve has moved."""
    is_blurred = _blur_share(e, ring, fit.blur_px) > _BLURRED_SHARE
    if is_toned(fit, ring) or (_is_shifted(e) and not is_blurred):
        return False
    if float(fit.normal @ e.normal) < _AGREE_COS:
        return False
    off = fit.position - e.position
    C = _covariance(e, ring, camera, fit.blur_px) + fit.covariance
    return float(off @ solved(C, off)) < _AGREE_CHI2


def _blur_share(e: RingEdgeFit, ring: Ring, blur_px: float | None) -> float:
    """Return the blur over the stroke's width where edges do not tell it, else 0.

    `blur_px` is that of a fit to grey levels; None: there is none.
    """
    stroke_px = e.radius_px * (1.0 - ring.inner_ratio)
    told_px = max(_TOLD_SHARE * stroke_px, _TOLD_PX)
    if blur_px is None:
        return _UNTOLD_SHARE if e.blur_px > told_px else 0.0
    is_told = e.blur_px < min(told_px, _TOLD_WIDE_PX)
    return 0.0 if is_told else min(blur_px / stroke_px, _MOST_SHARE)


def _covariance(e: RingEdgeFit, ring: Ring, camera: CameraModel, blur_px: float | None) -> F64:
    """Return the covariance of the position (3, 3), m^2, biases included.

    `blur_px` is that of a fit to grey levels; None: there is none.
    """
    _, axes = pose_axes((e.position, e.normal))
    a = axes[0].astype(np.float64)
    distance = float(np.linalg.norm(e.position))
    sight = e.position / distance
    C = e.covariance + frontal_inflation(e.covariance, a @ sight)
    focal = camera.focal
    shift = math.hypot(_SHIFT_BIAS * e.shift_px, _NOISE_BIAS * e.noise_px) / e.visible**2
    shift = math.hypot(shift, _UNEVEN_BIAS_PX * min(e.uneven, 1.0))
    shine = _SHINE_BLURS * e.blur_px * abs(e.depth[0] - e.depth[1]) / max(min(e.depth), 1e-3)
    sharp, broad = _SPREAD_PX
    spread = e.noise_px * min(1.0, max(0.0, (e.blur_px - sharp) / (broad - sharp)))
    blurred = max(0.0, _blur_share(e, ring, blur_px) - _BLURRED_SHARE) * _BLUR_BIAS * e.radius_px
    both = shine / (1.0 + ring.inner_ratio)  # of the radius, if the shift of both edges takes it up
    radial_px = math.hypot(_EDGE_BIAS_PX, shift, spread, blurred, both, _flat_bias_px(e))
    aside = math.hypot(_SPREAD_ASIDE * spread, _BLUR_ASIDE * blurred, _SHINE_ASIDE * shine)
    lateral_px = math.hypot(_LATERAL_BIAS_PX, shift, aside)
    radial = radial_px * distance * distance / (focal * ring.radius_m)
    lateral = lateral_px * distance / focal
    covariance: F64 = a.T @ C[:3, :3] @ a + np.outer(sight, sight) * radial**2
    return covariance + lateral**2 * np.eye(3)


def _flat_bias_px(e: RingEdgeFit) -> float:
    """Return the error of the radius, px, of a ring that is seen flat."""
    flat = max(e.cos_tilt, MIN_COS) ** _FLAT_POWER
    return float(_FLAT_BIAS * e.blur_px**2 / (e.radius_px * flat))


def _ring_fit(
    e: RingEdgeFit,
    ring: Ring,
    camera: CameraModel,
    noise_px: float,
    inflation: float,
    blur_px: float | None = None,
) -> RingFit:
    """Return a fit to edges in the form of one to grey levels."""
    inside, black, outside = e.levels
    covariance = _covariance(e, ring, camera, blur_px)
    sigma_tilt = math.sqrt(max(0.0, float(np.trace(e.covariance[3:, 3:])) / 2.0))
    return RingFit(
        position=e.position,
        normal=e.normal,
        blur_px=e.blur_px,
        motion_px=np.zeros(2),
        inside=inside,
        black=black,
        outside=outside,
        noise=e.noise_px,
        cost=edge_cost(e.residual, noise_px, e.dependence),
        explained=lambda: min(e.support),
        uncertainty=lambda: (covariance, sigma_tilt),
        inflation=inflation,
        ratio=ring.inner_ratio,
        sigma_ratio=0.0,
        stage=EDGES,
    )
