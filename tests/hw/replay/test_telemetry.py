import math
import os
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from hw.replay.telemetry import Telemetry, TelemetryError, read_telemetry
from tests.recordings import ORIGIN, flown, write_bin, write_tlog

Write = Callable[..., Path]
BOTH = pytest.mark.parametrize(("write", "boot_s"), [(write_tlog, 5.0), (write_bin, 8.0)])


def check(telemetry: Telemetry, boot_s: float) -> None:
    assert (telemetry.start, telemetry.end) == pytest.approx((boot_s, boot_s + 19.9), abs=1e-3)
    for t in (0.0, 3.3, 12.35):
        position, angles, rate = flown(t)
        read, turned = telemetry.position.at(boot_s + t), telemetry.attitude.at(boot_s + t)
        assert read is not None
        assert turned is not None
        assert read[:3] == pytest.approx(position, abs=1e-3)
        assert read[3:] == pytest.approx((0.2, 0.1, 0.2))
        assert turned[:3] == pytest.approx(angles, abs=0.02)
        if t > 0.0:
            assert turned[5] == pytest.approx(rate, abs=0.4)


@BOTH
def test_attitude_and_position_are_what_was_flown(
    write: Write, boot_s: float, tmp_path: Path
) -> None:
    telemetry = read_telemetry(write(tmp_path / "a"))
    check(telemetry, boot_s)
    assert len(telemetry.armed) == 1


def test_the_mount_is_read(tmp_path: Path) -> None:
    telemetry = read_telemetry(write_bin(tmp_path / "a.bin"))
    angles = telemetry.gimbal.at(10.0)
    assert angles == pytest.approx((math.radians(5.0), math.radians(-60.0), 0.0))


def test_places_on_earth_become_local(tmp_path: Path) -> None:
    telemetry = read_telemetry(write_tlog(tmp_path / "a.tlog"))
    north, east = telemetry.local(ORIGIN[0] + math.degrees(30.0 / 6378137.0), ORIGIN[1])
    assert (north, east) == pytest.approx((30.0, 0.0), abs=0.05)
    without = read_telemetry(write_bin(tmp_path / "a.bin"))
    with pytest.raises(TelemetryError, match="no global position"):
        without.local(*ORIGIN)


@BOTH
def test_what_is_missing_is_named(write: Write, boot_s: float, tmp_path: Path) -> None:
    path = write(tmp_path / "a", skip=("ATT", "ATTITUDE"))
    with pytest.raises(TelemetryError, match=r"a: no attitude \(ATT, ATTITUDE\) in it"):
        read_telemetry(path)
    path = write(tmp_path / "a", skip=("XKF1", "LOCAL_POSITION_NED"))
    with pytest.raises(TelemetryError, match="a: no local position"):
        read_telemetry(path)


@BOTH
def test_cut_or_damaged_it_gives_what_is_good_and_is_quiet(
    write: Write, boot_s: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = write(tmp_path / "a").read_bytes()
    (tmp_path / "a").write_bytes(data[: len(data) // 2 + 7])
    assert 8.0 < read_telemetry(tmp_path / "a").end - boot_s < 12.0
    rng = random.Random(3)
    damaged = data[: len(data) // 3] + rng.randbytes(500) + data[len(data) // 3 :]
    (tmp_path / "a").write_bytes(damaged)
    telemetry = read_telemetry(tmp_path / "a")
    assert telemetry.end - boot_s == pytest.approx(19.9, abs=0.5)
    check(telemetry, boot_s)
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_other_files_are_refused_in_one_line(tmp_path: Path) -> None:
    for content, says in (
        (b"", "empty"),
        (b"hello, world, hello", "neither"),
        (b"\xa3\x95", "no "),
    ):
        (tmp_path / "a").write_bytes(content)
        with pytest.raises(TelemetryError) as e:
            read_telemetry(tmp_path / "a")
        assert says in str(e.value)
        assert "\n" not in str(e.value)
    with pytest.raises(TelemetryError, match="cannot be read: No such file"):
        read_telemetry(tmp_path / "none")
    assert os.fstat(2)  # the silence has given standard error back
