"""Faults of the pilot that overlap."""

import asyncio
from contextlib import ExitStack
from types import SimpleNamespace
from typing import cast

from hw.autopilots.arducopter import Mode
from hw.sim.faults.bench import Bench
from hw.sim.faults.pilot import FAULTS
from hw.sim.stand_in.switch import GateSwitch
from landerd.runtime.clock import run_virtual

HIGH, LOW = 1900, 1100


class Pilot:
    """Remembers his modes, the last of which is flown, and whether his transmitter is on."""

    def __init__(self) -> None:
        self.modes = [Mode.GUIDED]
        self.has_radio = True

    def flies(self) -> Mode:
        return self.modes[-1]

    def select(self, mode: Mode) -> None:
        self.modes.append(mode)

    def lose_radio(self) -> None:
        self.has_radio = False

    def restore_radio(self) -> None:
        self.has_radio = True


class Aircraft:
    """A bench with nothing but a pilot and his switch."""

    def __init__(self) -> None:
        self.pulses: list[int] = []
        self.pilot = Pilot()
        switch = GateSwitch(self.pulses.append, fades=False)
        self._bench = SimpleNamespace(
            vehicle=SimpleNamespace(switch=switch, pilot=self.pilot),
            between=lambda least, most, severity: least + severity * (most - least),
        )

    def begin(self, fault: str) -> ExitStack:
        """Let a fault begin; closed, it is over."""
        lasts = ExitStack()
        lasts.enter_context(FAULTS[fault](cast(Bench, self._bench), 1.0))
        return lasts


def test_the_switch_stays_low_until_the_last_of_two_lets_it_go() -> None:
    for first_ends_first in (True, False):
        craft = Aircraft()
        lasting = [craft.begin("switch-low"), craft.begin("switch-low")]
        lasting.pop(0 if first_ends_first else 1).close()
        assert craft.pulses[-1] == LOW
        lasting.pop().close()
        assert craft.pulses[-1] == HIGH


def test_a_switch_that_is_held_low_does_not_flap() -> None:
    async def fly() -> None:
        craft = Aircraft()
        flapping = craft.begin("switch-flapping")
        await asyncio.sleep(1.0)
        assert HIGH in craft.pulses
        low = craft.begin("switch-low")
        craft.pulses.clear()
        await asyncio.sleep(1.0)
        flapping.close()
        assert HIGH not in craft.pulses
        low.close()
        assert craft.pulses[-1] == HIGH

    run_virtual(fly())


def test_the_newest_mode_that_lasts_is_flown_and_guided_after_all_of_them() -> None:
    craft = Aircraft()
    loiter, rtl = craft.begin("mode-loiter"), craft.begin("mode-rtl")
    assert craft.pilot.flies() == Mode.RTL
    rtl.close()
    assert craft.pilot.flies() == Mode.LOITER
    again = craft.begin("mode-loiter")
    loiter.close()
    assert craft.pilot.flies() == Mode.LOITER
    again.close()
    assert craft.pilot.flies() == Mode.GUIDED


def test_without_his_radio_the_pilot_selects_nothing() -> None:
    craft = Aircraft()
    loiter, lost = craft.begin("mode-loiter"), craft.begin("rc-lost")
    lost_too = craft.begin("rc-lost")
    craft.pilot.modes.append(Mode.RTL)  # by the autopilot's own decision
    loiter.close()
    lost.close()
    assert (craft.pilot.flies(), craft.pilot.has_radio) == (Mode.RTL, False)
    lost_too.close()
    assert (craft.pilot.flies(), craft.pilot.has_radio) == (Mode.GUIDED, True)
