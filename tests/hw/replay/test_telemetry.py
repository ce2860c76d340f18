import math
import os
import random
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from hw.replay.telemetry import Telemetry, TelemetryError, read_telemetry
from hw.replay.track import Track
from landerd.geometry import rot_zxy, rotate
from tests.recordings import FORMATS_2014, ORIGIN, flown, place, write_bin, write_tlog

Write = Callable[..., Path]
BOTH = pytest.mark.parametrize(("write", "boot_s"), [(write_tlog, 5.0), (write_bin, 8.0)])


def check(telemetry: Telemetry, boot_s: float, *, within_m: float = 1e-3) -> None:
    assert (telemetry.start, telemetry.end) == pytest.approx((boot_s, boot_s + 19.9), abs=1e-3)
    for t in (0.0, 3.3, 12.35):
        position, angles, rate = flown(t)
        read, turned = telemetry.position.at(boot_s + t), telemetry.attitude.at(boot_s + t)
        assert read is not None
        assert turned is not None
        assert read[:3] == pytest.approx(position, abs=within_m)
        assert turned[:3] == pytest.approx(angles, abs=0.02)
        if t > 0.0:
            assert read[3:] == pytest.approx((0.2, 0.1, 0.2), abs=max(1e-6, 5.0 * within_m))
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


@BOTH
def test_a_mount_that_rolls_looks_straight_down_where_ardupilot_says_so(
    write: Write, boot_s: float, tmp_path: Path
) -> None:
    telemetry = read_telemetry(write(tmp_path / "a", mount_deg=(5.0, -90.0, 3.0)))
    angles = telemetry.gimbal.at(boot_s + 5.0)
    assert angles is not None
    yaw, pitch, roll = angles
    assert rotate(rot_zxy(yaw, roll, pitch), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0))


def test_a_gimbal_that_tells_its_yaw_from_north_is_read_and_no_second_one(tmp_path: Path) -> None:
    telemetry = read_telemetry(write_tlog(tmp_path / "a.tlog", look_deg=(20.0, -45.0)))
    for t in (9.0, 9.031):
        angles = telemetry.gimbal.at(t)
        assert angles is not None
        yaw, pitch, _ = (math.degrees(angle) for angle in angles)
        assert (yaw, pitch) == pytest.approx((20.0, -45.0), abs=1.0)
    assert "of several gimbals the one that reports first is shown" in telemetry.remarks


def test_places_on_earth_become_local(tmp_path: Path) -> None:
    telemetry = read_telemetry(write_tlog(tmp_path / "a.tlog"))
    north, east = telemetry.local(ORIGIN[0] + math.degrees(30.0 / 6378137.0), ORIGIN[1])
    assert (north, east) == pytest.approx((30.0, 0.0), abs=0.05)
    without = read_telemetry(write_bin(tmp_path / "a.bin"))
    with pytest.raises(TelemetryError, match="no global position"):
        without.local(*ORIGIN)


@BOTH
def test_missing_records_are_named(write: Write, boot_s: float, tmp_path: Path) -> None:
    path = write(tmp_path / "a", skip=("ATT", "ATTITUDE"))
    with pytest.raises(TelemetryError, match=r"a: no attitude \(ATT, ATTITUDE\) in it"):
        read_telemetry(path)
    positions = ("XKF1", "NKF1", "POS", "GPS", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT")
    path = write(tmp_path / "a", skip=positions)
    with pytest.raises(TelemetryError, match=r"a: no position \(XKF1, .*\) in it"):
        read_telemetry(path)


def test_firmware_of_2014_names_and_dates_its_records_otherwise(tmp_path: Path) -> None:
    path = write_bin(tmp_path / "a.bin", formats=FORMATS_2014, firmware="ArduCopter V3.1.3")
    telemetry = read_telemetry(path)
    check(telemetry, 8.0)
    assert telemetry.position_source == "EKF1"
    assert telemetry.armed[0] == pytest.approx((8.0, 27.9))
    assert telemetry.remarks == ()


@pytest.mark.parametrize(
    ("estimator", "primary", "source"),
    [(3, 0, "XKF1"), (3, 1, "XKF1 of core 1"), (2, 0, "NKF1")],
)
def test_the_estimator_that_flew_is_used_of_several(
    estimator: int, primary: int, source: str, tmp_path: Path
) -> None:
    path = write_bin(tmp_path / "a.bin", skip=(), estimator=estimator, primary=primary)
    telemetry = read_telemetry(path)
    assert telemetry.position_source == source
    check(telemetry, 8.0)


@pytest.mark.parametrize(
    ("write", "skip", "source", "boot_s"),
    [
        (write_bin, ("XKF1", "NKF1", "GPS"), "POS", 8.0),
        (write_bin, ("XKF1", "NKF1", "POS"), "GPS", 8.0),
        (write_tlog, ("LOCAL_POSITION_NED",), "GLOBAL_POSITION_INT", 5.0),
    ],
)
def test_without_a_local_position_a_global_one_serves_and_it_is_said(
    write: Write, skip: tuple[str, ...], source: str, boot_s: float, tmp_path: Path
) -> None:
    telemetry = read_telemetry(write(tmp_path / "a", skip=skip))
    assert telemetry.position_source == source
    assert any(source in remark for remark in telemetry.remarks)
    # Its zero is its first place: the made-up flight begins 4 m to the south of the other zero.
    position, first = telemetry.position, telemetry.position.values[0]
    assert first[:2] == (0.0, 0.0)
    north, east, down = flown(0.0)[0]
    shifted = [(n + north, e + east, d - first[2] + down, *v) for n, e, d, *v in position.values]
    position.values[:] = shifted
    check(telemetry, boot_s, within_m=0.02)
    assert telemetry.local(*place(3.0)) == pytest.approx((0.6, 0.3), abs=0.03)


def test_rates_are_those_of_the_flight_and_not_of_the_time_disarmed(tmp_path: Path) -> None:
    telemetry = read_telemetry(write_bin(tmp_path / "a.bin", disarmed_s=300.0))
    assert telemetry.armed[0] == pytest.approx((308.0, 327.9))
    assert telemetry.attitude.rate_hz(telemetry.flown) == pytest.approx(10.0, abs=0.1)
    assert telemetry.attitude.rate_hz(((telemetry.start, telemetry.end),)) < 2.0


def test_a_gap_does_not_count_in_the_rate_but_as_missing() -> None:
    track = Track()
    for i in [*range(100), *range(400, 500)]:
        track.add(0.1 * i, (0.0,))
    assert track.rate_hz(((0.0, 50.0),)) == pytest.approx(10.0)
    assert track.covered_s(((0.0, 50.0),)) == pytest.approx(19.8)


@pytest.mark.parametrize("firmware", ["ArduPlane V4.5.0", "APM:Rover v2.50", "ArduSub V4.1"])
def test_other_vehicles_logs_are_refused(firmware: str, tmp_path: Path) -> None:
    path = write_bin(tmp_path / "a.bin", firmware=firmware)
    with pytest.raises(TelemetryError, match=r"a.bin: not a copter's: it is of a (pl|ro|su)"):
        read_telemetry(path)


def test_a_planes_telemetry_is_refused_and_an_unnamed_vehicle_is_said(tmp_path: Path) -> None:
    path = write_tlog(tmp_path / "a", vehicle=1)
    with pytest.raises(TelemetryError, match="not a copter's: it is of fixed wing"):
        read_telemetry(path)
    telemetry = read_telemetry(write_bin(tmp_path / "b", skip=("MSG", "NKF1", "XKF4")))
    assert "it does not say what kind of vehicle it is of" in telemetry.remarks


def test_the_longest_part_is_used_of_two_vehicles_or_two_boots(tmp_path: Path) -> None:
    parts = [
        write_tlog(tmp_path / "1", length_s=6.0, boot_s=900.0),
        write_tlog(tmp_path / "2", at_s=10.0),
        write_tlog(tmp_path / "3", length_s=8.0, system=2, at_s=40.0),
    ]
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    telemetry = read_telemetry(path)
    # Five messages make sure of a new start.
    assert (telemetry.start, telemetry.end) == pytest.approx((5.2, 24.9))
    several, started = sorted(telemetry.remarks, key=lambda r: "started" in r)
    assert several == "of several vehicles system 1 is shown, not 2"
    assert "started 2 times" in started


@BOTH
def test_cut_or_damaged_it_gives_what_is_good_and_says_what_not(
    write: Write, boot_s: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "a")
    data = path.read_bytes()
    assert read_telemetry(path).remarks == ()
    path.write_bytes(data[: len(data) // 2 + 7])
    cut = read_telemetry(path)
    assert 8.0 < cut.end - boot_s < 12.0
    assert cut.remarks == ("its last record is cut off",)
    rng = random.Random(3)
    path.write_bytes(data[: len(data) // 3] + rng.randbytes(500) + data[len(data) // 3 :])
    telemetry = read_telemetry(path)
    check(telemetry, boot_s)
    assert re.search(r"damaged or cut: .* 5\d\d in the middle are left out", telemetry.remarks[0])
    assert capfd.readouterr() == ("", "")


@BOTH
def test_zeros_at_its_start_cost_only_what_they_replace(
    write: Write, boot_s: float, tmp_path: Path
) -> None:
    path = write(tmp_path / "a")
    data = path.read_bytes()
    path.write_bytes(bytes(4096) + data)
    telemetry = read_telemetry(path)
    check(telemetry, boot_s)
    assert "4096 at its start" in telemetry.remarks[0]
    path.write_bytes(bytes(100) + data[100:])
    telemetry = read_telemetry(path)
    assert telemetry.end == pytest.approx(boot_s + 19.9)
    assert "at its start" in telemetry.remarks[0]


def test_a_bin_that_begins_with_a_record_of_an_unknown_kind_is_read_from_the_next_one_on(
    tmp_path: Path,
) -> None:
    path = write_bin(tmp_path / "a.bin")
    path.write_bytes(b"\xa3\x95\xfa" + bytes(20) + path.read_bytes())
    telemetry = read_telemetry(path)
    check(telemetry, 8.0)
    assert "23 at its start" in telemetry.remarks[0]


def test_a_bin_whose_formats_are_lost_is_refused_in_one_line(tmp_path: Path) -> None:
    path = write_bin(tmp_path / "a.bin")
    data = path.read_bytes()
    end = data.rfind(b"\xa3\x95\x80") + 89
    path.write_bytes(bytes(end) + data[end:])
    with pytest.raises(TelemetryError, match=r"a.bin: its formats \(FMT records\) are lost"):
        read_telemetry(path)


@BOTH
def test_no_damage_makes_more_than_a_line(write: Write, boot_s: float, tmp_path: Path) -> None:
    path = write(tmp_path / "a", length_s=4.0)
    data, rng = path.read_bytes(), random.Random(1)
    for _ in range(60):
        damaged = bytearray(data)
        for _ in range(rng.choice((1, 30, 300))):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        at = rng.randrange(len(damaged))
        path.write_bytes(bytes(damaged[: at + rng.choice((0, 0, len(damaged)))]))
        outcome = ""
        try:
            telemetry = read_telemetry(path)
        except TelemetryError as e:
            outcome = str(e)
        assert len(outcome.splitlines()) == 1 or telemetry.start < telemetry.end


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
