"""A real ArduCopter in SITL, landed by landerd. docs/sitl.md tells how to run these tests."""

import asyncio
import math
import os

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bench.step_response import MEASURED
from hw.autopilots.arducopter import Mode
from hw.autopilots.mavlink_codec import MavlinkCodec
from landerd.config.files import Loaded, config_dir
from landerd.drivers import read_configuration
from landerd.guidance.pilot_texts import HOLDING_OVER
from landerd.messages import Phase
from landerd.runtime.clock import run_slaved
from landerd.simulation.flight import Simulation
from landerd.simulation.result import result_of
from landerd.simulation.sitl import Script, SitlFlight
from tests.simulation.sitl_steps import compare

URL = os.environ.get("LANDERD_SITL", "")
pytestmark = pytest.mark.skipif(
    not URL, reason="LANDERD_SITL holds no URL of an ArduCopter in SITL"
)


def _loaded(scenario: str) -> Loaded:
    return read_configuration(
        config_dir() / "default.yaml", overlays=[config_dir() / "scenarios" / f"{scenario}.yaml"]
    )


def _fly(scenario: str, seed: int, script: Script | None = None) -> Simulation:
    flight = SitlFlight(_loaded(scenario), seed, URL, take_off_m=10.0)
    run_slaved(flight.run(script))
    return flight.simulation


def _broken(simulation: Simulation) -> list[str]:
    """Return the rules broken but for 3: rates and slopes tell of a busy machine's stalls."""
    return [rule for rule in simulation.rules.broken if not rule.startswith("3:")]


@pytest.mark.parametrize("seed", [1, 2])
def test_it_lands_on_a_still_pad(seed: int) -> None:
    simulation = _fly("stationary", seed)
    result = result_of(simulation.flown(), "stationary", seed)
    assert result["landed"]
    assert result["touchdown_error_m"] <= 0.20
    assert _broken(simulation) == []
    assert simulation.rules.disarm_orders > 0


def test_it_touches_a_pad_that_drives_at_1_mps() -> None:
    simulation = _fly("moving", 1)
    result = result_of(simulation.flown(), "moving", 1)
    assert result["landed"]
    assert result["touchdown_error_m"] <= 0.20
    assert result["touchdown_horizontal_mps"] <= 0.3
    assert _broken(simulation) == []


def test_it_holds_over_a_driving_marker_until_it_is_told_to_land() -> None:
    errors_m: list[float] = []

    async def script(simulation: Simulation) -> None:
        while simulation.daemon.lander.reason != HOLDING_OVER:
            await asyncio.sleep(0.1)
        for _ in range(80):
            await asyncio.sleep(0.1)
            errors_m.append(math.hypot(*simulation.world.offset))
            assert simulation.world.height == pytest.approx(2.0, abs=0.3)

    simulation = _fly("hold", 1, script)
    assert result_of(simulation.flown(), "hold", 1)["landed"]
    assert sorted(errors_m)[75] <= 0.2
    assert _broken(simulation) == []


class _Watch:
    """Waits for the descent, lets the pilot act, and notes the set-points that come after."""

    def __init__(self) -> None:
        self.acted_t = math.inf
        self.last_flown_t = -math.inf  # of a set-point other than zero
        self.count = 0
        self._codec = MavlinkCodec(255, 0)

    def listen(self, flight: SitlFlight) -> None:
        judge = flight.link.tap

        def tap(t: float, data: bytes) -> None:
            if judge is not None:
                judge(t, data)
            for m in self._codec.decode(data):
                if m.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
                    self.count += 1
                    if max(map(abs, (m.vx, m.vy, m.vz, m.yaw_rate))) > 1e-6:
                        self.last_flown_t = t

        flight.link.tap = tap


async def _descending(simulation: Simulation) -> None:
    while not (simulation.daemon.lander.phase is Phase.DESCENT and simulation.world.height < 6.0):
        await asyncio.sleep(0.02)


def _take_over(by_mode: bool) -> tuple[_Watch, Simulation]:
    watch = _Watch()
    flight = SitlFlight(_loaded("stationary"), 1, URL, take_off_m=10.0)

    async def script(simulation: Simulation) -> None:
        watch.listen(flight)
        await _descending(simulation)
        watch.acted_t = asyncio.get_running_loop().time()
        if by_mode:
            await simulation.ground_station.set_mode(Mode.LOITER)
        else:
            simulation.ground_station.set_rc(simulation.config.rc.gate_channel, 1100)
        await asyncio.sleep(3.0)
        simulation.over = True

    run_slaved(flight.run(script))
    return watch, flight.simulation


@pytest.mark.parametrize(("by_mode", "limit_s"), [(True, 0.1), (False, 0.2)])
def test_the_pilot_takes_over_in_the_descent(by_mode: bool, limit_s: float) -> None:
    watch, simulation = _take_over(by_mode)
    stops_s = watch.last_flown_t - watch.acted_t
    print(f"{'mode' if by_mode else 'channel 11'}: last set-point other than zero {stops_s:.3f} s")
    assert watch.count > 0
    assert stops_s <= limit_s
    assert _broken(simulation) == []
    assert simulation.world.vehicle.motors


def test_the_stand_in_responds_to_orders_as_sitl_does() -> None:
    # 20 ms, which a loaded machine is late by, are a tenth of a yaw step. From 4.6 on an ordered
    # yaw rate is overshot by a fifth, by the 4.5.7 that the stand-in was fitted to by half.
    differences = compare(URL)
    turns = {name for name, (axis, *_) in MEASURED.items() if axis == "yaw"}
    assert max(differences[name] for name in differences.keys() - turns) <= 0.15
    assert max(differences[name] for name in turns) <= 0.4
