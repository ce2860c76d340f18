"""The CSI drivers as far as they can be tested without boards; picamera2 is a model."""

import asyncio
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hw.cameras.gstreamer import GstreamerCamera, GstreamerOptions
from hw.cameras.picamera2 import Picamera2Camera, Picamera2Options
from landerd.messages import ExposureOrder
from landerd.ports import DeviceLost, NotInstalled


class Request:
    """A YUV420 picture: brightness on top, colour below, lines wider than the picture."""

    def __init__(self, value: int, stamp_s: float, exposure_us: int) -> None:
        self._value = value
        self._metadata = {"SensorTimestamp": int(1e9 * stamp_s), "ExposureTime": exposure_us}

    def make_array(self, name: str) -> Any:
        assert name == "main"
        planes = np.full((72, 96), 255, np.uint8)
        planes[:48, :64] = self._value
        return planes

    def get_metadata(self) -> dict[str, int]:
        return self._metadata


class Model:
    """A model of picamera2.Picamera2, after its manual."""

    made: list["Model"] = []  # noqa: RUF012

    def __init__(self, number: int) -> None:
        if number > 0:
            raise IndexError("list index out of range")
        self.pre_callback: Callable[[Request], None] | None = None
        self.closed = False
        Model.made.append(self)

    def create_video_configuration(self, **settings: Any) -> dict[str, Any]:
        return settings

    def configure(self, settings: dict[str, Any]) -> None:
        self.settings = settings

    def camera_configuration(self) -> dict[str, Any]:
        width, height = self.settings["main"]["size"]
        return {"main": {"size": (width - width % 2, height)}}

    def start(self) -> None: ...

    def set_controls(self, controls: dict[str, Any]) -> None:
        self.settings["controls"] |= controls

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def picamera2(monkeypatch: pytest.MonkeyPatch) -> list[Model]:
    module = types.ModuleType("picamera2")
    module.Picamera2 = Model  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "picamera2", module)
    Model.made.clear()
    return Model.made


def test_a_pi_camera_gives_the_newest_brightness_and_the_middle_of_the_exposure(
    picamera2: list[Model],
) -> None:
    options = Picamera2Options(width=64, height=48, exposure_s=0.004, gain=2.0)

    async def main() -> None:
        driver = Picamera2Camera(options=options)
        await driver.open()
        (camera,) = picamera2
        assert camera.settings["main"]["size"] == (64, 48)
        assert camera.settings["controls"]["ExposureTime"] == 4000
        assert camera.settings["controls"]["AeEnable"] is False
        end = time.clock_gettime(time.CLOCK_BOOTTIME) - 0.05
        now = asyncio.get_running_loop().time()

        def send() -> None:
            for value in (10, 20):
                assert camera.pre_callback is not None
                camera.pre_callback(Request(value, end, 4000))

        await asyncio.to_thread(send)
        await asyncio.sleep(0.01)
        frame = await driver.newest()
        assert (frame.image.shape, int(frame.image.min()), int(frame.image.max())) == (
            (48, 64),
            20,
            20,
        )
        assert frame.t == pytest.approx(now - 0.05 - 0.002, abs=0.0015)
        driver.expose(ExposureOrder(0.0021, 3.5))
        assert camera.settings["controls"]["ExposureTime"] == 2100
        assert camera.settings["controls"]["AnalogueGain"] == 3.5
        await driver.close()
        assert camera.closed
        driver.expose(ExposureOrder(0.001, 1.0))  # while it is away
        await driver.open()
        assert picamera2[-1].settings["controls"]["ExposureTime"] == 1000
        assert picamera2[-1].settings["controls"]["AeEnable"] is False
        await driver.close()

    asyncio.run(main())


@pytest.mark.parametrize(
    ("options", "said"),
    [({"number": 1}, "camera 1 .* is not there"), ({"width": 641}, "no 641x480; nearest: 640x480")],
)
def test_a_pi_camera_that_cannot_be_used_says_why(
    picamera2: list[Model], options: dict[str, int], said: str
) -> None:
    driver = Picamera2Camera(options=Picamera2Options(**options))

    async def main() -> None:
        with pytest.raises(DeviceLost, match=said):
            await driver.open()
        await driver.close()

    asyncio.run(main())


@pytest.mark.parametrize(
    "driver",
    [Picamera2Camera(options=Picamera2Options()), GstreamerCamera(options=GstreamerOptions())],
    ids=["picamera2", "gstreamer"],
)
def test_without_its_library_a_driver_says_what_to_install(
    driver: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "picamera2", None)
    monkeypatch.setitem(sys.modules, "gi", None)

    async def main() -> None:
        with pytest.raises(DeviceLost, match="python3-"):
            await driver.open()
        await driver.close()

    asyncio.run(main())


@pytest.mark.parametrize(
    ("error", "mend"),
    [
        ('ValueError("numpy.dtype size changed, may indicate binary incompatibility")',
         "pip install --ignore-installed --no-deps 'simplejpeg>=1.8.1'"),
        ('ImportError("libcamera.so.0.2: cannot open shared object file")',
         "sudo apt install python3-picamera2"),
    ],
)  # fmt: skip
def test_a_picamera2_that_cannot_be_loaded_is_told_with_its_reason_and_what_mends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: str, mend: str
) -> None:
    (tmp_path / "picamera2.py").write_text(f"raise {error}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "picamera2", raising=False)
    driver = Picamera2Camera(options=Picamera2Options())

    async def main() -> None:
        with pytest.raises(NotInstalled) as told:
            await driver.open()
        assert error.split('"')[1] in told.value.what
        assert mend in told.value.mend
        await driver.close()

    asyncio.run(main())
