"""What a protocol model is connected with: the gimbal in the world, links, the autopilot."""

import os
import pty
import socket
import tty
from dataclasses import dataclass
from typing import Protocol

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.links.memory import memory_pair
from hw.links.serial import SerialLink
from hw.links.udp import UdpLink
from hw.sim.gimbals.mount import SimMount
from hw.sim.gimbals.pty_link import PtyLink
from hw.sim.stand_in.autopilot import SimAutopilot
from landerd.ports import ByteLink, Gimbal

_LOOPBACK = "127.0.0.1"


class Model(Protocol):
    """A device below a driver."""

    async def run(self) -> None:
        """Be the device until cancelled."""


@dataclass(frozen=True, slots=True)
class Bench:
    """Where a model is set up."""

    mount: SimMount
    autopilot: SimAutopilot | None  # the stand-in, for gimbals that it drives; None: a real one
    driver: MavlinkAutopilot  # landerd's driver, through which theirs speak
    realtime: bool  # real sockets and terminals instead of links in memory

    def join(self, url: str) -> tuple[ByteLink, ByteLink]:
        """Return the driver's end and the model's end of a link like that of the URL."""
        if not self.realtime:
            return memory_pair()
        if url.startswith("udp"):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
                free.bind((_LOOPBACK, 0))
                port = int(free.getsockname()[1])
            return UdpLink(_LOOPBACK, port, listen=False), UdpLink(_LOOPBACK, port, listen=True)
        master, slave = pty.openpty()
        tty.setraw(slave)
        path = os.ttyname(slave)
        return SerialLink(path, 115200), PtyLink(master, slave)


Connected = tuple[Gimbal, Model | None]
