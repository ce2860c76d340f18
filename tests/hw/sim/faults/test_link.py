"""Faults of the link that overlap."""

from types import SimpleNamespace
from typing import cast

import pytest

from hw.links.memory import LinkFaults, memory_pair
from hw.sim.faults.bench import Bench
from hw.sim.faults.link import FAULTS
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_virtual


def test_the_first_of_two_overlapping_faults_may_end_first_and_nothing_is_left() -> None:
    """Once, a link that was late and then also lossy stayed late for the rest of the flight."""
    near, far = memory_pair()
    near.faults = sound = LinkFaults(jitter_s=0.01)
    bench = cast(Bench, SimpleNamespace(vehicle=SimpleNamespace(near=near, far=far)))
    late, lossy = FAULTS["link-late"](bench, 0.5), FAULTS["link-lossy"](bench, 0.5)
    dead = FAULTS["link-dead-up"](bench, 0.5)
    late.__enter__()
    lossy.__enter__()
    dead.__enter__()
    assert (near.faults.delay_s, near.faults.drop, near.faults.jitter_s) == (0.21, 1.0, 0.01)
    late.__exit__(None, None, None)
    assert (near.faults.delay_s, far.faults.drop) == (0.0, 0.26)
    dead.__exit__(None, None, None)
    assert near.faults.drop == 0.26
    lossy.__exit__(None, None, None)
    assert near.faults == sound
    assert far.faults.drop == 0.0


def test_a_link_that_is_cut_twice_is_whole_when_both_are_over() -> None:
    async def fly() -> None:
        near, far = memory_pair()
        bench = cast(Bench, SimpleNamespace(vehicle=SimpleNamespace(near=near, far=far)))
        first, second = FAULTS["link-cut"](bench, 0.5), FAULTS["link-cut"](bench, 0.5)
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        with pytest.raises(DeviceLost):
            await near.open()
        second.__exit__(None, None, None)
        await near.open()

    run_virtual(fly())
