"""Faults of one message that overlap."""

from types import SimpleNamespace
from typing import cast

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.sim.faults.bench import Bench
from hw.sim.faults.telemetry import FAULTS
from hw.sim.tampering import Tampering


class Autopilot:
    """A bench with nothing but the autopilot's positions."""

    def __init__(self) -> None:
        self.tampering = Tampering()
        rng = SimpleNamespace(choice=lambda signs: signs[-1])
        self.bench = cast(
            Bench,
            SimpleNamespace(
                vehicle=SimpleNamespace(tampering=self.tampering),
                rng=rng,
                between=lambda least, most, severity: least + severity * (most - least),
            ),
        )
        self._ms = 0

    def position(self) -> Message | None:
        """Return what becomes of a position at local zero, with a velocity of zero."""
        sent: list[Message] = []
        self._ms += 20
        zero = mavlink.MAVLink_local_position_ned_message(self._ms, *(0.0,) * 6)
        self.tampering.pass_on(zero, sent.append)
        return sent[0] if sent else None


def test_the_first_of_two_overlapping_faults_may_end_first() -> None:
    """Once, the second of two faults of a message ended with the first."""
    autopilot = Autopilot()
    biased = FAULTS["position-biased"](autopilot.bench, 0.5)
    lost = FAULTS["position-lost"](autopilot.bench, 0.5)
    biased.__enter__()
    lost.__enter__()
    biased.__exit__(None, None, None)
    assert autopilot.position() is None
    lost.__exit__(None, None, None)
    found = autopilot.position()
    assert found is not None
    assert (found.vx, found.vy, found.vz) == (0.0, 0.0, 0.0)


def test_a_permanent_reset_stays_when_another_fault_ends() -> None:
    autopilot = Autopilot()
    FAULTS["height-reset"](autopilot.bench, 0.5).__enter__()
    with FAULTS["position-biased"](autopilot.bench, 0.5):
        found = autopilot.position()
        assert found is not None
        assert (found.z, found.vz) == (pytest.approx(1.05), pytest.approx(1.1))
    found = autopilot.position()
    assert found is not None
    assert (found.z, found.vz) == (pytest.approx(1.05), 0.0)
