"""Measures the CPU time of the MAVLink driver, and feeds it damaged bytes.

Run as `python -m bench.link`; it exits with code 1 if damaged bytes accumulate in memory, and with
an exception if they raise one. The share of a core is mostly the cost of waking up, so that it
depends on what else the machine does; it should be at most 5 %.
"""

import asyncio
import logging
import random
import resource
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink import MavlinkAutopilot
from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links import open_link
from landerd.config.models import Config
from landerd.config.parameters import ParameterSet
from landerd.messages import Setpoint
from landerd.ports import DeviceLost

RATE_HZ = 250  # messages from the autopilot per second
DURATION_S = 8.0  # of the measurement over UDP
SETPOINT_HZ = 40
FUZZ_BYTES = 10_000_000  # number of damaged bytes


def telemetry(boot_ms: int) -> list[Message]:
    """Return the 25 messages that an autopilot sends in 0.1 s, from a time since boot on."""
    messages: list[Message] = []
    for i in range(10):
        t = boot_ms + 10 * i
        messages.append(mavlink.MAVLink_attitude_message(t, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03))
        messages.append(mavlink.MAVLink_local_position_ned_message(t, 1, 2, -3, 0.1, 0.2, 0.3))
    for i in range(0, 100, 25):
        channels = (1500,) * 16
        messages.append(mavlink.MAVLink_rc_channels_message(boot_ms + i, 16, *channels, 0, 0, 255))
    messages.append(mavlink.MAVLink_extended_sys_state_message(0, 2))
    return messages


def codec_cost() -> tuple[float, float]:
    """Return the CPU times to pack and to parse one message, s, on average."""
    packer, parser = MavlinkCodec(1, 1), MavlinkCodec(1, 191)
    count, packed, parsed = 0, 0.0, 0.0
    for i in range(400):
        messages = telemetry(100 * i)
        start = time.process_time()
        frames = [packer.encode(m) for m in messages]
        between = time.process_time()
        heard = sum(len(parser.decode(frame)) for frame in frames)
        parsed += time.process_time() - between
        packed += between - start
        count += len(messages)
        assert heard == len(messages)
    return packed / count, parsed / count


async def driver_load(port: int) -> tuple[int, float]:
    """Return the number of messages received over UDP, and the share of a core that was used.

    Set-points are sent meanwhile.
    """
    driver = MavlinkAutopilot(open_link(f"udpin:127.0.0.1:{port}"))
    await driver.open()
    await driver.receive()
    loop = asyncio.get_running_loop()
    got = 0

    async def receive() -> None:
        nonlocal got
        while True:
            await driver.receive()
            got += 1

    task = asyncio.create_task(receive())
    wall, cpu = loop.time(), time.process_time()
    while loop.time() - wall < DURATION_S:
        driver.fly(Setpoint((1.0, 0.0, 0.0), 0.1))
        await asyncio.sleep(1.0 / SETPOINT_HZ)
    share = (time.process_time() - cpu) / (loop.time() - wall)
    task.cancel()
    await driver.close()
    return got, share


def send(port: int) -> None:
    """Act as the autopilot: send RATE_HZ messages per second, each in a datagram."""
    codec = MavlinkCodec(1, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        start = time.monotonic()
        for i in range(round(10 * (DURATION_S + 2.0))):
            for j, message in enumerate(telemetry(100 * i)):
                due = start + 0.1 * i + j / RATE_HZ
                time.sleep(max(0.0, due - time.monotonic()))
                out.sendto(codec.encode(message), ("127.0.0.1", port))


class Stream:
    """A ByteLink that yields FUZZ_BYTES damaged bytes, in pieces like those of a serial port.

    Attributes:
        settled_kb: largest resident memory of the process after the first tenth of the bytes.
    """

    def __init__(self) -> None:
        """Make the undamaged bytes."""
        rng = self._rng = random.Random(1)
        autopilot, ground = MavlinkCodec(1, 1), MavlinkCodec(255, 190)
        sound = [autopilot.encode(m) for i in range(40) for m in telemetry(100 * i)]
        sound += [ground.encode(mavlink.MAVLink_param_request_list_message(1, 191))] * 20
        for _ in range(2000):  # valid frames of every kind, with random content
            codec, kind = rng.choice((autopilot, ground)), rng.choice(list(mavlink.mavlink_map))
            sound.append(_any_content(codec, kind, rng))
        rng.shuffle(sound)
        self._sound = b"".join(sound)
        self._pieces: Iterator[bytes] = self._damaged()
        self.settled_kb = 0

    def _damaged(self) -> Iterator[bytes]:
        """Yield pieces of 200 bytes: frames with single bytes changed, and random bytes."""
        done, rng = 0, self._rng
        while done < FUZZ_BYTES:
            stream = bytearray(self._sound)
            for _ in range(len(stream) // 100):
                stream[rng.randrange(len(stream))] = rng.choice((0xFD, 0xFE, rng.randrange(256)))
            stream += rng.randbytes(len(stream))
            yield from (bytes(stream[at : at + 200]) for at in range(0, len(stream), 200))
            done += len(stream)
            if not self.settled_kb and done > FUZZ_BYTES / 10:
                self.settled_kb = _resident_kb()

    async def open(self) -> None:
        """Nothing is needed."""

    async def close(self) -> None:
        """Nothing is needed."""

    def write(self, data: bytes) -> None:
        """Nobody reads it."""

    async def read(self) -> bytes:
        """Return the next piece. Raises DeviceLost at the end."""
        await asyncio.sleep(0.0)
        piece = next(self._pieces, None)
        if piece is None:
            raise DeviceLost("the end")
        return piece


def _any_content(codec: MavlinkCodec, kind: int, rng: random.Random) -> bytes:
    """Return a valid frame of a kind of message with random content."""
    message = mavlink.MAVLink_message(kind, mavlink.mavlink_map[kind].msgname)
    layout = mavlink.mavlink_map[kind]
    body = rng.randbytes(layout.unpacker.size)
    message.pack = lambda mav: message._pack(mav, layout.crc_extra, body)
    return codec.encode(message)


async def fuzz() -> tuple[float, int, int, Counter[str]]:
    """Feed the driver FUZZ_BYTES damaged bytes.

    Returns:
        CPU time, s; number of messages received; growth of memory after the first tenth, kB; the
        driver's counters.
    """
    stream = Stream()
    driver = MavlinkAutopilot(stream, parameters=ParameterSet(Config()))
    got, start = 0, time.process_time()
    try:
        while True:
            await driver.receive()
            got += 1
    except DeviceLost:
        pass
    return time.process_time() - start, got, _resident_kb() - stream.settled_kb, driver.counters


def _resident_kb() -> int:
    """Return the largest resident memory of this process so far, kB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> int:
    """Print all figures; return the exit code."""
    packed, parsed = codec_cost()
    print(
        f"codec: packed {1e6 * packed:.1f} us, parsed {1e6 * parsed:.1f} us a message: "
        f"{100 * RATE_HZ * (packed + parsed):.1f} % of a core at {RATE_HZ} messages/s each way"
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    with subprocess.Popen([sys.executable, __file__, "send", str(port)]) as sender:
        got, share = asyncio.run(driver_load(port))
        sender.terminate()
    print(
        f"driver over UDP: {got / DURATION_S:.0f} messages/s in, {SETPOINT_HZ} set-points/s out: "
        f"{100 * share:.1f} % of a core"
    )
    logging.disable()
    seconds, got, grown, counters = asyncio.run(fuzz())
    print(
        f"{FUZZ_BYTES / 1e6:.0f} million random and mutated bytes: no exception, {seconds:.1f} s, "
        f"{got} messages taken, {grown} kB grown after the first million; "
        + ", ".join(f"{count} {kind}" for kind, count in counters.most_common(6))
    )
    return int(grown > 2000)


if __name__ == "__main__":
    if sys.argv[1:2] == ["send"]:
        send(int(sys.argv[2]))
    else:
        sys.exit(main())
