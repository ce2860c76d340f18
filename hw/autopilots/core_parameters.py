"""The autopilot's parameters that the core uses, under their names in each firmware."""

from collections.abc import Collection

from landerd.messages import ParameterChange

# The core's key, and the least and greatest value that the configuration allows.
_ACCELERATION = ("autopilot.acceleration_mps2", 0.5, 10.0)
_VERTICAL_ACCELERATION = ("autopilot.vertical_acceleration_mps2", 0.3, 5.0)
_JERK = ("autopilot.jerk_mps3", 1.0, 50.0)
_VERTICAL_JERK = ("autopilot.vertical_jerk_mps3", 1.0, 50.0)
_ATTITUDE = ("autopilot.attitude_time_constant_s", 0.01, 2.0)
# The unit in SI of each. ArduCopter 4.7 has new names for some.
_PARAMETERS: dict[str, tuple[float, tuple[str, float, float]]] = {
    "GUID_TIMEOUT": (1.0, ("autopilot.guided_timeout_s", 0.1, 3600.0)),
    "WPNAV_ACCEL": (0.01, _ACCELERATION),
    "WP_ACC": (1.0, _ACCELERATION),
    "WPNAV_ACCEL_Z": (0.01, _VERTICAL_ACCELERATION),
    "WP_ACC_Z": (1.0, _VERTICAL_ACCELERATION),
    "PSC_JERK_XY": (1.0, _JERK),
    "PSC_JERK_NE": (1.0, _JERK),
    "PSC_NE_JERK": (1.0, _JERK),
    "PSC_JERK_Z": (1.0, _VERTICAL_JERK),
    "PSC_JERK_D": (1.0, _VERTICAL_JERK),
    "PSC_D_JERK": (1.0, _VERTICAL_JERK),
    "ATC_INPUT_TC": (1.0, _ATTITUDE),
}


def change_of(name: str, value: float, now: float) -> ParameterChange | None:
    """Return a parameter reported at now (s) as the core's change; None: of no use to the core."""
    if name not in _PARAMETERS or not value > 0.0:
        return None
    unit, (key, least, most) = _PARAMETERS[name]
    return ParameterChange(now, key, min(max(unit * float(value), least), most))


def untold(told: Collection[str]) -> list[str]:
    """Return the names of the parameters that have not been reported yet."""
    keys = {_PARAMETERS[name][1] for name in told if name in _PARAMETERS}
    return [name for name, (_, key) in _PARAMETERS.items() if key not in keys]
