"""The parameters a pilot tunes: names, ranges, what is locked, what flying notices of a change."""

import itertools
import math
import os
from pathlib import Path

import pytest

from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.config.parameters import (
    ParameterSet,
    parameters,
    value_of,
    with_value,
)
from landerd.drivers import read_configuration
from landerd.flightlog.reader import read_log
from landerd.flightlog.replay import replay
from landerd.messages import ParameterChange, Phase
from landerd.ports import ParameterRefused
from tests.recorded_flight import RecordedFlight, recorder
from tests.scripted_flight import DT, Flight


def test_names_fit_mavlink_and_are_plain() -> None:
    for name in parameters():
        assert 0 < len(name) <= 16  # of MAVLink's param_id
        assert name.replace("_", "").isalnum()
        assert name.isupper()


def test_gains_region_limits_and_gate_are_there_with_the_values_of_the_configuration() -> None:
    table = parameters()
    assert {"PID_UP_KP", "DESC_K1", "LIM_SPEED", "RC_GATE_CH", "LOST_HOLD"} <= set(table)
    config = Config()
    for parameter in table.values():
        assert value_of(config, parameter.key) == parameter.default


def test_every_value_within_the_range_is_taken_and_every_one_outside_refused() -> None:
    for name, parameter in parameters().items():
        for word, bound in parameter.bounds:
            tuned = ParameterSet(Config())
            step = 1.0 if parameter.whole else 1e-6
            inside = bound + step if word in ("above", "at least") else bound - step
            outside = bound - step if word in ("above", "at least") else bound + step
            assert with_value(Config(), parameter.key, parameter.default) == Config()
            with pytest.raises(ParameterRefused, match=name):
                tuned.change(name, outside, disarmed=True)
            assert tuned.value(name) == parameter.default
            if not name.startswith(
                ("DESC_ALIGN", "DESC_REALIGN", "RC_LAND")
            ):  # bound to each other
                assert tuned.change(name, inside, disarmed=True) == parameter.key
                assert tuned.value(name) == inside
        for bad in (math.nan, math.inf, -math.inf):
            with pytest.raises(ParameterRefused):
                tuned.change(name, bad, disarmed=True)


def test_a_channel_is_a_whole_number() -> None:
    tuned = ParameterSet(Config())
    with pytest.raises(ParameterRefused, match="whole"):
        tuned.change("RC_GATE_CH", 7.5, disarmed=True)
    tuned.change("RC_GATE_CH", 7.0, disarmed=True)
    assert tuned.value("RC_GATE_CH") == 7


def test_keys_that_depend_on_each_other_are_checked_together() -> None:
    tuned = ParameterSet(Config())
    with pytest.raises(ParameterRefused, match="align_deg < realign_deg"):
        tuned.change("DESC_ALIGN", 4.5, disarmed=True)


def test_while_armed_gains_change_and_the_gate_and_limits_do_not() -> None:
    tuned = ParameterSet(Config())
    for name in ("PID_UP_KP", "PID_FINAL_KI", "DESC_K1", "DESC_SLOWEST"):
        tuned.change(name, 0.2, disarmed=False)
        assert tuned.value(name) == 0.2
    for name in parameters():
        if name.startswith(("RC_", "LIM_", "LOST_", "TD_", "DESC_COMMIT", "DESC_ALIGN")):
            before = tuned.value(name)
            with pytest.raises(ParameterRefused, match="disarmed"):
                tuned.change(name, before, disarmed=False)


def test_an_unknown_name_is_a_key_error() -> None:
    with pytest.raises(KeyError):
        ParameterSet(Config()).change("NO_SUCH", 1.0, disarmed=True)


# ---- saving ------------------------------------------------------------------------------------


def test_saved_parameters_apply_when_the_configuration_is_read_next_time(tmp_path: Path) -> None:
    overlay = tmp_path / "saved.yaml"
    overlay.write_text("guidance: {pid: {up: {kd: 0.7}}}\nvehicle: {gear_height_m: 0.3}\n")
    tuned = ParameterSet(Config(), overlay)
    tuned.change("PID_UP_KP", 1.25, disarmed=True)
    assert "1.25" not in overlay.read_text()  # only on request
    tuned.change("RC_GATE_CH", 9.0, disarmed=True)
    tuned.save()
    config = read_configuration(config_dir() / "default.yaml", overlays=[overlay]).config
    assert (config.guidance.pid.up.kp, config.guidance.pid.up.kd) == (1.25, 0.7)
    assert (config.rc.gate_channel, config.vehicle.gear_height_m) == (9, 0.3)
    assert list(tmp_path.iterdir()) == [overlay]


def test_saved_parameters_are_readable_for_other_users_than_the_services(tmp_path: Path) -> None:
    overlay = tmp_path / "saved.yaml"
    tuned = ParameterSet(Config(), overlay)
    tuned.change("PID_UP_KP", 1.25, disarmed=True)
    before = os.umask(0o077)  # as in the unit
    try:
        tuned.save()
    finally:
        os.umask(before)
    assert overlay.stat().st_mode & 0o777 == 0o644


def test_saving_keeps_the_other_keys_of_the_overlay_file(tmp_path: Path) -> None:
    overlay = tmp_path / "saved.yaml"
    overlay.write_text("estimation: {bearing_noise_deg: 5e-2}\nautopilot: {system_id: 010}\n")
    tuned = ParameterSet(Config(), overlay)
    tuned.change("PID_UP_KP", 1.25, disarmed=True)
    before = read_configuration(config_dir() / "default.yaml", overlays=[overlay]).config
    tuned.save()
    config = read_configuration(config_dir() / "default.yaml", overlays=[overlay]).config
    assert config.guidance.pid.up.kp == 1.25
    assert (config.estimation, config.autopilot) == (before.estimation, before.autopilot)


@pytest.mark.parametrize("text", ["- 1", "guidance: [", "a: 1\na: 2"])
def test_an_overlay_that_cannot_be_read_is_not_saved_over(text: str, tmp_path: Path) -> None:
    overlay = tmp_path / "saved.yaml"
    overlay.write_text(text)
    tuned = ParameterSet(Config(), overlay)
    tuned.change("PID_UP_KP", 1.25, disarmed=True)
    with pytest.raises(ParameterRefused, match="not saved"):
        tuned.save()
    assert overlay.read_text() == text


def test_saving_without_an_overlay_file_is_refused(tmp_path: Path) -> None:
    for overlay in (None, tmp_path / "no-such-folder" / "saved.yaml"):
        with pytest.raises(ParameterRefused, match="save"):
            ParameterSet(Config(), overlay).save()


# ---- in the core -------------------------------------------------------------------------------


def change(flight: Flight, key: str, value: float) -> None:
    flight.lander.step(ParameterChange(flight.t, key, value))


def test_gains_changed_in_flight_take_effect_without_a_bump() -> None:
    def fly(*, changed: bool) -> list[float]:
        flight = Flight().engaged()
        flight.run(1.0)
        if changed:
            for gain, value in (("kp", 0.5), ("lead_s", 0.8)):
                change(flight, f"guidance.tracking.{gain}", value)
        return [s.velocity[0] for s in flight.run(2.0)]

    plain, tuned = fly(changed=False), fly(changed=True)
    assert tuned[0] == pytest.approx(plain[0], abs=0.02)
    assert max(abs(a - b) for a, b in zip(plain, tuned, strict=True)) > 0.1
    steps = [abs(b - a) for a, b in itertools.pairwise(tuned)]
    assert max(steps) <= Config().guidance.limits.acceleration_mps2 * DT * 1.01


def test_a_change_is_in_the_log_and_replays_identically(tmp_path: Path) -> None:
    flight = RecordedFlight(recorder(tmp_path / "a.mcap"))
    flight.engaged().run(0.5)
    flight.give(ParameterChange(flight.t, "guidance.pid.close_approach.kp", 0.1))
    flight.run(1.0)
    flight.recorder.close()
    log = read_log(tmp_path / "a.mcap")
    assert any(isinstance(step.message, ParameterChange) for step in log.steps)
    assert replay(log, Config()).comparison.identical


def test_after_a_change_of_the_gate_channel_the_new_one_must_be_seen_low_first() -> None:
    flight = Flight().engaged()
    assert any(s.velocity != (0.0, 0.0, 0.0) for s in flight.run(1.0))
    change(flight, "rc.gate_channel", 9)
    assert all(s.velocity == (0.0, 0.0, 0.0) for s in flight.run(3.0))
    assert flight.lander.phase is Phase.NOT_LANDING
