"""Servo gimbals: table, model, and what goes out on each of the three outputs."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from hw.gimbals.i2c import I2c
from hw.gimbals.servo import ServoAxis, ServoAxisOptions, ServoGimbal, ServoOptions
from hw.gimbals.servo_mavlink import ServoMavlinkOptions
from hw.gimbals.servo_pca9685 import ServoPca9685Gimbal, ServoPca9685Options
from hw.gimbals.servo_sysfs import ServoSysfsGimbal, ServoSysfsOptions
from landerd.messages import GimbalCommand, GimbalState
from landerd.ports import DeviceLost, Gimbal
from landerd.runtime.clock import run_virtual

TILT = {"channel": 0, "table": [[-90.0, 1100.0], [-45.0, 1500.0], [0.0, 2000.0]]}
PAN = {"channel": 3, "table": [[-90.0, 2000.0], [90.0, 1000.0]]}


def run(driver: Gimbal, scene: Callable[[Gimbal], Awaitable[None]]) -> None:
    async def main() -> None:
        await driver.open()
        await scene(driver)
        await driver.close()

    run_virtual(main())


class Pulses:
    """An output that keeps the pulses written to it."""

    def __init__(self) -> None:
        self.last: dict[int, float] = {}

    async def open(self) -> None:
        pass

    def write(self, pulses: dict[int, float]) -> None:
        self.last = pulses

    async def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("angle_deg", "pulse_us"),
    [(-90.0, 1100.0), (-67.5, 1300.0), (-45.0, 1500.0), (-9.0, 1900.0), (0.0, 2000.0)],
)
def test_the_table_is_read_in_straight_lines(angle_deg: float, pulse_us: float) -> None:
    axis = ServoAxis(ServoAxisOptions.model_validate(TILT), 2.0, 0.08)
    axis.target = math.radians(angle_deg)
    assert axis.pulse == pytest.approx(pulse_us)


@pytest.mark.parametrize(
    "table",
    [
        [[0.0, 1500.0]],
        [[0.0, 1500.0], [0.0, 1600.0]],
        [[10.0, 1500.0], [0.0, 1600.0]],
        [[0.0, 1500.0], [10.0, 1600.0], [20.0, 1550.0]],
    ],
)
def test_a_table_that_can_not_be_read_both_ways_is_refused(table: list[list[float]]) -> None:
    with pytest.raises(ValidationError, match="rising angles"):
        ServoAxisOptions.model_validate({"channel": 0, "table": table})


def servos(**options: Any) -> tuple[ServoGimbal, Pulses]:
    output = Pulses()
    chosen = {"pitch": TILT, "yaw": PAN} | options
    return ServoGimbal(ServoOptions.model_validate(chosen), output), output


async def after(gimbal: Gimbal, seconds: float) -> GimbalState:
    end = asyncio.get_running_loop().time() + seconds
    while (state := await gimbal.state()).t < end:
        pass
    return state


def test_reports_where_the_servos_should_be_by_now() -> None:
    gimbal, output = servos(slew_deg_s=100.0, lag_s=0.1)

    async def scene(_: Gimbal) -> None:
        gimbal.command(GimbalCommand(0.0, math.radians(-90.0)))
        assert output.last == pytest.approx({3: 1500.0, 0: 1100.0})
        # 90 degrees at 100 a second, then the lag: half-way after half the time.
        assert math.degrees((await after(gimbal, 0.45)).pitch) == pytest.approx(-45.0, abs=3.0)
        assert math.degrees((await after(gimbal, 1.5)).pitch) == pytest.approx(-90.0, abs=0.1)

    run(gimbal, scene)


def test_a_small_order_is_followed_with_the_lag() -> None:
    gimbal, _ = servos(slew_deg_s=500.0, lag_s=0.1)

    async def scene(_: Gimbal) -> None:
        gimbal.command(GimbalCommand(math.radians(10.0), 0.0))
        state = await after(gimbal, 0.1)
        assert math.degrees(state.yaw) == pytest.approx(10.0 * (1.0 - 1.0 / math.e), abs=0.1)

    run(gimbal, scene)


def test_without_a_yaw_servo_yaw_is_ahead() -> None:
    gimbal, output = servos(yaw=None)

    async def scene(_: Gimbal) -> None:
        gimbal.command(GimbalCommand(1.0, -1.0))
        assert list(output.last) == [0]
        assert (await after(gimbal, 0.5)).yaw == 0.0
        assert gimbal.traits.yaw_limits == (0.0, 0.0)

    run(gimbal, scene)


# ---- sysfs ----


def chip(folder: Path, channels: tuple[int, ...] = (0,)) -> Path:
    (folder / "export").touch()
    for channel in channels:
        (folder / f"pwm{channel}").mkdir()
        for name, value in (("period", "0"), ("duty_cycle", "0"), ("enable", "0")):
            (folder / f"pwm{channel}" / name).write_text(value)
    return folder


def sysfs(folder: Path) -> ServoSysfsGimbal:
    return ServoSysfsGimbal(
        ServoSysfsOptions.model_validate_json(
            f'{{"chip": "{folder}", "pitch": {{"channel": 0, "table": [[-90, 1000], [0, 2000]]}}}}'
        )
    )


def test_sysfs_gets_nanoseconds(tmp_path: Path) -> None:
    gimbal = sysfs(chip(tmp_path))

    async def scene(_: Gimbal) -> None:
        gimbal.command(GimbalCommand(0.0, math.radians(-45.0)))
        files = {f.name: f.read_text() for f in (tmp_path / "pwm0").iterdir()}
        assert files == {"period": "20000000", "duty_cycle": "1500000", "enable": "1"}

    run(gimbal, scene)


def test_sysfs_exports_a_channel_that_is_not_there(tmp_path: Path) -> None:
    gimbal = sysfs(chip(tmp_path, channels=()))

    async def scene(_: Gimbal) -> None:
        gimbal.command(GimbalCommand(0.0, -1.0))
        assert (tmp_path / "export").read_text() == "0"
        with pytest.raises(DeviceLost, match="pwm0/duty_cycle"):  # as no kernel made it
            await gimbal.state()

    run(gimbal, scene)


def test_sysfs_of_a_channel_that_another_program_switched_off_is_lost_and_opened_anew(
    tmp_path: Path,
) -> None:
    """ArduPilot does so with its board's channels at its start: the servo ignored all orders."""
    gimbal = sysfs(chip(tmp_path))
    enable = tmp_path / "pwm0" / "enable"

    async def turn(seconds: float) -> None:
        for _ in range(round(50 * seconds)):
            gimbal.command(GimbalCommand(0.0, -0.8))
            await gimbal.state()

    async def scene(_: Gimbal) -> None:
        await turn(2.0)
        enable.write_text("0")
        with pytest.raises(DeviceLost, match="another program has switched it off"):
            await turn(2.0)
        await gimbal.open()
        await turn(0.1)
        assert enable.read_text() == "1"

    run(gimbal, scene)


def test_sysfs_without_its_chip_is_lost(tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="no such PWM chip"):
        asyncio.run(sysfs(tmp_path / "none").open())


# ---- PCA9685 ----


class Bus:
    """An I2C bus that keeps what is written."""

    def __init__(self) -> None:
        self.writes: list[tuple[int, int, list[int]]] = []
        self.gone = False

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        self.write_i2c_block_data(i2c_addr, register, [value])

    def write_i2c_block_data(self, i2c_addr: int, register: int, data: list[int]) -> None:
        if self.gone:
            raise OSError(121, "Remote I/O error")
        self.writes.append((i2c_addr, register, data))

    def close(self) -> None:
        pass


def test_pca9685_gets_the_registers_of_its_data_sheet() -> None:
    bus = Bus()
    options = ServoPca9685Options.model_validate(
        {"pitch": {"channel": 4, "table": [[-90.0, 1000.0], [0.0, 2000.0]]}}
    )
    gimbal = ServoPca9685Gimbal(options, I2c(lambda _: bus, in_thread=False))

    async def scene(_: Gimbal) -> None:
        # Sleep, prescale 25 MHz / (4096 * 50 Hz) - 1 = 121, awake with auto-increment.
        assert bus.writes == [(0x40, 0x00, [0x30]), (0x40, 0xFE, [121]), (0x40, 0x00, [0x20])]
        bus.writes.clear()
        gimbal.command(GimbalCommand(0.0, math.radians(-45.0)))
        await asyncio.sleep(0.0)  # it is written beside the control task
        # 1500 us of 4.88 us steps: 307 = 0x133; LED4 begins at 0x06 + 16.
        assert bus.writes == [(0x40, 0x16, [0x00, 0x00, 0x33, 0x01])]
        bus.gone = True
        gimbal.command(GimbalCommand(0.0, -1.0))
        await asyncio.sleep(0.0)
        gimbal.command(GimbalCommand(0.0, -1.0))
        with pytest.raises(DeviceLost, match="PCA9685 at 0x40 of /dev/i2c-1: Remote I/O error"):
            await gimbal.state()
        with pytest.raises(DeviceLost):
            await gimbal.open()
        bus.gone = False
        await gimbal.open()
        assert (await gimbal.state()).pitch < 0.0

    run(gimbal, scene)


def test_pca9685_without_its_bus_is_lost() -> None:
    def open_bus(number: int) -> Bus:
        raise FileNotFoundError(2, "No such file or directory")

    with pytest.raises(DeviceLost, match="No such file"):
        asyncio.run(ServoPca9685Gimbal(ServoPca9685Options(), I2c(open_bus, in_thread=True)).open())


def test_two_servos_on_one_channel_are_refused() -> None:
    with pytest.raises(ValidationError, match="two channels, both are 0"):
        ServoOptions.model_validate({"yaw": TILT, "pitch": TILT})


def test_the_autopilots_outputs_count_from_one() -> None:
    with pytest.raises(ValidationError, match="channel: found 0"):
        ServoMavlinkOptions.model_validate({"pitch": TILT})


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"frequency_hz": 24.0, "oscillator_hz": 27e6}, "frequency_hz: expected 25.7 to 1648"),
        ({"frequency_hz": 1500.0}, "frequency_hz: expected less than 500"),
        ({"pitch": TILT | {"channel": 16}}, "channel: found 16, expected 0 to 15"),
    ],
)
def test_frequencies_and_channels_beyond_the_pca9685_are_refused(
    options: dict[str, Any], expected: str
) -> None:
    """The prescaler is one byte: once 274 became 18, and the pulses were 15 times too short."""
    with pytest.raises(ValidationError, match=expected):
        ServoPca9685Options.model_validate({"pitch": TILT, **options})
