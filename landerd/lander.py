"""The core's interface: timestamped messages in, commands out. No I/O, clock or randomness.

`step` is called with every message in the order the daemon took it; ticks at the control rate make
the set-points. It only routes: where things are is decided in `estimation`, who flies in
guidance.gate, what is flown in guidance.landing, where the camera looks in guidance.aim.
"""

import math

from landerd.config.models import Config
from landerd.config.parameters import with_value
from landerd.estimation.estimator import Estimator
from landerd.estimation.health import Health
from landerd.estimation.pad_filter import SensorErrors
from landerd.geometry import Vec3
from landerd.guidance.aim import Aim
from landerd.guidance.exposure import ExposureControl
from landerd.guidance.gate import Gate
from landerd.guidance.landing import Landing
from landerd.guidance.landing_target import landing_target
from landerd.guidance.last_orders import LastOrders
from landerd.guidance.look_direction import LookDirection
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.states import State
from landerd.messages import (
    Attitude,
    AutopilotRestarted,
    ClockSync,
    Command,
    GimbalState,
    Heartbeat,
    Input,
    Landed,
    LandedState,
    LocalPosition,
    ParameterChange,
    Phase,
    Prior,
    RcChannels,
    Shutdown,
    Sightings,
    Tick,
)
from landerd.pad import PadLayout


class Lander:
    """Lands the vehicle; see docs/how-it-lands.md for the picture."""

    def __init__(self, config: Config, layout: PadLayout) -> None:
        self._config = config
        self._estimator = Estimator(config)
        self._gate = Gate(config.rc, config.freshness)
        self._landing = Landing(config, layout, self._gate, self._estimator)
        self._aim = Aim(config.aim, config.gimbal)
        self._look_direction = LookDirection(layout)
        is_metered = config.camera.exposure == "pad"
        self._exposure = ExposureControl(config.camera.metering) if is_metered else None
        self._tick_t: float | None = None

    # ---- what others look at -------------------------------------------------------------------

    @property
    def config(self) -> Config:
        """The configuration with all changes so far."""
        return self._config

    @property
    def state(self) -> State:
        """What landerd is doing about the landing."""
        return self._landing.state

    @property
    def phase(self) -> Phase:
        """The thesis's phase that the landing is in."""
        return self._landing.phase

    @property
    def reason(self) -> str:
        """Why it is in that phase, in plain words."""
        return self._landing.reason

    @property
    def outcome(self) -> str | None:
        """Outcome of the last landing, None while none has ended."""
        return self._landing.outcome

    @property
    def aborts(self) -> int:
        """Times a descent was broken off, or the pad went out of sight while flying."""
        return self._landing.aborts

    @property
    def needs_sight(self) -> bool:
        """Whether pictures still decide anything: not once the vehicle stands on the pad."""
        return not self._landing.stands

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the newest sighting, 3 on average; NaN without one."""
        return self._estimator.nis

    @property
    def health(self) -> Health | None:
        """How well the sightings of the last moments fit, and how old they are; None: none."""
        return self._estimator.health.newest

    @property
    def flight_health(self) -> Health | None:
        """The same of the whole flight so far."""
        return self._estimator.health.flight

    @property
    def sensor_errors(self) -> SensorErrors:
        """What is wrong about camera and gimbal, as far as it is known."""
        return self._estimator.sensor_errors

    @property
    def last_orders(self) -> LastOrders | None:
        """What is to be streamed should this core fail now; None while it flies nothing."""
        return self._landing.last_orders

    def prior(self, t: float) -> Prior:
        """Return what is known of a picture exposed at time t (s) before it is searched."""
        if not math.isfinite(t):
            return Prior()
        return self._estimator.prior(t)

    def relative_state(self, now: float) -> RelativeState | None:
        """Return the pad relative to the vehicle at time now, None while either is unknown."""
        return self._landing.relative_state(now)

    # ---- messages in, commands out -------------------------------------------------------------

    def step(self, message: Input) -> list[Command]:
        """Take one message and return the commands that follow, in order."""
        match message:
            case Tick():
                return self._on_tick(message.t)
            case Sightings():
                return self._on_sightings(message)
            case LocalPosition() | Attitude() | GimbalState():
                self._estimator.on_telemetry(message)
            case Heartbeat():
                self._gate.on_heartbeat(message)
            case RcChannels():
                self._gate.on_rc(message)
            case LandedState():
                self._landing.on_landed_state(message.state)
            case ClockSync():
                self._estimator.on_clock(message)
                self._gate.on_clock(message)
            case AutopilotRestarted():
                self._gate.on_restart()
                self._estimator.on_restart()
                self._landing.on_landed_state(Landed.UNDEFINED)
            case Shutdown():
                self._gate.end()
            case ParameterChange():
                self._configure(with_value(self._config, message.key, message.value))
        return []  # a Battery is for the log only

    def _configure(self, config: Config) -> None:
        """Go on with changed numbers; only `guidance`, `rc` and `autopilot` have any."""
        self._config = config
        self._gate.configure(config.rc)
        self._landing.configure(config)

    def _on_sightings(self, sightings: Sightings) -> list[Command]:
        observations = self._estimator.on_sightings(sightings)
        if observations is None:
            return []  # late, twice or no number: never flown on
        if self.needs_sight and self._config.aim.method == "increment":
            exposed_t = sightings.t - self._config.camera.clock_offset_s
            self._aim.on_sightings(sightings, self._estimator.poses.gimbal.at(exposed_t))
        commands: list[Command] = []
        if self._exposure is not None and self._tick_t is not None:
            order = self._exposure.on_sightings(self._tick_t, sightings)
            commands += [order] if order is not None else []
        if observations and self._config.guidance.output == "landing_target":
            target = landing_target(self._estimator, observations)
            commands += [target] if target is not None else []
        return commands

    def _on_tick(self, now: float) -> list[Command]:
        dt = now - self._tick_t if self._tick_t is not None else 0.0
        self._tick_t = now
        if dt <= 0.0:
            return []
        self._estimator.on_tick(now)
        if self._landing.has_stood:
            # The pad stays in the picture, wherever it carries the vehicle: by its known velocity
            # the lens was turned away from one that turned off under the feet.
            self._aim.hold(now)
        else:
            self._turn_camera(now)
        return [self._aim.command, *self._landing.step(now, dt)]

    def _turn_camera(self, now: float) -> None:
        """Aim at the pad, or where it is looked for."""
        direction = self._look(now)
        vehicle = self._estimator.vehicle(now) if direction is None else None  # to search by
        course = vehicle.course if vehicle is not None else None
        base = self._estimator.poses.gimbal_base(0.0) if direction is None else None
        R_local_base = None if base is None else base[1]
        self._aim.on_tick(now, direction, self._estimator.sighting_t, course, R_local_base)

    def _look(self, now: float) -> Vec3 | None:
        options = self._config.aim
        if options.method == "increment":
            return None
        return self._look_direction.ahead(self._estimator, now, options)
