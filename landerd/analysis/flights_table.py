"""A table of several flights from their logs, with 95 % intervals of landing rate and means.

It is the first part of a report on several flights.
"""

from collections.abc import Sequence

from landerd.analysis.flight import Flight
from landerd.analysis.intervals import in_percent, mean_interval, wilson, with_interval
from landerd.analysis.page import Block, Heading, Table, Text


def section(flights: Sequence[Flight]) -> list[Block]:
    """Return the table of all flights, with their landing rate and means above it.

    A dry run is no landing: it has a row, and does not count.
    """
    rows = [_row(flight) for flight in flights]
    flown = [flight for flight in flights if not flight.log.is_dry]
    landed = [flight for flight in flown if _landed(flight)]
    share = in_percent(wilson(len(landed), len(flown)))
    parts = [f"{len(landed)} of {len(flown)} landed (95 %: {share})"]
    for name, unit, values in (
        ("time", "s", [_time_s(f) for f in landed]),
        ("energy", "hJ", [None if f.energy_j is None else f.energy_j / 100.0 for f in landed]),
    ):
        known = [value for value in values if value is not None]
        if known:
            mean = with_interval(sum(known) / len(known), mean_interval(known), 1)
            parts.append(f"{name} {mean} {unit}")
    said = "; ".join(parts) + ", means of those that landed, from first sight to disarming."
    head = ["flight", "outcome", "time s", "energy hJ", "own estimate m", "sight lost"]
    return [Heading("All flights", 2), Text(said), Table(head, rows)]


def _landed(flight: Flight) -> bool:
    """Tell whether a flight ended with a landing, by its last recorded state."""
    states = flight.log.states
    return bool(states) and states[-1].outcome == "landed"


def _time_s(flight: Flight) -> float | None:
    """Return the time from the first sighting that counts to disarming; None: unknown."""
    first, disarmed = flight.first_sight_t, flight.disarmed_t
    return None if first is None or disarmed is None else disarmed - first


def _row(flight: Flight) -> list[str]:
    """Return the cells of a flight."""
    last = flight.log.states[-1] if flight.log.states else None
    time_s, energy_j = _time_s(flight), flight.energy_j
    at_end = None if flight.disarmed_t is None else flight.state_at(flight.disarmed_t)
    off = None if at_end is None or at_end.relative is None else at_end.relative.distance
    return [
        flight.title,
        "-" if last is None or last.outcome is None else last.outcome.replace("_", " "),
        "-" if time_s is None else f"{time_s:.1f}",
        "-" if energy_j is None else f"{energy_j / 100.0:.1f}",
        "-" if off is None else f"{off:.3f}",
        "-" if last is None else str(last.aborts),
    ]
