"""A second pad with the same ids beside the right one: the fault `second-pad`."""

import cv2
import numpy as np

from hw.sim.picture.camera import U8, Renders
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.shutter import Readout
from hw.sim.picture.vehicle import fill
from hw.sim.picture.view import Frustum, in_camera, on_pad
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.geometry import Vec3, add, rotate
from landerd.pad import Plate


class SecondPad:
    """Draws the pad and another one like it, with the renderer of the first."""

    def __init__(self, renderer: Renders, plate: Plate, frustum: Frustum, aside: Vec3) -> None:
        """Prepare to draw both pads.

        Args:
            renderer: of the first pad.
            plate: outline of either pad.
            frustum: of the camera.
            aside: vector from the first pad to the second, pad frame, m.
        """
        self._renderer = renderer
        self._aside = aside
        self._frustum = frustum
        north, south, east, west = plate.north_m, -plate.south_m, plate.east_m, -plate.west_m
        self._corners = np.array(
            [(north, east, 0.0), (south, east, 0.0), (south, west, 0.0), (north, west, 0.0)]
        )

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
        """Return the picture (height, width) of an exposure from pose start to pose end."""
        shot = (frame_index, start, end)
        first = self._renderer.render(*shot, pad, vehicle, exposure, readout)
        place = add(pad.position, rotate(pad.R_local_pad, self._aside))
        other = PadPose(place, pad.R_local_pad)
        (outline,) = self._frustum.outlines([in_camera(start, on_pad(other, self._corners))])
        if len(outline) < 3:
            return first
        second = self._renderer.render(*shot, other, vehicle, exposure, readout)
        mask = np.zeros_like(first)
        fill(mask, outline, 255)
        cv2.copyTo(second, mask, first)
        return first

    def brightness(self, image: U8) -> float:
        """Return the mean of a picture, share of full scale."""
        return self._renderer.brightness(image)
