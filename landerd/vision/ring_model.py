"""The model of grey levels near a ring that `ring_fit` fits to pixels, and its derivatives.

Model of a pixel: its ray meets the pad's plane at a distance rho from the ring's centre. The edges
at rho = r_i and r_o are steps between three grey levels, blurred by a Gaussian and, if asked for,
by straight motion, under light with a linear gradient. Distances are computed in the pad's plane,
so that they are exact in spite of perspective and lens distortion; two second-order corrections
make up for measuring them in pixels. If asked for, grey levels pass through the camera's response
(`ring_response`).

If asked for, white over full scale is clipped. Only the dark side of each edge is left of it then,
in which a shift of the edge looks like another blur or another white. So the model is more exact
there: a pixel is a box, blur differs by direction, as by a little motion or in pixels that are not
square, and light falls off to all sides, as towards the corners of an image.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from landerd.camera_model import F64
from landerd.pad import Ring
from landerd.vision.arrays import F32
from landerd.vision.patch import FULL_SCALE
from landerd.vision.ring_pixels import Pixels, PlaneView, blurred_step, shifted
from landerd.vision.ring_response import HALO_PX, RESPONSES, responded

# Rows of the derivative, one for each parameter. The two of the light's gradient, where white is
# clipped also one of its curvature, and, last, the residual follow them.
RATIO = 0  # inner radius, m: fits hold it; it shows whether the pixels agree with the ring's ratio
CENTRE = slice(1, 4)  # m, on the plane's axes
TILT = slice(4, 6)  # turn of the normal towards the two tangents, rad
BLUR = 6  # variance, px^2
INSIDE = 7  # grey level inside the ring
HEIGHTS = slice(8, 10)  # steps of the grey level outwards: at the outer and at the inner edge
# If one of them is fitted: path of the image, px, or parameters of the camera's response.
MOTION, RESPONSE = slice(10, 12), slice(10, 10 + RESPONSES)
# Or, where white is clipped: by how much the blur exceeds its mean across edges whose normal lies
# along the image's x, and along the diagonal between x and y, px^2.
ASTIGMATISM = slice(10, 12)
_STATIC = 10  # number of rows before these, or before the light's gradient

MIN_BLUR_PX = 0.2  # sigma
_BLACKEST, _WHITEST = 2.5, 252.5  # grey levels beyond which a pixel is clipped; JPEG changes some
# Distance of subpixels from a pixel's centre along x and along y, px.
_SUBPIXEL_PX = 0.4
# The same where white is clipped: such subpixels have the box's own fourth cumulant, too.
_CLIPPED_SUBPIXEL_PX = 0.254
_BOX_BLUR = 1.0 / 12.0  # variance of a pixel's own box, px^2
_SUBPIXELS = np.array([[[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]]])
# Spacing of the samples of a motion's path, px, and limits of their number.
_PATH_STEP_PX = 1.3
_MIN_PATH_SAMPLES, _MAX_PATH_SAMPLES = 3.0, 9.0


class RingModel:
    """The grey levels that pixels would have under poses of a ring, and their derivatives.

    Several fits (`starts`) are computed side by side.
    """

    def __init__(
        self,
        pixels: Pixels,
        centre: F64,
        ring: Ring,
        motion_px: Sequence[F64] | None,
        *,
        has_response: bool = False,
        is_clipped: bool = False,
    ) -> None:
        """Prepare for some pixels.

        Args:
            pixels: what the model is compared with.
            centre: of the ring, roughly, camera frame, m, (3,); the light's gradient is about it.
            ring: its true size and ratio.
            motion_px: path (2,) of the image during exposure for every start; None: it stood still.
            has_response: whether the camera's response is fitted; not together with motion.
            is_clipped: whether white is clipped; not together with either.
        """
        self.pixels, self.ring = pixels, ring
        self.is_moving, self.has_response = motion_px is not None, has_response
        self.is_clipped = is_clipped
        radius = ring.radius_m
        self._radii = np.array([radius, radius * ring.inner_ratio], dtype=np.float32)
        x, y, z = centre.tolist()
        xy = pixels.rays[:2] - np.array([[x / z], [y / z]], dtype=np.float32)
        self._xy = xy * np.float32(z / radius)
        if is_clipped:
            self._xy = np.vstack([self._xy, (self._xy * self._xy).sum(axis=0)])
        self._along: F64 | None = None  # the motion's path, where the image is sampled
        if motion_px is not None:
            length = max(math.hypot(*m) for m in motion_px)
            samples = max(length / _PATH_STEP_PX, _MIN_PATH_SAMPLES)
            parts = int(min(samples, _MAX_PATH_SAMPLES))
            self._along = (np.arange(parts) + 0.5) / parts - 0.5
        # Which pixels (starts, n) were not clipped in the last derivative; None: all count.
        self.is_told: NDArray[np.bool_] | None = None
        self._curvature: tuple[F32, F32] | None = None
        extension = RESPONSE if has_response else MOTION  # as many as of astigmatism
        extended = self.is_moving or has_response or is_clipped
        self._static = extension.stop if extended else _STATIC
        self.rows = self._static + len(self._xy) + 1

    def derivative(self, t: F32, axes: F32, parameters: F64, supersampled: bool) -> F32:
        """Return the derivatives of the grey levels and, in the last row, the residuals.

        Args:
            t: centres (starts, 3), camera frame, m.
            axes: planes' axes (starts, 3, 3) as `PlaneView` takes them.
            parameters: blur, levels, motion or response or astigmatism, and gradient of the light
                (starts, rows - 1), in the order of the rows; those of ratio and pose are not read.
            supersampled: whether each pixel is the mean of four subpixels. The edges of a small
                ring are curved within the blur. A Gaussian is nearly the mean of four narrower
                ones in a square, and within those the edges are straight enough.

        Returns:
            (starts, rows, n), grey levels per unit of each parameter.
        """
        v, parts, spread = self._sampled(parameters, supersampled)
        g = PlaneView(v, self.pixels.focal, t, axes)
        least = MIN_BLUR_PX**2
        blur = [math.sqrt(max(b - spread**2, least)) for b in parameters[:, BLUR].tolist()]
        s = np.array(blur, dtype=np.float32)[:, None, None]
        d, shift = self._distances(g, supersampled)
        p = parameters.astype(np.float32)
        shape = _joined(self._shape(g, d, shift, s, p), parts)
        level = _level(shape, p)
        if self.has_response:
            s = np.sqrt(s * s + np.float32(HALO_PX * HALO_PX))
            softer = _joined(self._shape(g, d, shift, s, p), parts)
            level = _respond(shape, level, softer, p)
        return self._lit(shape, level, p)

    def _sampled(self, parameters: F64, supersampled: bool) -> tuple[F32, int, float]:
        """Return the rays of samples, their number per pixel, and what they add to the blur, px.

        The last is the samples' distance from the pixel's centre along x and y. Samples along a
        motion add nothing, as the motion is no part of the blur.
        """
        if self._along is not None:
            path = parameters[:, MOTION, None] * self._along
            return shifted(self.pixels, path), len(self._along), 0.0
        if supersampled:
            px = _CLIPPED_SUBPIXEL_PX if self.is_clipped else _SUBPIXEL_PX
            return shifted(self.pixels, px * _SUBPIXELS), 4, px
        return self.pixels.rays, 1, 0.0

    def _distances(self, g: PlaneView, supersampled: bool) -> tuple[F32, F32]:
        """Return signed distances to outer and inner edge (starts, 2, n), px, and `_blur_shift`.

        Distances are positive outside an edge. Without supersampling the second-order terms are
        those of the first call: they change little from step to step.
        """
        radii = self._radii[:, None]
        scale = g.scale[:, None]
        d = (g.rho[:, None] - radii) / scale
        if supersampled:
            area, bend = g.curvature()
            d, scale = g.foot(d - bend[:, None] * d * d, radii)
            return d, _blur_shift(area, radii, scale)
        if self._curvature is None:
            area, bend = g.curvature()
            self._curvature = bend[:, None], _blur_shift(area, radii, scale)
        bend, shift = self._curvature
        d -= bend * d * d
        return d, shift

    def _shape(self, g: PlaneView, d: F32, shift: F32, s: F32, parameters: F32) -> F32:
        """Return the derivatives under even light (starts, rows before the light's, samples).

        Args:
            g: rays and planes.
            d: signed distances to the edges, px, (starts, 2, samples).
            shift: see `_blur_shift`.
            s: sigma of the blur, px, (starts, 1, 1).
            parameters: see `derivative`.
        """
        if self.is_clipped:
            s, f, density, turns = self._astigmatic(g, d, shift, s, parameters)
        else:
            f, density = blurred_step(d / s + shift * s)
        density *= _heights(parameters) / s
        shape = np.empty((len(parameters), self._static, f.shape[-1]), dtype=np.float32)
        outwards = -g.scale
        down = density[:, 0] + density[:, 1]
        down /= outwards
        np.divide(density[:, 1], outwards, out=shape[:, RATIO])
        np.multiply(down[:, None], g.u, out=shape[:, CENTRE])
        turned = down * g.a
        turned *= g.rho
        np.multiply(turned[:, None], g.u[:, :2], out=shape[:, TILT])
        density *= d
        np.multiply(density[:, 0] + density[:, 1], -0.5 / (s[:, 0] * s[:, 0]), out=shape[:, BLUR])
        shape[:, INSIDE] = 1.0
        shape[:, HEIGHTS] = f
        if self._along is not None:
            share = np.repeat(self._along, len(self.pixels.grey)).astype(np.float32)
            shape[:, MOTION] = (down * outwards * share)[:, None] * g.across()
        if self.is_clipped:
            np.multiply(shape[:, BLUR, None], turns, out=shape[:, ASTIGMATISM])
        if self.has_response:
            shape[:, RESPONSE] = 0.0  # filled in by `_respond`
        return shape

    def _astigmatic(
        self, g: PlaneView, d: F32, shift: F32, s: F32, parameters: F32
    ) -> tuple[F32, F32, F32, F32]:
        """Return the blur's sigma, the blurred steps, their density, and the blur's derivatives.

        Arguments are as `_shape` takes them. Sigmas are (starts, 1, samples), steps and density
        (starts, 2, samples). The derivatives are those of the variance by the astigmatism,
        (starts, 2, samples).
        """
        x, y = g.across().transpose(1, 0, 2)
        turns = np.stack([x * x - y * y, 2.0 * x * y], axis=1)
        mean = s * s
        is_one = d.shape[-1] == len(self.pixels.grey)  # sample a pixel: its box is in the blur
        variance = mean + (parameters[:, ASTIGMATISM, None] * turns).sum(axis=1, keepdims=True)
        np.maximum(variance, np.float32(_BOX_BLUR if is_one else MIN_BLUR_PX**2), out=variance)
        s = np.sqrt(variance)
        # It is the blur along a curved edge that shifts it.
        z = (d + shift * (2.0 * mean - variance)) / s
        f, density = blurred_step(z)
        if is_one:
            # Edgeworth's series to the fourth cumulant: that of a box is -1/120 along x and y.
            cumulant = (1.0 + turns[:, :1] * turns[:, :1]) * np.float32(-1.0 / 240.0)
            f += cumulant / (24.0 * variance * variance) * (z * (z * z - 3.0) * -density)
        return s, f, density, turns

    def _lit(self, shape: F32, level: F32, parameters: F32) -> F32:
        """Return the derivatives under light with a gradient, with those by it and the residual.

        Args:
            shape: derivatives under even light, (starts, rows before the light's, n).
            level: grey levels under even light, (starts, n).
            parameters: see `derivative`.
        """
        grey = self.pixels.grey
        light = parameters[:, self._static :] @ self._xy
        light += 1.0
        J = np.empty((len(parameters), self.rows, len(grey)), dtype=np.float32)
        np.multiply(shape, light[:, None], out=J[:, : self._static])
        np.multiply(level[:, None], self._xy, out=J[:, self._static : -1])
        made = light * level
        if self.is_clipped:
            self.is_told = made <= FULL_SCALE
            J[:, :-1] *= self.is_told[:, None]
            np.minimum(made, np.float32(FULL_SCALE), out=made)
        np.subtract(grey, made, out=J[:, -1])
        if self.has_response:
            beyond = _beyond(grey, J[:, -1])
            J *= ~beyond[:, None]
            self.is_told = ~beyond
        return J


def _beyond(grey: F32, residual: F32) -> NDArray[np.bool_]:
    """Tell which pixels (starts, n) are clipped, and should be whiter, or blacker, than that."""
    clipped: NDArray[np.bool_] = (grey > _WHITEST) & (residual < 0.0)
    clipped |= (grey < _BLACKEST) & (residual > 0.0)
    return clipped


def _joined(shape: F32, parts: int) -> F32:
    """Return derivatives of pixels: the means of those of their samples (starts, rows, parts n)."""
    if parts == 1:
        return shape
    mean: F32 = shape.reshape(*shape.shape[:2], parts, -1).mean(axis=2)
    return mean


def _level(shape: F32, parameters: F32) -> F32:
    """Return grey levels (starts, n) under even light."""
    rises = _heights(parameters) * shape[:, HEIGHTS]
    level: F32 = rises[:, 0] + rises[:, 1]
    level += parameters[:, INSIDE, None]
    return level


def _respond(shape: F32, level: F32, softer: F32, parameters: F32) -> F32:
    """Return grey levels after the camera's responses; change the derivatives in place likewise.

    Args:
        shape: derivatives under even light, (starts, rows before the light's, n); changed.
        level: grey levels under even light, (starts, n).
        softer: derivatives of the softer image of `ring_response`, like `shape`; overwritten.
        parameters: see `RingModel.derivative`.
    """
    inside, outer, inner = parameters[:, INSIDE : HEIGHTS.stop].T[:, :, None]
    response = parameters[:, RESPONSE]
    made = responded(
        level, _level(softer, parameters), inside + inner, 0.5 * (outer - inner), response
    )
    shape *= made.by_sharp[:, None]
    softer *= made.by_soft[:, None]
    shape += softer
    shape[:, INSIDE] = 1.0  # the curve lies between the levels, and moves with all of them
    shape[:, HEIGHTS] += (0.5 * made.by_white)[:, None]
    shape[:, HEIGHTS.start + 1] += made.by_black
    shape[:, RESPONSE] = made.by_response
    return made.level


def _heights(parameters: F32) -> F32:
    """Return the steps of the grey level at outer and inner edge, outwards, (starts, 2, 1)."""
    return parameters[:, HEIGHTS, None]


def _blur_shift(area: F32, radii: F32, scale: F32) -> F32:
    """Return by how much blur shifts curved edges (starts, 2, n), in sigmas per px of sigma.

    Args:
        area: of the plane in a pixel, m^2, (starts, n).
        radii: of the edges, m, (2, 1).
        scale: metres of the plane per px across the edges, broadcasts to (starts, 2, n).
    """
    return (0.5 * area * area)[:, None] / (radii * scale**3)
