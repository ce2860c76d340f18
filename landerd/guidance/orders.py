"""The commands of one control step: orders for the autopilot, texts for the pilot."""

import math

from landerd.config.models import LimitsSection
from landerd.geometry import Vec3
from landerd.guidance import pilot_texts
from landerd.guidance.limits import Limiter
from landerd.messages import Command, Disarm, Phase, PhaseChange, PressDown, Severity, StatusText

# Set-points continue from the last one if it is no older than this, s; else they begin at the
# vehicle's velocity. Chosen by hand, between a tick (25 ms) and the time in which velocities
# change.
CONTINUE_S = 0.5


class Orders:
    """Collects the commands of a control step; keeps set-points within the limits.

    Attributes:
        commands: of this control step so far.
        phase: of the landing, as last entered.
        reason: why that phase, for the pilot.
    """

    def __init__(self, limits: LimitsSection) -> None:
        self.commands: list[Command] = []
        self.phase = Phase.NOT_LANDING
        self.reason = pilot_texts.STARTING
        self._limiter = Limiter(limits)
        self._now = -math.inf
        self._dt = 0.0
        self._setpoint_t = -math.inf  # of the last set-point
        # Time of the last set-point before a stop, s, and its sink rate, m/s.
        self._before_stop = (-math.inf, 0.0)
        self._said: dict[str, float] = {}  # when each line was told last
        self._news: tuple[Severity, str] | None = None  # of phase or reason, not told yet
        self._resumed_t = math.inf  # when a landing went on, if that is to be told again

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
        """Whether the last set-point is recent and climbs; it may not have been answered yet."""
        return self._now - self._setpoint_t <= CONTINUE_S and self.velocity[2] < 0.0

    def go_on_from(self, velocity: Vec3) -> None:
        """Begin at this velocity (local NED, m/s), unless there was a set-point a moment ago.

        Where a stop was between, begin to sink no faster than was ordered before it: a vehicle lags
        behind its orders, and with a switch that flickers it would not brake its descent.
        """
        if self._now - self._setpoint_t <= CONTINUE_S:
            return
        north, east, down = velocity
        stopped_t, sink_rate = self._before_stop
        if self._now - stopped_t <= CONTINUE_S:
            down = min(down, max(0.0, sink_rate))
        self._limiter.reset((north, east, down))

    def fly(self, velocity: Vec3, yaw_rate: float, *, may_descend: bool) -> None:
        """Order a velocity (local NED, m/s) and a yaw rate (rad/s), within the limits.

        Args:
            velocity: local NED, m/s.
            yaw_rate: rad/s.
            may_descend: if False, a downward order ends at once.
        """
        self._setpoint_t = self._now
        self.commands.append(
            self._limiter.step(velocity, yaw_rate, self._dt, may_descend=may_descend)
        )

    def climb_away(self, north: float, east: float) -> None:
        """Order a climb away from the pad, at once, with this horizontal velocity, m/s."""
        self._setpoint_t = self._now
        self.commands.append(self._limiter.climb_away(north, east, self._dt))

    def end_climb(self, north: float, east: float) -> None:
        """End a climb at once; horizontal velocity in m/s."""
        self._setpoint_t = self._now
        self.commands.append(self._limiter.end_climb(north, east, self._dt))

    def stop(self) -> None:
        """Order zero velocity and yaw rate at once; exempt from the acceleration limits.

        Set-points that follow begin at the vehicle's velocity: it may not have stopped yet.
        """
        if self._setpoint_t > -math.inf:
            self._before_stop = (self._setpoint_t, self.velocity[2])
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

    def enter(self, phase: Phase, reason: str, *, reminds: bool = False) -> None:
        """Set phase and reason; tell the pilot a new phase, and outside a landing a new reason.

        Outside a landing the reason is told again after REMIND_S if it asks for the switch, or if
        `reminds` says so.
        """
        is_out = phase is Phase.NOT_LANDING
        if is_out:
            self._resumed_t = math.inf
        elif self.phase is Phase.NOT_LANDING and self.reason.endswith(pilot_texts.WITHOUT_SIGHT):
            self._resumed_t = self._now
        if phase is not self.phase or (is_out and reason != self.reason):
            self.commands.append(PhaseChange(phase, reason))
            news = (Severity.NOTICE, _of_phase(phase, reason))
            self._news = (Severity.WARNING, reason) if is_out else news
        elif is_out and (reminds or pilot_texts.asks_for_switch(reason)):
            self.say(Severity.WARNING, reason, every_s=pilot_texts.REMIND_S)
        elif self._now - self._resumed_t >= pilot_texts.RESUMED_S:
            self._resumed_t, self._news = math.inf, (Severity.NOTICE, _of_phase(phase, reason))
        self.phase, self.reason = phase, reason
        # A line that was said a moment ago is not repeated now, but later if it still holds.
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


def _of_phase(phase: Phase, reason: str) -> str:
    """Return a phase with its reason, or, where they do not fit one line, the reason alone."""
    text = f"{phase.value.replace('_', ' ').lower()}: {reason}"
    fits = len(pilot_texts.PREFIX) + len(text) <= pilot_texts.MAX_CHARACTERS
    return text if fits else reason


def _line(text: str) -> str:
    """Return a text as it is sent, cut to the length of a STATUSTEXT."""
    return f"{pilot_texts.PREFIX}{text}"[: pilot_texts.MAX_CHARACTERS]
