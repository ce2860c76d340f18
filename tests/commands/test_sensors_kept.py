"""What a flight finds out about camera and gimbal is reported, in words that say what to set."""

import errno
import math
import os
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from landerd.commands.run import SensorNotes
from landerd.config.models import CameraSection, Config, GimbalSection
from landerd.estimation.health import Health
from landerd.estimation.pad_filter import SensorErrors
from landerd.geometry import R_GIMBAL_CAMERA, Mat3, camera_mount, matmul, transpose
from landerd.messages import Phase, Tick
from landerd.preflight.sensors import (
    LastFlight,
    last_flight_findings,
    read_sensors,
    sensor_findings,
    write_sensors,
)
from tests.scripted_flight import LOW, Flight

SENSORS = SensorErrors(-0.021, 0.002, 0.0, 0.003, 0.0, 0.0, 0.005, 0.005)
HEALTH = Health(600, 2.9, 0.01, 0.12)
FOUND = LastFlight(SENSORS, HEALTH)


def found(**changed: float) -> LastFlight:
    return replace(FOUND, sensors=replace(SENSORS, **changed))


def test_pictures_with_time_stamps_too_early_are_reported() -> None:
    (finding,) = sensor_findings(Config(), FOUND)
    assert finding.level == "warn"
    assert "21 ms earlier" in finding.what
    assert finding.mend == "set camera.clock_offset_s: -0.021"


def test_an_error_that_the_configuration_corrects_already_is_not_reported() -> None:
    config = Config(camera=CameraSection(clock_offset_s=-0.020))
    assert sensor_findings(config, FOUND) == []


def test_an_uncertain_error_is_not_reported() -> None:
    assert sensor_findings(Config(), found(sigma_clock_s=0.008)) == []


def test_a_lens_that_points_too_low_is_reported() -> None:
    low = found(clock_s=0.0, up=math.radians(-2.0))
    (finding,) = sensor_findings(Config(), low)
    assert "2.0 degrees lower" in finding.what
    assert finding.mend == "set pitch of gimbal.camera_rotation_deg to -2.0"


def test_what_a_flight_found_out_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "sensors.json"
    for flight in (FOUND, replace(FOUND, health=None)):
        write_sensors(path, flight)
        assert read_sensors(path) == flight


def test_the_file_is_readable_for_other_users_than_the_services(tmp_path: Path) -> None:
    path = tmp_path / "sensors.json"
    before = os.umask(0o077)  # as in the unit
    try:
        write_sensors(path, FOUND)
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_file_that_this_user_may_not_read_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def locked(path: Path, **_: object) -> str:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    path = tmp_path / "sensors.json"
    assert last_flight_findings(Config(), path) == []
    write_sensors(path, FOUND)
    (finding,) = last_flight_findings(Config(), path)
    assert "21 ms earlier" in finding.what
    monkeypatch.setattr(Path, "read_text", locked)
    (finding,) = last_flight_findings(Config(), path)
    assert (finding.level, finding.item) == ("warn", "last flight")
    assert f"may not be read by this user: {path}" in finding.what
    assert "sudo" in finding.mend


@pytest.mark.parametrize(
    ("health", "says", "mend"),
    [
        (replace(HEALTH, refused=0.12), "12 % of the sightings were refused", "bench-test gimbal"),
        (replace(HEALTH, picture_age_s=0.34), "pictures were 0.34 s old", "check --budget"),
    ],
)
def test_a_flight_with_poor_sight_is_reported_before_the_next(
    health: Health, says: str, mend: str
) -> None:
    (finding,) = sensor_findings(Config(), replace(found(clock_s=0.0), health=health))
    assert (finding.level, says in finding.what, mend in finding.mend) == ("warn", True, True)


def test_a_slow_disk_delays_no_orders_and_the_file_is_whole_at_the_end(tmp_path: Path) -> None:
    """The disk is a pipe that is read late; a real one must not delay the orders either."""
    path = tmp_path / "sensors.json"
    pipe = path.with_suffix(".new")
    read: list[str] = []
    os.mkfifo(pipe)

    def read_late() -> None:
        time.sleep(1.0)
        read.append(pipe.read_text())

    flight = Flight().engaged().until(Phase.DESCENT)
    notes = SensorNotes(path)
    notes.on_flight(flight.lander)
    flight.pulse_us = LOW
    flight.run(0.1)
    assert flight.lander.outcome == "released"
    reading = threading.Thread(target=read_late)
    reading.start()
    began = time.monotonic()
    notes.on_step(flight.t, Tick(flight.t), [])
    assert time.monotonic() - began < 0.5
    notes.close()
    reading.join()
    path.unlink()  # the pipe, which has been put in its place
    path.write_text(read[0])
    assert read_sensors(path) == LastFlight(
        flight.lander.sensor_errors, flight.lander.flight_health
    )


def test_a_disk_that_hangs_when_a_landing_has_ended_does_not_keep_the_process(
    tmp_path: Path,
) -> None:
    pipe = tmp_path / "sensors.new"
    os.mkfifo(pipe)  # which nobody reads
    flight = Flight().engaged().until(Phase.DESCENT)
    notes = SensorNotes(tmp_path / "sensors.json")
    notes.on_flight(flight.lander)
    flight.pulse_us = LOW
    flight.run(0.1)
    notes.on_step(flight.t, Tick(flight.t), [])
    closing = threading.Thread(target=notes.close)
    closing.start()
    closing.join(5.0)
    is_closed = not closing.is_alive()
    pipe.read_text()
    closing.join()
    assert is_closed


@pytest.mark.parametrize("text", ["", "{}", "[1]", "7", '{"sensors": {}, "health": null}'])
def test_a_damaged_file_is_ignored(tmp_path: Path, text: str) -> None:
    path = tmp_path / "sensors.json"
    path.write_text(text)
    assert read_sensors(path) is None


def test_a_lens_that_sits_rolled_is_set_about_the_gimbals_axes() -> None:
    config = Config(gimbal=GimbalSection(camera_rotation_deg=(180.0, 0.0, 0.0)))
    # Upside down: what is up in the picture is down for the gimbal.
    (finding,) = sensor_findings(config, found(clock_s=0.0, up=math.radians(2.0)))
    assert "2.0 degrees lower" in finding.what
    assert finding.mend == "set pitch of gimbal.camera_rotation_deg to -2.0"


class Skewed(Flight):
    """A flight whose lens looks elsewhere than the gimbal reports."""

    def __init__(self, *, up_deg: float, right_deg: float) -> None:
        super().__init__(position=(-8.0, 3.0, -8.0))
        self._mount = camera_mount((0.0, up_deg, right_deg))

    def R_local_camera(self) -> Mat3:  # noqa: N802 - rotates camera to local
        as_said = super().R_local_camera()
        return matmul(matmul(as_said, transpose(R_GIMBAL_CAMERA)), self._mount)


@pytest.mark.parametrize(("up_deg", "right_deg"), [(2.0, 0.0), (0.0, -2.0)])
def test_a_skewed_lens_is_found_to_look_where_it_does(up_deg: float, right_deg: float) -> None:
    flight = Skewed(up_deg=up_deg, right_deg=right_deg).engaged().until(Phase.DESCENT)
    errors = flight.lander.sensor_errors
    for angle, sigma, true_deg in (
        (errors.up, errors.sigma_up, up_deg),
        (errors.right, errors.sigma_right, right_deg),
    ):
        assert math.degrees(angle) == pytest.approx(true_deg, abs=3.0 * math.degrees(sigma))
        assert abs(math.degrees(angle) - true_deg) < 0.3 + 0.6 * abs(true_deg)
