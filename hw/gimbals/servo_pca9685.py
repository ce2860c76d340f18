"""Servos on a PCA9685, the PWM chip of the common 16-channel servo boards, over I2C.

Source: NXP, "PCA9685 16-channel, 12-bit PWM Fm+ I2C-bus LED controller", rev. 4: MODE1 (7.3.1),
LEDn_ON and LEDn_OFF (7.3.3), PRE_SCALE (7.3.5), which may only be written in sleep.
"""

import asyncio
from functools import partial
from typing import Annotated, Protocol

from pydantic import Field, model_validator

from hw.gimbals.i2c import KERNELS, I2c, I2cDevice
from hw.gimbals.imu import ReadableBus
from hw.gimbals.servo import ServoGimbal, ServoOptions
from landerd.ports import DeviceLost

MODE1, LED0_ON_L, PRE_SCALE = 0x00, 0x06, 0xFE
AUTO_INCREMENT, SLEEP = 0x20, 0x10
STEPS = 4096  # of one period
LEAST_PRESCALE, MOST_PRESCALE = 3, 255  # section 7.3.5
_LAST_CHANNEL = 15


class ServoPca9685Options(ServoOptions):
    """Servos on a PCA9685; their channels are the chip's, 0 to 15."""

    bus: Annotated[int, Field(ge=0, le=99)] = 1  # /dev/i2c-1
    address: Annotated[int, Field(ge=0x08, le=0x77)] = 0x40
    frequency_hz: Annotated[float, Field(ge=24, le=1500)] = 50.0  # digital servos: up to 300
    oscillator_hz: Annotated[float, Field(ge=20e6, le=50e6)] = (
        25e6  # boards are off by some percent
    )

    @model_validator(mode="after")
    def _within_the_chip(self) -> "ServoPca9685Options":
        if not LEAST_PRESCALE <= self.prescale <= MOST_PRESCALE:
            least, most = (
                self.oscillator_hz / (STEPS * (n + 1)) for n in (MOST_PRESCALE, LEAST_PRESCALE)
            )
            raise ValueError(
                f"frequency_hz: expected {least:.1f} to {most:.0f} with this oscillator_hz"
            )
        for axis in self.axes:
            if axis.channel > _LAST_CHANNEL:
                raise ValueError(f"channel: found {axis.channel}, expected 0 to {_LAST_CHANNEL}")
        self.see_pulses_fit(self.frequency_hz)
        return self

    @property
    def prescale(self) -> int:
        """Divisor of the oscillator's frequency minus one, as PRE_SCALE takes it (7.3.5)."""
        return round(self.oscillator_hz / (STEPS * self.frequency_hz)) - 1


class WritableBus(Protocol):
    """The part of an I2C bus (smbus2.SMBus) that is used."""

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
        i2c: I2c[WritableBus] = KERNELS,
        imu_i2c: I2c[ReadableBus] = KERNELS,
    ) -> None:
        super().__init__(options, Pca9685(options, i2c), imu_i2c)


class Pca9685:
    """The chip: each channel's pulse has 12 bits of resolution in a common period."""

    def __init__(self, options: ServoPca9685Options, i2c: I2c[WritableBus]) -> None:
        self._address = options.address
        self._device = I2cDevice(f"PCA9685 at 0x{options.address:02x}", options.bus, i2c)
        self._prescale = options.prescale
        self._step_us = 1e6 * (self._prescale + 1) / options.oscillator_hz
        self._next: dict[int, float] | None = None  # pulses not written yet
        self._writing: asyncio.Task[None] | None = None
        self._failure: DeviceLost | None = None

    async def open(self) -> None:
        """Set the period and wake the chip. Raises DeviceLost."""
        self._next = self._failure = None
        await self._device.open(self._set_up)

    def write(self, pulses: dict[int, float]) -> None:
        """Schedule pulse widths, us by channel. Raises DeviceLost if the last write failed."""
        if self._failure is not None:
            raise self._failure
        self._next = pulses
        if self._writing is None or self._writing.done():
            self._writing = asyncio.create_task(self._write())

    async def close(self) -> None:
        """Release the bus; the chip keeps sending the last pulses."""
        self._next = None
        await self._device.close()

    async def _write(self) -> None:
        """Write the newest pulses until there are no newer ones."""
        while (pulses := self._next) is not None:
            self._next = None
            try:
                await self._device.do(partial(self._put, pulses))
            except DeviceLost as e:
                self._failure = e
                return

    def _set_up(self, bus: WritableBus) -> None:
        bus.write_byte_data(self._address, MODE1, SLEEP | AUTO_INCREMENT)
        bus.write_byte_data(self._address, PRE_SCALE, self._prescale)
        bus.write_byte_data(self._address, MODE1, AUTO_INCREMENT)

    def _put(self, pulses: dict[int, float], bus: WritableBus) -> None:
        for channel, pulse_us in pulses.items():
            off = min(STEPS - 1, round(pulse_us / self._step_us))
            register = LED0_ON_L + 4 * channel
            bus.write_i2c_block_data(self._address, register, [0, 0, off & 0xFF, off >> 8])
