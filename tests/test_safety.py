"""Every safety rule of docs/safety.md, flown: the daemon with simulated devices that fail.

The judge (hw.sim.judge.rules) watches each flight from the bytes on the wire and the truth; these
tests make the situations in which a rule matters, and say what a pilot would notice besides.
`make mutants` shows for each rule that a test here fails when the rule is taken out.
"""

import asyncio
import math
from functools import cache
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.sim.gimbals.sim import GimbalFault, SimGimbal
from hw.sim.picture.camera import CameraFaults
from landerd.messages import Phase
from landerd.simulation.flight import Simulation
from landerd.simulation.result import result_of
from tests.simulated import ABOVE, AS_FOUND, MODELLED, SEEN, fly


class Wire:
    """What landerd sent: velocity set-points, and orders to stand level, with their times."""

    def __init__(self, simulation: Simulation) -> None:
        self.setpoints: list[tuple[float, Any]] = []
        self.level: list[tuple[float, Any]] = []
        self._codec = mavlink.MAVLink(None)
        self._judge = simulation.rules.from_landerd
        simulation.link.tap = self._tap

    def _tap(self, t: float, data: bytes) -> None:
        for message in self._codec.parse_buffer(bytearray(data)) or []:
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                self.setpoints.append((t, message))
            elif message.get_type() == "SET_ATTITUDE_TARGET":
                self.level.append((t, message))
        self._judge(t, data)

    def after(self, t: float) -> list[tuple[float, Any]]:
        return [(at, m) for at, m in self.setpoints if at > t]


def speed(m: Any) -> float:
    return math.hypot(m.vx, m.vy, m.vz)


def now() -> float:
    return asyncio.get_running_loop().time()


async def phase_is(simulation: Simulation, *phases: Phase) -> None:
    while simulation.daemon.lander.phase not in phases:
        await asyncio.sleep(0.01)


async def ends_in(simulation: Simulation, seconds: float) -> None:
    """End the flight after a while."""
    await asyncio.sleep(seconds)
    simulation.over = True


async def flying(simulation: Simulation) -> None:
    """Wait until landerd has flown for a moment."""
    await phase_is(simulation, Phase.APPROACH, Phase.CLOSE_APPROACH, Phase.YAW_CORRECTION)
    await asyncio.sleep(1.0)


def texts(simulation: Simulation) -> str:
    return "\n".join(t.text for t in simulation.ground_station.texts if t.component == 191)


@cache
def undisturbed(guid_timeout_s: float) -> Simulation:
    return fly(overrides=[*ABOVE, f"sim.autopilot.guid_timeout_s={guid_timeout_s}"])


def test_an_undisturbed_landing_breaks_no_rule_and_is_told() -> None:
    simulation = undisturbed(1.0)
    assert simulation.score.landed
    assert simulation.rules.broken == {}
    assert simulation.rules.disarm_orders >= 1
    assert simulation.daemon.lander.outcome == "landed"
    assert "descent" in texts(simulation)


# ---- rule 1: who flies -------------------------------------------------------------------------


@cache
def without_heartbeats() -> tuple[Simulation, Wire, float]:
    """Return a flight whose heartbeats end, what was sent, and when that was."""
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await flying(simulation)
        simulation.autopilot.mute.add(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        seen["t"] = now()
        await ends_in(simulation, 7.0)

    simulation = fly(script, overrides=[*ABOVE, "sim.start.altitude_m=10"])
    return simulation, seen["wire"], seen["t"]


def test_1a_nothing_is_sent_without_heartbeats() -> None:
    simulation, wire, t = without_heartbeats()
    assert wire.after(t), "landerd never flew"
    assert all(speed(m) == 0.0 for _, m in wire.after(t + 3.1))
    assert wire.after(t + 4.2) == []
    assert simulation.rules.broken == {}


def test_1b_without_heartbeats_it_stops_before_it_is_silent() -> None:
    simulation, _, _ = without_heartbeats()
    assert simulation.rules.broken == {}


def test_1b_a_closed_gate_gives_zeros_for_a_second_and_then_silence() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await flying(simulation)
        simulation.autopilot.pilot.set(11, 1100)
        seen["t"] = now()
        await ends_in(simulation, 4.0)

    simulation = fly(script)
    wire, closed = seen["wire"], seen["t"]
    after = wire.after(closed + 0.1)
    assert after
    assert all(speed(m) == 0.0 and m.yaw_rate == 0.0 for _, m in after)
    assert 0.8 < after[-1][0] - closed < 1.3
    assert simulation.rules.broken == {}


def test_1b_stale_rc_closes_the_gate_but_does_not_latch() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await flying(simulation)
        simulation.autopilot.mute.add(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
        seen["stale"] = now() + 0.5
        await asyncio.sleep(3.0)
        simulation.autopilot.mute.clear()
        seen["back"] = now()
        await ends_in(simulation, 1.5)

    simulation = fly(script, longest_s=40.0)
    wire = seen["wire"]
    between = [m for t, m in wire.after(seen["stale"] + 0.1) if t < seen["back"]]
    assert between
    assert all(speed(m) == 0.0 for m in between)
    flown = [m for _, m in wire.after(seen["back"] + 0.5)]
    assert any(speed(m) > 0.05 for m in flown), "mere staleness latched"
    assert simulation.rules.broken == {}


def test_1c_landerd_is_silent_until_it_has_seen_the_pad() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        simulation.camera.faults.drop = 1.0
        await asyncio.sleep(5.0)
        simulation.camera.faults.drop = 0.0
        seen["t"] = now()
        await flying(simulation)
        simulation.over = True

    simulation = fly(script)
    assert seen["wire"].setpoints[0][0] > seen["t"]
    assert simulation.rules.broken == {}


def test_1d_out_of_sight_it_hovers_does_not_turn_says_so_and_hands_back() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await phase_is(simulation, Phase.YAW_CORRECTION)
        await asyncio.sleep(0.3)
        simulation.camera.faults.drop = 1.0
        seen["t"] = now()
        while simulation.daemon.lander.outcome is None:
            await asyncio.sleep(0.1)
        await ends_in(simulation, 2.0)

    overrides = [*ABOVE, "sim.start.heading_deg=100", "guidance.lost.give_up_s=8"]
    simulation = fly(script, longest_s=25.0, overrides=overrides)
    wire, lost = seen["wire"], seen["t"]
    blind = wire.after(lost + 0.7)
    assert blind, "nothing streamed while blind"
    assert all(m.yaw_rate == 0.0 and m.vz <= 0.0 for _, m in blind)
    assert blind[-1][0] > lost + 8.0, "the stop was not repeated"
    assert blind[-1][0] < lost + 11.0, "never handed back"
    assert "take over" in texts(simulation)
    assert simulation.daemon.lander.outcome == "handed_back"
    assert simulation.rules.broken == {}


@cache
def latching(event: str) -> tuple[Simulation, Wire, dict[str, float]]:
    """Return a flight with an event that latches, what was sent, and times of the script."""
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await flying(simulation)
        copter = simulation.autopilot.copter
        seen["began"] = now()
        if event == "mode":
            copter.set_mode(5)  # LOITER
            await asyncio.sleep(1.5)
            copter.set_mode(4)
        elif event == "disarm":
            # Told disarmed for a while: the motors are left alone, this is about the latch.
            copter.armed = False
            await asyncio.sleep(1.5)
            copter.armed = True
        else:
            simulation.autopilot.reboot()
            # Its streams are forgotten: landerd hovers until one comes back and tells.
            await asyncio.sleep(3.0)
        seen["t"] = now() + 0.2
        await asyncio.sleep(3.0)
        seen["open"] = now()
        simulation.autopilot.pilot.set(11, 1100)
        await asyncio.sleep(1.0)
        simulation.autopilot.pilot.set(11, 1900)
        await ends_in(simulation, 2.0)

    simulation = fly(script, overrides=[*ABOVE, "sim.start.altitude_m=8"])
    return simulation, seen["wire"], seen


def test_1a_set_points_end_when_the_pilot_leaves_guided() -> None:
    simulation, wire, seen = latching("mode")
    assert any(t < seen["began"] for t, _ in wire.setpoints), "landerd never flew"
    assert [t for t, _ in wire.after(seen["began"] + 0.1) if t < seen["open"]] == []
    assert simulation.rules.broken == {}


@pytest.mark.parametrize("event", ["mode", "disarm", "reboot"])
def test_1_it_latches_until_the_switch_was_low(event: str) -> None:
    simulation, wire, seen = latching(event)
    latched = [t for t, _ in wire.after(seen["t"]) if t < seen["open"]]
    assert latched == []
    assert wire.after(seen["open"] + 1.0), "did not fly again after the switch was low"
    assert simulation.rules.broken == {}


def test_1b_when_the_autopilot_restarts_it_stops_before_it_is_silent() -> None:
    simulation, _, _ = latching("reboot")
    assert simulation.rules.broken == {}


def test_1b_a_gate_closed_just_over_a_moving_pad_does_not_stop_on_it() -> None:
    async def script(simulation: Simulation) -> None:
        while simulation.world.height > 0.12:
            await asyncio.sleep(0.01)
        simulation.autopilot.pilot.set(11, 1100)
        await ends_in(simulation, 6.0)

    simulation = fly(script, overrides=[*ABOVE, "sim.pad.speed_mps=1.5"])
    assert simulation.rules.broken == {}


def test_1b_a_gate_closed_on_the_pad_leaves_the_vehicle_standing() -> None:
    async def script(simulation: Simulation) -> None:
        while simulation.score.contact is None:
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.0)
        simulation.autopilot.pilot.set(11, 1100)
        await ends_in(simulation, 4.0)

    simulation = fly(script)
    assert simulation.score.contact is not None
    assert simulation.rules.broken == {}


# ---- rule 2: never blind -----------------------------------------------------------------------


def test_2_no_descent_without_a_young_sighting() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await phase_is(simulation, Phase.DESCENT)
        simulation.camera.faults.drop = 1.0
        seen["t"] = now()
        await asyncio.sleep(2.0)
        simulation.camera.faults.drop = 0.0

    # A wide region: it is the age of the sighting that must end the descent, not its uncertainty.
    simulation = fly(script, longest_s=40.0, overrides=[*ABOVE, "guidance.descent.k1_m=1.0"])
    blind = [m for t, m in seen["wire"].after(seen["t"] + 0.55) if t < seen["t"] + 2.0]
    assert blind
    assert all(m.vz <= 0.0 for m in blind)
    assert simulation.score.landed
    assert simulation.daemon.lander.aborts >= 1
    assert simulation.rules.broken == {}


def test_2_no_commitment_higher_than_the_commit_height() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        while simulation.world.height > 0.6:
            await asyncio.sleep(0.01)
        simulation.camera.faults.drop = 1.0
        seen["t"] = now()
        await ends_in(simulation, 2.0)

    simulation = fly(script, longest_s=40.0)
    blind = [m for _, m in seen["wire"].after(seen["t"] + 0.55)]
    assert blind
    assert all(m.vz <= 0.0 for m in blind)
    assert simulation.rules.broken == {}


def test_2_after_commit_it_sinks_blind_for_a_second_at_most() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await phase_is(simulation, Phase.LANDED)
        simulation.camera.faults.drop = 1.0
        seen["t"] = now()
        await ends_in(simulation, 2.4)

    # Committed early and sinking slowly: contact takes two seconds.
    slow = ["guidance.descent.commit_height_m=0.2", "guidance.touchdown_descent_mps=0.1"]
    simulation = fly(script, longest_s=40.0, overrides=[*ABOVE, *slow])
    blind = [m for _, m in seen["wire"].after(seen["t"] + 1.05)]
    assert blind
    assert all(m.vz <= 0.0 for m in blind)
    assert simulation.rules.broken == {}


@pytest.mark.parametrize("timeout_s", [1.0, 3.0])
def test_2_if_landerd_dies_at_any_height_the_vehicle_comes_down_gently(timeout_s: float) -> None:
    simulation = undisturbed(timeout_s)
    assert simulation.score.landed
    assert simulation.rules.broken == {}


@pytest.mark.parametrize("seed", [1, 35, 45])
def test_2_a_pad_that_stops_after_commit_is_waved_off(seed: int) -> None:
    async def script(simulation: Simulation) -> None:
        await phase_is(simulation, Phase.LANDED)
        pad = simulation.world._motion
        pad._brake, pad._brake_t = 5.0, simulation.world.t
        await ends_in(simulation, 6.0)

    simulation = fly(script, overrides=[*ABOVE, AS_FOUND, "sim.pad.speed_mps=2.0"], seed=seed)
    assert simulation.rules.broken == {}


@pytest.mark.parametrize("seed", [2, 5])
def test_4_on_a_deck_that_heaves_and_moves_it_stands_until_it_is_disarmed(seed: int) -> None:
    # What the deck carried down was taken for flying: its thrust came back, and it was tipped over.
    deck = ("sim.pad.speed_mps=3.0", "sim.pad.heave_m=0.3", "sim.pad.heave_hz=0.2")
    simulation = fly(longest_s=40.0, overrides=[*ABOVE, AS_FOUND, *deck], seed=seed)
    assert "landed and disarmed" in texts(simulation)
    assert simulation.monitor.worst.tilt_deg < 15.0
    assert simulation.rules.broken == {}


def test_4_it_goes_with_a_pad_that_brakes_under_it() -> None:
    async def script(simulation: Simulation) -> None:
        while not all(simulation.world.vehicle.feet):
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.4)
        pad = simulation.world._motion
        pad._brake, pad._brake_t = 1.0, simulation.world.t

    simulation = fly(script, longest_s=30.0, overrides=[*ABOVE, "sim.pad.speed_mps=2.0"])
    assert "landed and disarmed" in texts(simulation)
    assert simulation.rules.broken == {}


def test_2_no_descent_outside_the_region() -> None:
    overrides = [*ABOVE, "sim.start.position_m=[-3.0, 2.0]", "sim.wind.speed_mps=4"]
    simulation = fly(longest_s=45.0, overrides=overrides)
    assert simulation.score.landed
    assert simulation.rules.broken == {}


PID = "guidance.method=pid"


def test_2_no_descent_below_the_alignment_height_with_the_heading_off() -> None:
    # The thesis's controller asks for all it wants: here the core's own bounds are on trial.
    overrides = [*ABOVE, "sim.start.heading_deg=120", "sim.yaw_response=measured", PID]
    simulation = fly(longest_s=45.0, overrides=overrides)
    assert simulation.score.landed
    assert abs(math.degrees(simulation.world.heading_error)) < 6.0
    assert simulation.rules.broken == {}


SWITCH_OF_THREE = ("rc.gate_threshold_us=1300", "rc.land_threshold_us=1700")


@pytest.mark.parametrize("height_m", [1.0, 0.12])
def test_2_asked_to_hold_it_sinks_no_further_and_lands_at_the_go(height_m: float) -> None:
    seen: dict[str, float] = {}

    async def script(simulation: Simulation) -> None:
        pilot = simulation.autopilot.pilot
        while simulation.world.height > height_m:
            await asyncio.sleep(0.01)
        pilot.set(11, 1500)
        await asyncio.sleep(6.0)
        seen["height"] = simulation.world.height
        pilot.set(11, 1900)

    moves = "sim.pad.speed_mps=1.0"
    simulation = fly(script, longest_s=40.0, overrides=[*ABOVE, *SWITCH_OF_THREE, moves])
    assert seen["height"] == pytest.approx(2.0, abs=0.3)
    assert "holding over the marker, switch to land" in texts(simulation)
    held = result_of(simulation.flown(), "hold", 1)["hold_error_m_p95"]
    assert 0.0 < held < 0.15
    assert simulation.score.landed
    assert simulation.rules.broken == {}


# ---- rule 3: limits ----------------------------------------------------------------------------


@pytest.mark.parametrize("method", [[], [PID, "guidance.limits.speed_mps=3.0"]])
def test_3_set_points_keep_the_limits_from_far_away(method: list[str]) -> None:
    async def script(simulation: Simulation) -> None:
        await phase_is(simulation, Phase.DESCENT)
        await ends_in(simulation, 2.0)

    overrides = [MODELLED, "sim.start.position_m=[-16, 5]", "sim.start.altitude_m=8", *method]
    simulation = fly(script, longest_s=60.0, overrides=overrides)
    assert not simulation.timed_out, "did not come down over the pad"
    assert simulation.rules.broken == {}


# ---- rule 4: after contact ---------------------------------------------------------------------


def test_4_without_on_ground_it_keeps_pressing_and_tells_the_pilot() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        simulation.autopilot.mute.add(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)

    simulation = fly(script, longest_s=40.0)
    contact = simulation.score.contact
    assert contact is not None
    pressing = [m for t, m in seen["wire"].after(contact.t) if t < contact.t + 0.6]
    assert len(pressing) > 20
    assert all(0.0 < m.vz <= 0.6 for m in pressing)
    assert seen["wire"].after(contact.t + 1.8) == []
    assert seen["wire"].level[-1][0] > contact.t + 6.0
    assert {(m.q[1], m.q[2], m.thrust) for _, m in seen["wire"].level} == {(0.0, 0.0, 0.0)}
    assert simulation.rules.disarm_orders == 0
    assert "not confirmed" in texts(simulation)
    assert simulation.daemon.lander.outcome == "touchdown_unconfirmed"
    assert simulation.rules.broken == {}


def test_4_in_strong_wind_it_stands_where_it_touched_and_is_soon_disarmed() -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        while simulation.score.contact is None:
            await asyncio.sleep(0.01)
        seen["touched"] = simulation.world.offset

    wind = ("sim.wind.speed_mps=9.0", "sim.wind.from_deg=0.0", "sim.start.altitude_m=1.0")
    simulation = fly(script, longest_s=60.0, overrides=[*ABOVE, *wind])
    contact = simulation.score.contact
    assert contact is not None
    assert simulation.score.landed
    assert math.dist(seen["touched"], simulation.world.offset) < 0.2
    assert seen["wire"].level[0][0] < contact.t + 2.0
    assert simulation.score.disarm_t is not None
    assert simulation.score.disarm_t < contact.t + 4.0
    assert simulation.rules.broken == {}


# ---- rule 5: freshness -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (mavlink.MAVLINK_MSG_ID_ATTITUDE, "attitude is stale"),
        (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, "position is stale"),
    ],
)
def test_5_stale_telemetry_is_not_flown_on(message: int, reason: str) -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await flying(simulation)
        simulation.autopilot.mute.add(message)
        seen["t"] = now()
        await asyncio.sleep(4.0)
        simulation.autopilot.mute.clear()
        await ends_in(simulation, 2.5)

    overrides = [MODELLED, "sim.start.position_m=[-10, 2]", "sim.start.altitude_m=5"]
    simulation = fly(script, longest_s=60.0, overrides=overrides)
    late = [m for t, m in seen["wire"].after(seen["t"] + 2.9) if t < seen["t"] + 3.9]
    assert late
    assert all(speed(m) < 0.02 for m in late)
    assert reason in texts(simulation)
    assert speed(seen["wire"].setpoints[-1][1]) > 0.1, "did not fly on"
    assert simulation.rules.broken == {}


@pytest.mark.parametrize("fault", [GimbalFault.SILENT, GimbalFault.NAN, GimbalFault.LOST])
def test_5_a_gimbal_that_fails_stops_the_landing(fault: GimbalFault) -> None:
    seen: dict[str, Any] = {}

    async def script(simulation: Simulation) -> None:
        seen["wire"] = Wire(simulation)
        await flying(simulation)
        assert isinstance(simulation.gimbal, SimGimbal)
        simulation.gimbal.fault = fault
        seen["t"] = now()
        await asyncio.sleep(4.0)
        simulation.gimbal.fault = None
        await ends_in(simulation, 2.0)

    simulation = fly(script)
    blind = [m for t, m in seen["wire"].after(seen["t"] + 0.95) if t < seen["t"] + 3.9]
    assert blind
    assert all(m.vz <= 0.0 for m in blind)
    assert "gimbal angles are stale" in texts(simulation)
    assert simulation.rules.broken == {}


def test_5_frozen_gimbal_angles_stop_the_landing() -> None:
    async def script(simulation: Simulation) -> None:
        await flying(simulation)
        assert isinstance(simulation.gimbal, SimGimbal)
        simulation.gimbal.fault = GimbalFault.FROZEN
        await ends_in(simulation, 9.0)

    simulation = fly(script)
    assert simulation.rules.broken == {}


def test_5_data_that_was_long_under_way_counts_as_old() -> None:
    async def script(simulation: Simulation) -> None:
        await flying(simulation)
        simulation.autopilot_end.faults.delay_s = 0.35
        await ends_in(simulation, 9.0)

    simulation = fly(script)
    assert simulation.rules.broken == {}


# ---- bad input at the device protocols ---------------------------------------------------------


@pytest.mark.parametrize(
    ("faults", "sight"),
    [
        (CameraFaults(wrong_size=True), SEEN),
        (CameraFaults(wrong_type=True), SEEN),
        (CameraFaults(time_ahead_s=5.0), MODELLED),
        (CameraFaults(disconnected=True), MODELLED),
        (CameraFaults(frozen=True), MODELLED),
    ],
)
def test_bad_pictures_stop_the_landing_and_not_the_daemon(faults: CameraFaults, sight: str) -> None:
    async def script(simulation: Simulation) -> None:
        await flying(simulation)
        good = simulation.camera.faults
        simulation.camera.faults = faults
        await asyncio.sleep(3.0)
        assert simulation.daemon.lander.phase is not Phase.DESCENT
        simulation.camera.faults = good
        await phase_is(simulation, Phase.DESCENT)
        await ends_in(simulation, 0.5)

    simulation = fly(script, longest_s=40.0, overrides=[*ABOVE, sight])
    assert not simulation.timed_out, "did not land on"
    assert simulation.daemon.lander.aborts >= 1
    assert simulation.rules.broken == {}


def test_a_bad_link_breaks_no_rule() -> None:
    async def script(simulation: Simulation) -> None:
        simulation.link.faults.drop = 0.1
        simulation.autopilot_end.faults.corrupt = 0.002
        simulation.autopilot_end.faults.drop = 0.1

    simulation = fly(script, longest_s=60.0)
    assert simulation.score.landed
    broken = {r for r in simulation.rules.broken if not r.startswith("3: set-points less often")}
    assert broken == set()
