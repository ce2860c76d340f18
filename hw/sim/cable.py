"""The link between landerd and a real autopilot, with simulated link faults in it."""

import asyncio
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import memory_pair
from hw.sim.tampering import Tampering
from landerd.ports import ByteLink, DeviceLost

_REOPEN_S = 0.1


class Cable:
    """A link in memory with the autopilot's own link behind it.

    Attributes:
        near: landerd's end.
        far: the autopilot's end; its messages are written here, one per write.
        tampering: changes messages on their way to landerd.
    """

    def __init__(self, link: ByteLink) -> None:
        """Make one; link: the autopilot's own link."""
        self.near, self.far = memory_pair()
        self.tampering = Tampering()
        self._link = link
        self._codec = MavlinkCodec(255, 0)  # used only for decoding

    async def run(self) -> None:
        """Forward bytes in both directions until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._up())
            tasks.create_task(self._down())

    async def _up(self) -> None:
        while True:
            try:
                await self.far.open()
                while True:
                    self._link.write(await self.far.read())
            except DeviceLost:
                await asyncio.sleep(_REOPEN_S)

    async def _down(self) -> None:
        while True:
            for message in self._codec.decode(await self._link.read()):
                self.tampering.pass_on(message, partial(self._send_as, message))

    def _send_as(self, original: Message, message: Message) -> None:
        """Send the original unchanged, or another message with its sender and sequence number."""
        if message is original:
            self.far.write(bytes(original.get_msgbuf()))
            return
        sender = mavlink.MAVLink(None, original.get_srcSystem(), original.get_srcComponent())
        sender.seq = original.get_seq()
        self.far.write(message.pack(sender))
