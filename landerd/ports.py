"""The device protocols. A real device, a simulated one and a recorded one look the same here.

Devices raise `DeviceLost` when they are gone; the daemon opens them again with back-off. Nothing
here may block the event loop.

Below them stands what a driver brings so that `landerd.devices` can make it: its options, a block
of the configuration of the driver's own model, and what makes the device of them.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal, Protocol, runtime_checkable

from landerd.messages import (
    AutopilotMessage,
    ExposureOrder,
    Frame,
    GimbalCommand,
    GimbalState,
    LandingTarget,
    PressDown,
    Reference,
    Setpoint,
    StatusText,
)
from landerd.section import Section


class DeviceLost(Exception):
    """The device or link is gone; opening it again may help. The text says what happened."""


class NotInstalled(DeviceLost):
    """What the driver needs is not installed.

    Attributes:
        mend: the command that installs it.
    """

    def __init__(self, what: str, mend: str) -> None:
        super().__init__(f"{what}: {mend}")
        self.what, self.mend = what, mend


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


@runtime_checkable
class ExposureControl(Protocol):
    """What a camera has, too, whose exposure can be ordered while it runs."""

    def expose(self, order: ExposureOrder) -> None:
        """Expose so from the next pictures on; a lost device drops the order silently."""


class Feedback(Enum):
    """What the angles that a gimbal's driver reports are."""

    MEASURED = "measured"
    MODELLED = "modelled"  # where the gimbal should be by now
    ORDERED = "ordered"  # the core takes it that the gimbal follows with gimbal.lag_s


@dataclass(frozen=True, slots=True)
class GimbalTraits:
    """What a driver states about its gimbal."""

    reference: Reference  # what its angles are measured against
    feedback: Feedback
    rate_hz: float  # of its reports
    yaw_limits: tuple[float, float]  # rad
    pitch_limits: tuple[float, float]
    sigma: float = 0.0  # of the lens's direction where it is worse than of other gimbals, rad


class Gimbal(Protocol):
    """Two axes that point the camera."""

    @property
    def traits(self) -> GimbalTraits:
        """What the driver states about its gimbal; never changes."""
        ...

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

    @property
    def counters(self) -> Mapping[str, int]:
        """What was dropped, lost on the way or refused, by kind."""
        ...

    @property
    def vehicle_parameters(self) -> Mapping[str, float]:
        """The autopilot's own parameters, those that were asked for and answered."""
        ...

    def ask_parameter(self, name: str) -> None:
        """Ask for one of them; the answer comes with what `receive` takes in."""

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


# ---- what a driver brings ----------------------------------------------------------------------


@runtime_checkable
class CameraOptions(Protocol):
    """What every camera driver's block of the configuration has."""

    @property
    def width(self) -> int:
        """Of the pictures asked for, px."""
        ...

    @property
    def height(self) -> int:
        """Of the pictures asked for, px."""
        ...

    @property
    def fps(self) -> float:
        """Pictures a second asked for."""
        ...


@runtime_checkable
class GimbalOptions(Protocol):
    """What every gimbal driver's block of the configuration has."""

    @property
    def traits(self) -> GimbalTraits:
        """What there is to know of the gimbal."""
        ...


@runtime_checkable
class LinkOptions(Protocol):
    """What a driver's block has if the driver speaks over a link of its own."""

    @property
    def url(self) -> str:
        """Where the device is, as `hw.links.open_link` takes it."""
        ...


class CameraFactory(Protocol):
    """Makes a camera; it is not opened."""

    def __call__(self, *, options: Section) -> Camera:
        """Options: of the driver's own model."""
        ...


class GimbalFactory(Protocol):
    """Makes a gimbal that needs nothing but the machine it is plugged into."""

    def __call__(self, *, options: Section) -> Gimbal:
        """Options: of the driver's own model."""
        ...


class GimbalOverLinkFactory(Protocol):
    """Makes a gimbal that is spoken to over a link of its own."""

    def __call__(self, *, options: Section, link: ByteLink) -> Gimbal:
        """Options: of the driver's own model, with `LinkOptions`."""
        ...


class GimbalBehindAutopilotFactory(Protocol):
    """Makes a gimbal whose messages go through the autopilot's driver."""

    def __call__(self, *, options: Section, autopilot: Autopilot) -> Gimbal:
        """Options: of the driver's own model; autopilot: of the same protocol family."""
        ...


class MessageSigning(Protocol):
    """The key that messages are signed with, and their time stamp, which never goes back."""

    @property
    def key(self) -> bytes:
        """The secret, 32 bytes."""
        ...

    def open(self) -> None:
        """Make sure of the time stamp, before the link is opened. Raises DeviceLost: not yet."""

    def stamp(self, now: float) -> int:
        """Return the time stamp of the next message, sent at loop time now (s)."""
        ...

    def accepts(self, frame: bytes, system: int, component: int) -> bool:
        """Tell whether a frame with sound checksum is signed with the key, and no repetition."""
        ...


class AutopilotFactory(Protocol):
    """Makes an autopilot's driver; its link is not opened."""

    def __call__(
        self,
        link: ByteLink,
        *,
        system_id: int,
        setpoint_frame: Literal["local_ned", "body_ned"],
        ground_stations: Collection[int],
        parameters: Parameters | None,
        signing: MessageSigning | None,
    ) -> Autopilot:
        """Take what the section `autopilot` of the configuration says.

        Args:
            link: to the autopilot.
            system_id: the vehicle's.
            setpoint_frame: of the velocities sent.
            ground_stations: system ids whose parameter messages and commands are taken.
            parameters: what they may read and change; None: nothing.
            signing: of all messages; None: unsigned.
        """
        ...
