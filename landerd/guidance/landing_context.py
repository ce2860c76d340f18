"""What the states of a landing share: the control step, what is seen, how the landing goes."""

import math
from dataclasses import dataclass
from typing import Protocol

from landerd.config.models import Config
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.estimation.vehicle_state import VehicleState
from landerd.geometry import Vec3
from landerd.guidance import pilot_texts
from landerd.guidance.orders import Orders
from landerd.guidance.relative_state import RelativeState
from landerd.guidance.states import Event
from landerd.messages import Landed


@dataclass(frozen=True, slots=True)
class ControlStep:
    """One control step, as the gate let it begin."""

    now: float  # s
    dt: float  # since the last one, s
    granted: bool  # landerd may fly
    why: str  # why not, or why the state that has its turn was entered: pilot_texts


class LandingState(Protocol):
    """One state of the landing; `states.TRANSITIONS` says where its events lead."""

    def enter(self, step: ControlStep) -> None:
        """Begin; no order is made yet, but the pilot may be told."""

    def order(self, step: ControlStep) -> Event | None:
        """Make the orders of one control step, or return the event that ends the state."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The pad in sight in one control step, of a vehicle whose own data are fresh."""

    relative: RelativeState
    age: float  # since the exposure of the last accepted sighting, s


class LandingContext:
    """Shared by the states, of which one at a time is active.

    Attributes:
        options: `guidance` of the configuration as it is now; parameters may change in flight.
        estimator: where vehicle and pad are.
        orders: of this control step.
        outcome: of the last landing, None while none has ended.
        aborts: times a descent was broken off, or the pad went out of sight while flying.
        low: below the alignment height when the pad was last in sight.
        landed: what the autopilot's land detector has said since commit.
        pad_velocity: when contact was made, local NED, m/s.
    """

    def __init__(self, config: Config, estimator: Estimator, orders: Orders) -> None:
        self.options = config.guidance
        self.estimator = estimator
        self.orders = orders
        self.outcome: str | None = None
        self.aborts = 0
        self.low = False
        self.landed = Landed.UNDEFINED
        self.pad_velocity: Vec3 = (0.0, 0.0, 0.0)
        self._sigma_bearing = math.radians(config.estimation.gimbal_sigma_deg)
        self._descents_broken_off = 0

    # ---- what is seen --------------------------------------------------------------------------

    def sight(self, step: ControlStep) -> Sight | None:
        """Return the sight of the pad, None while it may not be flown on (rules 2 and 5)."""
        vehicle = self.estimator.fresh_vehicle(step.now)
        pad = self.estimator.pad(step.now)
        age = step.now - self.estimator.sighting_t
        # The sighting must still be young enough when the next control step comes.
        limit = self.options.lost.after_s - step.dt
        if vehicle is None or pad is None or not age < limit:
            return None
        return Sight(self.relative(vehicle, pad), age)

    def relative(self, vehicle: VehicleState, pad: PadEstimate) -> RelativeState:
        """Return the pad relative to the vehicle, both now."""
        return RelativeState.between(vehicle, pad, self._sigma_bearing)

    def why_blind(self, now: float) -> str:
        """Return why there is no sight of the pad, for the pilot."""
        stale = self.estimator.stale(now)
        if stale is not None:
            return pilot_texts.STALE[stale]
        if now - self.estimator.frame_t > self.options.lost.after_s:
            return pilot_texts.NO_PICTURES
        if now - self.estimator.refused_t <= self.options.lost.after_s:
            return pilot_texts.NOT_BELIEVED
        return pilot_texts.NOT_IN_SIGHT

    # ---- how the landing goes ------------------------------------------------------------------

    def note_height(self, relative: RelativeState) -> None:
        """Keep whether it is low: what to do when sight is lost hangs on it."""
        self.low = relative.height < self.options.descent.alignment_height_m

    def break_off(self) -> None:
        """Count an abort; those of descents are limited in number (guidance.lost.retries)."""
        self.aborts += 1
        if self.low:
            self._descents_broken_off += 1

    @property
    def tried_enough(self) -> bool:
        """Whether more descents were broken off than are allowed."""
        return self._descents_broken_off > self.options.lost.retries

    def forgive(self) -> None:
        """Count the descents that are broken off anew: the pilot has the vehicle."""
        self._descents_broken_off = 0

    def finish(self, outcome: str) -> None:
        """Keep the first outcome of a landing: what follows is its consequence."""
        if self.outcome is None:
            self.outcome = outcome
