"""Reports that jump as no vehicle can: one is dropped, a second in a row that agrees is believed.

An EKF that is reset says the new value from then on; what comes once was never so.
"""

from landerd.geometry import Vec3, norm, sub


class Spikes:
    """Looks at the reports of one kind, in order."""

    def __init__(self) -> None:
        self._suspected: Vec3 | None = None  # the last one, if it jumped

    def is_one(self, value: Vec3, expected: Vec3, most: float) -> bool:
        """Tell whether a report is not to be taken.

        Args:
            value: that is reported.
            expected: by those before.
            most: by which it may be off that, in the same unit.
        """
        if norm(sub(value, expected)) <= most:
            self._suspected = None
            return False
        suspected, self._suspected = self._suspected, value
        return suspected is None or norm(sub(value, suspected)) > most
