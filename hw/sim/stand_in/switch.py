"""The pilot's hand on the switch that lets landerd fly, and a pilot who does as he is told."""

import asyncio

from hw.autopilots.arducopter import Mode
from hw.sim.stand_in.autopilot import SimAutopilot
from hw.sim.stand_in.ground_station import GroundStation

OVERRIDE_S = 0.5  # an override is said again: ArduPilot forgets it after 3 s
HIGH_US, _LOW_US = 1900, 1100  # the switch's ends
_REACTS_S = 1.0  # from a line on the screen to a hand that moves, and to the next move
_LOOKS_S = 0.2
_TRIES = 3  # so often he lets landerd try again
_LANDERD = 191  # its component
_TOLD = ("take over", "low, then high")  # what asks him for the switch
_OVER = "told to stop"  # landerd ends: he flies by hand


class GateSwitch:
    """The switch, by the radio, or where that has none, by a ground station's override.

    Attributes:
        stuck: it stays as it is, whatever the pilot does.
    """

    def __init__(self, autopilot: SimAutopilot, channel: int, *, by_radio: bool) -> None:
        """Channel: counted from 1."""
        self.stuck = False
        self._autopilot = autopilot
        self._channel = channel
        self._by_radio = by_radio
        self._us = _LOW_US

    def set(self, *, high: bool) -> None:
        """Move it to one of its ends."""
        self.move(HIGH_US if high else _LOW_US)

    def move(self, us: int) -> None:
        """Move it to where its channel has this pulse width, us."""
        if self.stuck:
            return
        self._us = us
        if self._by_radio:
            self._autopilot.pilot.set(self._channel, us)
        else:
            self._say()

    async def run(self) -> None:
        """Say an override again and again, for ever."""
        while not self._by_radio:
            self._say()
            await asyncio.sleep(OVERRIDE_S)

    def _say(self) -> None:
        raw = [0xFFFF] * 18
        raw[self._channel - 1] = self._us
        self._autopilot.pilot.override(tuple(raw), asyncio.get_running_loop().time())


class ObedientPilot:
    """Lowers and raises the switch where landerd asks for it, and selects GUIDED again."""

    def __init__(
        self, switch: GateSwitch, autopilot: SimAutopilot, ground_station: GroundStation
    ) -> None:
        self._switch = switch
        self._autopilot = autopilot
        self._station = ground_station
        self._read = 0

    async def run(self) -> None:
        """Watch the screen for ever."""
        for _ in range(_TRIES):
            while not self._asked():
                await asyncio.sleep(_LOOKS_S)
            await asyncio.sleep(_REACTS_S)
            self._switch.set(high=False)
            await asyncio.sleep(_REACTS_S)
            self._autopilot.copter.set_mode(Mode.GUIDED)
            self._switch.set(high=True)
            self._read = len(self._station.texts)

    def _asked(self) -> bool:
        """Tell whether landerd has asked for the switch since it was moved."""
        lines = [t.text for t in self._station.texts[self._read :] if t.component == _LANDERD]
        self._read = len(self._station.texts)
        asks = any(words in line for line in lines for words in _TOLD)
        return asks and not any(_OVER in line for line in lines)
