"""A recorded vehicle: what it measured, as messages for the core."""

import math
from collections.abc import Callable

from hw.replay.telemetry import Telemetry
from landerd import gimbal_frames
from landerd.geometry import R_GIMBAL_CAMERA, Mat3, Vec3, matmul, rot_zyx
from landerd.messages import (
    Attitude,
    AutopilotMessage,
    Battery,
    GimbalCommand,
    GimbalState,
    LocalPosition,
    Reference,
)

MEASURE_S = 0.02  # period of attitude, position and gimbal angles given to the core
GIMBAL_LAG_S = 0.08  # of the pretended gimbal
GIMBAL_START = (0.0, math.radians(-23.0))  # and its first yaw and pitch


class RecordedVehicle:
    """The recording as messages for the core, interpolated to a steady rate.

    Attributes:
        is_pretended: it has a gimbal that the recorded vehicle had not.
        ordered: the gimbal's last order, for a pretended one.
    """

    def __init__(
        self,
        telemetry: Telemetry,
        fixed_deg: tuple[float, float] | None,
        *,
        pretended: bool,
        start: float,
    ) -> None:
        """Begin at a time.

        Args:
            telemetry: the recording.
            fixed_deg: yaw and pitch of a camera that does not move; None: see `pretended`.
            pretended: a gimbal that the recorded vehicle had not; else its recorded angles.
            start: of the first measurements, s on the recording's clock.
        """
        self._telemetry = telemetry
        self._fixed = None if fixed_deg is None else tuple(map(math.radians, fixed_deg))
        self.is_pretended = pretended
        self._t = start
        self._battery = 0
        self.ordered: Callable[[], GimbalCommand] | None = None
        self._angles = [(start, *GIMBAL_START)]  # of the pretended gimbal: t yaw pitch

    def measure(self, now: float) -> list[AutopilotMessage | GimbalState]:
        """Return what was measured since the last call."""
        telemetry = self._telemetry
        messages: list[AutopilotMessage | GimbalState] = []
        while self._t <= now:
            t = self._t
            self._t += MEASURE_S
            position, attitude = telemetry.position.at(t), telemetry.attitude.at(t)
            if position is not None:
                n, e, d, vn, ve, vd = position
                messages.append(LocalPosition(t, (n, e, d), (vn, ve, vd)))
            if attitude is not None:
                roll, pitch, yaw, p, q, r = attitude
                messages.append(Attitude(t, roll, pitch, yaw, (p, q, r)))
            if self.is_pretended:
                self._turn(t)
            gimbal = self.gimbal(t)
            if gimbal is not None:
                messages.append(gimbal)
        battery = telemetry.battery
        while self._battery < len(battery.times) and battery.times[self._battery] <= now:
            volts, joules = battery.values[self._battery]
            if self._battery % 5 == 0:
                t = battery.times[self._battery]
                messages.append(Battery(t, volts or None, joules or None))
            self._battery += 1
        return messages

    def gimbal(self, t: float) -> GimbalState | None:
        """Return the camera's angles at a time."""
        if self._fixed is not None:
            return GimbalState(t, self._fixed[0], self._fixed[1], 0.0, Reference.BODY)
        if self.is_pretended:
            at = max(0, min(len(self._angles) - 1, round((t - self._angles[0][0]) / MEASURE_S)))
            return GimbalState(t, self._angles[at][1], self._angles[at][2], 0.0, Reference.BODY)
        angles = self._telemetry.gimbal.at(t)
        if angles is None:
            return None
        yaw, pitch, roll = angles
        return GimbalState(t, yaw, pitch, roll, Reference.HORIZON)

    def _turn(self, t: float) -> None:
        """Let the pretended gimbal follow its last order."""
        _, yaw, pitch = self._angles[-1]
        k = MEASURE_S / GIMBAL_LAG_S
        if self.ordered is not None:
            order = self.ordered()
            yaw, pitch = yaw + k * (order.yaw - yaw), pitch + k * (order.pitch - pitch)
        self._angles.append((t, yaw, pitch))

    def look(self, t: float) -> Mat3 | None:
        """Return R_local_camera at a time."""
        attitude, gimbal = self._telemetry.attitude.at(t), self.gimbal(t)
        if attitude is None or gimbal is None:
            return None
        roll, pitch, yaw = attitude[:3]
        angles = (gimbal.yaw, gimbal.pitch, gimbal.roll)
        R_local_gimbal = gimbal_frames.rotation_local_gimbal(
            gimbal.reference, rot_zyx(yaw, pitch, roll), yaw, angles
        )
        return matmul(R_local_gimbal, R_GIMBAL_CAMERA)

    def body(self, t: float) -> tuple[Vec3, Mat3] | None:
        """Return position and R_local_body at a time."""
        position, attitude = self._telemetry.position.at(t), self._telemetry.attitude.at(t)
        if position is None or attitude is None:
            return None
        roll, pitch, yaw = attitude[:3]
        return (position[0], position[1], position[2]), rot_zyx(yaw, pitch, roll)
