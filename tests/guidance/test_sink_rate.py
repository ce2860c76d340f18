"""A vehicle whose companion dies, flown on by its autopilot's timeout alone."""

import pytest

from landerd.guidance.sink_rate import (
    LATE_S,
    LEAD_S,
    TOUCHES_AT_MPS,
    safe_sink_rate,
    unstopped_height,
)

STEP_S = 0.001
BRAKES_MPS2 = 1.0


def _dies_at(height: float, timeout_s: float) -> tuple[float, float]:
    """Return height (m) and speed (m/s) at which the vehicle stands, or meets the ground."""
    speed = safe_sink_rate(height, TOUCHES_AT_MPS, timeout_s, BRAKES_MPS2)
    for _ in range(5):  # it looks ahead by the rate that it has
        speed = safe_sink_rate(height, speed, timeout_s, BRAKES_MPS2)
    t = 0.0
    while height > 0.0 and speed > 0.0:
        t += STEP_S
        if t > timeout_s + LATE_S:
            speed -= BRAKES_MPS2 * STEP_S
        height -= speed * STEP_S
    return height, speed


@pytest.mark.parametrize("timeout_s", [0.5, 1.0, 3.0])
def test_should_landerd_die_the_vehicle_stops_in_the_air_or_touches_gently(
    timeout_s: float,
) -> None:
    strikes_m = unstopped_height(timeout_s, BRAKES_MPS2)
    above = [strikes_m + LEAD_S * TOUCHES_AT_MPS + 0.05 * i for i in range(100)]
    below = [strikes_m * share for share in (0.1, 0.4, 0.7, 0.95)]
    assert all(_dies_at(height, timeout_s)[0] > 0.0 for height in above)
    for height in below:
        end, speed = _dies_at(height, timeout_s)
        assert end <= 0.0
        assert speed <= TOUCHES_AT_MPS
