"""Compares the simulated vehicle's step responses to those measured on ArduCopter 4.5.7 in SITL.

Run as `python bench/step_response.py`; it exits with code 1 if a value differs by more than 5 % of
the step.
"""

import math

from hw.sim.physics.response import (
    STEP_S,
    HorizontalResponse,
    MeasuredYawResponse,
    VerticalResponse,
)

# Times after the order at which velocities are compared.
TIMES_S = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.4, 2.0, 3.0)
# Axis; velocity before and order, m/s or rad/s; measured velocity over the step at each time.
MEASURED: dict[str, tuple[str, float, float, tuple[float, ...]]] = {
    "forward 1 m/s": (
        "forward",
        0.0,
        1.0,
        (-0.014, 0.014, 0.088, 0.215, 0.365, 0.501, 0.692, 0.801, 0.905, 0.951, 0.982),
    ),
    "stop from 1 m/s": (
        "forward",
        1.0,
        0.0,
        (0.985, 0.956, 0.879, 0.750, 0.601, 0.465, 0.276, 0.167, 0.064, 0.017, -0.010),
    ),
    "forward 3 m/s": (
        "forward",
        0.0,
        3.0,
        (-0.004, 0.006, 0.032, 0.077, 0.140, 0.221, 0.403, 0.580, 0.824, 0.933, 0.981),
    ),
    "down 0.5 m/s": (
        "down",
        0.0,
        0.5,
        (0.015, 0.097, 0.253, 0.440, 0.632, 0.786, 0.983, 1.073, 1.086, 1.009, 0.976),
    ),
    "stop from 0.5 m/s down": (
        "down",
        0.5,
        0.0,
        (0.961, 0.878, 0.722, 0.535, 0.344, 0.191, -0.005, -0.096, -0.110, -0.033, 0.002),
    ),
    "down 0.3 m/s": (
        "down",
        0.0,
        0.3,
        (0.011, 0.148, 0.388, 0.597, 0.759, 0.881, 1.028, 1.087, 1.071, 0.996, 0.969),
    ),
    "yaw rate 30 deg/s": (
        "yaw",
        0.0,
        math.radians(30.0),
        (0.041, 0.345, 0.814, 1.216, 1.468, 1.545, 1.318, 0.971, 0.874, 1.049, 1.008),
    ),
    "stop from 30 deg/s": (
        "yaw",
        math.radians(30.0),
        0.0,
        (0.962, 0.662, 0.199, -0.209, -0.464, -0.540, -0.316, 0.030, 0.128, -0.048, -0.005),
    ),
}
TOLERANCE = 0.05  # largest difference, over the step


def answer(axis: str, start: float, order: float) -> list[float]:
    """Return the simulated velocity over the step at each of TIMES_S after an order.

    Args:
        axis: forward, down or yaw.
        start: velocity before the order, m/s or rad/s.
        order: the ordered velocity.
    """
    values: list[float] = []
    step = abs(order - start)
    if axis == "forward":
        horizontal = HorizontalResponse()
        horizontal.settle(start, 0.0)
        for _ in range(round(TIMES_S[-1] / STEP_S)):
            horizontal.step(order, 0.0)
            values.append(horizontal.vn / step)
    elif axis == "down":
        vertical = VerticalResponse()
        vertical.settle(start)
        for _ in range(round(TIMES_S[-1] / STEP_S)):
            vertical.step(order)
            values.append(vertical.v / step)
    else:
        yaw = MeasuredYawResponse()
        yaw.settle(start)
        for _ in range(round(TIMES_S[-1] / STEP_S)):
            yaw.step(order)
            values.append(yaw.rate / step)
    return [values[round(t / STEP_S) - 1] for t in TIMES_S]


def main() -> int:
    """Print the comparison; return the exit code."""
    worst = 0.0
    for name, (axis, start, order, measured) in MEASURED.items():
        ours = answer(axis, start, order)
        errors = [a - b for a, b in zip(ours, measured, strict=True)]
        largest = max(abs(e) for e in errors)
        worst = max(worst, largest)
        print(f"{name}: largest difference {100 * largest:.1f} % of the step")
        print("  t s     ", *(f"{t:7.1f}" for t in TIMES_S))
        print("  measured", *(f"{v:7.3f}" for v in measured))
        print("  ours    ", *(f"{v:7.3f}" for v in ours))
    print(f"largest of all: {100 * worst:.1f} % (allowed {100 * TOLERANCE:.0f} %)")
    return 0 if worst <= TOLERANCE else 1


if __name__ == "__main__":
    raise SystemExit(main())
