"""Servos on the kernel's PWM outputs: Raspberry Pi (dtoverlay=pwm-2chan), Navio2 (rcio_pwm).

Source: Linux kernel, Documentation/driver-api/pwm.rst, "Using PWMs with the sysfs interface":
export, period and duty_cycle in nanoseconds, enable.
"""

import asyncio
import math
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from hw.gimbals.i2c import KERNELS, I2c
from hw.gimbals.imu import ReadableBus
from hw.gimbals.servo import ServoGimbal, ServoOptions
from landerd.ports import DeviceLost

_LOOK_S = 1.0  # interval at which it is checked that a channel is still enabled


class ServoSysfsOptions(ServoOptions):
    """Servos on a PWM chip of the kernel's; their channels are the chip's."""

    chip: Path = Path("/sys/class/pwm/pwmchip0")
    frequency_hz: Annotated[float, Field(ge=40, le=400)] = 50.0

    @model_validator(mode="after")
    def _within_the_period(self) -> "ServoSysfsOptions":
        self.see_pulses_fit(self.frequency_hz)
        return self


class ServoSysfsGimbal(ServoGimbal):
    """Servos on sysfs PWM."""

    def __init__(self, options: ServoSysfsOptions, imu_i2c: I2c[ReadableBus] = KERNELS) -> None:
        super().__init__(options, SysfsPwm(options.chip, options.frequency_hz), imu_i2c)


class SysfsPwm:
    """A PWM chip's channels as files."""

    def __init__(self, chip: Path, frequency_hz: float) -> None:
        self._chip = chip
        self._period_ns = round(1e9 / frequency_hz)
        self._ready: set[int] = set()
        self._looked_t = -math.inf

    async def open(self) -> None:
        """Check that the chip is there. Raises DeviceLost."""
        self._ready.clear()
        if not (self._chip / "export").exists():
            raise DeviceLost(f"{self._chip}: no such PWM chip")

    def write(self, pulses: dict[int, float]) -> None:
        """Set pulse widths, us by channel; a new channel is exported first.

        Raises:
            DeviceLost: writing failed, or another program has disabled a channel, as ArduPilot
                does with all those of its board when it starts; reopening enables it again.
        """
        now = asyncio.get_running_loop().time()
        is_due = now - self._looked_t >= _LOOK_S
        if is_due:
            self._looked_t = now
        for channel, pulse_us in pulses.items():
            folder = self._chip / f"pwm{channel}"
            try:
                if channel not in self._ready:
                    self._export(channel, folder)
                _put(folder / "duty_cycle", round(1e3 * pulse_us))
                if channel not in self._ready:
                    _put(folder / "enable", 1)
                    self._ready.add(channel)
                if is_due and _get(folder / "enable") == 0:
                    raise DeviceLost(f"{folder}: another program has switched it off")
            except OSError as e:
                raise DeviceLost(f"{e.filename or folder}: {e.strerror}") from None

    async def close(self) -> None:
        """Leave the pulses as they are."""

    def _export(self, channel: int, folder: Path) -> None:
        if not folder.exists():
            _put(self._chip / "export", channel)
        duty = folder / "duty_cycle"
        if _get(duty) > self._period_ns:
            _put(duty, 0)  # the kernel refuses a period shorter than the pulse
        _put(folder / "period", self._period_ns)


def _put(path: Path, value: int) -> None:
    path.write_text(str(value), encoding="ascii")


def _get(path: Path) -> int:
    return int(path.read_text(encoding="ascii") or 0)
