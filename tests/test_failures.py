"""Unexpected errors in a whole simulated flight: none ends it without stop orders."""

import asyncio
import socket
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from landerd.flightlog.reader import read_log
from landerd.flightlog.replay import replay, replay_vision
from landerd.messages import Command, Frame, Input, Phase, Prior, Sightings, Tick
from landerd.runtime.daemon import CoreFailed
from landerd.runtime.observer import Observer
from landerd.runtime.service import ServiceNotifier
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, SEEN, fly
from tests.test_safety import Wire, flying, now, speed, texts

pytestmark = pytest.mark.long


def test_a_search_that_raises_loses_a_frame_but_the_flight_goes_on() -> None:
    async def script(simulation: Simulation) -> None:
        await flying(simulation)
        daemon = simulation.daemon
        sound = daemon._vision.process

        def fails(frame: Frame, prior: Prior | None = None) -> Sightings:
            raise ZeroDivisionError("in vision")

        daemon._vision.process = fails  # type: ignore[method-assign]
        await asyncio.sleep(1.0)
        assert daemon._vision.process is not sound  # vision has begun anew

    simulation = fly(script, longest_s=30.0)
    assert simulation.daemon.faults["image not searched"] == 1
    assert simulation.score.landed
    assert simulation.rules.broken == {}


def test_a_search_that_failed_replays_to_the_bit(tmp_path: Path) -> None:
    async def script(simulation: Simulation) -> None:
        await flying(simulation)
        simulation.daemon._vision.process = fails  # type: ignore[method-assign]
        await asyncio.sleep(1.0)
        simulation.over = True

    def fails(frame: Frame, prior: Prior | None = None) -> Sightings:
        raise ZeroDivisionError("in vision")

    file = tmp_path / "a.mcap"
    lossless = ("log.images=lossless", "log.every_nth=1", "log.keep_free_mb=0")
    simulation = fly(script, longest_s=10.0, overrides=[*ABOVE, SEEN, *lossless], log=file)
    assert simulation.daemon.faults["image not searched"] == 1
    log = read_log(file)
    assert sum(searched.anew for searched in log.searched) == 1
    assert replay(log, simulation.config).comparison.identical
    vision = replay_vision(log, simulation.config)
    assert not isinstance(vision, str), vision
    assert vision.comparison.identical


def test_an_observer_that_raises_changes_nothing() -> None:
    class Broken:
        def on_flight(self, lander: Any) -> None:
            raise OSError("no such socket")

        def on_vision_reset(self) -> None:
            raise OSError("no such socket")

        def on_last_orders(self, now: float) -> None:
            raise OSError("no such socket")

        def on_frame(self, frame: Frame, prior: Prior, sightings: Sightings) -> None:
            raise ValueError("cannot be written")

        def on_step(self, t: float, message: Input, commands: Any) -> None:
            raise OSError("disk full")

    async def script(simulation: Simulation) -> None:
        daemon = simulation.daemon
        daemon._observers = (*daemon._observers, Broken())

    simulation = fly(script)
    assert simulation.score.landed
    assert simulation.rules.broken == {}


def test_a_notify_socket_that_refuses_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/notify")

    async def script(simulation: Simulation) -> None:
        simulation.daemon.observe(ServiceNotifier())
        await flying(simulation)
        simulation.over = True

    simulation = fly(script, overrides=ABOVE)
    assert simulation.daemon.faults["ServiceNotifier failed"] > 10
    assert simulation.rules.broken == {}
    assert simulation.daemon.lander.phase is not Phase.NOT_LANDING


def test_a_gimbal_driver_that_raises_is_opened_again() -> None:
    async def script(simulation: Simulation) -> None:
        await flying(simulation)
        sound = simulation.gimbal.state

        async def fails() -> Any:
            simulation.gimbal.state = sound  # type: ignore[method-assign]
            raise KeyError("in a driver")

        simulation.gimbal.state = fails  # type: ignore[method-assign]

    simulation = fly(script)
    assert simulation.daemon.faults["gimbal lost"] == 1
    assert simulation.score.landed
    assert simulation.rules.broken == {}


def fails_when(simulation: Simulation, kind: type) -> None:
    """Let the core raise at the next message of a kind."""
    lander = simulation.daemon.lander
    sound = lander.step

    def step(message: Input) -> list[Command]:
        if isinstance(message, kind):
            raise OverflowError("in the core")
        return sound(message)

    lander.step = step  # type: ignore[method-assign]


def failed_flight(
    message: type, low: float, *overrides: str, observer: Observer | None = None
) -> tuple[Simulation, Wire, float]:
    """Fly until the core fails at a height; return the flight, what was sent, and when."""
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"], seen["simulation"] = Wire(simulation), simulation
        if observer is not None:
            simulation.daemon.observe(observer)
        while simulation.world.height > low or simulation.daemon.lander.phase is Phase.NOT_LANDING:
            await asyncio.sleep(0.01)
        seen["t"] = now()
        fails_when(simulation, message)

    with pytest.raises(ExceptionGroup) as raised:
        fly(script, longest_s=30.0, overrides=[*ABOVE, *overrides])
    assert raised.group_contains(CoreFailed, depth=1)
    return seen["simulation"], seen["wire"], seen["t"]


def test_the_watchdog_is_fed_while_a_failed_core_stops_the_vehicle(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Otherwise systemd, whose watchdog waits 2 s, would cut the stop orders short."""
    fed: list[float] = []
    at = str(tmp_path / "systemd")
    monkeypatch.setenv("NOTIFY_SOCKET", at)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(at)
        systemd.setblocking(False)

        class Systemd(ServiceNotifier):
            def on_last_orders(self, now: float) -> None:
                super().on_last_orders(now)
                with suppress(BlockingIOError):
                    while True:
                        if systemd.recv(4096) == b"WATCHDOG=1":
                            fed.append(now)

        _, wire, t = failed_flight(Tick, 2.0, "guidance.release_s=3", observer=Systemd())
    assert wire.after(t)[-1][0] - fed[-1] < 0.6
    assert sum(at > t + 0.1 for at in fed) >= 5


@pytest.mark.parametrize("message", [Tick, Sightings])
def test_a_core_that_raises_stops_the_vehicle_and_tells_the_pilot(message: type) -> None:
    simulation, wire, t = failed_flight(message, 2.0)
    after = wire.after(t + 0.2)
    assert len(after) >= 30
    assert all(speed(m) == 0.0 and m.yaw_rate == 0.0 for _, m in after)
    assert after[-1][0] - t < 1.4
    assert "failed: pilot, take over" in texts(simulation)


def test_just_over_a_moving_pad_a_failed_core_climbs_away_first() -> None:
    _, wire, t = failed_flight(Tick, 0.12, "sim.pad.speed_mps=1.5")
    first, last = wire.after(t + 0.05)[0][1], wire.after(t)[-1][1]
    assert first.vz < -0.3
    assert abs(speed(first) - speed(last)) > 1.0
    assert speed(last) == 0.0
