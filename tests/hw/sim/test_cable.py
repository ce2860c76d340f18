"""The cable to a real autopilot: what passes, and what faults change."""

import asyncio
import copy
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.links.memory import memory_pair
from hw.sim.cable import Cable
from landerd.runtime.clock import run_virtual

LANDED_STATE = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE


def on_ground(message: Message, send: Callable[[Message], None]) -> None:
    message = copy.copy(message)
    message.landed_state = mavlink.MAV_LANDED_STATE_ON_GROUND
    send(message)


def test_it_changes_what_it_is_told_to_and_passes_all_else_to_the_bit_also_after_a_cut() -> None:
    async def passed() -> tuple[list[Message], list[Message], list[bytes]]:
        side, autopilot = memory_pair()
        cable = Cable(side)
        await asyncio.gather(side.open(), autopilot.open(), cable.near.open())
        running = asyncio.create_task(cable.run())
        await asyncio.sleep(0.1)
        cable.tampering.begin(LANDED_STATE, on_ground)
        codec = MavlinkCodec(3, 1)
        sent = [
            mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, 4, 3),
            mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR),
            mavlink.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0),
        ]
        frames = [codec.encode(message) for message in sent]
        autopilot.write(b"".join(frames))
        cable.near.write(b"an order")
        await asyncio.sleep(0.1)
        arrived = MavlinkCodec(1, 191).decode(await cable.near.read())
        orders = [await autopilot.read()]
        cable.near.cut()
        await asyncio.sleep(0.1)
        cable.near.mend()
        await asyncio.sleep(0.2)
        await cable.near.open()
        cable.near.write(b"a later one")
        orders.append(await autopilot.read())
        running.cancel()
        return MavlinkCodec(1, 191).decode(b"".join(frames)), arrived, orders

    sent, arrived, orders = run_virtual(passed())
    assert orders == [b"an order", b"a later one"]
    assert [bytes(m.get_msgbuf()) for m in arrived[::2]] == [
        bytes(m.get_msgbuf()) for m in sent[::2]
    ]
    assert arrived[1].landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert (arrived[1].get_srcSystem(), arrived[1].get_seq()) == (3, sent[1].get_seq())
