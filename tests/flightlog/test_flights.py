"""What the daemon makes of arming: each flight has its own core and its own log."""

import asyncio
from pathlib import Path

from landerd.commands.replay import config_of
from landerd.config.files import config_dir
from landerd.drivers import read_configuration
from landerd.flightlog.reader import read_log
from landerd.messages import Heartbeat, ParameterChange
from landerd.runtime.clock import run_virtual
from landerd.simulation.flight import Simulation


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
    second = read_log(tmp_path / "a-2.mcap")
    assert isinstance(second.steps[0].message, Heartbeat)
    assert config_of(second, [])[0].guidance.pid.up.kp == 0.6
    before = read_log(tmp_path / "a.mcap")
    assert config_of(before, [])[0].guidance.pid.up.kp != 0.6
