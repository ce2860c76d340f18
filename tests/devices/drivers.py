"""Run as root in the virtual machine of `make test-devices`: drivers on the kernel's devices."""

import asyncio
import math
import os
import struct
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from smbus2 import SMBus

from hw.cameras.v4l2 import V4l2Camera, V4l2Options, cameras
from hw.cameras.v4l2_node import Filled, VideoNode
from hw.gimbals.servo_pca9685 import ServoPca9685Gimbal, ServoPca9685Options
from hw.gimbals.servo_sysfs import ServoSysfsGimbal, ServoSysfsOptions
from landerd.camera_model import load_camera
from landerd.messages import GimbalCommand, Prior
from landerd.pad import load_pad
from landerd.ports import DeviceLost, Gimbal
from landerd.vision import Vision
from tests.devices import hotplug
from tests.devices.bench import run_checks, sh, wait_for
from tests.devices.kernel import CAMERA, configuration, load_module, plug_in_camera

SIZE, FPS = (640, 480), 25.0


# ---- the camera ----


class CountedNode(VideoNode):
    """Notes what is taken from the kernel.

    Attributes:
        taken: numbers of the pictures, in order.
        suspect: those that were taken when the kernel had no buffer left, so that it may have
            dropped newer ones.
        empty_t: when it was last seen that the kernel holds no picture.
    """

    last: "CountedNode"

    def __init__(self, path: str) -> None:
        self.taken: list[int] = []
        self.suspect: set[int] = set()
        self.empty_t = 0.0
        self._lent = 0  # buffers that the kernel has
        self._batch: list[int] = []  # taken since it was last empty
        self._lent_before = 0
        CountedNode.last = self
        super().__init__(path)

    def queue(self, index: int) -> None:
        super().queue(index)
        self._lent += 1

    def dequeue(self) -> Filled | None:
        if not self._batch:
            self._lent_before = self._lent
        filled = super().dequeue()
        if filled is not None:
            self._lent -= 1
            self.taken.append(filled.sequence)
            self._batch.append(filled.sequence)
            return filled
        if len(self._batch) >= self._lent_before:
            self.suspect.update(self._batch)
        self._batch.clear()
        self.empty_t = time.monotonic()
        return None

    def drop_filled(self) -> int:
        """Give all filled buffers back and return how many there were."""
        count = len(self.taken)
        while (filled := self.dequeue()) is not None:
            self.queue(filled.buffer)
        return len(self.taken) - count


def with_camera(use: Callable[[V4l2Camera], Awaitable[None]], name: str = "YUYV") -> None:
    async def main() -> None:
        options = V4l2Options.model_validate(
            {"device": CAMERA, "width": 640, "height": 480, "fps": FPS, "format": name, "gain": 90}
        )
        driver = V4l2Camera(options=options, node=CountedNode)
        await driver.open()
        try:
            await use(driver)
        finally:
            await driver.close()

    asyncio.run(main())


def check_every_format_and_the_controls_of_a_camera() -> None:
    means = {}
    plug_in_camera()
    for name in ("GREY", "NV12", "YUYV"):

        async def use(driver: V4l2Camera, name: str = name) -> None:
            frame = await driver.newest()
            assert frame.image.shape == SIZE[::-1]
            means[name] = float(frame.image.mean())
            assert sh(f"v4l2-ctl -d {CAMERA} -C gain").endswith("90")
            assert not any("gain" in remark for remark in driver.remarks)

        with_camera(use, name)
    assert max(means.values()) - min(means.values()) < 15.0, means
    assert cameras()[0][0] == CAMERA


def check_the_newest_picture_under_load_and_after_half_a_second() -> None:
    """Counted in the kernel: what it has filled after the picture when that is handed over.

    Numbers alone do not tell: vivid skips some when it is late itself.
    """
    loaded = configuration()
    model = load_camera(loaded.config.camera.calibration)
    vision = Vision(load_pad(loaded.config.pad.layout), model, loaded.config.vision)
    behind: dict[str, list[int]] = {"search": [], "busy thread": [], "busy process": []}

    async def use(driver: V4l2Camera) -> None:
        node, frame = CountedNode.last, await driver.newest()
        for what in ["search"] * 15 + ["busy thread", "search", "busy process", "search"] * 3:
            if what == "search":
                await asyncio.to_thread(vision.process, frame, Prior())
            elif what == "busy thread":
                await asyncio.to_thread(time.sleep, 0.5)
            else:
                time.sleep(0.5)  # nothing runs, as when the machine swaps
            frame = await driver.newest()
            looked_t, newer = node.empty_t, node.drop_filled()
            if frame.seq in node.suspect:  # some were dropped before it was taken
                newer = (await driver.newest()).seq - frame.seq
            if node.empty_t - looked_t < 1.0 / FPS or frame.seq in node.suspect:
                behind[what].append(newer)  # else the machine stood still while it was counted

    with_camera(use)
    print("  pictures behind after", behind)
    assert len(behind["search"]) >= 10
    assert all(counts and max(counts) <= 1 for counts in behind.values())


# ---- servos ----


def as_landerd(use: Callable[[], None]) -> None:
    """Do it as the service's user with the service's groups."""
    groups = [int(sh(f"getent group {name} | cut -d: -f3")) for name in ("video", "i2c", "gpio")]
    uid, gid = int(sh("id -u landerd")), int(sh("id -g landerd"))
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.setgroups(groups)
            os.setgid(gid)
            os.setuid(uid)
            use()
            code = 0
        except BaseException as e:
            print(f"  as landerd: {e!r}", flush=True)
        os._exit(code)
    assert os.waitpid(child, 0)[1] == 0


def aim(driver: Gimbal, yaw_deg: float, pitch_deg: float, *, opens: int = 1) -> None:
    """Open a gimbal and aim it; a lost one is opened again, so often in all."""

    async def main() -> None:
        for left in reversed(range(opens)):
            await driver.open()
            driver.command(GimbalCommand(math.radians(yaw_deg), math.radians(pitch_deg)))
            try:
                await driver.state()
                break
            except DeviceLost as e:
                print(f"  {e}")
                if not left:
                    raise
                await asyncio.sleep(0.5)
        await driver.close()

    asyncio.run(main())


TABLES = {
    "yaw": {"channel": 3, "table": [[-90.0, 1000.0], [90.0, 2000.0]]},
    "pitch": {"channel": 0, "table": [[-90.0, 1000.0], [0.0, 2000.0]]},
}


def i2c_bus() -> int:
    """Return the number of the bus on which the kernel plays a PCA9685 and an MPU-6050."""
    load_module("modprobe i2c-dev && modprobe i2c-stub chip_addr=0x40,0x68")
    names = Path("/sys/bus/i2c/devices").glob("i2c-*/name")
    stub = next(path.parent for path in names if "stub" in path.read_text())
    wait_for(Path(f"/dev/{stub.name}").exists, "the bus")
    sh("udevadm settle")
    return int(stub.name.removeprefix("i2c-"))


def check_servos_on_a_pca9685() -> None:
    bus = i2c_bus()

    def use() -> None:
        options = {"bus": bus, "address": 0x40, **TABLES}
        aim(ServoPca9685Gimbal(ServoPca9685Options.model_validate(options)), 45.0, -45.0)
        absent = ServoPca9685Options.model_validate({**options, "address": 0x41})
        try:
            aim(ServoPca9685Gimbal(absent), 0.0, 0.0)
        except DeviceLost as e:
            print(f"  {e}")
        else:
            raise AssertionError("it took orders at an address where nothing is")

    as_landerd(use)
    with SMBus(bus) as chip:
        registers = [chip.read_byte_data(0x40, at) for at in range(6 + 16)]
        prescale = chip.read_byte_data(0x40, 0xFE)
    # NXP's PCA9685: 25 MHz / 4096 / 122 = 50.03 Hz; awake, with auto-increment.
    assert (registers[0], prescale) == (0x20, 121)
    # 1500 us of 19988.48 us in 4096 steps is 307.4; 1750 us is 358.6.
    assert registers[6:10] == [0, 0, 307 & 255, 307 >> 8]
    assert registers[6 + 12 : 6 + 16] == [0, 0, 359 & 255, 359 >> 8]


def check_an_imu_on_the_camera() -> None:
    bus = i2c_bus()
    # At rest, the lens 45 degrees down; at +-4 g a count is g/8192.
    force = struct.pack(">7h", -5793, 0, 5793, 0, 0, 0, 0)
    with SMBus(bus) as chip:
        chip.write_byte_data(0x68, 0x75, 0x68)  # WHO_AM_I
        for at, value in enumerate(force, start=0x3B):
            chip.write_byte_data(0x68, at, value)

    def use() -> None:
        options = {"bus": bus, **TABLES, "imu": {"kind": "mpu6050", "bus": bus}}
        driver = ServoPca9685Gimbal(ServoPca9685Options.model_validate(options))

        async def main() -> None:
            await driver.open()
            pitch = math.degrees((await driver.state()).pitch)
            await driver.close()
            assert abs(pitch + 45.0) < 0.1, pitch

        asyncio.run(main())

    as_landerd(use)
    with SMBus(bus) as chip:  # awake, +-500 degrees/s, +-4 g
        assert [chip.read_byte_data(0x68, at) for at in (0x6B, 0x1B, 0x1C)] == [0x01, 0x08, 0x08]


def check_servos_on_a_pwm_chip() -> None:
    load_module("insmod /opt/fake_pwm.ko")
    chip = next(Path("/sys/class/pwm").glob("pwmchip*"))
    sh("udevadm settle")

    def use() -> None:
        options = ServoSysfsOptions.model_validate({"chip": str(chip), **TABLES})
        # A channel that has just been exported belongs to root until udev has given it away.
        aim(ServoSysfsGimbal(options), 45.0, -45.0, opens=6)

    as_landerd(use)
    orders = sh("dmesg | grep fake_pwm:").splitlines()
    for channel, pulse in ((0, 1_500_000), (3, 1_750_000)):
        last = [line for line in orders if f"channel {channel} " in line][-1]
        assert last.endswith(f"period {20_000_000} pulse {pulse} on"), last


if __name__ == "__main__":
    # Those first that need a kernel into which nothing has been loaded.
    sys.exit(run_checks({**vars(hotplug), **globals()}, "DRIVERS"))
