"""Which error of which marker explains best that a pad's markers contradict each other.

For the camera check before a flight and for `landerd detect`. Each marker in turn is allowed to
have any size, place, tilt or heading. The error that lowers the joint chi-square (`pad_pose`) most
is the likeliest one. It is reported if it lowers chi-square by more than the uncertainties stated
in the pad file let expect.
"""

import math
from dataclasses import dataclass

import numpy as np

from landerd.camera_model import F64
from landerd.pad import Marker, PadLayout, Ring
from landerd.vision.marker_errors import ERRORS, SCALE, MarkerErrors
from landerd.vision.pad_pose import Joint, Measurement, in_order, joint_poses

# Variances of a marker's errors while they may be anything: m^2, rad^2 and a share squared.
_FREE = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.3]) ** 2
# Which of a marker's errors have one cause: a bent plate tilts and lifts a marker.
_CAUSES = {"size": (SCALE,), "place": (0, 1), "tilt": (2, 3, 4), "heading": (5,)}
# Least reduction of chi-square: up to 2 sigma the pad file itself allows.
_LEAST_GAIN = 4.0
# If scores differ by less than this, the marker farther from the landing point is blamed.
_ALIKE = 1.0


@dataclass(frozen=True)
class Disagreement:
    """An error of a marker that would explain the contradiction in a picture."""

    marker: Marker
    what: str  # "size", "place", "tilt" or "heading"
    by: float  # its size: a share, m, rad or rad
    text: str  # the same in words


def disagreement(
    measured: list[Measurement], errors: MarkerErrors, layout: PadLayout
) -> Disagreement | None:
    """Return the likeliest error if the markers of one picture contradict each other; else None.

    Args:
        measured: the markers seen, each once.
        errors: of the pad.
        layout: the pad.
    """
    if len(measured) < 2:
        return None
    measured = in_order(measured)
    allowed = errors.first([m.marker for m in measured])
    agreed = _best(measured, allowed)
    if agreed is None:
        return None
    found: list[tuple[float, float, int, str, F64]] = []
    for i, m in enumerate(measured):
        for what, numbers in _CAUSES.items():
            if m.heading is None and what == "heading":
                continue
            covariance = allowed.copy()
            for k in numbers:
                covariance[ERRORS * i + k, ERRORS * i + k] = _FREE[k]
            freed = _best(measured, covariance)
            if freed is None:
                continue
            gain = agreed.pose.cost - freed.pose.cost
            own = freed.errors[ERRORS * i : ERRORS * (i + 1)]
            if gain > _LEAST_GAIN:
                # Akaike's criterion: each free parameter must lower chi-square by 2.
                score = gain - 2.0 * len(numbers)
                found.append((score, float(np.linalg.norm(m.place)), m.marker, what, own))
    if not found:
        return None
    most = max(f[0] for f in found)
    _, _, number, what, own = max((f for f in found if f[0] > most - _ALIKE), key=lambda f: f[1])
    return _told(layout, layout.markers[number], what, own)


def _best(measured: list[Measurement], covariance: F64) -> Joint | None:
    known: F64 = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    found = joint_poses(measured, np.zeros(len(covariance)), known, None)
    return min(found, key=lambda j: j.pose.cost, default=None)


def _told(layout: PadLayout, marker: Marker, what: str, errors: F64) -> Disagreement:
    if not isinstance(marker, Ring):
        name = f"{marker.kind} {marker.id}"
    elif len(layout.rings) == 1:
        name = marker.kind
    else:
        name = f"{marker.kind} of {marker.outer_diameter_m:g} m at {list(marker.position_m)}"
    if what == "size":
        by = float(errors[SCALE])
        word = "larger" if by > 0.0 else "smaller"
        text = f"the {name} looks {100.0 * abs(by):.1f} % {word} than the pad file says"
    elif what == "place":
        north, east = 1e3 * float(errors[0]), 1e3 * float(errors[1])
        by = 1e-3 * math.hypot(north, east)
        ways = f"{abs(north):.0f} mm to the {'north' if north > 0.0 else 'south'}"
        ways += f" and {abs(east):.0f} mm to the {'east' if east > 0.0 else 'west'}"
        text = f"the {name} looks {ways} of where the pad file says"
    elif what == "tilt":
        by = math.hypot(float(errors[3]), float(errors[4]))
        text = f"the {name} looks tilted by {math.degrees(by):.1f} degrees against the pad"
    else:
        by = float(errors[5])
        way = "clockwise" if by > 0.0 else "anticlockwise"
        text = f"the {name} looks turned {way} by {math.degrees(abs(by)):.1f} degrees on the pad"
    return Disagreement(marker, what, by, text)
