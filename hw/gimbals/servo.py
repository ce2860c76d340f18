"""A gimbal of hobby servos: pulse widths out, a model of the servos instead of feedback.

Angles are relative to the airframe. The model gives the angles at which the servos should be by
now: it follows the ordered ones with a limited speed and a lag. As it cannot notice a servo that
falls behind, orders turn no faster than servos certainly follow. Tables, made by calibration,
convert angles to pulse widths.

An IMU on the camera, if there is one, measures the pitch against the horizon, and the pitch servo
is moved so that the camera keeps the ordered pitch however the airframe tilts. The drivers differ
in how they output the pulses (servo_mavlink, servo_sysfs, servo_pca9685).
"""

import asyncio
import math
from itertools import pairwise
from typing import Annotated, Protocol, Self

from pydantic import Field, model_validator

from hw.gimbals.i2c import KERNELS, I2c
from hw.gimbals.imu import ImuOptions, ReadableBus, make_imu
from hw.gimbals.mounting import SERVO_SIGMA
from landerd.geometry import clamp, wrap
from landerd.messages import GimbalCommand, GimbalState, Reference
from landerd.ports import DeviceLost, Feedback, GimbalTraits
from landerd.section import Angle, Section

_RATE_HZ = 50.0
_LEVELLING_S = 0.2  # time constant with which the pitch servo compensates the airframe's pitch
# Share of `slew_deg_s` at which orders turn at most: under load servos are slower than specified,
# and one that cannot follow is not where the model has it. In simulation of 10 field days, with
# servos of 60 to 200 degrees a second and 120 configured, 7 landed without this limit, 9 with it.
_ORDERED_SHARE = 0.5
_LATEST_S = 0.05  # longest duration of a reading of the IMU; the time of a longer one is uncertain
Pulse = Annotated[float, Field(ge=400, le=2600)]
TILT = ((-135.0, 1000.0), (-45.0, 1500.0), (45.0, 2000.0))  # a usual servo, middle at 45 down


class ServoAxisOptions(Section):
    """One servo."""

    channel: Annotated[int, Field(ge=0, le=32)]  # of the output
    # Angle of the camera (degrees, yaw right, pitch up) at pulse widths (us), rising angles; in
    # between a straight line. `landerd calibrate gimbal` makes it.
    table: tuple[tuple[Angle, Pulse], ...]

    @model_validator(mode="after")
    def _monotonic(self) -> "ServoAxisOptions":
        angles = [angle for angle, _ in self.table]
        pulses = [pulse for _, pulse in self.table]
        rises = all(a < b for a, b in pairwise(angles))
        one_way = all(a < b for a, b in pairwise(pulses)) or all(a > b for a, b in pairwise(pulses))
        if len(self.table) < 2 or not rises or not one_way:
            raise ValueError(
                "table: expected two or more [angle_deg, pulse_us] with rising angles and pulses "
                "that only rise or only fall"
            )
        return self

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest angle, rad."""
        return math.radians(self.table[0][0]), math.radians(self.table[-1][0])


class ServoOptions(Section):
    """Servos for pitch and perhaps yaw."""

    yaw: ServoAxisOptions | None = None  # none: the camera only tilts
    pitch: ServoAxisOptions = ServoAxisOptions(channel=0, table=TILT)
    slew_deg_s: Annotated[float, Field(gt=0, le=1000)] = 120.0  # largest speed under load
    lag_s: Annotated[float, Field(ge=0, le=0.5)] = 0.08  # behind a slowly moving order
    imu: ImuOptions | None = None  # a sensor on the camera

    @model_validator(mode="after")
    def _one_servo_a_channel(self) -> Self:
        if self.yaw is not None and self.yaw.channel == self.pitch.channel:
            raise ValueError(
                f"expected yaw and pitch on two channels, both are {self.pitch.channel}"
            )
        return self

    @property
    def axes(self) -> list[ServoAxisOptions]:
        """The configured servos, that for yaw first."""
        return [axis for axis in (self.yaw, self.pitch) if axis is not None]

    def see_pulses_fit(self, frequency_hz: float) -> None:
        """Check that each pulse of the tables ends before the next begins. Raises ValueError."""
        longest_us = max(pulse for axis in self.axes for _, pulse in axis.table)
        if longest_us >= 1e6 / frequency_hz:
            raise ValueError(
                f"frequency_hz: expected less than {1e6 / longest_us:.0f}, for the table's pulses "
                f"of {longest_us:g} us"
            )

    @property
    def traits(self) -> GimbalTraits:
        """The gimbal's properties that the core uses; its limits are those of its tables."""
        yaw = self.yaw.limits if self.yaw is not None else (0.0, 0.0)
        reference, feedback = Reference.BODY, Feedback.MODELLED
        if self.imu is not None:  # but the yaw is still modelled
            reference, feedback = Reference.TILT, Feedback.MEASURED
        return GimbalTraits(reference, feedback, _RATE_HZ, yaw, self.pitch.limits, SERVO_SIGMA)


class PulseOutput(Protocol):
    """Output of the pulses; `write` must not block."""

    async def open(self) -> None:
        """Get ready. Raises DeviceLost."""

    def write(self, pulses: dict[int, float]) -> None:
        """Set pulse widths (us) by channel. Raises DeviceLost."""

    async def close(self) -> None:
        """Leave the pulses as they are; safe to call twice."""


class ServoAxis:
    """Pulse width for an angle by the table, and a model of where the servo is by now."""

    def __init__(self, options: ServoAxisOptions, slew: float, lag_s: float) -> None:
        """Make one; slew: largest speed, rad/s; lag_s: time constant of the servo, s."""
        self.channel = options.channel
        self._table = [(math.radians(angle), pulse) for angle, pulse in options.table]
        self._slew, self._lag_s = slew, lag_s
        self.limits = options.limits
        self.wanted = self.target = self.angle = clamp(0.0, *self.limits)

    @property
    def pulse(self) -> float:
        """Pulse width for the target, us."""
        for (a0, p0), (a1, p1) in pairwise(self._table):
            if self.target <= a1:
                return p0 + (p1 - p0) * (self.target - a0) / (a1 - a0)
        return self._table[-1][1]

    def step(self, dt: float) -> None:
        """Advance by dt (s): the servo follows its target, and the target the wanted angle."""
        share = 1.0 - math.exp(-dt / self._lag_s) if self._lag_s > 0.0 else 1.0
        reach, most = self._slew * dt, _ORDERED_SHARE * self._slew * dt
        self.angle += clamp(share * (self.target - self.angle), -reach, reach)
        self.target += clamp(clamp(self.wanted, *self.limits) - self.target, -most, most)


class ServoGimbal:
    """Servos behind any output; a Gimbal."""

    def __init__(
        self, options: ServoOptions, output: PulseOutput, imu_i2c: I2c[ReadableBus] = KERNELS
    ) -> None:
        self._imu = make_imu(options.imu, imu_i2c) if options.imu is not None else None
        self._levelled = False
        self._airframe_pitch = 0.0  # measured pitch minus the servo's modelled angle, filtered, rad
        slew = math.radians(options.slew_deg_s)
        self._pitch = ServoAxis(options.pitch, slew, options.lag_s)
        self._yaw = ServoAxis(options.yaw, slew, options.lag_s) if options.yaw else None
        self._axes = [axis for axis in (self._yaw, self._pitch) if axis is not None]
        self._output = output
        self._due = self._t = 0.0
        self._is_open = self._is_ordered = False
        self._lost: DeviceLost | None = None
        self.traits = options.traits

    async def open(self) -> None:
        """Open the output and the IMU. Raises DeviceLost."""
        if self._imu is not None:
            await self._imu.open()
            self._levelled = False
        await self._output.open()
        self._due = self._t = asyncio.get_running_loop().time()
        self._lost = None
        self._is_open, self._is_ordered = True, False

    async def state(self) -> GimbalState:
        """Return where the camera looks, 50 times a second. Raises DeviceLost."""
        loop = asyncio.get_running_loop()
        while True:
            self._due = max(self._due + 1.0 / _RATE_HZ, loop.time())
            await asyncio.sleep(self._due - loop.time())
            self._advance(loop.time())
            self._write()
            if self._lost is not None:
                raise self._lost
            yaw = self._yaw.angle if self._yaw else 0.0
            if self._imu is None:
                return GimbalState(self._t, yaw, self._pitch.angle, 0.0, Reference.BODY)
            t, modelled = self._t, self._pitch.angle  # kept, as an order may arrive meanwhile
            pitch = await self._imu.pitch()
            took_s = loop.time() - t
            if pitch is not None and took_s < _LATEST_S:
                self._levelled = True
                airframe_pitch = wrap(pitch - modelled)
                self._airframe_pitch += (airframe_pitch - self._airframe_pitch) / (
                    _LEVELLING_S * _RATE_HZ
                )
                t += 0.5 * took_s - self._imu.latency_s
                return GimbalState(t, yaw, pitch, 0.0, Reference.TILT)

    def command(self, command: GimbalCommand) -> None:
        """Send pulses for new angles; if the output is lost, `state` raises DeviceLost."""
        if self._imu is not None and not self._levelled:
            return  # the IMU does not know the horizon yet
        if not (self._is_open and math.isfinite(command.yaw) and math.isfinite(command.pitch)):
            return
        self._pitch.wanted = command.pitch - self._airframe_pitch
        if self._yaw is not None:
            self._yaw.wanted = command.yaw
        self._advance(asyncio.get_running_loop().time())
        if not self._is_ordered:
            # The servos' angles are not known yet, so the first order is not limited in speed.
            self._is_ordered = True
            for axis in self._axes:
                axis.target = clamp(axis.wanted, *axis.limits)
        self._write()

    async def close(self) -> None:
        """Release the output; the servos hold their angles."""
        self._is_open = False
        await self._output.close()
        if self._imu is not None:
            await self._imu.close()

    def _write(self) -> None:
        """Output the pulses, after the first order only."""
        if not (self._is_open and self._is_ordered):
            return
        try:
            self._output.write({axis.channel: axis.pulse for axis in self._axes})
        except DeviceLost as e:
            self._lost = e
            self._is_open = False

    def _advance(self, now: float) -> None:
        dt, self._t = now - self._t, now
        for axis in self._axes:
            axis.step(dt)
