"""Landings that were never flown, for the tests of campaigns; what a pool is handed is here, so
that its processes can import it."""

import os
import time
from typing import Any


def landing(scenario: str = "stationary", seed: int = 1, **changes: Any) -> dict[str, Any]:
    """Return what `landerd sim --json` prints, as far as campaigns look at it."""
    return {
        "scenario": scenario,
        "seed": seed,
        "landed": True,
        "outcome": "landed",
        "touchdown_error_m": 0.02,
        "touchdown_vertical_mps": 0.3,
        "yaw_error_deg": -2.0,
        "time_s": 18.0,
        "time_to_touchdown_s": 16.0,
        "energy_hj": 60.0,
        "pad_velocity_error_mps": 0.1,
        "nis_ratio": 1.1,
        "refused_percent": 0.5,
        "off_centre_px_p95": 40.0,
        "touchdown_horizontal_mps": 0.05,
        "aborts": 0,
        "rules_broken": [],
        "world": {},
        "infeasible": None,
        **changes,
    }


class Misfortune(Exception):
    """The error that a run raises."""


def fly(scenario: str, seed: int) -> dict[str, Any]:
    """Return a landing; "raises" and "dies" fail so with seed 2, "waits" takes a minute."""
    if scenario == "raises" and seed == 2:
        try:
            raise Misfortune("the pad\nis gone")
        except Misfortune as e:
            raise ExceptionGroup("unhandled errors in a TaskGroup", [e]) from None
    if scenario == "dies" and seed == 2:
        os._exit(9)
    if scenario == "waits":
        time.sleep(60.0)
    return landing(scenario, seed)
