"""How fast a vehicle may sink whose companion computer may die at any moment (design rule 2)."""

import math

# At the ground, m/s; the rule allows 0.5. The rest is for what is not known of height and heave.
TOUCHES_AT_MPS = 0.42
LATE_S = 0.1  # of the autopilot's answer, which bench/step_response.py measures
LEAD_S = 0.3  # it is looked so far ahead: the limits let no order follow the height at once


def safe_sink_rate(height: float, sink_rate: float, timeout_s: float, deceleration: float) -> float:
    """Return the fastest sinking that the autopilot's own timeout still stops, m/s.

    Without set-points it sinks on for the timeout and is braked then: from v^2 - 2 a (h - v T) =
    u^2. Where it would reach the ground before that, it may sink at u.

    Args:
        height: h, over the pad, m.
        sink_rate: that it has, m/s.
        timeout_s: T, after the last set-point.
        deceleration: a, of the autopilot, m/s^2.
    """
    a, t = deceleration, timeout_s + LATE_S
    ahead = max(0.0, height - LEAD_S * max(0.0, sink_rate))
    fastest = math.sqrt(a * a * t * t + 2.0 * a * ahead + TOUCHES_AT_MPS**2) - a * t
    return max(TOUCHES_AT_MPS, fastest)


def unstopped_height(timeout_s: float, deceleration: float) -> float:
    """Return the height below which the autopilot's own timeout stops it on the ground only, m.

    Higher up the safe sink rate lets it be stopped in the air; from here down it sinks at
    TOUCHES_AT_MPS, u: u T + u^2 / (2 a).

    Args:
        timeout_s: T, after the last set-point.
        deceleration: a, of the autopilot, m/s^2.
    """
    u = TOUCHES_AT_MPS
    return u * (timeout_s + LATE_S) + u * u / (2.0 * deceleration)
