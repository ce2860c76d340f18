"""A real driver in the whole daemon, in the simulator: its bytes keep the camera on the pad."""

import asyncio
import math

import pytest

from hw.sim.gimbals.byte_model import ByteModel
from landerd.messages import Reference
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, fly


@pytest.mark.parametrize(
    ("driver", "reference"),
    [("siyi", Reference.HORIZON), ("mavlink", Reference.HORIZON), ("servo_sysfs", Reference.BODY)],
)
def test_finds_the_pad_and_stays_on_it(driver: str, reference: Reference) -> None:
    simulation = fly(longest_s=5.0, overrides=[*ABOVE, f"gimbal.driver={driver}"])
    assert simulation.world.gimbal.reference is reference
    assert not simulation.rules.broken
    assert not simulation.daemon.faults
    assert len(simulation.recording.off_centre_px) > 50
    assert simulation.daemon.lander.aborts == 0
    # The estimate is made with the angles that the driver reports.
    assert simulation.daemon.lander.relative_state(simulation.world.t) is not None


def test_a_gimbal_that_falls_silent_is_not_flown_on_and_comes_back() -> None:
    seen: list[float] = []

    async def script(simulation: Simulation) -> None:
        await asyncio.sleep(3.0)
        assert isinstance(simulation.gimbal_model, ByteModel)
        simulation.gimbal_model.silent = True
        await asyncio.sleep(1.9)  # its angles are stale after 0.7 s, and it was descending
        seen.append(math.hypot(*simulation.world.vehicle.velocity))
        simulation.gimbal_model.silent = False

    overrides = [*ABOVE, "gimbal.driver=storm32"]
    simulation = fly(script, longest_s=7.0, overrides=overrides)
    assert simulation.daemon.faults["gimbal lost"] >= 1
    assert seen[0] < 0.15  # it hovers
    assert not simulation.rules.broken
    assert any("gimbal" in c.reason for _, c in simulation.recording.phases)
    assert simulation.daemon.lander.phase.value != "NOT_LANDING"
