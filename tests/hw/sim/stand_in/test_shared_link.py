"""landerd's link to a real autopilot, shared with the ground station and the simulated world."""

import asyncio

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import memory_pair
from hw.sim.stand_in.shared_link import SharedLink
from landerd.runtime.clock import run_virtual


def test_the_others_hear_whole_messages_and_landerd_every_byte() -> None:
    heard: list[bytes] = []
    messages: list[Message] = []

    async def main() -> None:
        near, far = memory_pair()
        shared = SharedLink(near)
        shared.heard = lambda t, data: heard.append(data)
        shared.listeners.append(messages.append)
        side = shared.side()
        await shared.open()
        await far.open()
        codec = MavlinkCodec(1, 1)
        sent = b"".join(
            codec.encode(mavlink.MAVLink_system_time_message(0, ms)) for ms in (10, 20, 30)
        )
        cut = len(sent) // 2  # within a message, as TCP may
        received = b""
        for part in (sent[:cut], sent[cut:]):
            far.write(part)
            received += await shared.read()
        assert received == sent == await side.read()

    run_virtual(main())
    assert [m.time_boot_ms for m in messages] == [10, 20, 30]
    assert [MavlinkCodec(1, 1).decode(frame)[0].time_boot_ms for frame in heard] == [10, 20, 30]


def test_only_what_landerd_writes_is_tapped() -> None:
    tapped: list[bytes] = []

    async def main() -> bytes:
        near, far = memory_pair()
        shared = SharedLink(near)
        shared.tap = lambda t, data: tapped.append(data)
        side = shared.side()
        await shared.open()
        await far.open()
        side.write(b"station")
        shared.write(b"landerd")
        await asyncio.sleep(0.01)
        return await far.read()

    assert run_virtual(main()) == b"stationlanderd"
    assert tapped == [b"landerd"]
