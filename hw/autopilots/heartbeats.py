"""Recognises the configured autopilot's heartbeats, by which a UDP link knows its peer."""

from collections import Counter
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.autopilots.signing import Signing


def heartbeat_of(
    system_id: int, signing: Signing | None, strangers: Counter[str] | None = None
) -> Callable[[bytes], bool]:
    """Return a function that tells whether a datagram holds a heartbeat of a system's autopilot.

    Args:
        system_id: MAVLink system id of the vehicle.
        signing: if given, a heartbeat counts only if it is signed with the key.
        strangers: is made to count what other datagrams hold, by the kinds of Autopilot.counters,
            and the heartbeats of other autopilots by system, as in "system 2".
    """
    counts: Counter[str] = Counter() if strangers is None else strangers

    def has_heartbeat(datagram: bytes) -> bool:
        codec = MavlinkCodec(system_id, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER, None)
        for message in codec.decode(datagram):
            is_autopilots = message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
            is_heartbeat = message.get_msgId() == mavlink.MAVLINK_MSG_ID_HEARTBEAT
            if not is_autopilots or message.get_srcSystem() != system_id:
                counts["foreign"] += 1
                if is_autopilots and is_heartbeat:
                    counts[f"system {message.get_srcSystem()}"] += 1
            elif signing is not None and not signing.is_genuine(bytes(message.get_msgbuf())):
                counts["badly signed"] += 1
            elif is_heartbeat:
                return True
        counts.update(codec.counters)
        return False

    return has_heartbeat
