"""An IMU on the camera of a servo gimbal, which tells the direction of gravity; over I2C.

Sources: InvenSense, "MPU-6000 and MPU-6050 Register Map and Descriptions", rev. 4.2 (WHO_AM_I,
PWR_MGMT_1, CONFIG, GYRO_CONFIG, ACCEL_CONFIG, ACCEL_XOUT_H to GYRO_ZOUT_L); Bosch Sensortec,
"BNO055 Intelligent 9-axis absolute orientation sensor", rev. 1.8 (CHIP_ID, OPR_MODE, UNIT_SEL,
GRV_DATA). The BNO055 does its own sensor fusion. For the MPU-6050 the gyroscope propagates the
direction and the accelerometer corrects it, as in Mahony, Hamel and Pflimlin, "Nonlinear
Complementary Filters on the Special Orthogonal Group" (2008). The correction is slow, because an
accelerometer on an accelerating aircraft shows the thrust, not gravity.
"""

import asyncio
import math
import struct
from abc import ABC, abstractmethod
from typing import Annotated, Literal, Protocol

from pydantic import Field, model_validator

from hw.gimbals.i2c import I2c, I2cDevice
from landerd.geometry import Vec3, add, cross, dot, norm, scale, sub, towards, unit
from landerd.ports import DeviceLost
from landerd.section import Section

# MPU-6050
CONFIG, GYRO_CONFIG, ACCEL_CONFIG, ACCEL_XOUT_H = 0x1A, 0x1B, 0x1C, 0x3B
PWR_MGMT_1, WHO_AM_I = 0x6B, 0x75
MPU_ID = 0x68
MPU_DATA = struct.Struct(">7h")  # acceleration, temperature, turn rates
ACCEL_UNIT = 9.80665 / 8192.0  # m/s^2 at +-4 g
GYRO_UNIT = math.radians(1.0 / 65.5)  # rad/s at +-500 degrees/s
# BNO055
CHIP_ID, GRV_DATA, UNIT_SEL, OPR_MODE = 0x00, 0x2E, 0x3B, 0x3D
BNO_ID = 0xA0
MODE_IMU = 0x08
BNO_DATA = struct.Struct("<3h")  # gravity vector, positive away from the ground, 0.01 m/s^2

_G = 9.80665
_STILL_SAMPLES = 25  # number of samples at the start that give the gyroscope's bias
_STILL_RADPS = math.radians(2.0)  # largest difference of turn rates from their mean at rest
_CORRECTION_S = 20.0  # time constant of the accelerometer's correction: 1 / k_P of the paper
_BIAS_GAIN = 0.25 / _CORRECTION_S**2  # k_I of the paper, 1/s^2, for critical damping
_GRAVITY_TOLERANCE = 0.1  # share of g; a force farther from 1 g does not show gravity's direction
_LONGEST_STEP_S = 0.2  # longest time between two samples over which turn rates are integrated
_STARTS_S = 1.0  # time after set-up by which a chip shows gravity; zeros later mean it was reset

Direction = Literal["x", "y", "z", "-x", "-y", "-z"]
Kind = Literal["mpu6050", "bno055"]


class ImuOptions(Section):
    """The sensor and how it sits on the camera."""

    kind: Kind
    bus: Annotated[int, Field(ge=0, le=99)] = 1  # /dev/i2c-1
    address: Annotated[int, Field(ge=0x08, le=0x77)] | None = None  # none: 0x68, of a BNO055 0x28
    # Which of the sensor's axes points along the lens, to the picture's right, to its bottom.
    axes: tuple[Direction, Direction, Direction] = ("x", "-y", "-z")

    @model_validator(mode="after")
    def _right_handed(self) -> "ImuOptions":
        along, right, bottom = (AXES[axis] for axis in self.axes)
        if cross(along, right) != bottom:
            raise ValueError("axes: expected a right-handed set, as [x, -y, -z]")
        return self


AXES: dict[str, Vec3] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}


class ReadableBus(Protocol):
    """The part of an I2C bus (smbus2.SMBus) that is used."""

    def read_byte_data(self, i2c_addr: int, register: int) -> int: ...  # noqa: D102
    def read_i2c_block_data(  # noqa: D102
        self, i2c_addr: int, register: int, length: int
    ) -> list[int]: ...
    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None: ...  # noqa: D102
    def close(self) -> None: ...  # noqa: D102


class Imu(ABC):
    """A sensor on the camera."""

    latency_s: float  # of its data
    _register: int  # first register of its data; next, how the data are packed
    _data: struct.Struct

    def __init__(self, options: ImuOptions, address: int, i2c: I2c[ReadableBus]) -> None:
        self._address = address if options.address is None else options.address
        self._rows = tuple(AXES[axis] for axis in options.axes)
        self._name = f"IMU at 0x{self._address:02x}"
        self._device = I2cDevice(self._name, options.bus, i2c)
        self._set_up_t = 0.0

    async def open(self) -> None:
        """Set the sensor up. Raises DeviceLost."""
        await self._device.open(self._set_up)
        self._set_up_t = asyncio.get_running_loop().time()

    async def pitch(self) -> float | None:
        """Return the lens's angle above the horizon, rad; None: not known yet. Raises DeviceLost.

        Beyond straight down it decreases further: looking level to the rear is -pi.
        """
        data = await self._device.do(self._read)
        waited_s = asyncio.get_running_loop().time() - self._set_up_t
        if not any(data[:3]) and waited_s > _STARTS_S:
            # It sleeps after a brown-out of its supply: reopening sets it up again.
            raise DeviceLost(f"{self._name}: shows no gravity, it was reset")
        down = self._down(data)
        if down is None:
            return None
        return math.atan2(-down[0], down[2])  # of Rz(yaw) Rx(roll) Ry(pitch)

    async def close(self) -> None:
        """Release the bus; safe to call twice."""
        await self._device.close()

    @abstractmethod
    def _set_up(self, bus: ReadableBus) -> None:
        """Configure the sensor to measure. Raises OSError."""

    @abstractmethod
    def _down(self, data: tuple[int, ...]) -> Vec3 | None:
        """Return the direction of gravity in the gimbal frame, a unit vector."""

    def _read(self, bus: ReadableBus) -> tuple[int, ...]:
        found = bus.read_i2c_block_data(self._address, self._register, self._data.size)
        return self._data.unpack(bytes(found))

    def _expect(self, bus: ReadableBus, register: int, chip: int, name: str) -> None:
        """Raise OSError unless a register identifies the chip as the expected one."""
        found = bus.read_byte_data(self._address, register)
        if found != chip:
            raise OSError(f"found 0x{found:02x}, expected {name}")

    def _in_gimbal(self, x: float, y: float, z: float) -> Vec3:
        along, right, bottom = self._rows
        v = (x, y, z)
        return (dot(along, v), dot(right, v), dot(bottom, v))


class Mpu6050(Imu):
    """Accelerometer and gyroscope, with the complementary filter computed here."""

    latency_s = 0.005  # of its low-pass at 44 Hz
    _register, _data = ACCEL_XOUT_H, MPU_DATA

    def __init__(self, options: ImuOptions, i2c: I2c[ReadableBus]) -> None:
        super().__init__(options, 0x68, i2c)
        self._bias: Vec3 = (0.0, 0.0, 0.0)  # gyroscope's bias, rad/s
        self._knows_bias = False
        self._still: list[tuple[Vec3, Vec3]] = []
        self._direction: Vec3 | None = None
        self._t = 0.0

    async def open(self) -> None:
        """Set the sensor up; it must find gravity's direction again. Raises DeviceLost."""
        self._still, self._direction = [], None
        await super().open()

    def _set_up(self, bus: ReadableBus) -> None:
        address = self._address
        self._expect(bus, WHO_AM_I, MPU_ID, "an MPU-6050")
        bus.write_byte_data(address, PWR_MGMT_1, 0x01)  # awake, clocked by the gyroscope
        bus.write_byte_data(address, CONFIG, 0x03)  # low-pass 44 Hz
        bus.write_byte_data(address, GYRO_CONFIG, 0x08)
        bus.write_byte_data(address, ACCEL_CONFIG, 0x08)

    def _down(self, data: tuple[int, ...]) -> Vec3 | None:
        ax, ay, az, _, p, q, r = data
        force = scale(self._in_gimbal(ax, ay, az), ACCEL_UNIT)
        rates = scale(self._in_gimbal(p, q, r), GYRO_UNIT)
        now = asyncio.get_running_loop().time()
        dt, self._t = now - self._t, now
        if self._direction is None:
            self._initialise(force, rates)
        elif norm(force) > 0.0:
            self._direction = self._propagated(
                self._direction, force, rates, min(dt, _LONGEST_STEP_S)
            )
        return self._direction

    def _initialise(self, force: Vec3, rates: Vec3) -> None:
        """Find gravity's first direction, and the gyroscope's bias while the sensor is at rest.

        The bias may be many degrees a second; without it no direction would hold for long. If the
        sensor is reopened in the air, it is never at rest: the earlier bias is kept, and the mean
        force is taken for gravity if it is 1 g.
        """
        self._still.append((force, rates))
        still = self._still
        if len(still) < _STILL_SAMPLES:
            return
        count = 1.0 / len(still)
        mean: Vec3 = (0.0, 0.0, 0.0)
        mean_rates: Vec3 = (0.0, 0.0, 0.0)
        for one_force, one_rates in still:
            mean = add(mean, scale(one_force, count))
            mean_rates = add(mean_rates, scale(one_rates, count))
        self._still = []
        is_still = all(norm(sub(one, mean_rates)) < _STILL_RADPS for _, one in still)
        if is_still and not self._knows_bias:
            self._bias, self._knows_bias = mean_rates, True
        if self._knows_bias and _is_gravity(mean):
            self._direction = unit(scale(mean, -1.0))

    def _propagated(self, down: Vec3, force: Vec3, rates: Vec3, dt: float) -> Vec3:
        down = unit(add(down, scale(cross(down, sub(rates, self._bias)), dt)))
        if not _is_gravity(force):
            return down
        shown = unit(scale(force, -1.0))
        self._bias = add(self._bias, scale(cross(down, shown), _BIAS_GAIN * dt))
        return unit(towards(down, shown, dt / _CORRECTION_S))


def _is_gravity(force: Vec3) -> bool:
    return abs(norm(force) - _G) <= _GRAVITY_TOLERANCE * _G


class Bno055(Imu):
    """A sensor that computes gravity's direction itself."""

    latency_s = 0.01
    _register, _data = GRV_DATA, BNO_DATA

    def __init__(self, options: ImuOptions, i2c: I2c[ReadableBus]) -> None:
        super().__init__(options, 0x28, i2c)

    def _set_up(self, bus: ReadableBus) -> None:
        address = self._address
        self._expect(bus, CHIP_ID, BNO_ID, "a BNO055")
        bus.write_byte_data(address, UNIT_SEL, 0x00)  # m/s^2; may only be set before the fusion
        bus.write_byte_data(address, OPR_MODE, MODE_IMU)

    def _down(self, data: tuple[int, ...]) -> Vec3 | None:
        x, y, z = data
        up = self._in_gimbal(x, y, z)
        return unit(scale(up, -1.0)) if norm(up) > 0.0 else None  # zero until the fusion runs


def make_imu(options: ImuOptions, i2c: I2c[ReadableBus]) -> Imu:
    """Return the sensor that the options name."""
    return {"mpu6050": Mpu6050, "bno055": Bno055}[options.kind](options, i2c)
