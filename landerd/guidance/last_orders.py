"""The orders still streamed after the core itself has failed; prepared in every control step."""

from dataclasses import dataclass

from landerd.messages import PressDown, Setpoint


@dataclass(frozen=True, slots=True)
class LastOrders:
    """Orders to stream, one after the other (rule 1b)."""

    # Climb away from a pad that moves, or stop until the vehicle lies on it; None: not needed.
    first: Setpoint | None
    first_s: float  # for how long, s
    then: Setpoint | PressDown  # afterwards: stop, or stand level on the pad
    then_s: float  # for how long, s

    def at(self, elapsed_s: float) -> Setpoint | PressDown | None:
        """Return the order at a time after the failure (s); None: nothing more is sent."""
        if self.first is not None:
            if elapsed_s < self.first_s:
                return self.first
            elapsed_s -= self.first_s
        return self.then if elapsed_s < self.then_s else None
