"""Compares a flight's estimates of the pictures' clock and the lens's direction to the truth.

    python -m bench.sensor_errors                       # a table of a few days of the field
    python -m bench.sensor_errors --first 401 --days 40 --set sim.sight=modelled

The true clock offset is the time by which stamps of pictures are later than those of telemetry: the
camera's own offset, less the delay of the EKF's output, plus half the difference of a TIMESYNC
exchange's times to the autopilot and back. The true direction of the lens is the angle by which it
looks higher and farther right than gimbal and calibration say, for a camera that looks straight
down, as at the end of a landing: errors of mounting, of the gimbal's pitch (bias, and scale over 90
degrees), and of the calibration's principal point. Backlash and jitter are left out.
"""

import argparse
import math
from statistics import median
from typing import Any, NamedTuple

from landerd.analysis.intervals import percentile
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.estimation.pad_filter import SensorErrors
from landerd.runtime.daemon import Daemon
from landerd.simulation.flight import simulate

LOOP_S = 0.00125  # mean time until the autopilot's main loop takes a message
NAMES = ("clock ms", "up deg", "right deg")


class Row(NamedTuple):
    """One flight: estimate, its sigma, and truth of the clock (ms) and of the lens (degrees)."""

    found: tuple[float, float, float]
    sigma: tuple[float, float, float]
    truth: tuple[float, float, float]


def truth(world: dict[str, Any], focal_px: float) -> tuple[float, float, float]:
    """Return the true clock offset, ms, and direction of the lens, up and right, degrees.

    Args:
        world: the result's `world` of a flight.
        focal_px: focal length.
    """
    link = "sim.link.delay_"
    there_s = world[f"{link}up_s"] + LOOP_S + world["sim.autopilot.timesync_delay_s"]
    timesync_s = 0.5 * (there_s - world[f"{link}down_s"])
    clock_s = world["sim.camera.clock_offset_s"] - world["sim.ekf.delay_s"] + timesync_s
    mount, lens = (
        "sim.gimbal.mount.camera_rotation_deg",
        "sim.camera.calibration_error.principal_px",
    )
    pitch_deg = 90.0 * world["sim.gimbal.scale_error"] - world["drawn.gimbal.pitch_bias_deg"]
    up = world[f"{mount}.1"] + pitch_deg + math.degrees(world[f"{lens}.1"] / focal_px)
    return 1e3 * clock_s, up, world[f"{mount}.2"] - math.degrees(world[f"{lens}.0"] / focal_px)


def flown(seed: int, overrides: list[str]) -> tuple[Row, dict[str, Any]]:
    """Fly one day of the field scenario; return its row and result."""
    loaded = read_configuration(
        config_dir() / "default.yaml",
        overlays=[config_dir() / "scenarios" / "field.yaml"],
        overrides=overrides,
        seed=seed,
    )
    daemons: list[Daemon] = []
    result = simulate(loaded, "field", seed, watch=daemons.append)
    e: SensorErrors = daemons[0].lander.sensor_errors
    focal_px = load_camera(loaded.config.camera.calibration).fx
    return (
        Row(
            (1e3 * e.clock_s, math.degrees(e.up), math.degrees(e.right)),
            (1e3 * e.sigma_clock_s, math.degrees(e.sigma_up), math.degrees(e.sigma_right)),
            truth(result["world"], focal_px),
        ),
        result,
    )


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=401)
    parser.add_argument("--days", type=int, default=4)
    parser.add_argument("--set", action="append", default=["sim.sight=modelled"])
    args = parser.parse_args()
    rows = []
    print("| day | " + " | ".join(f"{n}: found | true" for n in NAMES) + " | landed in |")
    print("|---" * 8 + "|")
    for seed in range(args.first, args.first + args.days):
        row, result = flown(seed, args.set)
        rows.append(row)
        cells = [
            f"{f:.{d}f} ± {s:.{d}f} | {t:.{d}f}" for f, s, t, d in zip(*row, (1, 2, 2), strict=True)
        ]
        landed = f"{result['time_s']:.0f} s" if result["landed"] else "no"
        print(f"| {seed} | " + " | ".join(cells) + f" | {landed} |", flush=True)
    for i, name in enumerate(NAMES):
        off = [row.found[i] - row.truth[i] for row in rows]
        inside = sum(abs(e) < 2.0 * row.sigma[i] for e, row in zip(off, rows, strict=True))
        sizes = [abs(e) for e in off]
        print(
            f"{name}: off by {median(sizes):.2f} (median), {percentile(sizes, 95.0):.2f} (95 of "
            f"100), mean {sum(off) / len(off):+.2f}; within 2 sigma {inside} of {len(off)}; "
            f"nothing known: {median(abs(row.truth[i]) for row in rows):.2f}"
        )


if __name__ == "__main__":
    main()
