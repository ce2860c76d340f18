"""Pads that are not where the world has its pad: carried off, or a second one of the same ids."""

import cv2
import numpy as np

from hw.sim.picture.camera import Renders
from hw.sim.picture.exposure import Exposure
from hw.sim.picture.renderer import U8
from hw.sim.picture.shutter import Readout
from hw.sim.picture.vehicle import fill
from hw.sim.picture.view import Frustum, in_camera
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.geometry import Vec3, add, rotate
from landerd.pad import Plate

_FAR: Vec3 = (1000.0, 1000.0, 0.0)  # in the pad frame, m


class ElsewherePad:
    """Draws the pad elsewhere."""

    def __init__(self, renderer: Renders, aside: Vec3 = _FAR) -> None:
        """Aside: from where the world has it, pad frame, m."""
        self._renderer = renderer
        self._aside = aside

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
        moved = self.moved(pad)
        return self._renderer.render(frame_index, start, end, moved, vehicle, exposure, readout)

    def moved(self, pad: PadPose) -> PadPose:
        """Return where the drawn pad lies."""
        return PadPose(add(pad.position, rotate(pad.R_local_pad, self._aside)), pad.R_local_pad)


class SecondPad:
    """Draws the pad and another one like it."""

    def __init__(self, renderer: Renders, plate: Plate, frustum: Frustum, aside: Vec3) -> None:
        """Take what there is.

        Args:
            renderer: of the first.
            plate: the pads' outline.
            frustum: of the camera.
            aside: from the first to the second, pad frame, m.
        """
        self._renderer = renderer
        self._second = ElsewherePad(renderer, aside)
        self._frustum = frustum
        north, south, east, west = plate.north_m, plate.south_m, plate.east_m, plate.west_m
        self._corners: tuple[Vec3, ...] = (
            (north, east, 0.0),
            (-south, east, 0.0),
            (-south, -west, 0.0),
            (north, -west, 0.0),
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
        shots = (frame_index, start, end)
        first = self._renderer.render(*shots, pad, vehicle, exposure, readout)
        moved = self._second.moved(pad)
        corners = [add(moved.position, rotate(pad.R_local_pad, c)) for c in self._corners]
        (outline,) = self._frustum.outlines([in_camera(start, np.array(corners))])
        if len(outline) < 3:
            return first
        second = self._renderer.render(*shots, moved, vehicle, exposure, readout)
        mask = np.zeros_like(first)
        fill(mask, outline, 255)
        cv2.copyTo(second, mask, first)
        return first
