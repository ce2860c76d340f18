"""What the arrays of vision hold; F64 is the camera model's."""

import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
Image = U8  # grey, (height, width)
F32 = NDArray[np.float32]  # of everything per pixel: half the time, and 1e-5 px is enough
Mask = NDArray[np.bool_]
