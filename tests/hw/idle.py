"""Camera and gimbal that say nothing, for tests of the link alone."""

import asyncio

from landerd.messages import Frame, GimbalCommand, GimbalState


class Idle:
    """Both at once."""

    async def open(self) -> None: ...
    async def close(self) -> None: ...
    def command(self, command: GimbalCommand) -> None: ...

    async def newest(self) -> Frame:
        return await asyncio.Future[Frame]()

    async def state(self) -> GimbalState:
        return await asyncio.Future[GimbalState]()
