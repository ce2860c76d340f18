"""The camera's IMU at its registers: bytes by hand, motion, and servos with it."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest
from pydantic import ValidationError

from hw.gimbals.i2c import I2c
from hw.gimbals.imu import ImuOptions, make_imu
from hw.gimbals.servo import ServoGimbal, ServoOptions
from landerd.messages import GimbalCommand, Reference
from landerd.ports import DeviceLost
from landerd.runtime.clock import run_virtual
from tests.hw.gimbals.benches import Stand, on_stand

G = 8192  # of the accelerometer at +-4 g


class Sensor:
    """Registers that the test sets; a sensor lying flat, its z away from the ground."""

    def __init__(self, number: int, registers: dict[int, int]) -> None:
        self.number, self.registers = number, dict(registers)
        self.data: list[int] = []
        self.read_at: list[tuple[int, int, int]] = []
        self.gone = self.closed = False

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        self._answer()
        return self.registers[register]

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        self._answer()
        self.read_at.append((i2c_addr, register, length))
        return self.data

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        self._answer()
        self.registers[register] = value

    def close(self) -> None:
        self.closed = True

    def _answer(self) -> None:
        if self.gone:
            raise OSError(121, "Remote I/O error")


def at_once(sensor: Sensor) -> I2c[Sensor]:
    return I2c(lambda _: sensor, in_thread=False)


def words(order: str, *values: int) -> list[int]:
    return [
        b for v in values for b in (v & 0xFFFF).to_bytes(2, "big" if order == ">" else "little")
    ]


def mpu(ax: int, ay: int, az: int, p: int = 0, q: int = 0, r: int = 0) -> list[int]:
    return words(">", ax, ay, az, 0, p, q, r)


def with_imu(
    options: ImuOptions, registers: dict[int, int], scene: Callable[[Sensor, object], object]
) -> Sensor:
    sensor = Sensor(1, registers)

    async def main() -> None:
        imu = make_imu(options, at_once(sensor))
        await scene(sensor, imu)  # type: ignore[misc]
        await imu.close()
        assert sensor.closed

    run_virtual(main())
    return sensor


async def sample(imu: object, count: int, dt: float = 0.02) -> float | None:
    pitch = None
    for _ in range(count):
        await asyncio.sleep(dt)
        pitch = await imu.pitch()  # type: ignore[attr-defined]
    return pitch


def degrees(pitch: float | None) -> float:
    assert pitch is not None
    return math.degrees(pitch)


@pytest.mark.parametrize(
    ("force", "pitch"),
    [
        ((0, 0, G), 0.0),  # lying flat: the lens looks ahead
        ((-G, 0, 0), -90.0),  # x to the ground: the lens looks down
        ((G, 0, 0), 90.0),
        ((-5793, 0, 5793), -45.0),
        ((0, 4096, 7094), 0.0),  # rolled to the right: that is no pitch
        ((-8102, -1212, -1000), -97.0),  # beyond straight down, and a little to the left
    ],
)
def test_an_mpu6050_at_rest_reports_the_angles_of_gravity(
    force: tuple[int, int, int], pitch: float
) -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        sensor.data = mpu(*force)
        assert await sample(imu, 20) is None  # it first learns its gyroscope's error
        assert degrees(await sample(imu, 10)) == pytest.approx(pitch, abs=0.1)

    sensor = with_imu(ImuOptions(kind="mpu6050"), {0x75: 0x68}, scene)
    # awake; 44 Hz; 500 degrees/s; 4 g
    assert [sensor.registers[r] for r in (0x6B, 0x1A, 0x1B, 0x1C)] == [0x01, 0x03, 0x08, 0x08]
    assert set(sensor.read_at) == {(0x68, 0x3B, 14)}


def test_the_angle_follows_the_gyroscope_whose_bias_is_learnt() -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        wrong = (98, -131, 66)  # 1.5, -2, 1 degrees/s
        sensor.data = mpu(0, 0, G, *wrong)
        await sample(imu, 30)
        assert degrees(await sample(imu, 500)) == pytest.approx(0.0, abs=0.1)
        # One second at 20 degrees/s about the sensor's y, which is the gimbal's left: the lens
        # sinks. The vehicle speeds up meanwhile, so that the accelerometer tells nothing.
        p, q, r = wrong
        sensor.data = mpu(3 * G, 0, 0, p, q + 1310, r)
        assert degrees(await sample(imu, 50)) == pytest.approx(-20.0, abs=0.3)

    with_imu(ImuOptions(kind="mpu6050"), {0x75: 0x68}, scene)


def test_no_angle_is_reported_before_the_sensor_was_still_for_a_moment() -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        for i in range(200):
            sensor.data = mpu(0, 0, G, 0, 400 * (i % 2))  # shaken by 6 degrees/s
            assert await sample(imu, 1) is None
        sensor.data = mpu(0, 0, G, 0, 200)
        assert degrees(await sample(imu, 60)) == pytest.approx(0.0, abs=0.1)

    with_imu(ImuOptions(kind="mpu6050"), {0x75: 0x68}, scene)


def test_opened_again_in_the_air_it_goes_on_with_the_error_it_had_learnt() -> None:
    """Once, one failed read lost the gimbal for the flight: in the air nothing is still."""

    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        sensor.data = mpu(0, 0, G, 98, -131, 66)
        await sample(imu, 30)
        sensor.gone = True
        with pytest.raises(DeviceLost):
            await sample(imu, 1)
        sensor.gone = False
        await imu.open()  # type: ignore[attr-defined]
        for i in range(60):
            shaken = 400 * (i % 2)  # by 6 degrees/s
            sensor.data = mpu(-5793, 0, 5793, 98, -131 - 200 + shaken, 66)
            pitch = await sample(imu, 1)
        assert degrees(pitch) == pytest.approx(-45.0, abs=0.2)

    with_imu(ImuOptions(kind="mpu6050"), {0x75: 0x68}, scene)


@pytest.mark.parametrize(
    ("kind", "registers", "flat", "nothing"),
    [
        ("mpu6050", {0x75: 0x68}, mpu(0, 0, G, 10, 20, 30), mpu(0, 0, 0)),
        ("bno055", {0x00: 0xA0}, words("<", 0, 0, 981), words("<", 0, 0, 0)),
    ],
)
def test_a_chip_that_was_reset_is_lost_and_set_up_again(
    kind: Any, registers: dict[int, int], flat: list[int], nothing: list[int]
) -> None:
    """Once, a chip asleep after a brown-out measured nothing, and its last angle was kept."""

    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        sensor.data = nothing  # as until its first measurement
        assert await sample(imu, 5) is None
        sensor.data = flat
        assert degrees(await sample(imu, 80)) == pytest.approx(0.0, abs=0.1)
        sensor.data = nothing
        with pytest.raises(DeviceLost, match="shows no gravity"):
            await sample(imu, 1)
        sensor.registers[0x6B] = sensor.registers[0x3D] = 0  # asleep
        await imu.open()  # type: ignore[attr-defined]
        assert sensor.registers[0x6B if kind == "mpu6050" else 0x3D] != 0

    with_imu(ImuOptions(kind=kind), registers, scene)


def test_a_short_acceleration_hardly_moves_the_horizon_and_a_false_one_is_found_again() -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        sensor.data = mpu(0, 0, G)
        await sample(imu, 30)
        sensor.data = mpu(-2048, 0, G)  # a quarter of g for a second, as if pitched by 14 degrees
        pitch = degrees(await sample(imu, 50))
        assert -1.5 < pitch < -0.3
        sensor.data = mpu(0, 0, G)
        assert degrees(await sample(imu, 3000)) == pytest.approx(0.0, abs=0.3)

    with_imu(ImuOptions(kind="mpu6050"), {0x75: 0x68}, scene)


def test_a_bno055_reports_its_own_angles() -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        sensor.data = words("<", 0, 0, 0)
        assert await sample(imu, 1) is None  # its fusion has not begun
        sensor.data = words("<", -693, 0, 693)
        assert degrees(await sample(imu, 1)) == pytest.approx(-45.0, abs=0.1)

    sensor = with_imu(ImuOptions(kind="bno055", address=0x29), {0x00: 0xA0}, scene)
    assert (sensor.registers[0x3B], sensor.registers[0x3D]) == (0x00, 0x08)
    assert set(sensor.read_at) == {(0x29, 0x2E, 6)}


def test_a_sensor_mounted_another_way_round_reports_the_same_angles() -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        await imu.open()  # type: ignore[attr-defined]
        sensor.data = words("<", 981, 0, 0)  # its x away from the ground: the picture's top
        assert degrees(await sample(imu, 1)) == pytest.approx(0.0, abs=0.1)

    with_imu(ImuOptions(kind="bno055", axes=("z", "y", "-x")), {0x00: 0xA0}, scene)
    with pytest.raises(ValidationError, match="right-handed"):
        ImuOptions(kind="bno055", axes=("x", "y", "-z"))


@pytest.mark.parametrize(("kind", "register"), [("mpu6050", 0x75), ("bno055", 0x00)])
def test_another_chip_and_none_at_all_are_lost_devices(kind: str, register: int) -> None:
    async def scene(sensor: Sensor, imu: object) -> None:
        sensor.registers[register] = 0x55
        with pytest.raises(DeviceLost, match="found 0x55, expected"):
            await imu.open()  # type: ignore[attr-defined]
        sensor.registers[register] = {"mpu6050": 0x68, "bno055": 0xA0}[kind]
        await imu.open()  # type: ignore[attr-defined]
        sensor.gone = True
        with pytest.raises(DeviceLost, match=r"/dev/i2c-1: Remote I/O error"):
            await imu.pitch()  # type: ignore[attr-defined]

    options = ImuOptions.model_validate({"kind": kind})
    with_imu(options, {register: 0}, scene)


@pytest.mark.parametrize("kind", ["mpu6050", "bno055"])
@pytest.mark.parametrize("driver", ["servo_sysfs", "servo_pca9685", "servo_mavlink"])
def test_servos_with_it_report_the_camera_against_the_horizon(driver: str, kind: str) -> None:
    async def scene(stand: Stand) -> None:
        order = GimbalCommand(0.0, math.radians(-60.0))
        last = (await stand.watch(4.0, order))[-1]
        assert last.reference is Reference.TILT
        assert last.pitch_measured
        # The linkage is 4 degrees off; what is measured is true, and the servo makes up for it.
        assert math.degrees(stand.world.gimbal.pitch.angle) == pytest.approx(-60.0, abs=1.0)
        assert math.degrees(last.pitch) == pytest.approx(-60.0, abs=1.0)

    mount = {"mount": {"pitch_zero_deg": 4.0}, "bias_deg": 0.0}
    on_stand(driver, scene, options={"imu": {"kind": kind}}, gimbal=mount)


def test_a_lost_sensor_is_a_lost_gimbal() -> None:
    sensor = Sensor(1, {0x75: 0x68})
    sensor.data = mpu(0, 0, G)

    class Nowhere:
        async def open(self) -> None: ...
        def write(self, pulses: dict[int, float]) -> None: ...
        async def close(self) -> None: ...

    async def main() -> None:
        gimbal = ServoGimbal(
            ServoOptions(imu=ImuOptions(kind="mpu6050")), Nowhere(), at_once(sensor)
        )
        await gimbal.open()
        await gimbal.state()
        sensor.gone = True
        with pytest.raises(DeviceLost, match="IMU at 0x68"):
            await gimbal.state()
        await gimbal.close()

    run_virtual(main())
