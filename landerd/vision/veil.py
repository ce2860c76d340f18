"""Pictures whose grey levels are crowded together, by a veil or by darkness.

A veil (fog, haze, a lens in the sun or misted) adds light to all levels, and the exposure goes by
the sum, so that black, white and ground differ by a few levels. So they do at dusk, before a camera
that cannot expose for longer. What tells a marker from texture is in grey levels as an ordinary
picture has them. A crowded picture has fewer of them, but little noise, too, so its levels are
spread.
"""

import cv2
import numpy as np

from landerd.messages import CLIPPED_LEVEL
from landerd.vision.arrays import U8
from landerd.vision.pyramid import is_blank

# A veil lies over a picture whose levels are all above the first and differ by less than the
# second, without any that is clipped. Of 36 pictures of pads behind a veil of 80 to 88 % of the
# light (20 to 250 px, three kinds of pad) the darkest was 104 or more, and the most that levels
# differed was 50.
_LEAST_DARKEST, _MOST_RANGE = 40.0, 100.0
# Levels are spread over so many about the middle grey, by no more than this factor: noise grows
# with it.
_SPREAD_OVER, _MOST_GAIN, _MIDDLE = 200.0, 3.0, 128.0
# A picture is dark if no level of it, reduced by the second, is above the first: a hot pixel is not
# bright then. Its levels are multiplied. At a twentieth of full scale white paper has 13.
_MOST_BRIGHTEST, _REDUCTION, _DARK_GAIN = 32.0, 0.25, 4.0


def spread(image: U8) -> U8:
    """Return an image (height, width) as it is, or with its levels spread if they are crowded.

    Not that of a clear sky: spread, its noise would look like texture.
    """
    gain, offset = (_DARK_GAIN, 0.0) if _is_dark(image) else _against_veil(image)
    if gain == 1.0 or is_blank(image):
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain, beta=offset), dtype=np.uint8)


def _against_veil(image: U8) -> tuple[float, float]:
    """Return the gain of levels, and what is added then; 1 and 0: no veil lies over the image."""
    darkest, brightest, _, _ = cv2.minMaxLoc(image)
    extent = brightest - darkest
    if darkest < _LEAST_DARKEST or extent > _MOST_RANGE or brightest >= CLIPPED_LEVEL:
        return 1.0, 0.0
    gain = min(_MOST_GAIN, _SPREAD_OVER / max(extent, 1.0))
    middle = 0.5 * (darkest + brightest)
    return gain, _MIDDLE - round(gain * middle)


def _is_dark(image: U8) -> bool:
    if cv2.mean(image)[0] > _MOST_BRIGHTEST:  # tells most pictures at once
        return False
    reduced = cv2.resize(image, None, fx=_REDUCTION, fy=_REDUCTION, interpolation=cv2.INTER_AREA)
    return cv2.minMaxLoc(reduced)[1] <= _MOST_BRIGHTEST
