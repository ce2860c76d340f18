"""A vehicle that swings over the pad is told from one that closes, stands off or is shaken."""

import math
import random
from itertools import pairwise

from landerd.guidance.swing import Swing
from tests.simulated import ABOVE, fly

GAIN, DT = 2.5, 0.025


def swings(error_of: list[tuple[float, float]]) -> bool:
    """Tell whether any window of north and east errors, DT apart, counts as a swing."""
    swing, seen = Swing(), False
    for (n0, e0), (n1, e1) in pairwise(error_of):
        rate = ((n1 - n0) / DT, (e1 - e0) / DT, 0.0)
        seen |= swing.step((n1, e1, 2.0), rate, GAIN, DT)
    return seen


def times(seconds: float) -> list[float]:
    return [i * DT for i in range(round(seconds / DT))]


def test_a_circle_about_the_pad_is_a_swing_and_a_line_through_it_too() -> None:
    assert swings([(0.2 * math.cos(3.8 * t), 0.2 * math.sin(3.8 * t)) for t in times(8.0)])
    assert swings([(0.2 * math.cos(3.8 * t), 0.0) for t in times(8.0)])


def test_an_error_that_closes_stays_or_is_small_is_not_taken_for_a_swing() -> None:
    rng = random.Random(3)
    assert not swings([(0.9 * math.exp(-GAIN * t), 0.1) for t in times(8.0)])
    assert not swings([(0.3, -0.2) for _ in times(8.0)])
    assert not swings([(0.03 * math.cos(3.8 * t), 0.03 * math.sin(3.8 * t)) for t in times(8.0)])
    assert not swings([(0.2 + rng.gauss(0.0, 0.002), 0.0) for _ in times(8.0)])


def test_motion_on_the_way_to_the_pad_is_not_taken_for_a_swing() -> None:
    assert not swings([(3.0 * math.cos(3.8 * t), 3.0 * math.sin(3.8 * t)) for t in times(8.0)])


def test_a_vehicle_slower_than_configured_is_calmed_and_lands() -> None:
    """Without reduced gains it circled for ever, and was handed back."""
    slow = ("delay_s=0.15", "bandwidth=0.7", "jerk_mps3=18", "acceleration_mps2=3")
    overrides = [*ABOVE, *(f"sim.response.{key}" for key in slow)]
    simulation = fly(overrides=overrides, longest_s=40.0)
    assert simulation.daemon.lander.outcome == "landed"
    assert not simulation.rules.broken
