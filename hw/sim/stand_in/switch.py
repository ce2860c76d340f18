"""The pilot's gate switch, and a pilot who moves it when landerd asks for it."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

from hw.autopilots.arducopter import Mode

OVERRIDE_S = 0.5  # an override is said again: ArduPilot forgets it after 3 s
HIGH_US, _LOW_US = 1900, 1100  # the switch's ends
_REACTS_S = 1.0  # from a line on the screen to a hand that moves, and to the next move
_LOOKS_S = 0.2
_TRIES = 3  # so often he lets landerd try again
_TOLD = ("take over", "low, then high")  # what asks him for the switch
_OVER = "told to stop"  # landerd ends: he flies by hand


class Pilot(Protocol):
    """What a pilot has besides the switch."""

    def select(self, mode: Mode) -> None:
        """Select a mode of the autopilot."""

    def lose_radio(self) -> None:
        """Switch the transmitter off."""

    def restore_radio(self) -> None:
        """Switch the transmitter on again."""


class GateSwitch:
    """The switch, by the radio, or where that has none, by a ground station's override.

    Attributes:
        stuck: it stays as it is, whatever the pilot does.
    """

    def __init__(self, put: Callable[[int], None], *, fades: bool) -> None:
        """Put brings the channel to a pulse width (us); fades: and for a few seconds only."""
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
        """Say an override again and again, for ever."""
        while self._fades:
            self._put(self._us)
            await asyncio.sleep(OVERRIDE_S)


class ObedientPilot:
    """Lowers and raises the switch where landerd asks for it, and selects GUIDED again."""

    def __init__(
        self, switch: GateSwitch, pilot: Pilot, screen: Callable[[], Sequence[str]]
    ) -> None:
        """Screen returns all lines of landerd's that he has been shown."""
        self._switch = switch
        self._pilot = pilot
        self._screen = screen
        self._read = 0

    async def run(self) -> None:
        """Watch the screen for ever."""
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
