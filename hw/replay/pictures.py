"""Pictures for a recorded flight: a video's, or drawn ones of a pad that was not there."""

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from hw.replay.vehicle import RecordedVehicle
from hw.replay.video import read_video
from hw.sim.options import PadOptions, RenderOptions
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose, VehiclePose
from landerd.camera_model import CameraModel
from landerd.geometry import Vec3, add, rot_z, rotate
from landerd.messages import Frame
from landerd.pad import PadLayout


class VideoPictures:
    """A video's frames on the recording's clock."""

    def __init__(self, path: Path, begins: float) -> None:
        self._frames: Iterator[Frame] = read_video(path)
        self._begins = begins
        self._next: Frame | None = None
        self._ended = False

    def expose(self, t: float) -> Frame | None:
        """Return the oldest frame up to time t."""
        if self._next is None and not self._ended:
            frame = next(self._frames, None)
            self._ended = frame is None
            if frame is not None:
                self._next = Frame(frame.t + self._begins, frame.seq, frame.image)
        if self._next is None or self._next.t > t:
            return None
        frame, self._next = self._next, None
        return frame


class Airframe(Protocol):
    """What is configured of the vehicle's geometry."""

    @property
    def camera_offset_m(self) -> Vec3:
        """Body to the gimbal's pivot, m."""
        ...

    @property
    def footprint_m(self) -> tuple[float, float]:
        """Between the feet, along x and along y, m."""
        ...

    @property
    def gear_height_m(self) -> float:
        """Down to the plane of the feet, m."""
        ...


class DrawnPictures:
    """Pictures of a pad as the recorded flight's camera would have taken them."""

    def __init__(
        self,
        layout: PadLayout,
        camera: CameraModel,
        render: RenderOptions,
        vehicle: RecordedVehicle,
        airframe: Airframe,
        pad: Vec3,
        *,
        start: float,
        fps: float,
    ) -> None:
        """Begin at a time.

        Args:
            layout: the pad's markers.
            camera: intrinsics.
            render: light, lens, ground; the ground lies as high as the pad.
            vehicle: where the camera is and how it looks.
            airframe: its geometry.
            pad: landing point, local NED, m; its north is north.
            start: of the first picture, s on the recording's clock.
            fps: pictures a second.
        """
        ground = render.model_copy(update={"ground_down_m": pad[2]})
        place = PadOptions(position_m=(pad[0], pad[1]))
        self._renderer = Renderer(layout, camera, ground, 1, pad=place)
        self._vehicle = vehicle
        self._airframe = airframe
        self._pad = PadPose(pad, rot_z(0.0))
        self._period = 1.0 / fps
        self._seq = 0
        self._next = start

    def expose(self, t: float) -> Frame | None:
        """Return the oldest frame up to time t."""
        while self._next <= t:
            at = self._next
            self._next += self._period
            self._seq += 1
            body, look = self._vehicle.body(at), self._vehicle.look(at)
            if body is None or look is None:
                continue
            position, R = body
            airframe = self._airframe
            lens = CameraPose(add(position, rotate(R, airframe.camera_offset_m)), look)
            pose = VehiclePose(position, R, airframe.footprint_m, airframe.gear_height_m)
            image = self._renderer.render(self._seq, lens, lens, self._pad, pose)
            return Frame(at, self._seq, image)
        return None
