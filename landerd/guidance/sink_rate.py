"""How fast a vehicle may descend if its companion computer may die at any moment (rule 2)."""

import math

# Sink rate at the ground, m/s. The rule allows 0.5; the rest is for errors of height and heave.
TOUCHES_AT_MPS = 0.42
LATE_S = 0.1  # delay of the autopilot's answer, measured by bench/step_response.py
LEAD_S = 0.3  # the height is extrapolated by this: the limits delay the order that follows it


def safe_sink_rate(height: float, sink_rate: float, timeout_s: float, deceleration: float) -> float:
    """Return the largest sink rate v from which the autopilot's own timeout brakes in time, m/s.

    Without set-points the vehicle descends on for the timeout and is braked then, to u =
    TOUCHES_AT_MPS at the ground: v^2 - 2 a (h - v T) = u^2. Where it would reach the ground before
    the timeout, u.

    Args:
        height: h, over the pad, m.
        sink_rate: the present one, m/s.
        timeout_s: T, after the last set-point, s; LATE_S is added.
        deceleration: a, of the autopilot, m/s^2.
    """
    a, t = deceleration, timeout_s + LATE_S
    ahead = max(0.0, height - LEAD_S * max(0.0, sink_rate))
    fastest = math.sqrt(a * a * t * t + 2.0 * a * ahead + TOUCHES_AT_MPS**2) - a * t
    return max(TOUCHES_AT_MPS, fastest)


def unstopped_height(timeout_s: float, deceleration: float) -> float:
    """Return the height below which the autopilot's own timeout cannot stop it in the air, m.

    There the safe sink rate is u = TOUCHES_AT_MPS, and the height that the stop takes is
    u T + u^2 / (2 a).

    Args:
        timeout_s: T, after the last set-point, s; LATE_S is added.
        deceleration: a, of the autopilot, m/s^2.
    """
    u = TOUCHES_AT_MPS
    return u * (timeout_s + LATE_S) + u * u / (2.0 * deceleration)
