"""Camera and gimbal that say nothing, for tests of the link alone."""

import asyncio

from landerd.messages import ExposureOrder, Frame, GimbalCommand, GimbalState, Reference
from landerd.ports import Feedback, GimbalTraits
from landerd.section import Section


class IdleOptions(Section):
    """The idle devices have no options."""


class Idle:
    """A camera and a gimbal that never report anything."""

    traits = GimbalTraits(Reference.BODY, Feedback.MEASURED, 50.0, (-1.5, 1.5), (-1.5, 1.5))

    def __init__(self, *, options: IdleOptions | None = None) -> None: ...

    async def open(self) -> None: ...
    async def close(self) -> None: ...
    def command(self, command: GimbalCommand) -> None: ...
    def expose(self, order: ExposureOrder) -> None: ...

    async def newest(self) -> Frame:
        return await asyncio.Future[Frame]()

    async def state(self) -> GimbalState:
        return await asyncio.Future[GimbalState]()
