"""The result of a simulated landing: the object that `landerd sim` prints, and the drawing."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hw.sim.judge.monitor import Worst
from hw.sim.judge.score import Score
from landerd.analysis.intervals import percentile
from landerd.analysis.picture import Trace
from landerd.estimation.health import NIS_EXPECTED
from landerd.lander import Lander
from landerd.messages import Phase
from landerd.pad import PadLayout
from landerd.simulation.faults import Faults
from landerd.simulation.recording import Recording
from landerd.vision.draw import draw


@dataclass(frozen=True)
class Flown:
    """A simulated flight that is over; times on the loop's clock, s."""

    began: float
    ended: float
    timed_out: bool  # whether it took longer than it may
    ends_at_contact: bool  # whether nothing was simulated after the first contact
    score: Score
    rules_broken: Mapping[str, float]  # rules with the time at which they were first broken
    lander: Lander  # the core at the end
    faults: Mapping[str, int]  # number of bad inputs by kind, as the daemon counted them
    findings: Mapping[str, float]  # of the safety monitor, with the time of the first
    happened: Faults  # the faults of `sim.faults`
    worst: Worst  # the hardest contact
    # When the pad left the camera's reach while landerd could not follow; None: it did not.
    left_reach_t: float | None
    recording: Recording
    innovation_gate: float  # largest NIS of a sighting that is not refused


def result_of(flown: Flown, scenario: str, seed: int) -> dict[str, Any]:
    """Return the object that `landerd sim --json` prints, without wall_s."""
    score, lander, recording = flown.score, flown.lander, flown.recording
    first, contact = score.first_sighting_t, score.contact
    flown_s = flown.ended - flown.began
    left_t = flown.left_reach_t

    def since_sighting(t: float | None) -> float | None:
        return t - first if t is not None and first is not None else None

    return {
        "scenario": scenario,
        "seed": seed,
        "landed": contact.on_plate if flown.ends_at_contact and contact else score.landed,
        "outcome": _outcome(flown),
        "touchdown_error_m": contact.error_m if contact else None,
        "touchdown_vertical_mps": contact.vertical_mps if contact else None,
        "touchdown_horizontal_mps": contact.horizontal_mps if contact else None,
        "touch_and_climbs": score.touch_and_climbs,
        "yaw_error_deg": math.degrees(contact.yaw_error) if contact else None,
        "time_s": since_sighting(score.disarm_t),
        "time_to_touchdown_s": since_sighting(contact.t if contact else None),
        "energy_hj": None if score.energy_j is None else score.energy_j / 100.0,
        "pad_velocity_error_mps": recording.pad_velocity_error_mps,
        "nis_ratio": _nis_ratio(flown),
        "refused_percent": _refused_percent(flown),
        "hold_error_m_p95": percentile(recording.hold_errors_m, 95.0),
        "off_centre_px_p95": percentile(recording.off_centre_px, 95.0),
        "gimbal_error_px_p95": percentile(recording.gimbal_errors_px, 95.0),
        "aborts": lander.aborts,
        "phases": _phases(flown),
        "rules_broken": _breaks(flown, flown.rules_broken),
        "findings": _breaks(flown, flown.findings),
        "excused": _excused(flown),
        "faults_flown": flown.happened.as_plain(),
        "worst_contact": asdict(flown.worst),
        "pad_out_of_reach_s": None if left_t is None else left_t - flown.began,
        "simulated_s": flown_s,
        "frames_per_s": recording.frames / flown_s,
        "faults": dict(flown.faults),
    }


def _breaks(flown: Flown, broken: Mapping[str, float]) -> list[str]:
    """Return broken rules or findings with their times since the start."""
    return [f"{rule} (at {t - flown.began:.2f} s)" for rule, t in broken.items()]


def _excused(flown: Flown) -> list[str]:
    """Return the broken rules and findings that a fault made unavoidable."""
    broken = {**flown.rules_broken, **flown.findings}
    excused = {
        rule: t for rule, t in broken.items() if flown.happened.excuses(rule, t - flown.began)
    }
    return _breaks(flown, excused)


def _outcome(flown: Flown) -> str:
    """Return how the flight ended, in words."""
    lander = flown.lander
    if lander.outcome is not None:
        return lander.outcome
    if flown.ends_at_contact and flown.score.contact is not None:
        return "touched down"
    if flown.timed_out:
        flown_s = flown.ended - flown.began
        return f"not landed in {flown_s:.0f} s: {lander.phase.value}, {lander.reason}"
    return lander.reason


def _nis_ratio(flown: Flown) -> float | None:
    """Return the mean NIS over its expectation: 1 if the filter's covariance is right.

    Refused sightings count, as otherwise a narrow gate would make any filter look right. No
    sighting counts for more than the gate, as otherwise one false alarm would outweigh a flight.
    None: no sighting could be compared.
    """
    capped = [min(nis, flown.innovation_gate) for nis in flown.recording.nis]
    return sum(capped) / len(capped) / NIS_EXPECTED if capped else None


def _refused_percent(flown: Flown) -> float | None:
    """Return the percentage of sightings that the filter refused; None: there were none."""
    nis = flown.recording.nis
    return 100.0 * sum(n > flown.innovation_gate for n in nis) / len(nis) if nis else None


def _phases(flown: Flown) -> list[dict[str, Any]]:
    """Return name, reason, start and end (s since the start) of each part of the landing."""
    changes = flown.recording.phases
    ends = [t for t, _ in changes[1:]] + [flown.ended]
    began = flown.began
    return [
        {"name": c.phase.value, "reason": c.reason, "start": t - began, "end": end - began}
        for (t, c), end in zip(changes, ends, strict=True)
    ]


def trace_of(recording: Recording, layout: PadLayout, result: dict[str, Any]) -> Trace:
    """Return what is drawn of a flight.

    Args:
        recording: of the flight.
        layout: of the pad.
        result: of the flight, for the title.
    """
    landed = "landed" if result["landed"] else "did not land"
    error = result["touchdown_error_m"]
    trace = Trace(
        f"landerd sim {result['scenario']}, seed {result['seed']}: {landed}"
        + (f", {error:.2f} m from the landing point" if error is not None else ""),
        recording.samples,
    )
    views = recording.views
    wanted = [p for p in (Phase.NOT_LANDING, Phase.DESCENT, Phase.LANDED) if p in views]
    for phase in wanted or list(views)[:3]:
        t, frame, sightings = views[phase]
        image = draw(frame.image, sightings, recording.camera_model, layout)
        trace.views.append((f"{t:.1f} s, {phase.value}", np.asarray(image)))
    return trace
