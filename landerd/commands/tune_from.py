"""`landerd tune --from`: fits a vehicle's response to orders from flight logs; proposes gains."""

import argparse
from dataclasses import asdict

from landerd.calibration.vehicle import REFERENCE, Fit, ResponseError, fit, stretches
from landerd.campaigns.search import SearchError, minimised
from landerd.campaigns.tuning import DIGITS, overlay, settings_of
from landerd.commands.shared import InputError, print_json, refusing, tell, write_text
from landerd.flightlog.reader import LogError, read_log

# Residual of the velocity (RMS) above which the fit is not to be trusted: wind and the log's noise
# alone leave less.
POOR_FIT_MPS = 0.3


def tune_from(args: argparse.Namespace) -> int:
    """Fit the response, print it and write the gains.

    Returns:
        0, or 1 if the fitted model does not explain the flights.

    Raises:
        InputError: a log cannot be used, or -o cannot be written.
    """
    flights = []
    with refusing(LogError, ResponseError, SearchError):
        for path in args.flights:
            log = read_log(path)
            if log.is_dry:
                raise InputError(
                    f"{path}: of a dry run, whose orders were not flown; expected a flight's log"
                )
            for note in log.notes:
                tell(note)
            flights += stretches(log)
        found = fit(flights, minimised)
    values, world = _proposed(found), _simulated(found)
    if args.json:
        print_json({**asdict(found), "proposed": values, "simulated": world})
    else:
        print("\n".join([*_in_words(found), *(f"  {each}" for each in settings_of(values))]))
    if args.out is not None:
        remarks = [*_in_words(found), "sim.response lets the simulator fly the same vehicle."]
        write_text(args.out, overlay({**values, **world}, remarks))
    if found.rms_mps > POOR_FIT_MPS:
        tell(
            f"{found.rms_mps:.2f} m/s are left unexplained: several vehicles, strong wind, or "
            "a pilot who helped? Do not fly on this"
        )
        return 1
    return 0


def _proposed(found: Fit) -> dict[str, float]:
    """Return the keys for guidance, with values; guidance derives its gains from them.

    Guidance compensates the lag of ArduCopter's shaper and control loops. Any further delay of the
    vehicle becomes lead_s.
    """
    response = found.response
    later = response.delay_s + response.lag_s - REFERENCE.lag_s
    return {
        "autopilot.acceleration_mps2": _rounded(response.acceleration_mps2),
        "autopilot.jerk_mps3": _rounded(response.jerk_mps3),
        "guidance.tracking.lead_s": _rounded(max(0.0, round(later, 2))),
    }


def _simulated(found: Fit) -> dict[str, float]:
    """Return the keys by which the simulated vehicle responds likewise, with values."""
    response = found.response
    return {
        "sim.response.delay_s": _rounded(response.delay_s),
        "sim.response.bandwidth": _rounded(response.omega / REFERENCE.omega),
        "sim.response.acceleration_mps2": _rounded(response.acceleration_mps2),
        "sim.response.jerk_mps3": _rounded(response.jerk_mps3),
    }


def _rounded(value: float) -> float:
    """Return a value rounded to DIGITS significant digits."""
    return float(f"{value:.{DIGITS}g}")


def _in_words(found: Fit) -> list[str]:
    r = found.response
    lines = [
        f"fitted to {found.flown_s:.0f} s of flight, {found.rms_mps:.3f} m/s left unexplained:",
        f"delay {r.delay_s:.2f} s, acceleration {r.acceleration_mps2:.2f} m/s^2, "
        f"jerk {r.jerk_mps3:.1f} m/s^3, control loops of {r.omega:.1f} rad/s (lag {r.lag_s:.2f} s)",
    ]
    if not found.limits_reached:
        lines.append("flown gently: acceleration and jerk may be higher than these")
    return lines
