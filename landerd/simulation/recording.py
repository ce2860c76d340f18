"""Records a simulated flight for its result, its path and its drawing."""

import math
from collections.abc import Callable

from hw.sim.judge.score import Score
from hw.sim.physics.world import World
from landerd.analysis.picture import Sample
from landerd.camera_model import CameraModel
from landerd.geometry import Vec3, norm, rot_z, rotate, sub, transpose
from landerd.guidance.pilot_texts import HOLDING_OVER
from landerd.lander import Lander
from landerd.messages import (
    Command,
    Frame,
    GimbalCommand,
    Input,
    Phase,
    PhaseChange,
    Prior,
    Sightings,
    Tick,
)
from landerd.runtime.observer import Observer

SAMPLE_S = 0.1  # time between samples
KNOWN_AFTER_S = 2.0  # time from the first sighting after which the pad's velocity should be known


class Recording(Observer):
    """An observer that keeps what result, path and drawing need.

    Attributes:
        began: start of the flight on the loop's clock, s.
        camera_model: of the pictures.
        samples: true positions of vehicle and pad.
        headings: for each sample, the true difference of the vehicle's heading from the pad's, rad.
        in_camera: for each sample, the landing point as last seen, camera frame, m; None: it was
            not seen since the sample before.
        estimates: for each sample, the landing point as landerd estimates it: ahead of, right of
            and below the feet, m; None: there was no estimate.
        phases: the changes of phase or reason, with their times on the loop's clock, s.
        views: for each phase the first picture with a marker, with its time since the start, s.
        progress: called with a line of text for each sample; None: nobody is told.
        frames: number of pictures searched.
        off_centre_px: distance of the tracked marker from the image's centre, for each picture with
            a marker.
        gimbal_errors_px: difference of the gimbal's true angles from each order, as a distance in
            the image.
        nis: normalised innovation squared of each sighting that the filter could compare.
        hold_errors_m: horizontal distance of the vehicle from the landing point, for each sample
            while it holds over the marker as the pilot asked.
        pad_velocity_error_mps: error of the pad's estimated velocity `KNOWN_AFTER_S` after the
            first sighting; None: there was no estimate.
    """

    def __init__(
        self,
        world: World,
        score: Score,
        camera_model: CameraModel,
        gimbal_angles: Callable[[], tuple[float, float]],
        *,
        has_pictures: bool = True,
    ) -> None:
        """Prepare to record a flight that starts now.

        Args:
            world: the truth.
            score: knows when the pad was first seen.
            camera_model: of the pictures.
            gimbal_angles: returns the true yaw and pitch, rad, in the reference of orders.
            has_pictures: whether frames show pictures; with modelled sight they do not.
        """
        self.began = world.t
        self.camera_model = camera_model
        self.samples: list[Sample] = []
        self.headings: list[float] = []
        self.in_camera: list[Vec3 | None] = []
        self.estimates: list[Vec3 | None] = []
        self.phases: list[tuple[float, PhaseChange]] = []
        self.views: dict[Phase, tuple[float, Frame, Sightings]] = {}
        self.progress: Callable[[str], None] | None = None
        self.frames = 0
        self.off_centre_px: list[float] = []
        self.gimbal_errors_px: list[float] = []
        self.nis: list[float] = []
        self.hold_errors_m: list[float] = []
        self.pad_velocity_error_mps: float | None = None
        self._world, self._score = world, score
        self._has_pictures = has_pictures
        self._gimbal_angles = gimbal_angles
        self._start_pad = world.pad
        self._sampled_t = -math.inf
        self._last_seen: Vec3 | None = None
        self._lander: Lander | None = None

    @property
    def lander(self) -> Lander:
        """The core of the flight in progress, or of the last one."""
        assert self._lander is not None
        return self._lander

    def on_flight(self, lander: Lander) -> None:
        """Take the core in use: arming makes a new one, although there is only one flight."""
        self._lander = lander

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Count a picture, and keep the first one with a marker in each phase."""
        self.frames += 1
        if sightings.markers:
            looked_at = min(sightings.markers, key=lambda m: m.kind.startswith("why"))
            x, y, z = looked_at.solutions[0].position
            model = self.camera_model
            self.off_centre_px.append(math.hypot(model.fx * x / z, model.fy * y / z))
        if sightings.pad:
            self._last_seen = sightings.pad[0].position
        phase = self.lander.phase
        if self._has_pictures and sightings.markers and phase not in self.views:
            self.views[phase] = (frame.t - self.began, frame, sightings)

    def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
        """Note changes of phase and innovations, and sample the truth."""
        if self.off_centre_px:
            for command in commands:
                if isinstance(command, GimbalCommand):
                    self._compare_gimbal(command)
        self.phases += [(now, c) for c in commands if isinstance(c, PhaseChange)]
        if isinstance(message, Tick) and now - self._sampled_t >= SAMPLE_S:
            self._sampled_t = now
            self._sample(now)
            self._compare_velocity(now)
        elif isinstance(message, Sightings):
            nis = self.lander.nis
            if not math.isnan(nis):
                self.nis.append(nis)

    def _compare_gimbal(self, ordered: GimbalCommand) -> None:
        """Note the difference of the gimbal's angles from an order, px."""
        yaw, pitch = self._gimbal_angles()
        yaw = (ordered.yaw - yaw) * math.cos(pitch)
        pitch = ordered.pitch - pitch
        self.gimbal_errors_px.append(self.camera_model.fx * math.hypot(yaw, pitch))

    def _compare_velocity(self, now: float) -> None:
        """Note the error of the pad's velocity, once, as soon as it should be known."""
        first = self._score.first_sighting_t
        if (
            self.pad_velocity_error_mps is None
            and first is not None
            and now > first + KNOWN_AFTER_S
        ):
            relative = self.lander.relative_state(now)
            if relative is not None:
                difference = sub(relative.pad_velocity, self._world.pad.velocity)
                self.pad_velocity_error_mps = norm(difference)

    def _sample(self, now: float) -> None:
        """Add a sample for a time on the loop's clock, s."""
        world, lander = self._world, self.lander
        world.advance(now)
        flown_s = now - self.began
        vehicle = self._from_start(world.footprint_centre)
        pad = self._from_start(world.pad.position)
        self.samples.append(Sample(flown_s, vehicle, pad, lander.phase))
        self.headings.append(world.heading_error)
        self.in_camera.append(self._last_seen)
        self._last_seen = None
        distance = math.hypot(*world.offset)
        if lander.reason == HOLDING_OVER:
            self.hold_errors_m.append(distance)
        relative = lander.relative_state(now)
        turned = rot_z(-world.vehicle.yaw)
        self.estimates.append(None if relative is None else rotate(turned, relative.error))
        if self.progress is not None:
            self.progress(
                f"{flown_s:5.1f} s  {lander.phase.value:14}  {distance:5.1f} m away  "
                f"{world.height:z5.2f} m up  {lander.reason}"
            )

    def _from_start(self, p: Vec3) -> Vec3:
        """Return a local point on the axes of the pad at its start: north, east and up, m."""
        origin = self._start_pad
        x, y, z = rotate(transpose(origin.R_local_pad), sub(p, origin.position))
        return (x, y, -z)
