"""Pictures that show only a number, for simulations with modelled sight.

The number leads to what the camera would have seen (`NumberedPictures.view_of`). As each picture
carries its own view, whatever its time stamp says, faults of pictures (lost, late, repeated,
frozen, blackened, of a wrong size) have the same effect as on drawn ones.
"""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from hw.sim.picture.exposure import Exposure
from hw.sim.picture.levels import Sensitivity
from hw.sim.picture.shutter import Readout
from hw.sim.picture.view import F64, in_camera
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import CameraModel
from landerd.pad import Plate

U8 = NDArray[np.uint8]

_KEPT = 300  # number of views kept: more than a second at any frame rate
# Odd factor that spreads numbers over 32 bits, so that an altered picture, as one upside down,
# shows no number of another view.
_ODD = 0x9E3779B1
_BYTES = 4  # of a number
_PLACES = 5  # along each axis of a picture at which its number is looked for


@dataclass(frozen=True, slots=True)
class View:
    """What one picture would show."""

    number: int  # of the picture, counted from 1
    # At start and end of the exposure, relative to the pad where it is at the middle.
    start: CameraPose
    end: CameraPose
    pad: PadPose  # at the middle of the exposure
    exposure: Exposure | None  # None: the one that the illumination is set for
    readout: Readout | None  # None: all rows are exposed at once
    column: U8  # the picture's first column, (height,)


class NumberedPictures:
    """Replaces a `Renderer`, and draws only numbers."""

    def __init__(self, camera: CameraModel, plate: Plate, sensitivity: Sensitivity) -> None:
        """Take what determines the mean of a picture.

        Args:
            camera: the true one.
            plate: of the pad.
            sensitivity: grey levels of pad and ground for an exposure.
        """
        self._camera = camera
        self._area_m2 = (plate.north_m + plate.south_m) * (plate.east_m + plate.west_m)
        self._sensitivity = sensitivity
        self._height = camera.height
        self._ramp = (np.arange(camera.width) % 256).astype(np.uint8)[None, :]
        self._views: dict[int, View] = {}
        self._count = 0

    def render(
        self,
        frame_index: int,
        start: CameraPose,
        end: CameraPose,
        pad: PadPose,
        vehicle: VehiclePose | None,
        exposure: Exposure | None = None,
        readout: Readout | None = None,
    ) -> U8:
        """Return a picture (height, width) that shows a new number; keep what it stands for."""
        code = (self._count + 1) * _ODD % 2**32
        self._views.pop((self._count + 1 - _KEPT) * _ODD % 2**32, None)
        self._count += 1
        number = np.frombuffer(code.to_bytes(_BYTES, "little"), np.uint8)
        times = math.ceil(self._height / _BYTES)
        column = np.tile(number, times)[: self._height]
        self._views[code] = View(self._count, start, end, pad, exposure, readout, column)
        return np.tile(self._ramp + number[:, None], (times, 1))[: self._height]

    def brightness(self, image: U8) -> float:
        """Return the approximate mean of what a picture stands for, share of full scale."""
        view = self.view_of(image)
        if view is None:
            return 0.0
        x, y, z = in_camera(view.start, np.array([view.pad.position]))[0].tolist()
        share = 0.0
        if z > 0.0 and abs(x) < z and abs(y) < z:  # roughly the field of view
            seen = self._area_m2 * self._camera.fx * self._camera.fy / (z * z)
            share = min(seen / (self._camera.width * self._camera.height), 1.0)
        return self._sensitivity.brightness(view.exposure, share)

    def view_of(self, image: U8) -> View | None:
        """Return the view that a picture stands for; None: its number cannot be read."""
        height, width = image.shape
        for y in range(0, height - _BYTES, max(height // _PLACES, 1)):
            for x in range(0, width, max(width // _PLACES, 1)):
                top = y - y % _BYTES
                code = int.from_bytes(
                    (image[top : top + _BYTES, x] - np.uint8(x % 256)).tobytes(), "little"
                )
                view = self._views.get(code)
                if view is not None:
                    return view
        return None


def carries(image: U8, view: View, px: F64) -> NDArray[np.bool_]:
    """Tell at which points (n, 2), px, a picture shows a view's number; outside it is False."""
    height, width = image.shape
    x, y = np.rint(px).astype(np.intp).T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    expected = view.column[y] + (x % 256).astype(np.uint8)
    return cast(NDArray[np.bool_], inside & (image[y, x] == expected))
