"""What one control step orders and tells, in order."""

import math

from landerd.config.models import LimitsSection
from landerd.geometry import Vec3
from landerd.guidance import pilot_texts
from landerd.guidance.limits import Limiter
from landerd.messages import Command, Disarm, Phase, PhaseChange, PressDown, Severity, StatusText

# Set-points go on from the last one if it is not older, s; else they begin at the vehicle's own
# velocity. Chosen by hand, between a tick (25 ms) and the time in which velocities change.
CONTINUE_S = 0.5


class Orders:
    """Collects the commands of a control step; keeps set-points within the limits.

    Attributes:
        commands: of this control step so far.
        phase: of the landing, as the pilot was told last.
        reason: why that phase.
    """

    def __init__(self, limits: LimitsSection) -> None:
        self.commands: list[Command] = []
        self.phase = Phase.NOT_LANDING
        self.reason = pilot_texts.STARTING
        self._limiter = Limiter(limits)
        self._now = -math.inf
        self._dt = 0.0
        self._setpoint_t = -math.inf  # of the last set-point
        self._said: dict[str, float] = {}  # when each line was told last
        self._news: tuple[Severity, str] | None = None  # of phase or reason, not told yet

    def configure(self, limits: LimitsSection) -> None:
        """Take new limits."""
        self._limiter.configure(limits)

    def begin(self, now: float, dt: float) -> None:
        """Begin a control step at time now, dt after the last, s."""
        self.commands = []
        self._now, self._dt = now, dt

    # ---- for the autopilot ---------------------------------------------------------------------

    @property
    def velocity(self) -> Vec3:
        """Velocity of the last set-point, local NED, m/s."""
        return self._limiter.velocity

    @property
    def climbs(self) -> bool:
        """Whether the last set-point is new and goes up: what has not answered yet soon will."""
        return self._now - self._setpoint_t <= CONTINUE_S and self.velocity[2] < 0.0

    def go_on_from(self, velocity: Vec3) -> None:
        """Begin at this velocity (local NED, m/s), unless there was a set-point just now."""
        if self._now - self._setpoint_t > CONTINUE_S:
            self._limiter.reset(velocity)

    def fly(self, velocity: Vec3, yaw_rate: float, *, may_descend: bool) -> None:
        """Order a velocity (local NED, m/s) and a yaw rate (rad/s), within the limits.

        Without `may_descend` a downward order ends at once.
        """
        self._setpoint_t = self._now
        self.commands.append(
            self._limiter.step(velocity, yaw_rate, self._dt, may_descend=may_descend)
        )

    def climb_away(self, north: float, east: float) -> None:
        """Order to climb away from the pad at once, with this velocity, m/s."""
        self._setpoint_t = self._now
        self.commands.append(self._limiter.climb_away(north, east, self._dt))

    def end_climb(self, north: float, east: float) -> None:
        """Order not to climb any more, at once, with this velocity, m/s."""
        self._setpoint_t = self._now
        self.commands.append(self._limiter.end_climb(north, east, self._dt))

    def stop(self) -> None:
        """Order zero velocity and yaw rate at once; exempt from the limits of acceleration.

        What flies on soon after it has not stopped yet, and goes on from the velocity it has.
        """
        self._setpoint_t = -math.inf
        self.commands.append(self._limiter.stop())

    def stand_level(self, heading: float, pad_velocity: Vec3) -> None:
        """Order a level attitude without thrust.

        Args:
            heading: to keep, local, rad.
            pad_velocity: of what it stands on, local NED, m/s; set-points go on from there.
        """
        self._setpoint_t = self._now
        north, east, _ = pad_velocity
        self._limiter.reset((north, east, 0.0))
        self.commands.append(PressDown(heading))

    def disarm(self) -> None:
        """Order the motors to stop, by the ordinary command."""
        self.commands.append(Disarm())

    # ---- for the pilot -------------------------------------------------------------------------

    def enter(self, phase: Phase, reason: str) -> None:
        """Say that a phase goes on or begins; out of a landing every new reason is told too."""
        is_out = phase is Phase.NOT_LANDING
        if phase is not self.phase or (is_out and reason != self.reason):
            self.commands.append(PhaseChange(phase, reason))
            name = phase.value.replace("_", " ").lower()
            self._news = (
                (Severity.WARNING, reason) if is_out else (Severity.NOTICE, f"{name}: {reason}")
            )
        elif is_out and pilot_texts.asks_for_switch(reason):
            self.say(Severity.WARNING, reason, every_s=pilot_texts.REMIND_S)
        self.phase, self.reason = phase, reason
        # Told just before, of another time, it is told again when it lasts.
        if self._news is not None and self.say(*self._news):
            self._news = None

    def say(self, severity: Severity, text: str, *, every_s: float = pilot_texts.REPEAT_S) -> bool:
        """Tell the pilot a line, unless it was told within every_s (s); return whether it was."""
        line = _line(text)
        if self._now - self._said.get(line, -math.inf) < every_s:
            return False
        self._said[line] = self._now
        self.commands.append(StatusText(severity, line))
        return True


def _line(text: str) -> str:
    return f"{pilot_texts.PREFIX}{text}"[: pilot_texts.MAX_CHARACTERS]
