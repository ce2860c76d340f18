"""Faults of the pad's motion: it still moves as one piece, with the velocity that it states."""

import math
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest

from hw.sim.faults.bench import Bench
from hw.sim.faults.pad import FAULTS
from hw.sim.physics.world import World
from landerd.geometry import norm, scale, sub
from tests.hw.sim.worlds import world

STEP_S = 1e-4
ONSET_S = 1.0


def disturbed(fault: str, severity: float, *, began_s: float = 0.0, **pad: Any) -> World:
    """Return a world whose pad has had the fault since ONSET_S after the world began."""
    moved = world(began_s=began_s, pad=pad)
    moved.advance(began_s + ONSET_S)
    bench = cast(
        Bench,
        SimpleNamespace(world=moved, rng=Random(1), between=lambda a, b, s: a + s * (b - a)),
    )
    FAULTS[fault](bench, severity).__enter__()
    return moved


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("severity", [0.0, 1.0])
@pytest.mark.parametrize("speed", [0.0, 3.0])
@pytest.mark.parametrize("turn", [0.0, 20.0])
def test_the_velocity_of_a_disturbed_pad_is_the_derivative_of_its_position(
    fault: str, severity: float, speed: float, turn: float
) -> None:
    motion = disturbed(fault, severity, speed_mps=speed, turn_rate_deg_s=turn)._motion
    for tenths in range(5, 60):
        t = 0.1 * tenths + 0.0123
        before, after = motion.at(t - STEP_S), motion.at(t + STEP_S)
        moved = scale(sub(after.position, before.position), 0.5 / STEP_S)
        assert norm(sub(moved, motion.at(t).velocity)) < 2e-3
        turned = math.remainder(after.heading - before.heading, 2.0 * math.pi) / (2.0 * STEP_S)
        assert turned == pytest.approx(motion.at(t).turn_rate, abs=2e-3)


@pytest.mark.parametrize("fault", FAULTS)
def test_before_a_fault_the_pad_moves_as_without_it(fault: str) -> None:
    sound = world(pad={"speed_mps": 3.0})
    moved = disturbed(fault, 1.0, speed_mps=3.0)
    assert moved._motion.at(0.9) == sound._motion.at(0.9)
    assert moved._motion.at(4.0) != sound._motion.at(4.0)


@pytest.mark.parametrize("began_s", [0.0, 50.0])  # of the loop's clock: SITL's world begins late
def test_a_pad_that_stops_stands_still(began_s: float) -> None:
    stopped = disturbed("pad-stops", 0.5, began_s=began_s, speed_mps=3.0)
    stopped.advance(began_s + 5.0)
    assert norm(stopped.pad.velocity) == 0.0


def test_a_lifted_pad_rises_with_what_stands_on_it() -> None:
    moved = disturbed("pad-lifted", 1.0)
    assert moved._motion.at(6.0).position[2] == pytest.approx(
        moved._motion.at(0.0).position[2] - 1.0
    )
