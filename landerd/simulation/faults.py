"""Starts and ends the faults of `sim.faults` in a flight, and notes when and where."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hw.sim.fault_options import FAULTS, PHASES, FaultKind, FaultOptions, OnsetOptions
from hw.sim.faults.bench import Bench
from hw.sim.faults.table import EFFECTS
from landerd.messages import Phase

LOOKS_S = 0.01
EXCUSED_S = 3.0  # how long after its end a fault still excuses broken rules
LASTING_S = 6.0  # the same after the onset of a momentary fault: a stall, a restart


def fault_kinds() -> Mapping[str, FaultKind]:
    """Return the kinds of faults by name; for modules that may not import `hw`."""
    return FAULTS


@dataclass
class Happened:
    """One fault as it happened; times since the flight began, s."""

    fault: str
    severity: float
    lasts_s: float | None  # as configured
    lands: bool  # a landing is expected all the same
    began: float | None = None  # None: its onset never came
    ended: float | None = None  # None: it lasted until the end of the flight
    phase: str = ""  # at the onset
    height_m: float | None = None  # at the onset


class Faults:
    """Runs the faults beside the flight.

    Attributes:
        happened: each fault, in the order of the configuration.
    """

    def __init__(
        self,
        options: Sequence[FaultOptions],
        bench: Callable[[int], Bench],
        phase: Callable[[], Phase],
    ) -> None:
        """Make one.

        Args:
            options: the faults to start.
            bench: returns the bench on which a fault, given by its number, acts.
            phase: returns the present phase of the landing.
        """
        self.happened = [
            Happened(each.fault, each.severity, each.lasts_s, FAULTS[each.fault].lands)
            for each in options
        ]
        self._options = options
        self._bench = bench
        self._phase = phase
        self._began = 0.0

    @property
    def lasts(self) -> bool:
        """Whether any fault has begun and is not over."""
        return any(n.began is not None and n.ended is None for n in self.happened)

    async def run(self) -> None:
        """Start and end the faults; to be cancelled with the flight's tasks."""
        self._began = asyncio.get_running_loop().time()
        async with asyncio.TaskGroup() as tasks:
            for number, (fault, note) in enumerate(zip(self._options, self.happened, strict=True)):
                tasks.create_task(self._happen(fault, note, self._bench(number)))

    async def _happen(self, fault: FaultOptions, note: Happened, bench: Bench) -> None:
        loop = asyncio.get_running_loop()
        await self._onset(fault.at, bench)
        note.began = loop.time() - self._began
        note.phase, note.height_m = self._phase().value, bench.world.height
        with EFFECTS[fault.fault](bench, fault.severity):
            if FAULTS[fault.fault].ends:
                await asyncio.sleep(float("inf") if fault.for_s is None else fault.for_s)
        if not FAULTS[fault.fault].stays:
            note.ended = loop.time() - self._began

    async def _onset(self, at: OnsetOptions, bench: Bench) -> None:
        if at.time_s is not None:
            await asyncio.sleep(at.time_s)
        else:
            wanted = _reached(at, self._phase, bench)
            while not wanted():
                await asyncio.sleep(LOOKS_S)
        await asyncio.sleep(at.after_s)

    def excuses(self, finding: str, t: float) -> bool:
        """Tell whether a fault excuses a broken rule or finding that first occurred at t, s."""
        for note in self.happened:
            kind = FAULTS[note.fault]
            # A fault that begins within a step of the world may show at the beginning of the step.
            if note.began is None or t < note.began - LOOKS_S:
                continue
            after_s = EXCUSED_S if kind.ends else LASTING_S
            if note.ended is not None and t > note.ended + after_s:
                continue
            if any(finding.startswith(words) for words in kind.excuses):
                return True
        return False

    def as_plain(self) -> list[dict[str, Any]]:
        """Return the faults as they happened, for the result."""
        return [asdict(note) for note in self.happened]


def _reached(at: OnsetOptions, phase: Callable[[], Phase], bench: Bench) -> Callable[[], bool]:
    """Return a function that tells whether the onset's phase or height has been reached."""

    def reached() -> bool:
        now = phase().value
        if at.phase is not None:
            return now in PHASES and PHASES.index(now) >= PHASES.index(at.phase)
        assert at.height_m is not None
        low = bench.world.height <= at.height_m or any(bench.world.vehicle.feet)
        return now in PHASES and low

    return reached
