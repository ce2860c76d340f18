"""The driver `sim`: a simulated gimbal without a protocol, and its faults."""

import asyncio
import math
from collections import deque
from dataclasses import replace
from enum import Enum

from hw.sim.gimbals.mount import SimMount
from hw.sim.options import SimGimbalOptions
from hw.sim.physics.gimbal import PITCH_LIMITS, YAW_LIMITS
from hw.sim.physics.response import STEP_S
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import DeviceLost, Feedback, GimbalTraits

REPORT_PERIOD_S = 0.02  # between reports of the angles


class GimbalFault(Enum):
    """Faults of the device."""

    SILENT = "silent"  # it reports nothing
    FROZEN = "frozen"  # it repeats the last angles with new times
    NAN = "nan"  # it reports angles of NaN
    LOST = "lost"  # it is disconnected
    RAISES = "raises"  # its driver raises an unexpected exception


class SimGimbal:
    """Implements landerd.ports.Gimbal.

    Attributes:
        fault: the present fault; may be changed at any time.
        late_s: fault: age of reports, whose times do not show it.
    """

    def __init__(self, mount: SimMount, options: SimGimbalOptions) -> None:
        """Take the gimbal in the world, and whether it measures its pitch."""
        self.fault: GimbalFault | None = None
        self._mount = mount
        self._options = options
        self._next_report = 0.0
        self._last: GimbalState | None = None
        self.late_s = 0.0
        self._under_way: deque[tuple[float, GimbalState]] = deque()  # time of measurement, report
        self.traits = GimbalTraits(
            Reference.BODY,
            Feedback.MEASURED if options.pitch_feedback else Feedback.ORDERED,
            1.0 / REPORT_PERIOD_S,
            YAW_LIMITS,
            PITCH_LIMITS,
        )

    async def open(self) -> None:
        """Start the device. Raises DeviceLost."""
        if self.fault is GimbalFault.LOST:
            raise DeviceLost("simulated gimbal is gone")
        self._next_report = asyncio.get_running_loop().time()

    async def state(self) -> GimbalState:
        """Wait for the next report, of which there are 50 per second. Raises DeviceLost."""
        loop = asyncio.get_running_loop()
        while True:
            missed = max(0.0, (loop.time() - self._next_report) // REPORT_PERIOD_S)
            self._next_report += (missed + 1.0) * REPORT_PERIOD_S
            await asyncio.sleep(self._next_report - loop.time())
            if self.fault is GimbalFault.LOST:
                raise DeviceLost("simulated gimbal is gone")
            if self.fault is GimbalFault.RAISES:
                raise ZeroDivisionError("in the simulated gimbal's driver")
            if self.fault is not GimbalFault.SILENT:
                return self._report(loop.time())

    def command(self, command: GimbalCommand) -> None:
        """Take new target angles; those that are not finite are ignored."""
        if self.fault is GimbalFault.LOST:
            return
        if math.isfinite(command.yaw) and math.isfinite(command.pitch):
            self._mount.aim(command.yaw, command.pitch)

    async def close(self) -> None:
        """Release the device."""

    def _report(self, t: float) -> GimbalState:
        """Return the report for a time t, s, as the fault and the delay leave it."""
        if self.fault is GimbalFault.NAN:
            return GimbalState(t, math.nan, math.nan, math.nan, Reference.BODY)
        if self.fault is GimbalFault.FROZEN and self._last is not None:
            return GimbalState(t, self._last.yaw, self._last.pitch, 0.0, Reference.BODY)
        measured = self._options.pitch_feedback
        yaw, pitch = self._mount.measure(pitch_measured=measured)
        made = GimbalState(t, yaw, pitch, 0.0, Reference.BODY, pitch_measured=measured)
        self._under_way.append((self._mount.measured_t, made))
        # The world's time may be a rounding error ahead of the loop's.
        while len(self._under_way) > 1 and self._under_way[1][0] <= t - self.late_s + STEP_S:
            self._under_way.popleft()
        measured_t, arriving = self._under_way[0]
        self._mount.reported(measured_t)
        self._last = replace(arriving, t=t)
        return self._last
