"""Compares flights with modelled sight to those of the same seeds with pictures, and CPU times.

    python -m bench.sight_flights                                # the table of a few
    python -m bench.sight_flights --seeds 200 --keep pairs.jsonl # goes on where it was stopped

Printed are the means with pictures, with modelled sight, and of the differences in pairs (modelled
minus pictures), with their 95 % intervals.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.simulation.flight import simulate

SIGHTS = ("pictures", "modelled")
FIGURES = ("landed", "time_s", "touchdown_error_m", "nis_ratio", "refused_percent", "aborts")
NORMAL_95 = 1.96  # half width of the 95 % interval of a normal distribution, sigmas


def flown(scenario: str, seed: int, sight: str) -> dict[str, Any]:
    """Fly once; return the figures, and the CPU time in `cpu_s`."""
    overlay = config_dir() / "scenarios" / f"{scenario}.yaml"
    loaded = read_configuration(
        config_dir() / "default.yaml",
        overlays=[overlay],
        overrides=[f"sim.sight={sight}"],
        seed=seed,
    )
    start = time.process_time()
    result = simulate(loaded, scenario, seed)
    row = {"scenario": scenario, "seed": seed, "sight": sight, "broken": result["rules_broken"]}
    row |= {name: result[name] for name in (*FIGURES, "simulated_s")}
    return row | {"cpu_s": time.process_time() - start}


def mean(values: list[float]) -> str:
    """Return the text of a mean with its 95 % interval."""
    if not values:
        return "-"
    spread = NORMAL_95 * float(np.std(values, ddof=1)) / math.sqrt(len(values)) if values[1:] else 0
    return f"{np.mean(values):.4g} +- {spread:.2g}"


def show(scenario: str, rows: dict[tuple[str, int, str], dict[str, Any]], seeds: range) -> None:
    """Print what the pairs of a scenario show.

    Args:
        scenario: its name.
        rows: of flights, by scenario, seed and sight.
        seeds: to be compared.
    """
    pairs = [tuple(rows[scenario, seed, sight] for sight in SIGHTS) for seed in seeds]
    broken = [sum(bool(r["broken"]) for r in side) for side in zip(*pairs, strict=True)]
    print(f"{scenario}, {len(pairs)} pairs; rules broken in {broken[0]} and {broken[1]}")
    for name in FIGURES:
        known = [(p[name], m[name]) for p, m in pairs if None not in (p[name], m[name])]
        left, right = ([float(pair[i]) for pair in known] for i in (0, 1))
        difference = [m - p for p, m in zip(left, right, strict=True)]
        print(f"  {name:18} {mean(left):>20} {mean(right):>20}   difference {mean(difference)}")
    slow, fast = (
        sum(r["simulated_s"] for r in side) / sum(r["cpu_s"] for r in side)
        for side in zip(*pairs, strict=True)
    )
    print(f"  {'times real time':18} {slow:20.1f} {fast:20.1f}   ratio {fast / slow:.1f}")


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=["stationary", "moving-5", "wind-8"])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--keep", type=Path, metavar="FILE")
    args = parser.parse_args()
    rows: dict[tuple[str, int, str], dict[str, Any]] = {}
    if args.keep is not None and args.keep.exists():
        for line in args.keep.read_text().splitlines():
            row = json.loads(line)
            rows[row["scenario"], row["seed"], row["sight"]] = row
    seeds = range(1, args.seeds + 1)
    for scenario in args.scenarios:
        for key in ((scenario, seed, sight) for seed in seeds for sight in SIGHTS):
            if key not in rows:
                rows[key] = flown(*key)
                if args.keep is not None:
                    with args.keep.open("a") as file:
                        file.write(json.dumps(rows[key]) + "\n")
        show(scenario, rows, seeds)


if __name__ == "__main__":
    main()
