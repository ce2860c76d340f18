"""ArduCopter's numbers in MAVLink messages: flight modes, vehicle types, the forced disarm."""

from enum import IntEnum


class Mode(IntEnum):
    """custom_mode of ArduCopter's HEARTBEAT."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9
    DRIFT = 11
    SPORT = 13
    FLIP = 14
    AUTOTUNE = 15
    POSHOLD = 16
    BRAKE = 17
    THROW = 18
    AVOID_ADSB = 19
    GUIDED_NOGPS = 20
    SMART_RTL = 21
    FLOWHOLD = 22
    FOLLOW = 23
    ZIGZAG = 24
    SYSTEMID = 25
    AUTOROTATE = 26
    AUTO_RTL = 27
    TURTLE = 28


# MAV_TYPE of the vehicles that ArduCopter flies: quad, coaxial, helicopter, hexa, octo, tri,
# dodeca, deca. The same mode number means another mode in ArduPlane or ArduRover.
VEHICLE_TYPES = frozenset({2, 3, 4, 13, 14, 15, 29, 35})
FORCE_DISARM = 21196.0  # param2 of MAV_CMD_COMPONENT_ARM_DISARM: disarms in the air, too


def mode_name(number: int) -> str:
    """Return the mode's name as pilots know it."""
    try:
        return Mode(number).name
    except ValueError:
        return f"MODE {number}"
