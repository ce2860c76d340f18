"""Where the gimbal is pointed (thesis 2.3.4, eq. 2.1).

`predicted` points it where the filter predicts the pad to be when the gimbal gets there, whatever
vehicle and pad do meanwhile.

`increment` is the thesis's law, which with every sighting adds k x/z to the yaw set-point and k y/z
to the pitch set-point. It differs from the thesis in three things:

- A picture is old by the time it has been searched: the error is added to the angles at its
  exposure, and the set-point moves by k of the way there. With a gimbal at its set-point this is
  eq. 2.1.
- Yaw moves the picture by cos(pitch) only, and not at all straight down, where its axis lies along
  the lens. The yaw error is therefore taken through the damped inverse of cos(pitch) (damped least
  squares: Wampler 1986), which fades out there instead of winding the gimbal round. For the same
  reason yaw is not pulled to its measured angle there: nothing in the picture would stop it, and a
  small bias of that angle would turn it forever.
- The limits hold for every marker.
"""

import math

from landerd.config.models import AimSection, GimbalSection
from landerd.geometry import Mat3, Vec3, clamp, is_finite, wrap
from landerd.messages import GimbalCommand, MarkerSighting, Sightings

# Constants were chosen by trial in the simulator, for the thesis's camera (field of view 78 by 63
# degrees): with them every landing of `landerd campaign guidance` reached its pad. None was
# measured on a gimbal.

# ---- increments --------------------------------------------------------------------------------
DAMPING = 0.3  # of the inverse of cos(pitch): that is largest 17 degrees from straight down
SQUARE_HOLD_S = 0.3  # a square marker stays preferred this long: not every frame is searched for it

# ---- by prediction -----------------------------------------------------------------------------
DEAD_BAND = math.radians(4.0)  # that the pad may be off the picture's centre, rad
PITCH_TIME_CONSTANT_S = 0.2
MAX_YAW_RATE = math.radians(120.0)  # rad/s, of the yaw set-point
# A pad no farther aside of the lens than this, rad, is in the picture. With the yaw at its limit
# that is better than losing sight of it while the gimbal turns right round.
VISIBLE_ASIDE = math.radians(28.0)

# ---- search ------------------------------------------------------------------------------------
SWEEP_PITCH_RATE = math.radians(20.0)  # rad/s
# Pitch limits of the sweep. A picture is 63 degrees high: the sweep shows whatever is more than 9
# degrees below the horizon, ahead and, pitched past straight down, behind: a vehicle flies past a
# pad that stops.
SWEEP_LOW, SWEEP_HIGH = math.radians(-140.0), math.radians(-40.0)
# Pitch from the horizon while the vehicle is under way: everything 19 to 81 degrees below the
# horizon is in each picture. With the sweep, two of 37 field days flew past a pad that was in too
# few pictures; with 40 degrees, two of 13 days with small codes, which are seen from near by only.
ON_COURSE_PITCH = math.radians(-50.0)
# The camera looks along the nose if the course is no farther from it than this, and else along the
# course: in wind a vehicle drifts beside the direction that its pilot flies in.
DRIFT = math.radians(45.0)
SWEEP_YAW = math.radians(50.0)  # rad to either side of idle: less than the picture's width


class Aim:
    """Holds the gimbal's set-points."""

    def __init__(self, aim: AimSection, gimbal: GimbalSection) -> None:
        self._gain = aim.gain
        self._search_after_s = aim.search_after_s
        self._yaw_limits = tuple(math.radians(a) for a in gimbal.yaw_limits_deg)
        self._pitch_limits = tuple(math.radians(a) for a in gimbal.pitch_limits_deg)
        self._idle_pitch = math.radians(aim.idle_pitch_deg)
        self._idle_yaw = math.radians(aim.idle_yaw_deg)
        self._sweep = -1.0  # direction of the sweep in pitch
        self._sweeps = 0  # finished so far
        self._seen_t = -math.inf
        self._began = math.inf  # first tick, s
        self._square_t = -math.inf
        self._t: float | None = None
        self.command = self._limited(self._idle_yaw, self._idle_pitch)

    def on_sightings(self, sightings: Sightings, angles: tuple[float, ...] | None) -> None:
        """Move the set-points towards the marker to look at: the law of increments.

        Args:
            sightings: what a frame shows.
            angles: gimbal yaw and pitch (and roll) at its exposure, rad; None when not known.
        """
        marker = self._preferred(sightings)
        if marker is None or angles is None:
            return
        x, y, z = marker.solutions[0].position
        if not (is_finite((x, y, z)) and z > 0.0):
            return
        self._seen_t = sightings.t
        c, s = math.cos(angles[1]), math.sin(angles[1])
        fade = c / (c * c + (DAMPING * s) ** 2)  # 1 / c, but 0 straight down
        k, last = self._gain, self.command
        self.command = self._limited(
            last.yaw + k * fade * (c * (angles[0] - last.yaw) + x / z),
            last.pitch + k * (angles[1] - last.pitch - y / z),
        )

    def hold(self, now: float) -> None:
        """Stay as it is, at time now (s)."""
        self._t = now

    def on_tick(
        self,
        now: float,
        direction: Vec3 | None = None,
        sighting_t: float = -math.inf,
        course: float | None = None,
        base: Mat3 | None = None,
    ) -> None:
        """Point at the pad, or search for it while it is out of sight.

        Args:
            now: s.
            direction: to where the pad will be, unit vector in the gimbal's base frame
                (gimbal_frames.rotation_local_base); None: not known, or aim.method is `increment`.
            sighting_t: exposure of the last sighting that the estimator accepted, s.
            course: direction of the vehicle's motion, rad to the right of its nose; None: hover.
            base: R_local_base; None: not known.
        """
        dt = now - self._t if self._t is not None else 0.0
        self._t = now
        self._began = min(self._began, now)
        self._seen_t = max(self._seen_t, sighting_t)
        if course is not None and not self._yaw_limits[0] <= course <= self._yaw_limits[1]:
            course = None
        if direction is not None:
            self._point(direction, dt)
            return
        was_seen = self._seen_t > -math.inf
        waited = now - max(self._began, self._seen_t) >= self._search_after_s
        if course is not None and (waited or not was_seen):
            self._look_along(course, dt, base)
        elif waited:
            self._sweep_round(dt, base)

    def _point(self, direction: Vec3, dt: float) -> None:
        """Turn towards a direction, but for a dead band about the picture's centre.

        The picture is wide: a shaking airframe or estimate need not shake the lens, all the more
        since the angles of a turning gimbal are less accurate. Straight down, where the yaw axis
        lies along the lens, little is off to the side, and the yaw stays as it is.
        """
        x, y, z = direction
        yaw, pitch = self.command.yaw, self.command.pitch
        ahead, right = _along_and_right(x, y, yaw)
        beyond = _aside(ahead, right, z) - DEAD_BAND
        if beyond > 0.0:
            max_step = min(1.0, beyond / DEAD_BAND) * MAX_YAW_RATE * dt
            yaw += clamp(self._nearest_yaw(direction) - yaw, -max_step, max_step)
            ahead, _ = _along_and_right(x, y, yaw)
        error = wrap(math.atan2(-z, ahead) - pitch)
        error -= clamp(error, -DEAD_BAND, DEAD_BAND)
        self.command = self._limited(yaw, pitch + min(1.0, dt / PITCH_TIME_CONSTANT_S) * error)

    def _nearest_yaw(self, direction: Vec3) -> float:
        """Return the yaw that shows the pad: facing it or, pitched past straight down, averted."""
        x, y, z = direction
        bearing = math.atan2(y, x)
        facing, averted = (
            clamp(yaw, *self._yaw_limits) for yaw in (bearing, wrap(bearing + math.pi))
        )
        if self._pitch_limits[0] > -0.75 * math.pi:
            return facing
        possible = [
            yaw
            for yaw in (facing, averted)
            if _aside(*_along_and_right(x, y, yaw), z) < VISIBLE_ASIDE
        ]
        return min(possible or [facing], key=lambda yaw: abs(yaw - self.command.yaw))

    def _look_along(self, course: float, dt: float, base: Mat3 | None) -> None:
        """Look ahead along the course, at a fixed pitch from the horizon however it leans."""
        drifts = abs(wrap(course - self._idle_yaw)) < DRIFT
        self._turn_to(self._idle_yaw if drifts else course, dt)
        step = SWEEP_PITCH_RATE * dt
        to_go = ON_COURSE_PITCH + _lean(base, self.command.yaw) - self.command.pitch
        self.command = self._limited(
            self.command.yaw, self.command.pitch + clamp(to_go, -step, step)
        )

    def _sweep_round(self, dt: float, base: Mat3 | None) -> None:
        """Sweep from ahead down and behind, and back, at another yaw each time."""
        lean = _lean(base, self.command.yaw)
        low = max(SWEEP_LOW + lean, self._pitch_limits[0])
        high = min(max(SWEEP_HIGH, self._idle_pitch) + lean, self._pitch_limits[1])
        pitch = self.command.pitch + self._sweep * SWEEP_PITCH_RATE * dt
        if (pitch <= low and self._sweep < 0.0) or (pitch >= high and self._sweep > 0.0):
            self._sweep = -self._sweep
            self._sweeps += 1
        self._turn_to(self._idle_yaw + (0.0, SWEEP_YAW, -SWEEP_YAW)[self._sweeps % 3], dt)
        self.command = self._limited(self.command.yaw, pitch)

    def _turn_to(self, yaw: float, dt: float) -> None:
        step = MAX_YAW_RATE * dt
        turned = self.command.yaw + clamp(yaw - self.command.yaw, -step, step)
        self.command = self._limited(turned, self.command.pitch)

    def _preferred(self, sightings: Sightings) -> MarkerSighting | None:
        """Return the marker to look at: a square one if seen lately, else a ring (thesis 2.3.5).

        None while a square one is still preferred but not in this frame.
        """
        squares = [m for m in sightings.markers if m.kind in ("apriltag", "aruco")]
        if squares:
            self._square_t = sightings.t
            return squares[0]
        if sightings.t - self._square_t < SQUARE_HOLD_S:
            return None
        return sightings.markers[0] if sightings.markers else None

    def _limited(self, yaw: float, pitch: float) -> GimbalCommand:
        return GimbalCommand(clamp(yaw, *self._yaw_limits), clamp(pitch, *self._pitch_limits))


def _lean(base: Mat3 | None, yaw: float) -> float:
    """Return the pitch of the gimbal's base frame along a yaw (rad), nose down positive, rad."""
    if base is None:
        return 0.0
    return math.asin(clamp(base[2][0] * math.cos(yaw) + base[2][1] * math.sin(yaw), -1.0, 1.0))


def _along_and_right(x: float, y: float, yaw: float) -> tuple[float, float]:
    """Return the components of (x, y) along a yaw (rad) and to its right."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x + s * y, c * y - s * x


def _aside(ahead: float, right: float, down: float) -> float:
    """Return the angle (rad) of a direction to the side of a lens at the best pitch."""
    return abs(math.atan2(right, math.hypot(ahead, down)))
