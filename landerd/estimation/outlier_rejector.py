"""Rejects reports that jump as no vehicle can, until they have agreed for a while.

An autopilot whose EKF was reset goes on reporting the new value; a single outlier does not repeat.
"""

from landerd.geometry import Vec3, norm, sub

AS_EXPECTED: Vec3 = (0.0, 0.0, 0.0)


class OutlierRejector:
    """Judges the reports of one kind, in order."""

    def __init__(self, believed_s: float) -> None:
        """Make one that has seen no jump yet.

        Args:
            believed_s: after a jump, reports must agree for this long before they are taken, s,
                also those without a jump.
        """
        self._believed_s = believed_s
        self._jump = AS_EXPECTED  # that the latest reports agree on
        self._since = float("-inf")

    def rejects(self, t: float, jump: Vec3, most: float) -> bool:
        """Tell whether a report is to be dropped.

        Args:
            t: of the report, s.
            jump: reported minus predicted value.
            most: largest jump that is possible, in the same unit.
        """
        jump = jump if norm(jump) > most else AS_EXPECTED
        is_other = norm(sub(jump, self._jump)) > most
        if is_other:
            self._jump, self._since = jump, t
        first = is_other and jump != AS_EXPECTED
        is_believed = not first and t - self._since >= self._believed_s
        if is_believed:
            self._jump = AS_EXPECTED  # the caller predicts from the new value now
        return not is_believed
