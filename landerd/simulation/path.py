"""Where a simulated vehicle flew, in columns: what campaigns keep of a flight for their figures."""

import math

from landerd.geometry import Vec3
from landerd.simulation.recording import Recording

EVERY = 3  # of the samples: every 0.3 s
DIGITS = 3

Column = list[float | None]

_BY_TRUTH = ("t", "north", "east", "up", "pad_north", "pad_east", "heading_error_deg")
_NAMES = (*_BY_TRUTH, *"xyz", "ahead", "right", "below")
_UNKNOWN = (None, None, None)


def path_of(recording: Recording, first_sighting_t: float | None) -> dict[str, Column]:
    """Return the path from the first sighting on, by truth.

    Args:
        recording: of the flight.
        first_sighting_t: s on the loop's clock; None: there was none, and the path is empty.

    Returns:
        Columns of one length: `t` since the first sighting, s; `north`, `east`, `up` of the
        vehicle's feet and `pad_north`, `pad_east` of the landing point, m, in axes of the pad at
        its start; `heading_error_deg`; `x`, `y`, `z` of the landing point in the camera's frame as
        seen, m, None where it was not; `ahead`, `right`, `below` of it from the vehicle's feet by
        landerd's own estimate, m, None where it had none.
    """
    columns: dict[str, Column] = {name: [] for name in _NAMES}
    if first_sighting_t is None:
        return columns
    from_s = first_sighting_t - recording.began
    rows = zip(
        recording.samples,
        recording.headings,
        recording.in_camera,
        recording.estimates,
        strict=True,
    )
    last_seen: Vec3 | None = None
    for i, (sample, heading, seen, estimate) in enumerate(rows):
        last_seen = seen or last_seen
        if i % EVERY or sample.t < from_s:
            continue
        row = (
            sample.t - from_s,
            *sample.vehicle,
            *sample.pad[:2],
            math.degrees(heading),
            *(last_seen or _UNKNOWN),
            *(estimate or _UNKNOWN),
        )
        last_seen = None
        for name, value in zip(_NAMES, row, strict=True):
            columns[name].append(None if value is None else round(value, DIGITS))
    return columns
