"""What is still ordered when the core itself has failed: prepared beforehand, at every step."""

from dataclasses import dataclass

from landerd.messages import PressDown, Setpoint


@dataclass(frozen=True, slots=True)
class LastOrders:
    """Orders to stream, one after the other (rule 1b)."""

    away: Setpoint | None  # first, for away_s: up from a pad that moves; None: not needed
    away_s: float
    then: Setpoint | PressDown  # for then_s: to stop, or to stand level on the pad
    then_s: float

    def at(self, elapsed_s: float) -> Setpoint | PressDown | None:
        """Return the order at a time after the failure, s; None: it is over."""
        if self.away is not None:
            if elapsed_s < self.away_s:
                return self.away
            elapsed_s -= self.away_s
        return self.then if elapsed_s < self.then_s else None
