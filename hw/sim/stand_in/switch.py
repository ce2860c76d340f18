"""The pilot's gate switch, and a pilot who moves it when landerd asks for it."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

from hw.autopilots.arducopter import Mode

OVERRIDE_S = 0.5  # interval at which an override is repeated: ArduPilot drops it after 3 s
HIGH_US, _LOW_US = 1900, 1100  # pulse widths at the switch's ends
_REACTS_S = 1.0  # the pilot's delay from a line on the screen to a move, and between two moves
_LOOKS_S = 0.2
_TRIES = 3  # how many times the pilot lets landerd try again
_TOLD = ("take over", "low, then high")  # parts of lines that ask the pilot to move the switch
_OVER = "told to stop"  # part of the line with which landerd ends: the pilot flies by hand


class Pilot(Protocol):
    """The pilot's controls besides the switch."""

    def select(self, mode: Mode) -> None:
        """Select a mode of the autopilot."""

    def lose_radio(self) -> None:
        """Switch the transmitter off."""

    def restore_radio(self) -> None:
        """Switch the transmitter on again."""


class GateSwitch:
    """The pilot's switch on the radio, or, if the radio has none, a ground station's override.

    Attributes:
        stuck: while set, it does not move, whatever the pilot does.
    """

    def __init__(self, put: Callable[[int], None], *, fades: bool) -> None:
        """Make one; put: sets the channel's pulse width, us; fades: it lasts only some seconds."""
        self.stuck = False
        self._put = put
        self._fades = fades
        self._us = _LOW_US

    def set(self, *, high: bool) -> None:
        """Move it to one of its ends."""
        self.move(HIGH_US if high else _LOW_US)

    def move(self, us: int) -> None:
        """Move it to where its channel has this pulse width, us."""
        if self.stuck:
            return
        self._us = us
        self._put(us)

    async def run(self) -> None:
        """Repeat an override until cancelled."""
        while self._fades:
            self._put(self._us)
            await asyncio.sleep(OVERRIDE_S)


class ObedientPilot:
    """Lowers and raises the switch when landerd asks for it, and selects GUIDED again."""

    def __init__(
        self, switch: GateSwitch, pilot: Pilot, screen: Callable[[], Sequence[str]]
    ) -> None:
        """Make one; screen: returns all lines of landerd's shown to the pilot so far."""
        self._switch = switch
        self._pilot = pilot
        self._screen = screen
        self._read = 0

    async def run(self) -> None:
        """Watch the screen and react, _TRIES times."""
        for _ in range(_TRIES):
            while not self._asked():
                await asyncio.sleep(_LOOKS_S)
            await asyncio.sleep(_REACTS_S)
            self._switch.set(high=False)
            await asyncio.sleep(_REACTS_S)
            self._pilot.select(Mode.GUIDED)
            self._switch.set(high=True)
            self._read = len(self._screen())

    def _asked(self) -> bool:
        """Tell whether landerd has asked for the switch since it was moved."""
        screen = self._screen()
        lines, self._read = screen[self._read :], len(screen)
        asks = any(words in line for line in lines for words in _TOLD)
        return asks and not any(_OVER in line for line in lines)
