"""Records a simulated flight for its result and its picture."""

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

SAMPLE_S = 0.1
KNOWN_AFTER_S = 2.0  # from the first sighting to when the pad's velocity is to be known


class Recording(Observer):
    """An observer that keeps what the result and the picture need.

    Attributes:
        began: when the flight began, s on the loop's clock.
        camera_model: intrinsics of the pictures.
        samples: where vehicle and pad were.
        headings: how far off the pad's heading was with every sample, rad.
        in_camera: the landing point in the camera's frame, m, as last seen with every sample;
            None: not since the one before.
        estimates: the landing point from the feet by landerd's own estimate with every sample,
            ahead, right and below, m; None: it knew of none.
        phases: the changes of phase or reason, with their loop times.
        views: the first picture with a marker of each phase, with its time from the beginning.
        progress: is told a line with every sample.
        frames: how many were searched.
        off_centre_px: the marker looked at, in each picture with one.
        gimbal_errors_px: where the gimbal points against where it was ordered to.
        nis: normalised innovation squared of every sighting that the filter could compare.
        hold_errors_m: horizontal, between landing point and vehicle, with every sample while the
            pilot had it held over the marker and was told that it is there.
        pad_velocity_error_mps: KNOWN_AFTER_S after the first sighting; None: not known then.
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
        """The flight begins where and when the world is now.

        Args:
            world: the truth.
            score: says when the pad was first seen.
            camera_model: intrinsics of the pictures.
            gimbal_angles: the true yaw and pitch, rad, against what orders are against.
            has_pictures: frames show something.
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
        """One flight is all there is, but arming makes a new core."""
        self._lander = lander

    def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
        """Count, and keep the first picture with a marker of each phase."""
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
        """Sample the truth, note changes of phase."""
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
        """Note how far off the picture is that an order has not moved yet."""
        yaw, pitch = self._gimbal_angles()
        yaw = (ordered.yaw - yaw) * math.cos(pitch)
        pitch = ordered.pitch - pitch
        self.gimbal_errors_px.append(self.camera_model.fx * math.hypot(yaw, pitch))

    def _compare_velocity(self, now: float) -> None:
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
        """Return a local point in axes of the pad at its start: to its north, east and up, m."""
        origin = self._start_pad
        x, y, z = rotate(transpose(origin.R_local_pad), sub(p, origin.position))
        return (x, y, -z)
