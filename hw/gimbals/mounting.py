"""Base of the gimbal drivers: how the gimbal is mounted on the airframe.

Drivers convert their manufacturer's angles to landerd's signs (yaw right, pitch up, roll right,
rad). The mounting then corrects for a gimbal that is mounted the other way round, or whose zero is
not straight ahead.
"""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from landerd.geometry import clamp, wrap
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import Feedback, GimbalTraits
from landerd.section import Angle, Section

Latency = Annotated[float, Field(ge=0, le=0.2)]
_LARGEST_ANGLE = 2.0 * math.pi + 1e-6  # largest angle that a gimbal reports, rad
SERVO_SIGMA = math.radians(1.5)  # standard deviation of hobby servos with a calibrated table


class MountOptions(Section):
    """A gimbal with electronics of its own; `landerd calibrate gimbal` finds signs and zeros.

    Such gimbals keep pitch and roll against the horizon, and yaw against the airframe.
    """

    yaw_sign: Literal[1, -1] = 1  # -1: it turns left when ordered right
    pitch_sign: Literal[1, -1] = 1
    yaw_zero_deg: Angle = 0.0  # where the camera looks when the gimbal says 0
    pitch_zero_deg: Angle = 0.0
    yaw_limits_deg: tuple[Angle, Angle]  # what the gimbal can reach, measured as landerd does
    pitch_limits_deg: tuple[Angle, Angle]
    rate_hz: float  # angles are asked for
    latency_s: Latency  # from measurement to answer

    @model_validator(mode="after")
    def _ordered(self) -> "MountOptions":
        for low, high in (self.yaw_limits_deg, self.pitch_limits_deg):
            if low > high:
                raise ValueError("expected limits as [lowest, highest]")
        return self

    @property
    def traits(self) -> GimbalTraits:
        """The gimbal's properties that the core uses."""
        return GimbalTraits(
            Reference.HORIZON,
            Feedback.MEASURED,
            self.rate_hz,
            _radians(self.yaw_limits_deg),
            _radians(self.pitch_limits_deg),
        )


class Mounting:
    """Converts a device's angles to landerd's, and orders to the device's angles."""

    def __init__(self, options: MountOptions) -> None:
        self._options = options
        self.traits = options.traits

    def state(self, t: float, yaw: float, pitch: float, roll: float = 0.0) -> GimbalState | None:
        """Return the state for a device's angles (rad) of time t (s); None: they are impossible."""
        if not all(-_LARGEST_ANGLE <= angle <= _LARGEST_ANGLE for angle in (yaw, pitch, roll)):
            return None  # NaN too
        o, is_measured = self._options, self.traits.feedback is not Feedback.ORDERED
        return GimbalState(
            t - o.latency_s,
            wrap(o.yaw_sign * yaw + math.radians(o.yaw_zero_deg)),
            wrap(o.pitch_sign * pitch + math.radians(o.pitch_zero_deg)),
            wrap(roll),
            self.traits.reference,
            pitch_measured=is_measured,
            yaw_measured=is_measured,
        )

    def order(self, command: GimbalCommand) -> tuple[float, float] | None:
        """Return the device's yaw and pitch (rad) for an order, within limits; None: not finite."""
        if not (math.isfinite(command.yaw) and math.isfinite(command.pitch)):
            return None
        o, traits = self._options, self.traits
        yaw = clamp(command.yaw, *traits.yaw_limits) - math.radians(o.yaw_zero_deg)
        pitch = clamp(command.pitch, *traits.pitch_limits) - math.radians(o.pitch_zero_deg)
        return o.yaw_sign * yaw, o.pitch_sign * pitch


def _radians(limits_deg: tuple[float, float]) -> tuple[float, float]:
    return math.radians(limits_deg[0]), math.radians(limits_deg[1])
