"""The path of a simulated flight in columns, which campaigns keep for their figures."""

import math

from landerd.geometry import Vec3
from landerd.simulation.recording import Recording

EVERY = 3  # each third sample is kept: one every 0.3 s
DIGITS = 3  # decimal places kept

Column = list[float | None]

# Names of the columns: first those by truth.
_BY_TRUTH = ("t", "north", "east", "up", "pad_north", "pad_east", "heading_error_deg")
_NAMES = (*_BY_TRUTH, *"xyz", "ahead", "right", "below")
_UNKNOWN = (None, None, None)


def path_of(recording: Recording, first_sighting_t: float | None) -> dict[str, Column]:
    """Return the path from the first sighting on, as truth, sightings and estimates show it.

    Args:
        recording: of the flight.
        first_sighting_t: time of the first sighting on the loop's clock, s; None: there was none,
            and the columns are empty.

    Returns:
        columns of the same length: `t` since the first sighting, s; `north`, `east`, `up` of the
        vehicle's feet and `pad_north`, `pad_east` of the landing point, m, on the axes of the pad
        at its start; `heading_error_deg`; `x`, `y`, `z` of the landing point as seen, camera frame,
        m, None: not seen; `ahead`, `right`, `below` of the landing point from the vehicle's feet as
        landerd estimates it, m, None: no estimate.
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
