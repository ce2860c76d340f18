"""Which bytes come from the configured autopilot: by them a UDP link knows its peer."""

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.autopilots.signing import Signing


def heartbeat_of(system_id: int, signing: Signing | None) -> Callable[[bytes], bool]:
    """Return what tells whether a datagram has a heartbeat of a system's autopilot.

    Args:
        system_id: of the vehicle.
        signing: with it a heartbeat counts only if it is signed with the key.
    """

    def has_heartbeat(datagram: bytes) -> bool:
        codec = MavlinkCodec(system_id, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER, None)
        return any(
            message.get_msgId() == mavlink.MAVLINK_MSG_ID_HEARTBEAT
            and message.get_srcSystem() == system_id
            and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
            and (signing is None or signing.is_genuine(bytes(message.get_msgbuf())))
            for message in codec.decode(datagram)
        )

    return has_heartbeat
