"""A modelled IMU on the camera of a servo gimbal: its registers on an I2C bus of its own.

It is an MPU-6050 or a BNO055, as the driver in `hw.gimbals.imu` expects.
"""

import math
from random import Random

from hw.gimbals.i2c import I2c
from hw.gimbals.imu import (
    ACCEL_UNIT,
    ACCEL_XOUT_H,
    BNO_DATA,
    BNO_ID,
    CHIP_ID,
    GRV_DATA,
    GYRO_UNIT,
    MODE_IMU,
    MPU_DATA,
    MPU_ID,
    OPR_MODE,
    PWR_MGMT_1,
    WHO_AM_I,
    ImuOptions,
)
from hw.gimbals.imu import AXES as SENSOR_AXES
from hw.sim.gimbals.mount import SimMount
from landerd.geometry import Mat3, Vec3, add, matmul, rotate, scale, sub, transpose

_G: Vec3 = (0.0, 0.0, 9.80665)  # gravity, local NED, m/s^2
_GYRO_BIAS = math.radians(1.5)  # magnitude of the gyroscope's bias about each axis, rad/s
_GYRO_NOISE = math.radians(0.1)  # standard deviation, rad/s
_ACCELEROMETER_NOISE = 0.05  # standard deviation, m/s^2
_SLEEP = 0x40  # bit of PWR_MGMT_1
_MPU_LATE_S, _BNO_LATE_S = 0.005, 0.01  # age of measurements of either chip when they are read


class ImuModel:
    """The IMU, which turns with the gimbal and accelerates with the vehicle.

    Attributes:
        gone: fault: the sensor does not answer.
    """

    def __init__(self, options: ImuOptions, mount: SimMount) -> None:
        """Take the kind of sensor and its axes, and the gimbal that it sits on."""
        self.gone = False
        self._is_bno = options.kind == "bno055"
        self._axes = [SENSOR_AXES[axis] for axis in options.axes]
        self._mount = mount
        self._rng = Random(3)
        self._written = {PWR_MGMT_1: _SLEEP}
        self._before: tuple[float, Mat3, Vec3] | None = None

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        """Read one register. Raises OSError."""
        self._answer()
        return ({CHIP_ID: BNO_ID} if self._is_bno else {WHO_AM_I: MPU_ID})[register]

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        """Write one register. Raises OSError."""
        self._answer()
        self._written[register] = value

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        """Read the registers of a measurement. Raises OSError."""
        self._answer()
        force, rates = self._feel()
        self._mount.reported(self._mount.measured_t)
        if self._is_bno and register == GRV_DATA:
            up = self._up() if self._written.get(OPR_MODE) == MODE_IMU else (0.0, 0.0, 0.0)
            return list(BNO_DATA.pack(*(round(100.0 * v) for v in self._in_sensor(up))))
        assert register == ACCEL_XOUT_H
        if self._written[PWR_MGMT_1] & _SLEEP:
            return [0] * length
        a = [round(v / ACCEL_UNIT) for v in self._in_sensor(force)]
        w = [round(v / GYRO_UNIT) for v in self._in_sensor(rates)]
        return list(MPU_DATA.pack(*a, 0, *w))

    def close(self) -> None:
        """Release the bus."""

    def _feel(self) -> tuple[Vec3, Vec3]:
        """Return the measured specific force, m/s^2, and turn rates, rad/s, gimbal frame."""
        t, R, velocity = now = self._mount.motion(_MPU_LATE_S)
        before, self._before = self._before, now
        acceleration: Vec3 = (0.0, 0.0, 0.0)
        rates: Vec3 = (0.0, 0.0, 0.0)
        if before is not None and t > before[0]:
            per_s = 1.0 / (t - before[0])
            acceleration = scale(sub(velocity, before[2]), per_s)
            R_before_now = matmul(transpose(before[1]), R)
            axis = (R_before_now[2][1], R_before_now[0][2], R_before_now[1][0])
            other = (R_before_now[1][2], R_before_now[2][0], R_before_now[0][1])
            rates = scale(sub(axis, other), 0.5 * per_s)
        force = rotate(transpose(R), sub(acceleration, _G))
        return add(force, self._noise(_ACCELEROMETER_NOISE)), add(
            add(rates, (_GYRO_BIAS, -_GYRO_BIAS, _GYRO_BIAS)), self._noise(_GYRO_NOISE)
        )

    def _up(self) -> Vec3:
        """Return the vector against gravity, gimbal frame, m/s^2."""
        return rotate(transpose(self._mount.motion(_BNO_LATE_S)[1]), scale(_G, -1.0))

    def _noise(self, sigma: float) -> Vec3:
        x, y, z = (self._rng.gauss(0.0, sigma) for _ in range(3))
        return (x, y, z)

    def _in_sensor(self, v: Vec3) -> Vec3:
        """Return a vector of the gimbal frame on the sensor's axes."""
        out: Vec3 = (0.0, 0.0, 0.0)
        for part, axis in zip(v, self._axes, strict=True):
            out = add(out, scale(axis, part))
        return out

    def _answer(self) -> None:
        if self.gone:
            raise OSError(121, "Remote I/O error")


def imu_bus(options: ImuOptions | None, mount: SimMount) -> I2c[ImuModel]:
    """Return a bus with the sensor, which is made when a driver opens the bus."""

    def open_bus(number: int) -> ImuModel:
        assert options is not None
        return ImuModel(options, mount)

    return I2c(open_bus, in_thread=False)
