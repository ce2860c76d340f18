"""What a simulated landing came to: the object that is printed, and the drawing."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from landerd.analysis.picture import Trace
from landerd.messages import Phase
from landerd.vision.draw import draw

if TYPE_CHECKING:
    from landerd.simulation.flight import Simulation

NIS_EXPECTED = 3.0  # of the pad filter: three coordinates


def result_of(simulation: "Simulation", scenario: str, seed: int) -> dict[str, Any]:
    """Return the object that `landerd sim --json` prints, but for wall_s."""
    score, lander = simulation.score, simulation.daemon.lander
    first, contact, disarm = score.first_sighting_t, score.contact, score.disarm_t

    began = simulation.began
    flown_s = simulation.world.t - began

    def since_sighting(t: float | None) -> float | None:
        return t - first if t is not None and first is not None else None

    return {
        "scenario": scenario,
        "seed": seed,
        "landed": contact.on_plate if simulation.ends_at_contact and contact else score.landed,
        "outcome": _outcome(simulation),
        "touchdown_error_m": contact.error_m if contact else None,
        "touchdown_vertical_mps": contact.vertical_mps if contact else None,
        "touchdown_horizontal_mps": contact.horizontal_mps if contact else None,
        "yaw_error_deg": math.degrees(contact.yaw_error) if contact else None,
        "time_s": since_sighting(disarm),
        "time_to_touchdown_s": since_sighting(contact.t if contact else None),
        "energy_hj": None if score.energy_j is None else score.energy_j / 100.0,
        "pad_velocity_error_mps": simulation.recording.pad_velocity_error_mps,
        "nis_ratio": _nis_ratio(simulation),
        "refused_percent": _refused_percent(simulation),
        "off_centre_px_p95": _percentile(simulation.recording.off_centre_px, 0.95),
        "gimbal_error_px_p95": _percentile(simulation.recording.gimbal_errors_px, 0.95),
        "aborts": lander.aborts,
        "phases": _phases(simulation),
        "rules_broken": [
            f"{rule} (at {t - began:.2f} s)" for rule, t in simulation.rules.broken.items()
        ],
        "simulated_s": flown_s,
        "frames_per_s": simulation.recording.frames / flown_s,
        "faults": dict(simulation.daemon.faults),
    }


def _outcome(simulation: "Simulation") -> str:
    lander = simulation.daemon.lander
    if lander.outcome is not None:
        return lander.outcome
    if simulation.ends_at_contact and simulation.score.contact is not None:
        return "touched down"
    if simulation.timed_out:
        flown_s = simulation.world.t - simulation.began
        return f"not landed in {flown_s:.0f} s: {lander.phase.value}, {lander.reason}"
    return lander.reason


def _nis_ratio(simulation: "Simulation") -> float | None:
    """Return the mean NIS over its expectation: 1 if the filter is as sure as it may be.

    Refused sightings count, or a narrow gate would make any filter look right; but none counts for
    more than the gate, or one false alarm would outweigh a flight.
    """
    gate = _gate(simulation)
    capped = [min(nis, gate) for nis in simulation.recording.nis]
    return sum(capped) / len(capped) / NIS_EXPECTED if capped else None


def _refused_percent(simulation: "Simulation") -> float | None:
    nis = simulation.recording.nis
    return 100.0 * sum(n > _gate(simulation) for n in nis) / len(nis) if nis else None


def _gate(simulation: "Simulation") -> float:
    return float(simulation.config.estimation.gate_sigma**2)


def _percentile(values: list[float], share: float) -> float | None:
    return sorted(values)[math.ceil(share * len(values)) - 1] if values else None


def _phases(simulation: "Simulation") -> list[dict[str, Any]]:
    changes = simulation.recording.phases
    ends = [t for t, _ in changes[1:]] + [simulation.world.t]
    began = simulation.began
    return [
        {"name": c.phase.value, "reason": c.reason, "start": t - began, "end": end - began}
        for (t, c), end in zip(changes, ends, strict=True)
    ]


def trace_of(simulation: "Simulation", result: dict[str, Any]) -> Trace:
    """Return the drawing of a flight."""
    landed = "landed" if result["landed"] else "did not land"
    error = result["touchdown_error_m"]
    trace = Trace(
        f"landerd sim {result['scenario']}, seed {result['seed']}: {landed}"
        + (f", {error:.2f} m from the landing point" if error is not None else ""),
        simulation.recording.samples,
    )
    views = simulation.recording.views
    wanted = [p for p in (Phase.NOT_LANDING, Phase.DESCENT, Phase.LANDED) if p in views]
    for phase in wanted or list(views)[:3]:
        t, frame, sightings = views[phase]
        image = draw(frame.image, sightings, simulation.camera_model, simulation.layout)
        trace.views.append((f"{t:.1f} s, {phase.value}", np.asarray(image)))
    return trace
