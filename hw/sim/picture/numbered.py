"""Pictures that show nothing but a number, for a simulation in which nobody looks at pictures.

Who has the number may ask what the camera would have seen (`view_of`). So what happens to pictures
on their way (lost, late, repeated, frozen, blackened, of a wrong size) happens here too: a picture
carries its own view, whatever its time stamp says.
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

_KEPT = 300  # views: of a second and more at any frame rate
_ODD = 0x9E3779B1  # spreads numbers over 32 bits: a picture upside down has none that is known
_BYTES = 4
_PLACES = 5  # along both axes of a picture, where its number is looked for


@dataclass(frozen=True, slots=True)
class View:
    """What one picture would show."""

    number: int
    start: CameraPose  # of the exposure, beside the pad where it is at its middle
    end: CameraPose
    pad: PadPose
    exposure: Exposure | None  # None: as the illumination has it
    readout: Readout | None
    column: U8  # (height,) of the picture's first column


class NumberedPictures:
    """Takes a `Renderer`'s place; draws nothing."""

    def __init__(self, camera: CameraModel, plate: Plate, sensitivity: Sensitivity) -> None:
        """Take the true camera, the pad's plate, and what exposures make of the light."""
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
        """Return a picture (height, width) that no other is like, and keep what it would show."""
        code = (self._count + 1) * _ODD % 2**32
        self._views.pop((self._count + 1 - _KEPT) * _ODD % 2**32, None)
        self._count += 1
        number = np.frombuffer(code.to_bytes(_BYTES, "little"), np.uint8)
        times = math.ceil(self._height / _BYTES)
        column = np.tile(number, times)[: self._height]
        self._views[code] = View(self._count, start, end, pad, exposure, readout, column)
        return np.tile(self._ramp + number[:, None], (times, 1))[: self._height]

    def brightness(self, image: U8) -> float:
        """Return about the mean of what a picture would show, share of full scale."""
        view = self.view_of(image)
        if view is None:
            return 0.0
        x, y, z = in_camera(view.start, np.array([view.pad.position]))[0].tolist()
        share = 0.0
        if z > 0.0 and abs(x) < z and abs(y) < z:  # about what a picture holds
            seen = self._area_m2 * self._camera.fx * self._camera.fy / (z * z)
            share = min(seen / (self._camera.width * self._camera.height), 1.0)
        return self._sensitivity.brightness(view.exposure, share)

    def view_of(self, image: U8) -> View | None:
        """Return what a picture would show; None: its number cannot be read."""
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
    """Tell at which pixels (n, 2) a picture carries a view's number, (n,); not outside of it."""
    height, width = image.shape
    x, y = np.rint(px).astype(np.intp).T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    expected = view.column[y] + (x % 256).astype(np.uint8)
    return cast(NDArray[np.bool_], inside & (image[y, x] == expected))
