"""No gimbal: a camera bolted to the airframe."""

import asyncio
import math

from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import Feedback, GimbalTraits
from landerd.section import Angle, Section

_RATE_HZ = 50.0


class FixedOptions(Section):
    """Where the camera looks, relative to the airframe."""

    yaw_deg: Angle = 0.0  # positive right
    pitch_deg: Angle = -90.0  # positive up; -90 is straight down
    roll_deg: Angle = 0.0  # positive right

    @property
    def traits(self) -> GimbalTraits:
        """Its properties that the core uses: its limits are the direction in which it looks."""
        yaw, pitch = math.radians(self.yaw_deg), math.radians(self.pitch_deg)
        return GimbalTraits(Reference.BODY, Feedback.MEASURED, _RATE_HZ, (yaw, yaw), (pitch, pitch))


class FixedGimbal:
    """Always reports the same angles; orders change nothing."""

    def __init__(self, options: FixedOptions) -> None:
        self.traits = options.traits
        self._angles = (
            self.traits.yaw_limits[0],
            self.traits.pitch_limits[0],
            math.radians(options.roll_deg),
        )
        self._due = 0.0

    async def open(self) -> None:
        """Nothing to open."""
        self._due = asyncio.get_running_loop().time()

    async def state(self) -> GimbalState:
        """Return the angles, 50 times a second."""
        loop = asyncio.get_running_loop()
        self._due = max(self._due + 1.0 / _RATE_HZ, loop.time())
        await asyncio.sleep(self._due - loop.time())
        return GimbalState(loop.time(), *self._angles, Reference.BODY)

    def command(self, command: GimbalCommand) -> None:
        """Do nothing: there is no motor."""

    async def close(self) -> None:
        """Nothing to close."""
