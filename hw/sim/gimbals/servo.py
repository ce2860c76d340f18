"""Modelled servos on each of the three outputs: from pulses to the angles of the gimbal.

The outputs are those of the autopilot (DO_SET_SERVO), a PWM chip of the Linux kernel (sysfs), and a
PCA9685 on an I2C bus.
"""

import asyncio
import math
import tempfile
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import Message
from hw.gimbals.i2c import I2c
from hw.gimbals.servo import ServoAxisOptions, ServoOptions
from hw.gimbals.servo_mavlink import ServoMavlinkGimbal, ServoMavlinkOptions
from hw.gimbals.servo_pca9685 import (
    AUTO_INCREMENT,
    LED0_ON_L,
    MODE1,
    PRE_SCALE,
    SLEEP,
    STEPS,
    ServoPca9685Gimbal,
    ServoPca9685Options,
)
from hw.gimbals.servo_sysfs import ServoSysfsGimbal, ServoSysfsOptions
from hw.sim.gimbals.bench import Bench, Connected
from hw.sim.gimbals.imu import imu_bus
from hw.sim.gimbals.mount import SimMount

_FRAME_S = 0.02  # period of the pulses, once in which a servo takes a new width


class Servos:
    """The servos, each of which goes to the angle of its pulse, with the error of its linkage.

    Attributes:
        channels: of all servos.
    """

    def __init__(self, options: ServoOptions, mount: SimMount) -> None:
        """Take the servos' tables and channels, and the gimbal that they move."""
        self._yaw, self._pitch = options.yaw, options.pitch
        self.channels = [axis.channel for axis in options.axes]
        self._mount = mount
        if options.yaw is None:
            mount.plant.yaw.bolt(-mount.yaw_bias)

    def move(self, pulses: Mapping[int, float]) -> None:
        """Order the angles of pulse widths, us by channel; a servo without pulses stays."""
        mount = self._mount
        yaw, pitch = mount.ordered
        if self._yaw is not None and self._yaw.channel in pulses:
            yaw = angle_of(self._yaw, pulses[self._yaw.channel]) - mount.yaw_bias
        if self._pitch.channel in pulses:
            pitch = angle_of(self._pitch, pulses[self._pitch.channel]) - mount.pitch_bias
        mount.aim(yaw, pitch)


def angle_of(axis: ServoAxisOptions, pulse: float) -> float:
    """Return the angle of a servo, rad, at a pulse width, us, limited to its table."""
    rising = sorted((p, a) for a, p in axis.table)
    pulse = max(rising[0][0], min(rising[-1][0], pulse))
    for (p0, a0), (p1, a1) in pairwise(rising):
        if pulse <= p1:
            return math.radians(a0 + (a1 - a0) * (pulse - p0) / (p1 - p0))
    raise AssertionError("within the table")


class SetServo:
    """The autopilot's outputs under DO_SET_SERVO, as measured on ArduCopter."""

    streams: Mapping[int, Callable[[float, int], Message]] = {}

    def __init__(self, servos: Servos) -> None:
        """Take the servos on the outputs."""
        self._servos = servos

    def command(self, command: Message, t: float) -> int | None:
        """Move a servo and return a MAV_RESULT; None: it is another command.

        An output that has another function is refused.
        """
        if command.command != mavlink.MAV_CMD_DO_SET_SERVO:
            return None
        channel = round(command.param1)
        if channel not in self._servos.channels:
            return int(mavlink.MAV_RESULT_FAILED)
        self._servos.move({channel: command.param2})
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def message(self, message: Message, t: float) -> None:
        """Ignore all messages."""


def connect_mavlink(options: ServoMavlinkOptions, bench: Bench) -> Connected:
    """Return the driver; the servos are on the simulated autopilot."""
    assert bench.autopilot is not None
    bench.autopilot.attach(SetServo(Servos(options, bench.mount)))
    imu = imu_bus(options.imu, bench.mount)
    return ServoMavlinkGimbal(options, bench.driver, imu), None


class PwmChip:
    """A PWM chip of the Linux kernel as a tree of files, read once per period of the pulses."""

    def __init__(self, servos: Servos, chip: Path) -> None:
        """Make the chip's files in a folder that exists."""
        self._servos, self._chip = servos, chip
        (chip / "export").touch()
        for channel in servos.channels:
            folder = chip / f"pwm{channel}"
            folder.mkdir()
            for name in ("period", "duty_cycle", "enable"):
                (folder / name).write_text("0", encoding="ascii")

    async def run(self) -> None:
        """Move the servos by the files' pulses until cancelled."""
        while True:
            await asyncio.sleep(_FRAME_S)
            pulses = {}
            for channel in self._servos.channels:
                folder = self._chip / f"pwm{channel}"
                if _number(folder / "enable") and _number(folder / "period"):
                    pulses[channel] = 1e-3 * _number(folder / "duty_cycle")
            self._servos.move(pulses)


def _number(path: Path) -> int:
    """Return the number in a file; an empty one counts as 0."""
    return int(path.read_text(encoding="ascii") or "0")


class _OwnPwmChip(PwmChip):
    """A PWM chip in a temporary folder, which is removed when it stops."""

    def __init__(self, servos: Servos) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="landerd-pwm-")
        self.chip = Path(self._folder.name)
        super().__init__(servos, self.chip)

    async def run(self) -> None:
        with self._folder:
            await super().run()


def connect_sysfs(options: ServoSysfsOptions, bench: Bench) -> Connected:
    """Return driver and chip; the chip's files are in a temporary folder."""
    chip = _OwnPwmChip(Servos(options, bench.mount))
    own = options.model_copy(update={"chip": chip.chip})
    return ServoSysfsGimbal(own, imu_bus(options.imu, bench.mount)), chip


class Pca9685Model:
    """The registers of a PCA9685 on an I2C bus of its own, used like a smbus2.SMBus.

    Attributes:
        gone: fault: the chip does not answer.
    """

    def __init__(self, servos: Servos, address: int, oscillator_hz: float) -> None:
        """Take the servos, the chip's address on the bus, and its clock."""
        self.gone = False
        self._servos, self._address = servos, address
        self._oscillator_hz = oscillator_hz
        self._registers = bytearray(256)
        self._registers[MODE1] = SLEEP | 0x01  # as after power-on
        self._registers[PRE_SCALE] = 0x1E

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        """Write one register. Raises OSError."""
        self._select(i2c_addr)
        if register != PRE_SCALE or self._registers[MODE1] & SLEEP:  # else it is locked
            self._registers[register] = value

    def write_i2c_block_data(self, i2c_addr: int, register: int, data: list[int]) -> None:
        """Write bytes to consecutive registers, and move the servos. Raises OSError."""
        self._select(i2c_addr)
        increment = 1 if self._registers[MODE1] & AUTO_INCREMENT else 0
        for i, value in enumerate(data):
            self._registers[register + i * increment] = value
        if not self._registers[MODE1] & SLEEP:
            self._servos.move({c: self.pulse_us(c) for c in self._servos.channels})

    def close(self) -> None:
        """Release the bus."""

    def pulse_us(self, channel: int) -> float:
        """Return a channel's pulse width, us."""
        at = LED0_ON_L + 4 * channel
        on, off = (self._registers[i] | self._registers[i + 1] << 8 for i in (at, at + 2))
        step_us = 1e6 * (self._registers[PRE_SCALE] + 1) / self._oscillator_hz
        return ((off - on) % STEPS) * step_us

    def _select(self, address: int) -> None:
        if self.gone or address != self._address:
            raise OSError(121, "Remote I/O error")


def connect_pca9685(options: ServoPca9685Options, bench: Bench) -> Connected:
    """Return the driver, on a bus with a modelled chip."""
    chip = Pca9685Model(Servos(options, bench.mount), options.address, options.oscillator_hz)
    imu = imu_bus(options.imu, bench.mount)
    return ServoPca9685Gimbal(options, I2c(lambda _: chip, in_thread=False), imu), None
