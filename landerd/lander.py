"""The core: timestamped messages in, commands out. No I/O, no clock, no randomness.

Everything that decides how the aircraft moves is here or below. `step` is called with every
message in the order the daemon took it; ticks at the control rate make the set-points.
"""

import math

from landerd.config.models import Config
from landerd.config.parameters import with_value
from landerd.estimation.pad_filter import PadEstimate, PadFilter
from landerd.estimation.placement import PlacedPad, Placement
from landerd.geometry import Vec3, add, rotate, sub, transpose
from landerd.guidance.aim import Aim
from landerd.guidance.gate import Authority, Gate
from landerd.guidance.landing_target import landing_target
from landerd.guidance.limits import Limiter
from landerd.guidance.lost import LostPlan
from landerd.guidance.method import make_method
from landerd.guidance.phases import Phases
from landerd.guidance.relative import Relative, VehicleNow, relative, vehicle_now
from landerd.guidance.touchdown import Step, Touchdown
from landerd.guidance.view import View
from landerd.messages import (
    Attitude,
    AutopilotRestarted,
    Battery,
    Command,
    Disarm,
    GimbalState,
    Heartbeat,
    Input,
    Landed,
    LandedState,
    LocalPosition,
    PadPrior,
    ParameterChange,
    Phase,
    PhaseChange,
    PoseSolution,
    PressDown,
    Prior,
    RcChannels,
    Severity,
    Shutdown,
    Sightings,
    StatusText,
    Tick,
)
from landerd.pad import PadLayout

LARGEST = 1e6  # a number beyond this in a pose comes from a fit that failed
CONTINUES_S = 0.5  # set-points go on from the last one if it is not older
SAY_AGAIN_S = 1.0  # the same line is not told to the pilot more often
LEAST_DESCENT_MPS = 0.05  # after commit, whatever the deck does
HOVER: Vec3 = (0.0, 0.0, 0.0)


class Lander:
    """Lands the vehicle; see docs/how-it-lands.md for the picture."""

    def __init__(self, config: Config, layout: PadLayout) -> None:
        self._config = config
        self._placement = Placement(config)
        self._filter = PadFilter(config.estimation)
        self._sigma_bearing = math.radians(config.estimation.gimbal_sigma_deg)
        self._gate = Gate(config.rc, config.freshness)
        self._phases = Phases(config.guidance.descent, has_heading=layout.has_heading)
        self._method = make_method(config.guidance)
        self._limiter = Limiter(config.guidance.limits)
        self._lost = LostPlan(config.guidance.lost)
        self._touchdown = Touchdown(
            config.guidance.touchdown_timeout_s,
            config.guidance.touchdown_descent_mps,
            0.5 * max(config.vehicle.footprint_m),
        )
        self._aim = Aim(config.aim, config.gimbal)
        self._view = View(layout)
        self._landed = Landed.UNDEFINED
        self._sighting_t = -math.inf  # exposure of the last accepted sighting
        self._frame_t = -math.inf
        self._tick_t: float | None = None
        self._ordered_t = -math.inf  # when the last set-point was made
        self._release_until: float | None = None  # zero velocity is streamed until then
        self._flown = False  # a set-point was sent since authority was granted
        self._searching = False  # the pad went out of sight while flying
        self._broken_off = 0  # descents of this landing
        self._low = False  # below the alignment height when last in sight
        self._lost_down = 0.0  # local z where the pad went out of sight, m
        self._heading_t = -math.inf  # when the landing last did not wait for the pad's heading
        self._pad: PadEstimate | None = None  # as last known
        self._pad_velocity = HOVER  # the pad's when contact was made, m/s
        self._said: dict[str, float] = {}
        self._out: list[Command] = []
        self.phase = Phase.NOT_LANDING
        self.reason = "starting"
        self.outcome: str | None = None  # of the last landing, None while none has ended
        self.aborts = 0  # times the pad went out of sight while flying

    def step(self, message: Input) -> list[Command]:
        """Take one message and return the commands that follow, in order."""
        self._out = []
        match message:
            case Tick():
                self._on_tick(message.t)
            case Sightings():
                self._on_sightings(message)
            case LocalPosition() | Attitude() | GimbalState():
                jump = self._placement.add(message)
                if jump is not None:
                    self._filter.shift(jump)
            case Heartbeat():
                self._gate.on_heartbeat(message)
            case RcChannels():
                self._gate.on_rc(message)
            case LandedState():
                self._landed = message.state
            case AutopilotRestarted():
                self._on_restart()
            case Shutdown():
                self._gate.end()
            case ParameterChange():
                self._configure(with_value(self._config, message.key, message.value))
            case Battery():
                pass
        return self._out

    def prior(self, t: float) -> Prior:
        """Return what is known of a picture exposed at time t before it is searched."""
        down = self._placement.down(t)
        camera = self._placement.camera(t)
        estimate = self._filter.estimate(t, self._sighting_t)
        if camera is None or estimate is None or t - self._sighting_t > 1.0:
            return Prior(down=down)
        R_camera_local = transpose(camera.R_local_camera)
        north = None
        if estimate.heading is not None:
            heading = estimate.heading
            north = rotate(R_camera_local, (math.cos(heading), math.sin(heading), 0.0))
        position = rotate(R_camera_local, sub(estimate.position, camera.position))
        # Where it will be seen is not where it is: lens and clock err in the next frame too.
        B = self._placement.common(t, camera, position)
        shown = rotate(R_camera_local, rotate(B, self._filter.common))
        normal = rotate(R_camera_local, estimate.normal)
        pad = PadPrior(add(position, shown), estimate.sigma_m, north, normal)
        return Prior(down=down, pad=pad)

    @property
    def config(self) -> Config:
        """The configuration with all changes so far."""
        return self._config

    @property
    def needs_sight(self) -> bool:
        """Whether pictures still decide anything: not once the vehicle stands on the pad."""
        return not (self.phase is Phase.LANDED and self._touchdown.in_contact)

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the newest sighting, 3 on average; NaN without one."""
        return self._filter.nis

    def relative(self, now: float) -> Relative | None:
        """Return the pad relative to the vehicle at time now, None while either is unknown."""
        estimate = self._filter.estimate(now, self._sighting_t)
        vehicle = vehicle_now(self._placement, self._config.vehicle, now)
        return relative(vehicle, estimate, self._sigma_bearing) if vehicle and estimate else None

    # ---- inputs --------------------------------------------------------------------------------

    def _on_sightings(self, sightings: Sightings) -> None:
        if not sightings.t > self._frame_t:
            return  # late, twice or no number: never flown on
        self._frame_t = sightings.t
        candidates = [
            placed
            for solution in sightings.pad
            if _is_sound(solution)
            and (placed := self._placement.place(sightings.t, solution)) is not None
        ]
        if self._filter.update(candidates):
            self._sighting_t = sightings.t
            self._show_target(candidates)
        if self.needs_sight and self._config.aim.method == "increment":
            self._aim.on_sightings(sightings, self._placement.gimbal.at(sightings.t))

    def _show_target(self, candidates: list[PlacedPad]) -> None:
        if self._config.guidance.output != "landing_target":
            return
        estimate = self._filter.estimate(self._sighting_t, self._sighting_t)
        if estimate is not None:
            target = landing_target(self._placement, estimate, candidates)
            self._out += [target] if target is not None else []

    def _configure(self, config: Config) -> None:
        """Go on with changed parameters; only `guidance` and `rc` have any."""
        guidance = config.guidance
        self._config = config
        self._gate.configure(config.rc)
        self._phases.configure(guidance.descent)
        self._method.configure(guidance)
        self._limiter.configure(guidance.limits)
        self._lost.configure(guidance.lost)
        self._touchdown.configure(guidance.touchdown_timeout_s, guidance.touchdown_descent_mps)

    def _on_restart(self) -> None:
        self._gate.on_restart()
        self._placement.forget()
        self._filter.reset()
        self._landed = Landed.UNDEFINED
        self._sighting_t = -math.inf

    # ---- the control step ----------------------------------------------------------------------

    def _on_tick(self, now: float) -> None:
        dt = now - self._tick_t if self._tick_t is not None else 0.0
        self._tick_t = now
        if dt <= 0.0:
            return
        self._aim.on_tick(now, self._look(now), self._sighting_t)
        self._out.append(self._aim.command)
        if self._config.guidance.output == "landing_target":
            self._enter(Phase.NOT_LANDING, "the autopilot's precision landing flies")
            return
        authority, why = self._gate.authority(now)
        if authority is Authority.SILENT:
            self._go_silent(why)
        elif authority is Authority.RELEASED:
            self._release(now, why)
        else:
            self._release_until = None
            self._fly(now, dt)

    def _look(self, now: float) -> Vec3 | None:
        """Return where the pad will be when the gimbal has got there, None to search for it."""
        attitude = self._placement.attitude.newest
        then = now + self._config.aim.lead_s
        if self._config.aim.method == "increment" or attitude is None:
            return None
        # From stale data the lens would be led away from a pad that is still in the picture.
        remembered = now - self._sighting_t < self._config.aim.search_after_s
        if not remembered or self._fresh_vehicle(now) is None:
            return None
        estimate = self._filter.estimate(then, self._sighting_t)
        if estimate is None:
            return None
        return self._view.direction(self._placement, estimate, then - attitude[0])

    def _go_silent(self, why: str) -> None:
        on_pad = self.phase is Phase.LANDED and self._touchdown.in_contact
        if on_pad and self._gate.disarmed:
            self._finish("landed")
            why = "landed and disarmed"
        elif self._flown:
            self._finish("taken over")
        self._flown = self._searching = False
        self._release_until = None
        self._enter(Phase.NOT_LANDING, why)

    def _release(self, now: float, why: str) -> None:
        """Stream zero velocity for a while after landerd has flown, then nothing."""
        self._broken_off = 0
        if self._flown:
            self._flown = self._searching = False
            self._release_until = now + self._config.guidance.release_s
            self._finish("released")
        if self._release_until is not None and now < self._release_until:
            self._ordered_t = now
            self._out.append(self._limiter.stop())
        self._enter(Phase.NOT_LANDING, why)

    def _fly(self, now: float, dt: float) -> None:
        if self.phase is Phase.LANDED and self._touchdown.in_contact:
            self._settle(now, dt)
            return
        vehicle = self._fresh_vehicle(now)
        estimate = self._pad_now(now)
        age = now - self._sighting_t
        if vehicle is None or estimate is None or not self._in_sight(age, dt):
            self._fly_blind(now, dt, vehicle)
            return
        if not self._flown or self._searching:
            self._engage(vehicle, now)
        rel = relative(vehicle, estimate, self._sigma_bearing)
        self._low = rel.height < self._config.guidance.descent.alignment_height_m
        if self.phase is not Phase.LANDED:
            climbed = self._phases.climbs_again
            phase, why = self._phases.step(rel, age)
            self._enter(phase, why)
            if self._phases.climbs_again and not climbed:
                self._break_off(now, why)
            elif climbed and not self._phases.climbs_again and self._tried_enough:
                self._hand_back(now, "no landing possible")
                return
            if phase is not Phase.YAW_CORRECTION or rel.heading_error is not None:
                self._heading_t = now
            elif now - self._heading_t > self._config.guidance.lost.give_up_s:
                self._hand_back(now, "pad's heading not seen")
                return
            if phase is Phase.LANDED:
                self._touchdown.begin(now)
                self._landed = Landed.UNDEFINED  # what was said of the air or another landing
        if self.phase is Phase.LANDED:
            self._touch_down(now, dt, vehicle, rel, age)
            return
        velocity, yaw_rate = self._method.step(self.phase, rel, self._phases.floor_m, dt)
        if self._phases.climbs_again:
            velocity = (velocity[0], velocity[1], -self._config.guidance.lost.climb_mps)
        may_descend = self._phases.may_descend(rel) and rel.height > self._phases.floor_m
        self._send(velocity, yaw_rate, dt, may_descend=may_descend)

    def _pad_now(self, now: float) -> PadEstimate | None:
        """Return the pad, None if it is not known.

        At the touch the airframe is turned faster than gimbal and clock are known: sightings are
        refused and the filter begins anew. After commit that is no reason to climb.
        """
        estimate = self._filter.estimate(now, self._sighting_t)
        if estimate is None and self.phase is Phase.LANDED and self._pad is not None:
            return self._pad.moved(now)
        self._pad = estimate
        return estimate

    def _engage(self, vehicle: VehicleNow, now: float) -> None:
        if now - self._ordered_t > CONTINUES_S:
            self._limiter.reset(vehicle.velocity)
        self._flown, self._searching = True, False
        self._heading_t = now
        self.outcome = None
        self._phases.restart()
        self._method.restart()
        self._enter(Phase.APPROACH, "pad in sight")

    def _in_sight(self, age: float, dt: float) -> bool:
        """Tell whether the last sighting will still be young enough when the next tick comes."""
        limit = self._config.guidance.lost.after_s - dt
        return age < limit or self.phase is Phase.LANDED

    def _fresh_vehicle(self, now: float) -> VehicleNow | None:
        fresh, placement = self._config.freshness, self._placement
        if placement.position.age(now) > fresh.position_s:
            return None
        if placement.attitude.age(now) > fresh.attitude_s:
            return None
        return vehicle_now(placement, self._config.vehicle, now)

    def _touch_down(
        self, now: float, dt: float, vehicle: VehicleNow, rel: Relative, age: float
    ) -> None:
        """After commit: still led by sight until contact."""
        heave = rel.pad_velocity[2]
        sinking, ordered = vehicle.velocity[2] - heave, self._limiter.velocity[2] - heave
        step = self._touchdown.step(now, sinking, ordered, age, self._landed)
        if step is Step.ABORT:
            self._fly_blind(now, dt, vehicle)
            return
        self._pad_velocity = rel.pad_velocity
        if self._touchdown.in_contact:
            self._settle(now, dt)
            return
        (north, east, _), yaw_rate = self._method.step(self.phase, rel, 0.0, dt)
        if age > self._config.guidance.lost.after_s:
            yaw_rate = 0.0
        # A deck that comes up meets the vehicle: just over it, to give way would be to hover there.
        descent = max(heave + self._touchdown.descent(vehicle.lean), LEAST_DESCENT_MPS)
        self._send((north, east, descent), yaw_rate, dt, may_descend=True)

    def _settle(self, now: float, dt: float) -> None:
        """On the pad: go with it and press down until the autopilot knows, then disarm."""
        if self._touchdown.disarm_due(now, self._landed):
            self._out.append(Disarm())
        if self._touchdown.unconfirmed(now, self._landed):
            self._finish("touchdown_unconfirmed")
            self._say(now, Severity.CRITICAL, "touch-down not confirmed, disarm by hand")
        vehicle = self._fresh_vehicle(now)
        sinking = slip = tipping = math.inf
        north, east, _ = self._pad_velocity
        if vehicle is not None:
            v_north, v_east, sinking = vehicle.velocity
            slip, tipping = math.hypot(v_north - north, v_east - east), vehicle.tipping
        level = self._touchdown.level_due(
            now, sinking, slip, tipping, math.hypot(north, east), self._landed
        )
        if level and vehicle is not None:
            self._ordered_t = now
            self._limiter.stop()
            self._out.append(PressDown(vehicle.yaw))
            return
        self._send((north, east, self._touchdown.descent(0.0)), 0.0, dt, may_descend=True)

    # ---- out of sight --------------------------------------------------------------------------

    def _fly_blind(self, now: float, dt: float, vehicle: VehicleNow | None) -> None:
        why = self._why_blind(now)
        if not self._flown:
            self._enter(Phase.NOT_LANDING, why)
            return
        if not self._searching:
            self._lose(now, vehicle)
        down = vehicle.feet[2] if vehicle else self._lost_down
        plan = self._lost.step(now, down)
        if plan is None or self._tried_enough:
            self._hand_back(now, "pad not found")
            return
        # Climbing needs a position to know when to stop.
        velocity, what = plan if vehicle is not None else (HOVER, "holding")
        self._enter(Phase.NOT_LANDING, f"{why}, {what}")
        self._send(velocity, 0.0, dt, may_descend=False)

    def _lose(self, now: float, vehicle: VehicleNow | None) -> None:
        self._searching = True
        self._lost_down = vehicle.feet[2] if vehicle else 0.0
        self._lost.begin(now, self._lost_down, low=self._low)
        self._break_off(now, None)

    @property
    def _tried_enough(self) -> bool:
        """Whether as many descents were broken off as are allowed."""
        return self._broken_off > self._config.guidance.lost.retries

    def _hand_back(self, now: float, why: str) -> None:
        self._finish("handed_back")
        self._say(now, Severity.CRITICAL, f"{why}: pilot, take over")
        self._gate.latch()
        self._release(now, why)

    def _break_off(self, now: float, why: str | None) -> None:
        """Count an abort; those of the descent are limited in number."""
        self.aborts += 1
        if self._low:
            self._broken_off += 1
        if why is not None:
            self._say(now, Severity.WARNING, why)

    def _why_blind(self, now: float) -> str:
        fresh, placement = self._config.freshness, self._placement
        if placement.attitude.age(now) > fresh.attitude_s:
            return "attitude is stale"
        if placement.position.age(now) > fresh.position_s:
            return "position is stale"
        if placement.gimbal.age(now) > fresh.gimbal_s:
            return "gimbal angles are stale"
        if now - self._frame_t > self._config.guidance.lost.after_s:
            return "no pictures from the camera"
        return "pad not in sight"

    # ---- outputs -------------------------------------------------------------------------------

    def _send(self, velocity: Vec3, yaw_rate: float, dt: float, *, may_descend: bool) -> None:
        self._ordered_t = self._tick_t or 0.0
        self._out.append(self._limiter.step(velocity, yaw_rate, dt, may_descend=may_descend))

    def _enter(self, phase: Phase, reason: str) -> None:
        changed = phase is not self.phase
        if not changed and (phase is not Phase.NOT_LANDING or reason == self.reason):
            self.reason = reason
            return
        self.phase, self.reason = phase, reason
        self._out.append(PhaseChange(phase, reason))
        if phase is Phase.NOT_LANDING:
            severity, text = Severity.WARNING, reason
        else:
            severity, text = Severity.NOTICE, f"{phase.value.replace('_', ' ').lower()}: {reason}"
        self._say(self._tick_t or 0.0, severity, text)

    def _finish(self, outcome: str) -> None:
        """Keep the first outcome of a landing: what follows is its consequence."""
        if self.outcome is None:
            self.outcome = outcome

    def _say(self, now: float, severity: Severity, text: str) -> None:
        line = f"landerd: {text}"[:50]
        if now - self._said.get(line, -math.inf) >= SAY_AGAIN_S:
            self._said[line] = now
            self._out.append(StatusText(severity, line))


def _is_sound(s: PoseSolution) -> bool:
    """Tell whether a pose is one that can be calculated with: NaN or a degenerate fit is not."""
    c = s.covariance
    numbers = (*s.position, *s.normal, *(s.north or ()), *c[0], *c[1], *c[2])
    scalars = (s.sigma_yaw or 0.0, s.sigma_tilt, s.cost)
    in_range = all(-LARGEST <= x <= LARGEST for x in (*numbers, *scalars))
    return in_range and c[0][0] > 0.0 and c[1][1] > 0.0 and c[2][2] > 0.0
