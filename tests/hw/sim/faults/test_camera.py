"""Faults of the camera that overlap."""

from types import SimpleNamespace
from typing import cast

from hw.sim.faults.bench import Bench
from hw.sim.faults.camera import FAULTS
from hw.sim.picture.camera import CameraFaults


def test_the_end_of_one_fault_is_not_the_end_of_another_that_spoils_pictures_too() -> None:
    faults = CameraFaults()
    bench = cast(Bench, SimpleNamespace(camera=SimpleNamespace(faults=faults)))
    black, half = FAULTS["pictures-black"](bench, 1.0), FAULTS["pictures-half"](bench, 1.0)
    half.__enter__()
    black.__enter__()
    assert faults.hides_pad
    black.__exit__(None, None, None)
    assert faults.spoil is not None
    assert not faults.hides_pad
    half.__exit__(None, None, None)
    assert faults.spoil is None
