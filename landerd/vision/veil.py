"""Pictures whose grey levels a veil has crowded together: fog, haze, a lens in the sun or misted.

A veil adds light to all levels, and the exposure goes by the sum, so that black, white and ground
differ by a few levels. What tells a marker from texture is in grey levels as an ordinary picture
has them. A crowded picture has fewer of them, but little noise, too, so its levels are spread.
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


def spread(image: U8) -> U8:
    """Return an image (height, width) as it is, or with its levels spread if a veil lies over it.

    Not that of a clear sky: spread, its noise would look like texture.
    """
    darkest, brightest, _, _ = cv2.minMaxLoc(image)
    extent = brightest - darkest
    if darkest < _LEAST_DARKEST or extent > _MOST_RANGE or brightest >= CLIPPED_LEVEL:
        return image
    if is_blank(image):
        return image
    gain = min(_MOST_GAIN, _SPREAD_OVER / max(extent, 1.0))
    middle = 0.5 * (darkest + brightest)
    spread_out = cv2.convertScaleAbs(image, alpha=gain, beta=_MIDDLE - round(gain * middle))
    return np.asarray(spread_out, dtype=np.uint8)
