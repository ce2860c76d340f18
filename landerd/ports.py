"""The device protocols. A real device, a simulated one and a recorded one look the same here.

Devices raise `DeviceLost` when they are gone; the daemon opens them again with back-off. Nothing
here may block the event loop.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from landerd.messages import (
    AutopilotMessage,
    Frame,
    GimbalCommand,
    GimbalState,
    LandingTarget,
    PressDown,
    Setpoint,
    StatusText,
)


class DeviceLost(Exception):
    """The device or link is gone; opening it again may help. The text says what happened."""


class Camera(Protocol):
    """A source of grey frames."""

    async def open(self) -> None:
        """Start the stream. Raises DeviceLost."""

    async def newest(self) -> Frame:
        """Wait for a frame newer than the last one returned and return the newest there is.

        Raises DeviceLost.
        """
        ...

    async def close(self) -> None:
        """Stop the stream; safe to call twice."""


class Gimbal(Protocol):
    """Two axes that point the camera."""

    async def open(self) -> None:
        """Start the device. Raises DeviceLost."""

    async def state(self) -> GimbalState:
        """Wait for the next measured (or modelled) angles. Raises DeviceLost."""
        ...

    def command(self, command: GimbalCommand) -> None:
        """Send new angles to take; a lost device drops them silently."""

    async def close(self) -> None:
        """Release the device; safe to call twice."""


class Autopilot(Protocol):
    """The flight controller."""

    async def open(self) -> None:
        """Open the link. Raises DeviceLost."""

    async def receive(self) -> AutopilotMessage:
        """Wait for the next message that concerns the core. Raises DeviceLost."""
        ...

    def heartbeat(self) -> None:
        """Say that landerd lives; the control task calls this once a second."""

    def fly(self, setpoint: Setpoint) -> None:
        """Send one velocity and yaw-rate set-point."""

    def press_down(self, order: PressDown) -> None:
        """Order a level attitude without thrust, in place of a set-point."""

    def tell(self, text: StatusText) -> None:
        """Show the pilot a line."""

    def disarm(self) -> None:
        """Ask for disarming; the autopilot refuses in the air."""

    def show_target(self, target: LandingTarget) -> None:
        """Tell the autopilot where the pad is, for its own precision landing."""

    def plot(self, values: Mapping[str, float]) -> None:
        """Send figures by name (at most 10 characters) for the ground station's plots."""

    async def close(self) -> None:
        """Close the link; safe to call twice."""


class ParameterRefused(Exception):
    """A parameter is not changed or not saved; the text says why in one short line."""


class Parameters(Protocol):
    """The numbers of the configuration that a ground station may read and change."""

    @property
    def names(self) -> Sequence[str]:
        """All names, at most 16 characters each, in a fixed order."""
        ...

    def value(self, name: str) -> float:
        """Return a value."""
        ...

    def change(self, name: str, value: float, *, disarmed: bool) -> str:
        """Change a value and return its key of the configuration. Raises ParameterRefused."""
        ...

    def save(self) -> None:
        """Keep the changed values for the next start. Raises ParameterRefused."""


class ByteLink(Protocol):
    """A two-way stream of bytes."""

    async def open(self) -> None:
        """Connect. Raises DeviceLost."""

    async def read(self) -> bytes:
        """Wait for bytes and return all that are there, at least one. Raises DeviceLost."""
        ...

    def write(self, data: bytes) -> None:
        """Queue bytes without waiting; a lost link drops them silently."""

    async def close(self) -> None:
        """Disconnect; safe to call twice."""
