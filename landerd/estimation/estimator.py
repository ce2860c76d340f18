"""What is known of vehicle, camera and pad: telemetry and sightings in, estimates out."""

import math
from dataclasses import replace
from typing import Literal

from landerd.config.models import Config
from landerd.estimation.camera_pose import DOWN, CameraPose, PoseHistory
from landerd.estimation.health import HealthMonitor
from landerd.estimation.inconsistency import Inconsistency
from landerd.estimation.observation import (
    BiasModel,
    ObservationModel,
    PadFix,
    PadObservation,
    camera_axes,
)
from landerd.estimation.pad_filter import MAX_GAP_S, PadEstimate, PadFilter, SensorErrors
from landerd.estimation.vehicle_state import VehicleState, slowest_foot, vehicle_state
from landerd.geometry import Vec3, add, rotate, sub, transpose
from landerd.messages import (
    Attitude,
    ClockSync,
    GimbalState,
    LocalPosition,
    PadPrior,
    PoseSolution,
    Prior,
    Sightings,
)

# A number of a pose beyond this (m, m^2, rad or chi-square) comes from a fit that failed: no camera
# sees a thousand kilometres. A variance of 1e160 overflowed in the filter.
MAX_PLAUSIBLE = 1e6
PRIOR_KEEP_S = 1.0  # after a sighting vision is told for so long where the pad is; chosen by hand


class Estimator:
    """Places sightings by the telemetry of their exposure and filters them.

    Attributes:
        poses: position, attitude and gimbal angles of the last second.
        sighting_t: exposure of the last sighting that the filter accepted, s; -inf: none.
        refused_t: exposure of the last frame whose pad the filter refused, s; -inf: none.
        other: exposure of the last frame with another pad, s, and its tag's id; None: none.
        frame_t: exposure of the newest frame that vision has searched, s; -inf: none.
        searched_t: the last control step before that frame had been searched, s; -inf: none.
        last_fix: of the newest frame that shows a pad, accepted or not; None: none.
        health: of what was seen so far.
    """

    def __init__(self, config: Config) -> None:
        self._vehicle = config.vehicle
        self._freshness = config.freshness
        self._clock_offset_s = config.camera.clock_offset_s
        self._sigma_clock_s = config.estimation.clock_sigma_s
        self.poses = PoseHistory(config)
        self._observations = ObservationModel(config.estimation, self.poses)
        self._filter = PadFilter(config.estimation)
        self.sighting_t = self.refused_t = -math.inf
        self.other: tuple[float, int] | None = None
        self.frame_t = self.searched_t = self._tick_t = -math.inf
        self.last_fix: PadFix | None = None
        self.health = HealthMonitor(config.estimation.gate_sigma**2)
        # How wrong the times of the autopilot's data and of the pictures may be, s.
        self._clock_s = self._picture_clock_s = 0.0
        self._is_gimbal_autopilots = False  # its angles come over the autopilot's link

    # ---- inputs --------------------------------------------------------------------------------

    def on_telemetry(self, message: LocalPosition | Attitude | GimbalState) -> None:
        """Take a measurement.

        While a pad is known the heading goes on by which it was seen so far: one that the autopilot
        sets anew may be wrong, and where it is right the old one did as well.
        """
        if isinstance(message, GimbalState):
            self._is_gimbal_autopilots = message.from_autopilot
        is_known = message.t - self.sighting_t <= MAX_GAP_S
        self.poses.add(message, keeps_heading=is_known)

    def on_clock(self, clock: ClockSync) -> None:
        """Take how well the autopilot's clock is known: its data may be so much older."""
        self._clock_s = clock.uncertainty_s
        self._filter.on_clock(math.hypot(self._clock_s, self._picture_clock_s))

    def on_sightings(self, sightings: Sightings) -> list[PadObservation] | None:
        """Take what one frame shows of the pad.

        Returns:
            the frame's observations if one of them was accepted, else an empty list; None for a
            frame that is late, comes twice or has no time: it is not looked at.
        """
        if not sightings.t > self.frame_t:
            return None
        self.frame_t, self.searched_t = sightings.t, self._tick_t
        if sightings.sigma_t != self._picture_clock_s:
            self._picture_clock_s = sightings.sigma_t
            self._filter.on_clock(math.hypot(self._clock_s, self._picture_clock_s))
        t = sightings.t - self._clock_offset_s
        if sightings.other_id is not None:
            self.other = t, sightings.other_id
        clocks = self._filter.clocks
        observations = [
            o
            for solution in sightings.pad
            if _is_plausible(solution)
            and (o := self._observations.observe(t, solution, clocks)) is not None
        ]
        if observations:
            self.last_fix = self._observations.fix(observations[0], clocks)
        else:
            self.inconsistency.unseen(t)
        refused_before = self._filter.rejected
        is_accepted = self._filter.update(observations)
        if not math.isnan(self._filter.nis):
            refused = self._filter.rejected > refused_before
            self.health.on_sighting(t, self._filter.nis, refused=refused)
        if not is_accepted:
            if observations:
                self.refused_t = t
            return []
        self.sighting_t = t
        return observations

    def on_tick(self, now: float) -> None:
        """A control step begins, at time now (s)."""
        self._tick_t = now
        if self.frame_t > -math.inf:
            self.health.on_tick(now, self.frame_t - self._clock_offset_s)

    def on_restart(self) -> None:
        """The autopilot restarted: its local frame may be another, so the pad is forgotten too."""
        self.poses.forget_autopilot()
        self._filter.reset()
        self.sighting_t = -math.inf
        self.last_fix = None

    # ---- estimates -----------------------------------------------------------------------------

    @property
    def inconsistency(self) -> Inconsistency:
        """Whether the newest sightings, accepted or not, were where the pad was expected."""
        return self._filter.inconsistency

    @property
    def is_shown(self) -> bool:
        """Whether the newest frame that was searched shows the pad, and was accepted."""
        return self.sighting_t == self.frame_t - self._clock_offset_s

    def sight_age(self, now: float) -> float:
        """Return the age of the last accepted sighting at time now, s; infinite without one.

        What its exposure may have been earlier than is said counts, as with telemetry: what the
        pictures' clock is assumed to be off by, or more where they are found to be stamped later.
        That shows against the autopilot's clock alone, so that they are found to be stamped early
        is not counted on.
        """
        late_s = max(self._sigma_clock_s, self._filter.clocks.pictures_s)
        return now - self.sighting_t + self._picture_clock_s + late_s

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the newest sighting, 3 on average; NaN without one."""
        return self._filter.nis

    @property
    def sensor_errors(self) -> SensorErrors:
        """What the filter has found of camera and gimbal, beside what the configuration says."""
        found = self._filter.sensor_errors
        return replace(found, clock_s=self._clock_offset_s + found.clock_s)

    def pad(self, t: float) -> PadEstimate | None:
        """Return the pad at time t, None while none is confirmed."""
        return self._filter.estimate(t)

    def unconfirmed(self, t: float, within_s: float) -> PadEstimate | None:
        """Return what may be the pad at time t, seen within so long, but too seldom; else None."""
        return self._filter.unconfirmed(t, within_s)

    def vehicle(self, now: float) -> VehicleState | None:
        """Return the vehicle from its newest telemetry, however old; None without any."""
        return vehicle_state(self.poses, self._vehicle, now)

    def fresh_vehicle(self, now: float) -> VehicleState | None:
        """Return the vehicle, None where position or attitude is too old to be flown on."""
        return self.vehicle(now) if self.has_fresh_vehicle(now) else None

    def velocities(self, after: float) -> list[tuple[float, Vec3]]:
        """Return the velocities measured after a time (s), with their times.

        Of the foot that sinks slowest, local NED, m/s; of the vehicle where its attitude is not
        known.
        """
        measured = []
        for t, p in self.poses.position.since(after):
            velocity, attitude = (p[3], p[4], p[5]), self.poses.attitude.at(t)
            if attitude is not None:
                velocity = slowest_foot(self._vehicle, velocity, attitude)
            measured.append((t, velocity))
        return measured

    def has_fresh_vehicle(self, now: float) -> bool:
        """Tell whether position and attitude are young enough to be flown on (rule 5)."""
        return self.stale(now) not in ("attitude", "position")

    def stale(self, now: float) -> Literal["attitude", "position", "gimbal"] | None:
        """Return the first of the sources that is too old to be flown on, None if none is."""
        fresh, poses = self._freshness, self.poses
        if poses.attitude.age(now) + self._clock_s > fresh.attitude_s:
            return "attitude"
        if poses.position.age(now) + self._clock_s > fresh.position_s:
            return "position"
        gimbal_late_s = self._clock_s if self._is_gimbal_autopilots else 0.0
        if poses.gimbal.age(now) + gimbal_late_s > fresh.gimbal_s:
            return "gimbal"
        return None

    def prior(self, t: float) -> Prior:
        """Return what is known of a picture exposed at time t (s) before it is searched."""
        t -= self._clock_offset_s
        clocks = self._filter.clocks
        t_true, back = t - clocks.pictures_s, clocks.gimbal_s
        camera = self.poses.camera_pose(t_true, gimbal_back_s=back)
        if camera is None:
            return Prior(down=self.poses.down(t_true, gimbal_back_s=back))
        down = rotate(transpose(camera.R_local_camera), DOWN)
        pad = self.pad(t_true)
        if pad is not None and t - self.sighting_t <= PRIOR_KEEP_S:
            return Prior(down=down, pad=self._expected(camera, pad))
        maybe = self._filter.unconfirmed(t_true)
        return Prior(down=down, maybe=self._expected(camera, maybe) if maybe else None)

    def _expected(self, camera: CameraPose, pad: PadEstimate) -> PadPrior:
        """Return where a camera will show a pad."""
        R_camera_local = transpose(camera.R_local_camera)
        north = None
        if pad.heading is not None:
            north = rotate(R_camera_local, (math.cos(pad.heading), math.sin(pad.heading), 0.0))
        position = rotate(R_camera_local, sub(pad.position, camera.position))
        # Where it will be seen is not where it is: the lens errs in the next frame too.
        biases = BiasModel(*camera_axes(camera))
        B = biases.jacobian(sub(pad.position, camera.position), biases.range_share)
        shown = rotate(R_camera_local, self._filter.shown(B))
        normal = rotate(R_camera_local, pad.normal)
        return PadPrior(add(position, shown), pad.sigma_m, north, normal)


def _is_plausible(s: PoseSolution) -> bool:
    """Tell whether a pose is one that can be calculated with: NaN or a degenerate fit is not."""
    c = s.covariance
    numbers = (*s.position, *s.normal, *(s.north or ()), *c[0], *c[1], *c[2])
    scalars = (s.sigma_yaw or 0.0, s.sigma_tilt, s.cost)
    in_range = all(-MAX_PLAUSIBLE <= x <= MAX_PLAUSIBLE for x in (*numbers, *scalars))
    return in_range and c[0][0] > 0.0 and c[1][1] > 0.0 and c[2][2] > 0.0
