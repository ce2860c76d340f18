"""Servos on a PCA9685, the PWM chip of the common 16-channel servo boards, over I2C.

Source: NXP, "PCA9685 16-channel, 12-bit PWM Fm+ I2C-bus LED controller", rev. 4: MODE1 (7.3.1),
LEDn_ON and LEDn_OFF (7.3.3), PRE_SCALE (7.3.5), which may only be written in sleep.
"""

from collections.abc import Callable
from typing import Annotated, Protocol

from pydantic import Field
from smbus2 import SMBus

from hw.gimbals.servo import OpenBus, ServoGimbal, ServoOptions
from landerd.ports import DeviceLost

MODE1, LED0_ON_L, PRE_SCALE = 0x00, 0x06, 0xFE
RESTART, AUTO_INCREMENT, SLEEP = 0x80, 0x20, 0x10
STEPS = 4096  # of one period


class ServoPca9685Options(ServoOptions):
    """Servos on a PCA9685; their channels are the chip's, 0 to 15."""

    bus: Annotated[int, Field(ge=0, le=99)] = 1  # /dev/i2c-1
    address: Annotated[int, Field(ge=0x08, le=0x77)] = 0x40
    frequency_hz: Annotated[float, Field(ge=24, le=1500)] = 50.0  # digital servos: up to 300
    oscillator_hz: Annotated[float, Field(ge=20e6, le=50e6)] = (
        25e6  # boards are off by some percent
    )


class Bus(Protocol):
    """What is used of an I2C bus (smbus2.SMBus)."""

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None: ...  # noqa: D102
    def write_i2c_block_data(  # noqa: D102
        self, i2c_addr: int, register: int, data: list[int]
    ) -> None: ...
    def close(self) -> None: ...  # noqa: D102


class ServoPca9685Gimbal(ServoGimbal):
    """Servos on a PCA9685."""

    def __init__(
        self,
        options: ServoPca9685Options,
        open_bus: Callable[[int], Bus] = SMBus,
        open_imu: OpenBus = SMBus,
    ) -> None:
        super().__init__(options, Pca9685(options, open_bus), open_imu)


class Pca9685:
    """The chip: twelve bits of time for each channel in a common period."""

    def __init__(self, options: ServoPca9685Options, open_bus: Callable[[int], Bus]) -> None:
        self._options, self._open_bus = options, open_bus
        self._bus: Bus | None = None
        # 7.3.5: round(oscillator / (4096 * frequency)) - 1
        self._prescale = round(options.oscillator_hz / (STEPS * options.frequency_hz)) - 1
        self._step_us = 1e6 * (self._prescale + 1) / options.oscillator_hz

    def open(self) -> None:
        """Set the period and wake the chip. Raises DeviceLost."""
        self.close()
        address = self._options.address
        try:
            self._bus = self._open_bus(self._options.bus)
            self._bus.write_byte_data(address, MODE1, SLEEP | AUTO_INCREMENT)
            self._bus.write_byte_data(address, PRE_SCALE, self._prescale)
            self._bus.write_byte_data(address, MODE1, AUTO_INCREMENT)
        except OSError as e:
            raise self._lost(e) from None

    def write(self, pulses: dict[int, float]) -> None:
        """Set pulse widths, us by channel. Raises DeviceLost."""
        if self._bus is None:
            return
        try:
            for channel, pulse_us in pulses.items():
                off = min(STEPS - 1, round(pulse_us / self._step_us))
                self._bus.write_i2c_block_data(
                    self._options.address, LED0_ON_L + 4 * channel, [0, 0, off & 0xFF, off >> 8]
                )
        except OSError as e:
            raise self._lost(e) from None

    def close(self) -> None:
        """Release the bus; the chip goes on with the last pulses."""
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()

    def _lost(self, e: OSError) -> DeviceLost:
        o = self._options
        return DeviceLost(f"PCA9685 at 0x{o.address:02x} of /dev/i2c-{o.bus}: {e.strerror or e}")
