"""Reports that jump as no vehicle can: they are not taken, until they have agreed for a while.

An EKF that is reset says the new value from then on; what comes once was never so.
"""

from landerd.geometry import Vec3, norm, sub


class Spikes:
    """Looks at the reports of one kind, in order."""

    def __init__(self, believed_s: float = 0.0) -> None:
        """Believed: reports that agree for so long are so, s; 0: the second one in a row."""
        self._believed_s = believed_s
        self._suspected: tuple[float, Vec3] | None = None  # since when, and by how much it jumped

    def is_one(self, t: float, jump: Vec3, most: float) -> bool:
        """Tell whether a report is not to be taken.

        Args:
            t: of the report, s.
            jump: that is reported, less what those before led to expect.
            most: that it may be, in the same unit.
        """
        if norm(jump) <= most:
            self._suspected = None
            return False
        if self._suspected is None or norm(sub(jump, self._suspected[1])) > most:
            self._suspected = t, jump
            return True
        return t - self._suspected[0] < self._believed_s
