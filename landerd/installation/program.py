"""The program itself, in a Python environment of its own below /opt.

Debian's Python takes no packages from elsewhere (PEP 668), and the service can see no home folder.
The environment sees Debian's packages too: picamera2 and GStreamer's binding come only as those.
"""

import hashlib
import importlib.util
import shutil
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from landerd.installation.steps import InstallError, Step, call

OPT = Path("/opt/landerd")
VENV = OPT / "venv"
PROGRAM = VENV / "bin" / "landerd"
_PIP = (str(VENV / "bin" / "python"), "-m", "pip", "--quiet", "--disable-pip-version-check")
_SOURCE_SUM = OPT / "source.sha256"  # of what the environment was filled from
_HOMES = (Path("/home"), Path("/root"), Path("/run/user"))  # hidden by the unit's ProtectHome
_PARTS = ("landerd", "hw", "config", "systemd", "ardupilot", "pyproject.toml")  # of a checkout


def is_installed_copy() -> bool:
    """Tell whether this process runs the program in /opt."""
    return Path(sys.prefix) == VENV


def source() -> Path:
    """Return the wheel or the checkout that this process runs from.

    Raises:
        InstallError: it runs from neither.
    """
    here = Path(__file__)
    for wheel in here.parents:
        if wheel.is_file():
            return wheel
    checkout = here.parents[2]
    if (checkout / "pyproject.toml").is_file():
        return checkout
    raise InstallError(
        f"landerd runs from {here.parents[1]}, which cannot be copied to {VENV}; run it from a "
        "checkout (sudo python3 -m landerd install) or out of its wheel "
        "(sudo python3 landerd-VERSION.whl/landerd install)"
    )


def program_steps(origin: Path) -> Iterator[Step]:
    """Yield what brings the program of a wheel or checkout to /opt, if it is another one there."""
    new = _sum_of(origin)
    if PROGRAM.exists() and _SOURCE_SUM.exists() and _SOURCE_SUM.read_text() == new:
        return
    if not (VENV / "bin" / "python").exists():
        if importlib.util.find_spec("ensurepip") is None:
            if shutil.which("apt-get") is None:
                raise InstallError("Python's venv module is missing: install your system's package")
            apt = ("apt-get", "install", "--yes", "--quiet", "python3-venv")
            yield Step("install Debian's package python3-venv", partial(call, *apt))
        yield Step(f"make a Python environment in {VENV}", make_environment)

    def fill() -> None:
        if origin.is_file():  # a wheel of the same version is taken for installed
            call(*_PIP, "install", "--force-reinstall", "--no-deps", str(origin))
        call(*_PIP, "install", str(origin), where=OPT)
        _SOURCE_SUM.write_text(new)

    yield Step(f"install landerd from {origin} into it", fill)


def picamera2_steps() -> Iterator[Step]:
    """Yield what lets the system's picamera2, if it is there, be imported in the environment.

    It imports simplejpeg, which Debian 12 builds for numpy 1, and landerd needs numpy 2:
    raspberrypi/picamera2 issue 1211. From 1.8.1 on simplejpeg has what newer picamera2 asks of it.
    """
    has_its_own = any(VENV.glob("lib/python*/site-packages/simplejpeg"))
    if importlib.util.find_spec("picamera2") is None or has_its_own:
        return
    # pip would be content with the system's.
    words = ("install", "--ignore-installed", "--no-deps", "simplejpeg>=1.8.1")
    text = f"install simplejpeg for numpy 2, which picamera2 needs, into {VENV}"
    yield Step(text, partial(call, *_PIP, *words, where=OPT))


def make_environment() -> None:
    """Make the environment of this Python. Raises InstallError."""
    base = Path(sys.base_prefix).resolve()
    if any(base.is_relative_to(home) for home in _HOMES):
        raise InstallError(
            f"this Python is in {base}, and the service can see no home folder; "
            "run it with the system's: sudo /usr/bin/python3 ..."
        )
    call(sys.executable, "-m", "venv", "--system-site-packages", str(VENV))


def _sum_of(origin: Path) -> str:
    """Return a checksum of what would be installed."""
    if origin.is_file():
        return hashlib.sha256(origin.read_bytes()).hexdigest()
    total = hashlib.sha256()
    for part in _PARTS:
        top = origin / part
        for path in [top] if top.is_file() else sorted(top.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                total.update(f"{path.relative_to(origin)}\0".encode() + path.read_bytes())
    return total.hexdigest()
