"""The estimator: telemetry and sightings in; vehicle, pad and camera prior out."""

import math
from dataclasses import replace
from functools import lru_cache, partial
from typing import Literal

from landerd.config.models import Config
from landerd.estimation.camera_pose import DOWN, PoseHistory
from landerd.estimation.health import HealthMonitor
from landerd.estimation.observation import (
    SIGMA_SCALE,
    BiasModel,
    ObservationModel,
    PadFix,
    PadObservation,
)
from landerd.estimation.pad_filter import MAX_GAP_S, PadEstimate, PadFilter, SensorErrors
from landerd.estimation.vehicle_state import VehicleState, slowest_foot, vehicle_state
from landerd.geometry import Mat3, Vec3, add, rotate, sub, transpose
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

# Numbers of a pose (m, m^2, rad, chi-square) beyond this come from a failed fit: no camera sees
# a thousand kilometres. A variance of 1e160 overflowed in the filter.
MAX_PLAUSIBLE = 1e6
PRIOR_KEEP_S = 1.0  # how long after a sighting vision gets the pad as a prior; chosen by hand


class Estimator:
    """Places sightings in local NED by the telemetry at their exposure, and filters them.

    Attributes:
        poses: position, attitude and gimbal angles of the last second.
        sighting_t: exposure of the last sighting that the filter accepted, s; -inf: none.
        refused_t: exposure of the last frame whose pad the filter refused, s; -inf: none.
        unplaced_t: exposure of the last frame that shows the pad at a time of which there are no
            position, attitude and gimbal angles, s; -inf: none.
        other: exposure of the last frame with another pad, s, and its tag's id; None: none.
        frame_t: exposure of the newest frame that vision has searched, by the camera's own clock,
            s; -inf: none.
        searched_t: the last control step before the result of that frame came, s; -inf: none.
        last_fix: from the newest frame that shows a pad, accepted or not; None: none.
        inconsistency: the run of newest sightings, accepted or not, that were not where the pad
            should be.
        health: whether sightings fit their predictions, and how old they are when used.
    """

    def __init__(self, config: Config) -> None:
        self._vehicle = config.vehicle
        self._freshness = config.freshness
        self._clock_offset_s = config.camera.clock_offset_s
        self._sigma_clock_s = config.estimation.clock_sigma_s
        self.poses = PoseHistory(config)
        self._observations = ObservationModel(config.estimation, self.poses)
        self._filter = PadFilter(config.estimation)
        self.inconsistency = self._filter.inconsistency
        self.sighting_t = self.refused_t = self.unplaced_t = -math.inf
        self.other: tuple[float, int] | None = None
        self.frame_t = self.searched_t = self._tick_t = -math.inf
        self.last_fix: PadFix | None = None
        self.health = HealthMonitor(config.estimation.gate_sigma**2)
        # Uncertainty of the times of the autopilot's data and of the pictures, s.
        self._clock_s = self._picture_clock_s = 0.0
        self._gimbal_from_autopilot = False  # its angles come over the autopilot's link
        # A control step asks for both at the same time again and again.
        self._pad_at = lru_cache(maxsize=1)(self._filter.estimate)
        newest_vehicle = partial(vehicle_state, self.poses, self._vehicle)
        self._vehicle_at = lru_cache(maxsize=1)(newest_vehicle)

    # ---- inputs --------------------------------------------------------------------------------

    def on_telemetry(self, message: LocalPosition | Attitude | GimbalState) -> None:
        """Take a measurement.

        While a pad is known, a reset of the autopilot's heading is not followed: the new heading
        may be wrong, and if it is right the old one served as well.
        """
        if isinstance(message, GimbalState):
            self._gimbal_from_autopilot = message.from_autopilot
        self._vehicle_at.cache_clear()
        is_known = message.t - self.sighting_t <= MAX_GAP_S
        self.poses.add(message, keeps_heading=is_known)

    def on_clock(self, clock: ClockSync) -> None:
        """Take the uncertainty of the autopilot's clock: its data may be older by that much."""
        self._pad_at.cache_clear()
        self._clock_s = clock.uncertainty_s
        self._filter.on_clock(math.hypot(self._clock_s, self._picture_clock_s))

    def on_sightings(self, sightings: Sightings) -> list[PadObservation] | None:
        """Take what one frame shows of the pad.

        Returns:
            the frame's observations if one of them was accepted, else an empty list; None for a
            frame that is ignored: not newer than the last one, or without a time.
        """
        if not sightings.t > self.frame_t:
            return None
        self._pad_at.cache_clear()
        self.frame_t, self.searched_t = sightings.t, self._tick_t
        if sightings.sigma_t != self._picture_clock_s:
            self._picture_clock_s = sightings.sigma_t
            self._filter.on_clock(math.hypot(self._clock_s, self._picture_clock_s))
        t = sightings.t - self._clock_offset_s
        if sightings.other_id is not None:
            self.other = t, sightings.other_id
        clocks = self._filter.clocks
        solutions = [solution for solution in sightings.pad if _is_plausible(solution)]
        placed = [self._observations.observe(t, solution, clocks) for solution in solutions]
        observations = [o for o in placed if o is not None]
        if solutions and not observations:
            self.unplaced_t = t
        if observations:
            self.last_fix = self._observations.fix(observations[0], clocks)
        else:
            self.inconsistency.unseen(t)
        refused_before = self._filter.rejected
        is_accepted = self._filter.update(observations, may_be_another=sightings.may_be_another)
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
        """Note that a control step begins, at time now (s)."""
        self._tick_t = now
        if self.frame_t > -math.inf:
            self.health.on_tick(now, self.exposed_t)

    def on_restart(self) -> None:
        """Forget vehicle and pad: the autopilot restarted, and its local frame may be another."""
        self._pad_at.cache_clear()
        self._vehicle_at.cache_clear()
        self.poses.forget_autopilot()
        self._filter.reset()
        self.sighting_t = -math.inf
        self.last_fix = None

    # ---- estimates -----------------------------------------------------------------------------

    @property
    def is_shown(self) -> bool:
        """Whether the newest frame that was searched shows the pad and was accepted."""
        return self.sighting_t == self.exposed_t

    @property
    def exposed_t(self) -> float:
        """Exposure of the newest frame that vision has searched, s; -inf: none."""
        return self.frame_t - self._clock_offset_s

    def sight_age(self, now: float) -> float:
        """Return the greatest age of the last accepted sighting at time now, s; inf without one.

        The exposure may have been earlier than stamped: by the assumed error of the pictures'
        clock, or by its estimate where that is larger. An estimate that makes sightings younger is
        not used: it is relative to the autopilot's clock, which may be the wrong one.
        """
        late_s = max(self._sigma_clock_s, self._filter.clocks.pictures_s)
        return now - self.sighting_t + self._picture_clock_s + late_s

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the newest sighting, 3 on average; NaN without one."""
        return self._filter.nis

    @property
    def sensor_errors(self) -> SensorErrors:
        """The estimated errors of camera and gimbal; the clock's includes the configured offset."""
        found = self._filter.sensor_errors
        return replace(found, clock_s=self._clock_offset_s + found.clock_s)

    def pad(self, t: float) -> PadEstimate | None:
        """Return the pad at time t, None while none is confirmed."""
        return self._pad_at(t)

    def unconfirmed(self, t: float, within_s: float) -> PadEstimate | None:
        """Return a pad not confirmed yet at time t (s), if seen within within_s; else None."""
        return self._filter.unconfirmed(t, within_s)

    def vehicle(self, now: float) -> VehicleState | None:
        """Return the vehicle from its newest telemetry, however old; None without any."""
        return self._vehicle_at(now)

    def fresh_vehicle(self, now: float) -> VehicleState | None:
        """Return the vehicle, None where position or attitude is too old to be flown on."""
        return self.vehicle(now) if self.has_fresh_vehicle(now) else None

    def velocities(self, after: float) -> list[tuple[float, Vec3]]:
        """Return the velocities measured after a time (s), each with its time (s).

        Each is that of the foot that sinks slowest, local NED, m/s; where the attitude is not
        known, the vehicle's.
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
        return self._stale_vehicle(now) is None

    def stale(self, now: float) -> Literal["attitude", "position", "gimbal"] | None:
        """Return the first source that is too old to be flown on (rule 5), None if none is."""
        late_s = self._clock_s if self._gimbal_from_autopilot else 0.0
        is_stale = self.poses.gimbal.age(now) + late_s > self._freshness.gimbal_s
        return self._stale_vehicle(now) or ("gimbal" if is_stale else None)

    def _stale_vehicle(self, now: float) -> Literal["attitude", "position"] | None:
        fresh, poses = self._freshness, self.poses
        if poses.attitude.age(now) + self._clock_s > fresh.attitude_s:
            return "attitude"
        if poses.position.age(now) + self._clock_s > fresh.position_s:
            return "position"
        return None

    def prior(self, t: float) -> Prior:
        """Return the prior of a picture exposed at time t (s, camera's clock) for its search."""
        t -= self._clock_offset_s
        clocks = self._filter.clocks
        t_true, back = t - clocks.pictures_s, clocks.gimbal_s
        camera = self.poses.camera_pose(t_true, gimbal_back_s=back)
        if camera is None:
            return Prior(down=self.poses.down(t_true, gimbal_back_s=back))
        R_camera_local = transpose(camera.R_local_camera)
        down = rotate(R_camera_local, DOWN)
        pad = self.pad(t_true)
        if pad is not None and t - self.sighting_t <= PRIOR_KEEP_S:
            return Prior(down=down, pad=self._expected(camera.position, R_camera_local, pad))
        maybe = self._filter.unconfirmed(t_true)
        if maybe is None:
            return Prior(down=down)
        return Prior(down=down, maybe=self._expected(camera.position, R_camera_local, maybe))

    def _expected(self, camera: Vec3, R_camera_local: Mat3, pad: PadEstimate) -> PadPrior:
        """Return where a pad will appear to a camera at a position, local NED, m."""
        north = None
        if pad.heading is not None:
            north = rotate(R_camera_local, (math.cos(pad.heading), math.sin(pad.heading), 0.0))
        arm = sub(pad.position, camera)
        # The biases shift it in this frame, too.
        about_x, about_y, _ = R_camera_local
        B = BiasModel(about_x, about_y).jacobian(arm, SIGMA_SCALE)
        shown = rotate(R_camera_local, self._filter.apparent_shift(B))
        normal = rotate(R_camera_local, pad.normal)
        return PadPrior(add(rotate(R_camera_local, arm), shown), pad.sigma_m, north, normal)


def _is_plausible(s: PoseSolution) -> bool:
    """Tell whether a pose can be computed with: no NaN, no degenerate fit."""
    c = s.covariance
    vectors = (*s.position, *s.normal, *(s.north or ()), *c[0], *c[1], *c[2])
    size = math.hypot(*vectors, s.sigma_yaw or 0.0, s.sigma_tilt, s.cost)
    return size <= MAX_PLAUSIBLE and c[0][0] > 0.0 and c[1][1] > 0.0 and c[2][2] > 0.0
