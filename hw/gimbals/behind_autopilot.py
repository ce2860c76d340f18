"""Base of the drivers for gimbals that the autopilot drives: orders and reports use its link.

Pitch and roll are against the horizon, yaw against the airframe.
"""

import asyncio
import math
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import Message
from hw.gimbals.mounting import SERVO_SIGMA, Latency, Mounting, MountOptions
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import Feedback, GimbalTraits
from landerd.section import Angle

_MOST_REPORTS = 50  # most reports kept, so that a stopped reader does not fill the memory


class BehindAutopilotOptions(MountOptions):
    """A gimbal that the autopilot drives."""

    rate_hz: Annotated[float, Field(ge=10, le=50)] = 50.0
    command_hz: Annotated[float, Field(ge=5, le=50)] = 20.0  # at most
    latency_s: Latency = 0.02
    feedback: bool = True  # false: servos, whose angles nobody measures
    yaw_limits_deg: tuple[Angle, Angle] = (-90.0, 90.0)
    pitch_limits_deg: tuple[Angle, Angle] = (-90.0, 20.0)

    @property
    def traits(self) -> GimbalTraits:
        """The gimbal's properties that the core uses."""
        if self.feedback:
            return super().traits
        return replace(super().traits, feedback=Feedback.ORDERED, sigma=SERVO_SIGMA)


class BehindAutopilotGimbal(ABC):
    """A Gimbal; derived drivers make and read the messages to and from the autopilot."""

    def __init__(
        self, options: BehindAutopilotOptions, autopilot: MavlinkAutopilot, report: int
    ) -> None:
        """Make a driver; report: id of the message that carries the angles."""
        self._options, self._autopilot = options, autopilot
        self._mounting = Mounting(options)
        self.traits = self._mounting.traits
        self._sent_t = -math.inf
        self._states: deque[GimbalState] = deque(maxlen=_MOST_REPORTS)
        self._waiter: asyncio.Future[None] | None = None
        autopilot.subscribe(report, options.rate_hz, self._take, self._counts)

    async def open(self) -> None:
        """Discard old reports."""
        self._states.clear()

    async def state(self) -> GimbalState:
        """Wait for a report and return the oldest one not returned yet."""
        while not self._states:
            self._waiter = asyncio.get_running_loop().create_future()
            await self._waiter
        return self._states.popleft()

    def command(self, command: GimbalCommand) -> None:
        """Order new angles, at most `command_hz` times a second."""
        now = asyncio.get_running_loop().time()
        angles = self._mounting.order(command)
        if angles is None or now - self._sent_t < 1.0 / self._options.command_hz - 1e-6:
            return
        self._sent_t = now
        self._order(*angles)

    async def close(self) -> None:
        """Discard the reports; the link stays open, as it is the autopilot's."""
        self._states.clear()

    @abstractmethod
    def _order(self, yaw: float, pitch: float) -> None:
        """Order angles as the device counts them, rad."""

    @abstractmethod
    def _angles(self, m: Message) -> tuple[float, float, float] | None:
        """Return yaw, pitch and roll of a report as the device counts them, rad; None: unusable."""

    def _counts(self, m: Message) -> bool:
        """Tell whether a report is from this gimbal."""
        return True

    def _take(self, m: Message, t: float) -> None:
        angles = self._angles(m)
        state = self._mounting.state(t, *angles) if angles is not None else None
        if state is None:
            return
        self._states.append(replace(state, from_autopilot=True))
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
