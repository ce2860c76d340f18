"""Checks the companion computer: other users of the autopilot's port, temperature, power supply.

It reads the files in which Linux reports these, below a root that tests can choose.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from landerd.preflight.finding import Finding

_DEBUG_TTY = "ttyAMA10"  # of a Raspberry Pi 5, where /dev/serial0 points to it
_HOT_C = 75.0  # temperature that is warned of; a Raspberry Pi slows down from 80 on
_NO_SENSOR = "PMIC-Die"  # of a Jetson: always says 100 degrees
_NOW_LOW, _WAS_LOW = 1 << 0, 1 << 16  # of get_throttled (Raspberry Pi's firmware)
_NOW_SLOW, _WAS_SLOW = 1 << 2 | 1 << 3, 1 << 18 | 1 << 19
_SLOWEST_HZ = 10.0  # least rate of searched pictures; at a lower one the pad's motion is seen late
_LATE_S = 0.1  # longest delay from a picture to the set-point: half a metre at 5 m/s
SYSTEM = Path("/")


def computer_findings(autopilot_url: str, root: Path = SYSTEM) -> list[Finding]:
    """Return the findings on this computer; one says so if nothing is wrong."""
    found = [*_port(autopilot_url, root), *_power(root), *_heat(root)]
    if all(f.level == "ok" for f in found):
        found.insert(0, Finding("ok", "computer", "nobody else uses the autopilot's port"))
    return found


def budget_finding(
    pictures_hz: float, median_s: float, p99_s: float, gap_s: float, fps: float | None
) -> Finding:
    """Return whether a computer is fast enough.

    Args:
        pictures_hz: searched one after the other.
        median_s: from a picture's coming to the next set-point; and `p99_s`.
        gap_s: the longest of the control task; set-points are late by it.
        fps: of the camera; None: not known.
    """
    text = (
        f"{pictures_hz:.0f} pictures searched a second; from picture to set-point "
        f"{1e3 * median_s:.0f} ms, at most {1e3 * p99_s:.0f} ms in 99 of 100; longest gap of the "
        f"control task {1e3 * gap_s:.0f} ms"
    )
    mend = "smaller pictures, a larger vision.min_ring_px, fewer other programs, a cooler computer"
    if pictures_hz < _SLOWEST_HZ or p99_s > 3.0 * _LATE_S:
        return Finding("fail", "budget", text, mend)
    if pictures_hz < (fps or 0.0) or p99_s > _LATE_S:
        return Finding("warn", "budget", text, mend)
    return Finding("ok", "budget", text)


def temperature_c(root: Path = SYSTEM) -> float | None:
    """Return the temperature of the hottest part; None: there is no sensor."""
    zones = (root / "sys/class/thermal").glob("thermal_zone*")
    told = (_read(zone / "temp") for zone in zones if _read(zone / "type").strip() != _NO_SENSOR)
    return max((float(text) / 1e3 for text in told if text), default=None)


def _port(url: str, root: Path) -> Iterator[Finding]:
    kind, _, rest = url.partition(":")
    if kind != "serial":
        return
    device = root / rest.partition("?")[0].lstrip("/")
    tty = device.resolve().name
    if tty == _DEBUG_TTY:
        yield Finding(
            "warn",
            "port",
            f"{tty} is the plug of three pins for debugging of a Raspberry Pi 5, not pins 8 and 10 "
            "of its header",
            "if you use these pins: autopilot.url serial:/dev/ttyAMA0?baud=..., and "
            "dtparam=uart0=on in /boot/firmware/config.txt (raspi-config: serial hardware yes)",
        )
    for token in _read(root / "proc/cmdline").split():
        name = token.removeprefix("console=").partition(",")[0]
        if token.startswith("console=") and (root / "dev" / name).resolve().name == tty:
            yield Finding(
                "fail",
                "console",
                f"the kernel writes its messages to {tty}, the autopilot's port",
                f"take {token} out of the kernel's command line (raspi-config: login shell over "
                "serial no) and restart",
            )
    for program, words in _processes(root):
        if "getty" in program and tty in words:
            unit = "nvgetty" if "nvgetty" in program else f"serial-getty@{tty}"
            yield Finding(
                "fail",
                "console",
                f"a login shell ({program}) reads what the autopilot sends to {tty}",
                f"sudo systemctl disable --now {unit}",
            )
        if program == "ModemManager" and _may_be_a_modem(tty, device, root):
            yield Finding(
                "warn",
                "ModemManager",
                f"talks to {tty} as to a modem when the autopilot is plugged in",
                "sudo landerd install writes a rule against it; or: sudo systemctl disable --now "
                "ModemManager",
            )


def _processes(root: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield name and arguments of every process."""
    for path in (root / "proc").glob("[0-9]*/cmdline"):
        name, *arguments = _read(path).rstrip("\0").split("\0")
        # nvgetty is a shell script: its name is the shell's first argument
        script = arguments[:1] if name.endswith("sh") else []
        words = [word.removeprefix("/dev/") for word in arguments]
        yield Path(script[0] if script else name).name.split(" ")[0], words


def _may_be_a_modem(tty: str, device: Path, root: Path) -> bool:
    """Tell whether ModemManager asks a port: those on USB that no rule of udev's keeps it from."""
    if not tty.startswith(("ttyACM", "ttyUSB")) or not device.exists():
        return False
    number = device.stat().st_rdev
    about = _read(root / f"run/udev/data/c{os.major(number)}:{os.minor(number)}")
    return "ID_MM_DEVICE_IGNORE=1" not in about


def _power(root: Path) -> Iterator[Finding]:
    # soc/soc:firmware; on a Raspberry Pi 5 soc@107c000000/soc@107c000000:firmware
    files = (root / "sys/devices/platform").glob("soc*/*firmware/get_throttled")
    text = next(map(_read, files), "").strip()
    bits = int(text, 16) if re.fullmatch(r"(0x)?[0-9a-fA-F]+", text) else 0
    supply = "a supply of 5.1 V and 3 A (Raspberry Pi 5: 5 A) or more, with short thick wires"
    if bits & _NOW_LOW:
        what = "the supply's voltage is too low: the computer slows down, and may restart in flight"
        yield Finding("fail", "supply", what, supply)
    elif bits & _WAS_LOW:
        what = "the supply's voltage was too low since the computer was started"
        yield Finding("warn", "supply", what, supply)
    if bits & (_NOW_SLOW | _WAS_SLOW):
        when = "is" if bits & _NOW_SLOW else "was"
        what = f"the computer {when} slowed down against heat: pictures are searched late"
        yield Finding("warn", "temperature", what, "a heat sink or fan; out of the sun")


def _heat(root: Path) -> Iterator[Finding]:
    temperature = temperature_c(root)
    if temperature is None:
        return
    text = f"{temperature:.0f} degrees C"
    if temperature > _HOT_C:
        what = f"{text}: hotter than {_HOT_C:.0f} it soon slows down"
        yield Finding("warn", "temperature", what, "a heat sink or fan; out of the sun")
    else:
        yield Finding("ok", "temperature", text)


def _read(path: Path) -> str:
    """Return a file's text; an empty one if it is missing or cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
