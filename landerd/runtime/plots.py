"""Figures for the ground station's plots, by names of at most ten characters."""

import math

from landerd.lander import Lander
from landerd.messages import Phase

PHASES = list(Phase)  # a phase is plotted as its index here


def landing_figures(lander: Lander, now: float) -> dict[str, float]:
    """Return the phase at now (s) and, as far as it is known, where the pad is, m."""
    figures = {"phase": float(PHASES.index(lander.phase))}
    pad = lander.relative_state(now)
    if pad is not None:
        figures |= {"pad_dist": pad.distance, "pad_hgt": pad.height, "pad_sigma": pad.sigma_m}
    return {name: value for name, value in figures.items() if math.isfinite(value)}


def health_figures(lander: Lander) -> dict[str, float]:
    """Return how well sightings and telemetry agree; nothing while the pad is not seen."""
    health, sensors = lander.health, lander.sensor_errors
    if health is None:
        return {}
    return {
        "pad_nis": health.nis,
        "pad_ref_pc": 100.0 * health.refused,
        "pic_age_ms": 1e3 * health.picture_age_s,
        "cam_clk_ms": 1e3 * sensors.clock_s,
        "cam_up_deg": math.degrees(sensors.up),
        "cam_rt_deg": math.degrees(sensors.right),
    }
