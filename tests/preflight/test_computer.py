"""Findings on the companion computer, from files as Linux has them."""

import os
from pathlib import Path

import pytest

from landerd.preflight.computer import budget_finding, computer_findings, temperature_c

UART = "serial:/dev/serial0?baud=921600"
USB = "serial:/dev/ttyACM0"
THROTTLED = "sys/devices/platform/soc/soc:firmware/get_throttled"
THROTTLED_5 = "sys/devices/platform/soc@107c000000/soc@107c000000:firmware/get_throttled"


class Linux:
    """The files of a Raspberry Pi in good order; tests break them."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.say("dev/ttyAMA0", "")
        self.say("dev/ttyACM0", "")
        (root / "dev/serial0").symlink_to("ttyAMA0")
        self.say("proc/cmdline", "console=tty1 root=PARTUUID=7 rootfstype=ext4 rootwait\n")
        self.say("proc/1/cmdline", "/sbin/init\0splash\0")
        self.say("proc/612/cmdline", "/sbin/agetty\0-o\0-p -- \\u\0--noclear\0tty1\0linux\0")
        self.say("sys/class/thermal/thermal_zone0/temp", "48312\n")
        self.say(THROTTLED, "0\n")

    def say(self, path: str, text: str) -> None:
        (self.root / path).parent.mkdir(parents=True, exist_ok=True)
        (self.root / path).write_text(text)

    def told(self, url: str) -> list[tuple[str, str, str, str]]:
        found = computer_findings(url, self.root)
        return [(f.level, f.item, f.what, f.mend) for f in found if f.level != "ok"]


@pytest.fixture
def linux(tmp_path: Path) -> Linux:
    return Linux(tmp_path)


@pytest.mark.parametrize("url", [UART, USB, "udpin:127.0.0.1:14550"])
def test_a_sound_computer_has_no_warning(linux: Linux, url: str) -> None:
    assert linux.told(url) == []
    assert {f.item for f in computer_findings(url, linux.root)} == {"computer", "temperature"}


def test_a_computer_without_any_of_linuxs_files_has_no_warning(tmp_path: Path) -> None:
    assert [f.level for f in computer_findings(UART, tmp_path)] == ["ok"]


@pytest.mark.parametrize(
    ("path", "text", "level", "item", "what", "mend"),
    [
        ("proc/cmdline", "console=serial0,115200 console=tty1", "fail", "console", "kernel writes",
         "raspi-config"),
        ("proc/cmdline", "console=ttyAMA0,115200", "fail", "console", "ttyAMA0", "restart"),
        ("proc/700/cmdline", "/sbin/agetty\0-o\0115200\0ttyAMA0\0vt220\0", "fail", "console",
         "login shell (agetty)", "disable --now serial-getty@ttyAMA0"),
        ("proc/701/cmdline", "/bin/sh\0/etc/systemd/nvgetty.sh\0ttyAMA0\0", "fail", "console",
         "nvgetty", "disable --now nvgetty"),
        (THROTTLED, "50005", "fail", "supply", "too low: the computer slows", "5.1 V"),
        (THROTTLED, "10000", "warn", "supply", "was too low", "5.1 V"),
        (THROTTLED, "80000", "warn", "temperature", "was slowed down", "fan"),
        ("sys/class/thermal/thermal_zone1/temp", "79500", "warn", "temperature", "80 degrees",
         "fan"),
    ],
)  # fmt: skip
def test_each_defect_of_the_computer_is_reported_with_its_remedy(
    linux: Linux, path: str, text: str, level: str, item: str, what: str, mend: str
) -> None:
    linux.say(path, text)
    told = linux.told(UART)
    assert (level, item) in [(found[0], found[1]) for found in told]
    assert any(what in found[2] and mend in found[3] for found in told)


def test_a_low_supply_of_a_raspberry_pi_5_is_named(linux: Linux) -> None:
    (linux.root / THROTTLED).unlink()
    linux.say(THROTTLED_5, "50005\n")
    assert ("fail", "supply") in [(level, item) for level, item, *_ in linux.told(UART)]


def test_the_constant_of_a_jetsons_power_chip_is_not_taken_for_a_temperature(linux: Linux) -> None:
    for zone, (kind, temperature) in enumerate((("CPU-therm", "38000"), ("PMIC-Die", "100000"))):
        linux.say(f"sys/class/thermal/thermal_zone{zone}/type", f"{kind}\n")
        linux.say(f"sys/class/thermal/thermal_zone{zone}/temp", f"{temperature}\n")
    assert linux.told(UART) == []
    assert temperature_c(linux.root) == 38.0


def test_a_console_on_another_serial_port_is_no_warning(linux: Linux) -> None:
    linux.say("proc/cmdline", "console=serial0,115200 console=tty1")
    assert linux.told(USB) == []


def test_the_debug_plug_of_a_raspberry_pi_5_is_told_from_its_header(linux: Linux) -> None:
    linux.say("dev/ttyAMA10", "")
    (linux.root / "dev/serial0").unlink()
    (linux.root / "dev/serial0").symlink_to("ttyAMA10")
    ((level, item, what, mend),) = linux.told(UART)
    assert (level, item) == ("warn", "port")
    assert "pins 8 and 10" in what
    assert "serial:/dev/ttyAMA0" in mend
    assert "dtparam=uart0=on" in mend
    assert linux.told("serial:/dev/ttyAMA0?baud=921600") == []


def test_modem_manager_is_reported_unless_a_udev_rule_keeps_it_away(linux: Linux) -> None:
    linux.say("proc/800/cmdline", "/usr/sbin/ModemManager\0")
    assert [(level, item) for level, item, *_ in linux.told(USB)] == [("warn", "ModemManager")]
    assert linux.told(UART) == []  # it asks ports on USB only
    number = (linux.root / "dev/ttyACM0").stat().st_rdev
    about = f"run/udev/data/c{os.major(number)}:{os.minor(number)}"
    linux.say(about, "E:ID_MM_DEVICE_IGNORE=1\n")
    assert linux.told(USB) == []


@pytest.mark.parametrize(
    ("pictures_hz", "p99_s", "level"),
    [(200.0, 0.04, "ok"), (25.0, 0.04, "warn"), (50.0, 0.2, "warn"), (8.0, 0.04, "fail")],
)
def test_a_slow_computer_is_named(pictures_hz: float, p99_s: float, level: str) -> None:
    found = budget_finding(pictures_hz, 0.02, p99_s, 0.0, 30.0)
    assert (found.level, found.item) == (level, "budget")
    assert f"{pictures_hz:.0f} pictures searched a second" in found.what
