"""Where the gimbal is pointed (thesis 2.3.4, eq. 2.1).

`predicted` points it where the filter says the pad will be when the gimbal has got there, whatever
vehicle and pad do meanwhile. `increment` is the thesis's law, which adds k x/z to the yaw set-point
and k y/z to the pitch one with every sighting. Three things differ here. A picture is old when it
is searched, so the error is added to the angles of its exposure and the set-point moves by k of the
way there; with a gimbal at its set-point this is eq. 2.1. Yaw moves the picture by cos(pitch) only:
straight down it lies along the lens and cannot move it at all, so its error is taken through the
damped inverse of cos(pitch) (Wampler 1986, damped least squares), which fades out there instead of
winding the gimbal round; nor is it pulled to the measured angle there, for with nothing in the
picture to stop it the least bias of that angle would turn it for ever. And the limits hold for
every marker.
"""

import math

from landerd.config.models import AimSection, GimbalSection
from landerd.geometry import Mat3, Vec3, clamp, is_finite, wrap
from landerd.messages import GimbalCommand, MarkerSighting, Sightings

# Chosen by trial in the simulator, for the thesis's camera (78 by 63 degrees): with them every
# landing of `landerd campaign guidance` reached its pad. None is measured on a gimbal.

# ---- increments --------------------------------------------------------------------------------
DAMPING = 0.3  # of the inverse of cos(pitch); 17 degrees from straight down it has full effect
SQUARE_HOLD_S = 0.3  # a square is still preferred to a ring: not every frame is searched for it

# ---- by prediction -----------------------------------------------------------------------------
DEAD_BAND = math.radians(4.0)  # rad from the picture's middle that the pad may be off
PITCH_TIME_CONSTANT_S = 0.2
MAX_YAW_RATE = math.radians(120.0)  # rad/s of the yaw's set-point
# A pad so far off the lens, rad, because the yaw is at its limit, is still in the picture: better
# there than out of it while the gimbal turns right round.
VISIBLE_ASIDE = math.radians(28.0)

# ---- search ------------------------------------------------------------------------------------
SWEEP_PITCH_RATE = math.radians(20.0)  # rad/s
# A picture is 63 degrees high: in these lies what is 9 degrees and more below the horizon, ahead
# and, pitched past straight down, behind: a pad that stops is flown past.
SWEEP_LOW, SWEEP_HIGH = math.radians(-140.0), math.radians(-40.0)
# On the way it looks so far down from the horizon: what is 19 to 81 degrees below it is in every
# picture. With the sweep, two of 37 field days flew past a pad that was in sight for too few of
# them; with 40 degrees two of 13 days with small codes, which are seen from near by alone.
ON_COURSE_PITCH = math.radians(-50.0)
# Where the nose points, if it flies there but for so much: in wind a vehicle drifts aside of what
# its pilot flies to.
DRIFT = math.radians(45.0)
SWEEP_YAW = math.radians(50.0)  # rad to either side of idle: less than a picture is wide


class Aim:
    """Holds the gimbal's set-points."""

    def __init__(self, aim: AimSection, gimbal: GimbalSection) -> None:
        self._gain = aim.gain
        self._search_after_s = aim.search_after_s
        self._yaw_limits = tuple(math.radians(a) for a in gimbal.yaw_limits_deg)
        self._pitch_limits = tuple(math.radians(a) for a in gimbal.pitch_limits_deg)
        self._idle_pitch = math.radians(aim.idle_pitch_deg)
        self._idle_yaw = math.radians(aim.idle_yaw_deg)
        self._sweep = -1.0  # direction of the search in pitch
        self._sweeps = 0
        self._seen_t = -math.inf
        self._began = math.inf  # when it was first ticked
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

    def on_tick(
        self,
        now: float,
        direction: Vec3 | None = None,
        sighting_t: float = -math.inf,
        course: float | None = None,
        base: Mat3 | None = None,
    ) -> None:
        """Point at the pad, or search while it is not in sight: on the way to it at once.

        Args:
            now: s.
            direction: where the pad will be, unit vector in the frame that the gimbal is measured
                in; None: not known, or the increments do it.
            sighting_t: of the last sighting that the estimate took, s.
            course: of the vehicle, rad to the right of its nose; None: it hovers.
            base: R_local_base, from the frame that the gimbal is measured in; None: not known.
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
        """Take the direction, as far as the pad lies off the middle of the picture.

        The picture is wide: what shakes the airframe or the estimate need not shake the lens, the
        less as a gimbal that turns is not quite where it says it is. Straight down the yaw axis
        lies along the lens; there little is off to the side, and the yaw stays where it is.
        """
        x, y, z = direction
        yaw, pitch = self.command.yaw, self.command.pitch
        beyond = _aside(x, y, z, yaw) - DEAD_BAND
        if beyond > 0.0:
            max_step = min(1.0, beyond / DEAD_BAND) * MAX_YAW_RATE * dt
            yaw += clamp(self._nearest_yaw(direction) - yaw, -max_step, max_step)
        ahead, _ = _along_and_right(x, y, yaw)
        error = wrap(math.atan2(-z, ahead) - pitch)
        error -= clamp(error, -DEAD_BAND, DEAD_BAND)
        self.command = self._limited(yaw, pitch + min(1.0, dt / PITCH_TIME_CONSTANT_S) * error)

    def _nearest_yaw(self, direction: Vec3) -> float:
        """Return the yaw to see a pad by: facing it or, pitched past straight down, averted."""
        x, y, z = direction
        bearing = math.atan2(y, x)
        facing, averted = (
            clamp(yaw, *self._yaw_limits) for yaw in (bearing, wrap(bearing + math.pi))
        )
        if self._pitch_limits[0] > -0.75 * math.pi:
            return facing
        possible = [yaw for yaw in (facing, averted) if _aside(x, y, z, yaw) < VISIBLE_ASIDE]
        return min(possible or [facing], key=lambda yaw: abs(yaw - self.command.yaw))

    def _look_along(self, course: float, dt: float, base: Mat3 | None) -> None:
        """Look where pads come into sight that are flown to, however the vehicle leans."""
        drifts = abs(wrap(course - self._idle_yaw)) < DRIFT
        self._turn_to(self._idle_yaw if drifts else course, dt)
        step = SWEEP_PITCH_RATE * dt
        to_go = ON_COURSE_PITCH + _lean(base, self.command.yaw) - self.command.pitch
        self.command = self._limited(
            self.command.yaw, self.command.pitch + clamp(to_go, -step, step)
        )

    def _sweep_round(self, dt: float, base: Mat3 | None) -> None:
        """Sweep down and behind, and back up, at another yaw each time."""
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
        """Return the marker to look at: a square one if seen lately, else a ring (thesis 2.3.5)."""
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
    """Return by how much what a gimbal is measured against leans forward along a yaw, rad."""
    if base is None:
        return 0.0
    return math.asin(clamp(base[2][0] * math.cos(yaw) + base[2][1] * math.sin(yaw), -1.0, 1.0))


def _along_and_right(x: float, y: float, yaw: float) -> tuple[float, float]:
    """Return the parts of (x, y) along a yaw and to its right."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x + s * y, c * y - s * x


def _aside(x: float, y: float, z: float, yaw: float) -> float:
    """Return how far a direction is to the side of a lens at a yaw, rad, whatever its pitch."""
    ahead, right = _along_and_right(x, y, yaw)
    return abs(math.atan2(right, math.hypot(ahead, z)))
