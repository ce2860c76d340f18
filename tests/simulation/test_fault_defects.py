"""Faults with which landerd once broke a rule, reduced to the smallest; the defects are mended."""

import asyncio

import pytest

from landerd.messages import Command, Input, Tick
from landerd.runtime.clock import run_virtual
from landerd.runtime.observer import Observer
from landerd.simulation.flight import Simulation
from tests.simulated import MODELLED, configured, fly

pytestmark = pytest.mark.long

START = (
    "sim.start.position_m=[-2.5, 1.0]",
    "sim.start.altitude_m=4.0",
    "sim.start.spread_m=0.5",
    "aim.idle_pitch_deg=-60.0",
    MODELLED,
    "sim.pilot=obeys",
)


def broken(simulation: Simulation) -> list[str]:
    found = {**simulation.rules.broken, **simulation.monitor.found}
    return [rule for rule, t in found.items() if not simulation.faults.excuses(rule, t)]


MENDED = [
    pytest.param(
        "{fault: landed-false, at: {height_m: 0.21}, for_s: 2.95, severity: 0.24}",
        0.0,
        3,
        id="a false ON_GROUND after commit was believed in the air, and landerd asked to disarm",
    ),
    pytest.param(
        "{fault: autopilot-restarts, at: {phase: LANDED, after_s: 0.64}, severity: 0.77}",
        1.0,
        3,
        id="on the pad, after a restart of the autopilot: it climbed where it stood",
    ),
    pytest.param(
        "{fault: loop-stalls, at: {phase: LANDED, after_s: 0.39}, severity: 0.21}",
        2.0,
        2,
        id="contact during a stall on a moving pad: it climbed away, and no descent was ordered",
    ),
    pytest.param(
        "{fault: switch-low, at: {height_m: 0}, for_s: 5, severity: 0.5}",
        2.0,
        1,
        id="released on a moving pad before contact was noticed: it was stopped as it lifted off",
    ),
    pytest.param(
        "{fault: heartbeat-disarmed, at: {phase: LANDED, after_s: 0.9}, for_s: 1.2, severity: 0.5}",
        0.0,
        1,
        id="a false word of being disarmed just after contact was told as a landing",
    ),
    pytest.param(
        "{fault: core-raises, at: {height_m: 0.05}}",
        5.0,
        2,
        id="the core failed just over a fast pad: stopped after 0.5 s of climbing, it tipped over",
    ),
    pytest.param(
        "{fault: velocity-spikes, at: {height_m: 0}, for_s: 2, severity: 0.9}",
        2.0,
        2,
        id="spikes of the velocity: sightings were refused, and it climbed where it stood",
    ),
    pytest.param(
        "{fault: position-biased, at: {height_m: 0.35}, for_s: 1, severity: 0.9}",
        0.0,
        1,
        id="velocities 1.8 m/s off: it jerked over the pad as if that had gone off",
    ),
]


async def until_its_end(simulation: Simulation) -> None:
    """Fly on for a while after the fault: longer than a rule took to be broken."""
    while simulation.faults.happened[0].began is None:
        await asyncio.sleep(0.1)
    await asyncio.sleep(8.0)
    simulation.over = True


@pytest.mark.parametrize(("fault", "speed_mps", "seed"), MENDED)
def test_defects_found_by_faults_and_mended_break_no_rule_any_more(
    fault: str, speed_mps: float, seed: int
) -> None:
    settings = [*START, f"sim.faults=[{fault}]", f"sim.pad.speed_mps={speed_mps}"]
    simulation = fly(until_its_end, overrides=settings, longest_s=25.0, seed=seed)
    assert simulation.faults.happened[0].began is not None
    assert broken(simulation) == []


# A pad of 1 m/s against the wind: the vehicle leans by 25 degrees as it touches.
AGAINST_WIND = (MODELLED, "sim.wind.speed_mps=8", "sim.pad.speed_mps=1", "sim.start.altitude_m=3.5")


def test_a_pad_that_speeds_up_before_the_touch_is_gone_with_as_it_is_seen_to_drive() -> None:
    fault = "sim.faults=[{fault: pad-starts, at: {height_m: 0.19}, severity: 0.2}]"
    settings = [*AGAINST_WIND, "sim.start.position_m=[-3.0, 1.0]", fault]
    simulation = fly(overrides=settings, longest_s=25.0, seed=4)
    assert simulation.daemon.lander.outcome == "landed_off_pad"  # it slides off within 0.5 s
    assert broken(simulation) == []


def test_a_vehicle_that_stood_there_while_nothing_could_be_sent_does_not_tip_over() -> None:
    fault = "sim.faults=[{fault: sending-raises, at: {height_m: 0.25}, for_s: 2.4}]"
    settings = [*START, *AGAINST_WIND[1:3], fault]
    simulation = fly(overrides=settings, longest_s=25.0, seed=2)
    assert simulation.score.landed
    assert simulation.daemon.lander.outcome == "landed"
    assert broken(simulation) == []


def test_a_vehicle_far_behind_its_pad_when_it_may_fly_again_climbs_within_the_limits() -> None:
    """Stopped 0.2 m up while it was latched, it took the pad 5 m ahead for one below its feet."""
    faults = (
        "{fault: clock-back, at: {height_m: 0.31}, severity: 0.30}",
        "{fault: gimbal-frozen, at: {height_m: 0.44}, for_s: 1.56, severity: 0.18}",
    )
    settings = [
        MODELLED,
        "sim.pilot=obeys",
        "sim.pad.speed_mps=5.0",
        f"sim.faults=[{', '.join(faults)}]",
    ]
    simulation = fly(overrides=settings, longest_s=18.0, seed=3035)
    assert "climbing again" in " ".join(text for _, text in simulation.rules.texts)
    assert broken(simulation) == []


@pytest.mark.parametrize("height_m", [2.5, 2.9])
def test_messages_that_arrived_during_a_stall_are_read_before_the_next_decision(
    height_m: float,
) -> None:
    said: list[str] = []

    class Reasons(Observer):
        def on_step(self, now: float, message: Input, commands: list[Command]) -> None:
            if isinstance(message, Tick):
                said.append(simulation.daemon.lander.reason)

    stalls = f"sim.faults=[{{fault: loop-stalls, at: {{height_m: {height_m}}}, severity: 0.09}}]"
    simulation = Simulation(configured([*START, stalls]), 2, observers=(Reasons(),))
    run_virtual(simulation.run(longest_s=8.0))
    assert simulation.daemon.monitor.longest_s > 0.3
    assert [reason for reason in said if "attitude is stale" in reason] == []
