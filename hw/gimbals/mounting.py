"""What all gimbal drivers share: how the gimbal sits on the airframe, and what each driver states.

Drivers turn their maker's angles into landerd's (yaw right, pitch up, roll right, rad); the
mounting then takes care of a gimbal that is built in the other way round or whose zero is not
straight ahead.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from landerd.geometry import Mat3, clamp, wrap
from landerd.messages import GimbalCommand, GimbalState, Reference

Angle = Annotated[float, Field(ge=-360, le=360)]
_STEEP = 0.3  # cosine of pitch below which roll is no axis of its own (see `level_angles`)
_LARGEST = 2.0 * math.pi + 1e-6  # no gimbal reports more, rad


class Feedback(Enum):
    """What the angles that a driver reports are."""

    MEASURED = "measured"
    MODELLED = "modelled"  # where the gimbal should be by now
    ORDERED = "ordered"  # the core takes it that the gimbal follows with gimbal.lag_s


class Options(BaseModel):
    """A driver's block of the configuration: unknown keys are errors, values never change."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class MountOptions(Options):
    """How the gimbal is built in; `landerd calibrate gimbal` finds these."""

    yaw_sign: Literal[1, -1] = 1  # -1: it turns left when ordered right
    pitch_sign: Literal[1, -1] = 1
    yaw_zero_deg: Angle = 0.0  # where the camera looks when the gimbal says 0
    pitch_zero_deg: Angle = 0.0
    yaw_limits_deg: tuple[Angle, Angle]  # what the gimbal can reach, measured as landerd does
    pitch_limits_deg: tuple[Angle, Angle]

    @model_validator(mode="after")
    def _ordered(self) -> "MountOptions":
        for low, high in (self.yaw_limits_deg, self.pitch_limits_deg):
            if low > high:
                raise ValueError("expected limits as [lowest, highest]")
        return self


@dataclass(frozen=True, slots=True)
class Traits:
    """What a driver states about its gimbal."""

    reference: Reference  # what its angles are measured against
    feedback: Feedback
    rate_hz: float  # of its reports
    yaw_limits: tuple[float, float]  # rad
    pitch_limits: tuple[float, float]


class Mounting:
    """Turns a device's angles into landerd's and orders into the device's."""

    def __init__(
        self,
        options: MountOptions,
        reference: Reference,
        rate_hz: float,
        feedback: Feedback = Feedback.MEASURED,
    ) -> None:
        self._options = options
        self.traits = Traits(
            reference,
            feedback,
            rate_hz,
            _radians(options.yaw_limits_deg),
            _radians(options.pitch_limits_deg),
        )

    def state(self, t: float, yaw: float, pitch: float, roll: float = 0.0) -> GimbalState | None:
        """Return the state for a device's angles, turned in the order yaw, roll, pitch, rad.

        None: they are no angles.
        """
        if not all(-_LARGEST <= angle <= _LARGEST for angle in (yaw, pitch, roll)):
            return None  # NaN too
        o = self._options
        yaw, pitch, roll = level_angles(
            o.yaw_sign * yaw + math.radians(o.yaw_zero_deg),
            o.pitch_sign * pitch + math.radians(o.pitch_zero_deg),
            roll,
        )
        traits = self.traits
        is_measured = traits.feedback is not Feedback.ORDERED
        return GimbalState(t, yaw, pitch, roll, traits.reference, pitch_measured=is_measured)

    def order(self, command: GimbalCommand) -> tuple[float, float] | None:
        """Return the device's yaw and pitch for an order, within its limits; None: no numbers."""
        if not (math.isfinite(command.yaw) and math.isfinite(command.pitch)):
            return None
        o, traits = self._options, self.traits
        yaw = clamp(command.yaw, *traits.yaw_limits) - math.radians(o.yaw_zero_deg)
        pitch = clamp(command.pitch, *traits.pitch_limits) - math.radians(o.pitch_zero_deg)
        return o.yaw_sign * yaw, o.pitch_sign * pitch


def level_angles(yaw: float, pitch: float, roll: float) -> tuple[float, float, float]:
    """Return yaw, pitch, roll of Rz Ry Rx for those of Rz Rx Ry, the order of most gimbals.

    To first order in roll, which a gimbal keeps near 0. Looking down the roll axis of Rz Rx Ry lies
    across the lens and no small angles of Rz Ry Rx stand for it: there it is left out.
    """
    c = math.cos(pitch)
    if abs(c) > _STEEP:
        yaw, roll = yaw + roll * math.tan(pitch), roll / c
    else:
        roll = 0.0
    return wrap(yaw), wrap(pitch), wrap(roll)


def gimbal_order(R: Mat3) -> tuple[float, float, float]:
    """Return yaw, pitch and roll of Rz(yaw) Rx(roll) Ry(pitch) = R, sound also straight down."""
    return (
        math.atan2(-R[0][1], R[1][1]),
        math.atan2(-R[2][0], R[2][2]),
        math.asin(clamp(R[2][1], -1.0, 1.0)),
    )


def _radians(limits_deg: tuple[float, float]) -> tuple[float, float]:
    return math.radians(limits_deg[0]), math.radians(limits_deg[1])
