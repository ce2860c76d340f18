"""Reports that jump as no vehicle can: they are not taken, until they have agreed for a while.

An EKF that is reset says the new value from then on; what comes once was never so.
"""

from landerd.geometry import Vec3, norm, sub

AS_EXPECTED: Vec3 = (0.0, 0.0, 0.0)


class OutlierRejector:
    """Looks at the reports of one kind, in order."""

    def __init__(self, believed_s: float = 0.0) -> None:
        """Make one that has seen no jump yet.

        Args:
            believed_s: reports that agree for so long are so, those as expected too once one has
                jumped, s; 0: as expected at once, with a jump the second one in a row.
        """
        self._believed_s = believed_s
        self._jump = AS_EXPECTED  # of the last reports, which agree
        self._since = float("-inf")

    def rejects(self, t: float, jump: Vec3, most: float) -> bool:
        """Tell whether a report is not to be taken.

        Args:
            t: of the report, s.
            jump: that is reported, less what those before led to expect.
            most: that it may be, in the same unit.
        """
        jump = jump if norm(jump) > most else AS_EXPECTED
        is_other = norm(sub(jump, self._jump)) > most
        if is_other:
            self._jump, self._since = jump, t
        first = is_other and jump != AS_EXPECTED
        is_believed = not first and t - self._since >= self._believed_s
        if is_believed:
            self._jump = AS_EXPECTED  # from now on that is expected
        return not is_believed
