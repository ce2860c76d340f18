"""What a camera makes of the light of a ring: a tone curve, and a halo by sharpening.

Cameras made for people bend grey levels (`tone`), then add an unsharp mask: a share of the
difference to a softer image.
"""

from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64
from landerd.vision.arrays import F32
from landerd.vision.tone import MAX_TONE, TONE_SIGMA, TONES, toned

RESPONSES = TONES + 1  # parameters of a response: those of the curve, and the share of the mask
LINEAR_RESPONSE = np.zeros(RESPONSES)
RESPONSE_SIGMAS = np.array([TONE_SIGMA, TONE_SIGMA, 0.8])  # of the parameters, before any picture
_LEAST = np.array([-MAX_TONE, -MAX_TONE, -0.2])
_MOST = np.array([MAX_TONE, MAX_TONE, 3.0])
HALO_PX = 0.9  # sigma of what the softer image is softer by: masks are 3 to 5 pixels wide
_MIN_CONTRAST = 1.0  # grey levels: a wrong fit may have none
# The bulge is negative where the print lies in the toe of an S-curve: 3 x^2 - 2 x^3, the strongest
# of styles, has -0.85 below a white of 10 grey levels, -0.68 below 90, -0.41 below 200. A ring
# whose ratio is a fifth too small, before a linear camera, looks like one behind -0.8 to -1.2.
_DARKEST_TOE, _TOE_BY_WHITE = -0.9, 0.6
# Number of pictures, a second or two, in which edges are tried before a response.
_BY_EDGES = 30
# Chi-square of a response against a linear camera's from which on it is kept: by chance in none of
# 5000.
_SEEN_CHI2 = 20.0


@dataclass
class CameraResponse:
    """What the last rings showed of the camera's response; the next fits start with it."""

    response: F64 | None = None  # None: linear, as far as rings show
    # For how many more pictures edges are tried first: no response explained the last ring.
    pictures_by_edges: int = 0

    def learn(self, response: F64 | None, chi2: float) -> None:
        """Take the response of an accepted fit to grey levels; None: it needed none."""
        self.response = response if chi2 > _SEEN_CHI2 else None
        self.pictures_by_edges = 0

    def learn_edges(self) -> None:
        """Note that no response explained a ring's grey levels, but its edges showed it."""
        is_news = self.pictures_by_edges == 0
        self.pictures_by_edges = _BY_EDGES if is_news else self.pictures_by_edges - 1


def bounded_response(response: F64) -> F64:
    """Return the nearest responses (..., 3) that are cameras'."""
    return np.clip(response, _LEAST, _MOST)


def is_cameras(response: F64, white: float) -> bool:
    """Tell whether cameras have such a curve between a print's black and its white, grey levels.

    At its bound it is none, but clipped white.
    """
    toe = _DARKEST_TOE + _TOE_BY_WHITE * white / 255.0
    return bool(np.all(np.abs(response[:TONES]) < MAX_TONE) and response[0] > toe)


@dataclass(frozen=True)
class Responded:
    """Grey levels (starts, n) behind responses, and their derivatives."""

    level: F32
    by_sharp: F32  # (starts, n), of the sharp image's grey levels
    by_soft: F32  # of the softer one's
    by_white: F32  # of the mean of the whites, the images held
    by_black: F32
    by_response: F32  # (starts, 3, n)


def responded(sharp: F32, soft: F32, black: F32, contrast: F32, response: F32) -> Responded:
    """Return grey levels behind camera responses, and their derivatives.

    The tone curve lies between the print's black and the mean of its whites, and moves with them.

    Args:
        sharp: linear grey levels of the sharp image, (starts, n).
        soft: the same of the softer image, which an unsharp mask subtracts.
        black: the print's black, (starts, 1).
        contrast: mean of the print's whites less its black, (starts, 1).
        response: parameters of the responses, (starts, 3).
    """
    contrast = np.maximum(contrast, np.float32(_MIN_CONTRAST))
    halo = response[:, TONES:]
    sum_of = []
    for image, share in ((sharp, 1.0 + halo), (soft, -halo)):
        value = (image - black) / contrast
        curve, slope, by_tone = toned(value, response[:, :TONES])
        by_white = curve - slope * value
        by_black = 1.0 - slope - by_white
        sum_of.append((curve, share * slope, share * by_white, share * by_black, by_tone, share))
    (c, slope_c, w, b, t, k), (s, slope_s, v, a, u, j) = sum_of
    return Responded(
        level=black + contrast * (k * c + j * s),
        by_sharp=slope_c,
        by_soft=slope_s,
        by_white=w + v,
        by_black=b + a,
        by_response=np.concatenate(
            [
                contrast[:, None] * (k[:, None] * t + j[:, None] * u),
                (contrast * (c - s))[:, None],
            ],
            axis=1,
        ),
    )
