"""Texts for the pilot on commands that the autopilot refuses; each is shown once."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_COMMANDS = {
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: "a message rate",
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: "to disarm",
    mavlink.MAV_CMD_DO_SET_SERVO: "to move a servo",
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: "to point the gimbal",
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: "control of the gimbal",
}
_RESULTS = {
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "not now",
    mavlink.MAV_RESULT_DENIED: "denied",
    mavlink.MAV_RESULT_UNSUPPORTED: "not supported",
    mavlink.MAV_RESULT_FAILED: "failed",
}


class Refusals:
    """Remembers which refusals, by command and result, the pilot has been told of."""

    def __init__(self) -> None:
        self._told: set[tuple[int, int]] = set()  # commands and results

    def restart(self) -> None:
        """Tell the pilot of all refusals again: the link or the autopilot is new."""
        self._told.clear()

    def tell(self, command: int, result: int) -> str | None:
        """Return the text on a command's refusal (a MAV_RESULT); None: the pilot was told."""
        if (command, result) in self._told:
            return None
        self._told.add((command, result))
        what = _COMMANDS.get(command, f"command {command}")
        return f"autopilot refuses {what}: {_RESULTS.get(result, result)}"
