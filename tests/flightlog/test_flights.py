"""What the daemon makes of arming: each flight has its own core and its own log."""

import asyncio
from pathlib import Path

import pytest
from pymavlink import mavutil

from landerd.commands.replay import config_of
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.flightlog.reader import read_log
from landerd.messages import Heartbeat, ParameterChange, Sightings
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, fly


def test_each_arming_begins_a_core_and_a_log_with_the_parameters_changed_before(
    tmp_path: Path,
) -> None:
    loaded = read_configuration(
        config_dir() / "default.yaml", overrides=["log.images=none", "log.keep_free_mb=0"]
    )
    simulation = Simulation(loaded, 1, log=tmp_path / "a.mcap")
    daemon, recorder = simulation.daemon, simulation.recorder
    assert recorder is not None

    async def fly() -> None:
        running = asyncio.create_task(daemon.run())
        await asyncio.sleep(0.2)
        loop = asyncio.get_running_loop()
        first = daemon.lander
        daemon._take_from("autopilot", Heartbeat(loop.time(), False, True, "GUIDED"))
        change = ParameterChange(loop.time(), "guidance.pid.up.kp", 0.6)
        daemon._take_from("autopilot", change)
        assert daemon.lander is first
        daemon._take_from("autopilot", Heartbeat(loop.time(), True, True, "GUIDED"))
        assert daemon.lander is not first
        await asyncio.sleep(0.2)
        running.cancel()

    run_virtual(fly())
    recorder.close()
    second = read_log(tmp_path / "a.restart-2.mcap")
    assert isinstance(second.steps[0].message, Heartbeat)
    assert config_of(second, [])[0].guidance.pid.up.kp == 0.6
    before = read_log(tmp_path / "a.mcap")
    assert config_of(before, [])[0].guidance.pid.up.kp != 0.6


def test_health_is_in_the_log_and_in_the_ground_stations_plots(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    quiet = ("log.images=none", "log.keep_free_mb=0")
    fly(overrides=(*ABOVE, *quiet), longest_s=6.0, log=path)
    log = read_log(path)
    known = [state.health for state in log.states if state.health is not None]
    assert known
    assert all(h.sightings > 0 and 0.0 <= h.refused <= 1.0 and h.nis > 0.0 for h in known)
    # The reference camera's pictures come 60 ms after their exposure, and are searched then.
    assert 0.06 < known[-1].picture_age_s < 0.15
    (last, *_) = [s.message for s in reversed(log.steps) if isinstance(s.message, Sightings)]
    assert last.arrived_t is not None
    assert last.arrived_t - last.t == pytest.approx(0.06, abs=0.02)
    tlog = mavutil.mavlink_connection(str(path.with_suffix(".tlog")))
    plots = set()
    while (message := tlog.recv_match(type="NAMED_VALUE_FLOAT")) is not None:
        plots.add(message.name)
    assert {"pad_nis", "pad_ref_pc", "pic_age_ms", "cam_clk_ms", "cam_up_deg"} <= plots
