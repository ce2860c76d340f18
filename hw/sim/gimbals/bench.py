"""What protocol models are connected to: the gimbal in the world, links, and the autopilot."""

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
    """A modelled device that a driver talks to."""

    async def run(self) -> None:
        """Act as the device until cancelled."""


@dataclass(frozen=True, slots=True)
class Bench:
    """The surroundings of a model."""

    mount: SimMount  # the gimbal in the world
    # The simulated autopilot, for gimbals that it drives; None: a real autopilot flies.
    autopilot: SimAutopilot | None
    driver: MavlinkAutopilot  # landerd's driver of the autopilot, which gimbals' drivers may use
    realtime: bool  # whether links are real sockets and terminals, instead of ones in memory

    def join(self, url: str) -> tuple[ByteLink, ByteLink]:
        """Return the driver's end and the model's end of a link of the URL's kind."""
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
