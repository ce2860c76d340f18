"""A ground station reads, sets and saves landerd's parameters, through the stand-in's routing."""

import asyncio
from collections.abc import Awaitable, Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from landerd.config.models import Config
from landerd.config.parameters import ParameterSet, parameters
from landerd.messages import ParameterChange
from landerd.runtime.clock import run_virtual
from tests.hw.flight import Client, Flight


def changes(f: Flight) -> list[ParameterChange]:
    """Return the ground station's changes, without the GUID_TIMEOUT that the autopilot reports."""
    return [m for m in f.got(ParameterChange) if not m.key.startswith("autopilot.")]


def fly(
    scene: Callable[[Flight, ParameterSet], Awaitable[None]],
    *,
    flying: bool = False,
    overlay: Path | None = None,
    **options: Any,
) -> None:
    async def main() -> None:
        tuned = ParameterSet(Config(), overlay)
        async with Flight(flying=flying, parameters=tuned, **options) as f:
            await f.connect()
            await scene(f, tuned)

    run_virtual(main())


def values(client: Client) -> dict[str, float]:
    return {m.param_id: m.param_value for _, m in client.of("PARAM_VALUE")}


async def open_file(f: Flight, *, component: int, opcode: int = 4) -> list[Any]:
    """Ask a component for its parameters as a file; return the answers."""
    name = b"@PARAM/param.pck"
    request = bytes([7, 0, 0, opcode, len(name), 0, 0, 0, *bytes(4)]) + name
    f.client.send(
        mavlink.MAVLink_file_transfer_protocol_message(
            0, 1, component, list(request.ljust(251, b"\0"))
        )
    )
    await asyncio.sleep(0.1)
    return [m for _, m in f.client.of("FILE_TRANSFER_PROTOCOL")]


def test_a_station_that_would_fetch_a_file_first_is_refused_at_once() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        (answer,) = await open_file(f, component=191)
        to = (answer.target_system, answer.target_component)
        assert to == (255, 190)
        # Sequence 8, session 0, NAK of 1 byte to OpenFileRO: no such command.
        assert bytes(answer.payload)[:13] == bytes([8, 0, 0, 129, 1, 4, 0, 0, 0, 0, 0, 0, 7])

    fly(scene)


@pytest.mark.parametrize(("component", "opcode"), [(1, 4), (0, 4), (191, 128), (191, 129)])
def test_file_requests_to_others_and_answers_are_ignored(component: int, opcode: int) -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        assert await open_file(f, component=component, opcode=opcode) == []

    fly(scene)


async def set_value(f: Flight, name: str, value: float, *, component: int = 191) -> None:
    f.client.send(
        mavlink.MAVLink_param_set_message(
            1, component, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
        )
    )
    await asyncio.sleep(0.05)


@pytest.mark.parametrize("component", [0, 191])
def test_the_list_of_parameters_is_complete_and_sent_no_faster_than_the_link_bears(
    component: int,
) -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        f.client.send(mavlink.MAVLink_param_request_list_message(1, component))
        await asyncio.sleep(2.0)
        heard = f.client.of("PARAM_VALUE")
        assert [m.param_id for _, m in heard] == list(parameters())
        assert {m.param_count for _, m in heard} == {len(parameters())}
        assert [m.param_index for _, m in heard] == list(range(len(parameters())))
        for name, value in values(f.client).items():
            assert value == pytest.approx(tuned.value(name))
        # On 57600 baud set-points must still get through: no burst of more than a few messages.
        times = [t for t, _ in heard]
        assert all(b - a > 0.015 for a, b in pairwise(times))

    fly(scene)


def test_a_parameter_is_read_by_name_or_by_index() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        f.client.send(mavlink.MAVLink_param_request_read_message(1, 191, b"RC_GATE_CH", -1))
        f.client.send(mavlink.MAVLink_param_request_read_message(1, 191, b"", 3))
        f.client.send(mavlink.MAVLink_param_request_read_message(1, 191, b"NO_SUCH", -1))
        f.client.send(mavlink.MAVLink_param_request_read_message(1, 191, b"", 999))
        await asyncio.sleep(0.1)
        assert [m.param_id for _, m in f.client.of("PARAM_VALUE")] == [
            "RC_GATE_CH",
            tuned.names[3],
        ]

    fly(scene)


def test_an_accepted_change_is_a_message_into_the_core() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        await set_value(f, "PID_UP_KP", 1.1)
        assert values(f.client) == {"PID_UP_KP": pytest.approx(1.1)}
        (change,) = changes(f)
        assert (change.key, change.value) == ("guidance.pid.up.kp", 1.1)  # no 1.10000002384
        now = asyncio.get_running_loop().time()
        assert change.t == pytest.approx(now, abs=0.1)

    fly(scene)


def test_a_refused_value_is_taken_back_and_the_pilot_is_told_why() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        await set_value(f, "PID_UP_KP", 99.0)
        assert values(f.client) == {"PID_UP_KP": pytest.approx(0.9)}
        assert not changes(f)
        assert "landerd: PID_UP_KP: at least 0, at most 10" in f.client.texts

    fly(scene)


@pytest.mark.parametrize(("flying", "taken"), [(False, 1), (True, 0)])
def test_the_gate_is_locked_while_armed(*, flying: bool, taken: int) -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        for name, value in (("RC_GATE_CH", 7.0), ("LIM_SPEED", 2.0)):
            await set_value(f, name, value)
        assert len(changes(f)) == 2 * taken
        assert tuned.value("RC_GATE_CH") == (7 if taken else 11)
        assert ("landerd: LIM_SPEED: only while disarmed" in f.client.texts) is not bool(taken)
        await set_value(f, "PID_UP_KD", 0.3)  # gains may be tuned in flight
        assert tuned.value("PID_UP_KD") == 0.3

    fly(scene, flying=flying)


def test_without_fresh_heartbeats_the_vehicle_counts_as_armed() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        f.autopilot.mute.add(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        await asyncio.sleep(4.0)
        before = tuned.value("LIM_SPEED")
        await set_value(f, "LIM_SPEED", 2.0)
        assert tuned.value("LIM_SPEED") == before

    fly(scene)


def test_only_configured_ground_stations_are_obeyed() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        before = f.driver.counters["foreign"]
        await set_value(f, "PID_UP_KP", 1.1)
        assert tuned.value("PID_UP_KP") == 0.9
        assert f.driver.counters["foreign"] == before + 1
        assert not f.client.of("PARAM_VALUE")

    fly(scene, ground_stations=[254])


def test_parameter_messages_for_other_components_are_ignored() -> None:
    async def scene(f: Flight, tuned: ParameterSet) -> None:
        await set_value(f, "PID_UP_KP", 1.1, component=154)
        await set_value(f, "WPNAV_SPEED", 500.0, component=0)
        f.client.send(
            mavlink.MAVLink_param_set_message(
                2, 191, b"PID_UP_KP", 1.1, mavlink.MAV_PARAM_TYPE_REAL32
            )
        )
        await asyncio.sleep(0.1)
        assert not f.client.of("PARAM_VALUE")
        assert not [t for t in f.client.texts if "parameter" in t]
        await set_value(f, "WPNAV_SPEED", 500.0)
        assert "landerd: no parameter WPNAV_SPEED" in f.client.texts

    fly(scene)


def command(f: Flight, number: int, param1: float) -> None:
    f.client.send(mavlink.MAVLink_command_long_message(1, 191, number, 0, param1, *(0.0,) * 6))


def test_values_are_saved_on_request_and_the_order_acknowledged(tmp_path: Path) -> None:
    overlay = tmp_path / "mine.saved.yaml"

    async def scene(f: Flight, tuned: ParameterSet) -> None:
        await set_value(f, "PID_UP_KP", 1.1)
        assert not overlay.exists()
        command(f, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 1.0)
        await asyncio.sleep(0.1)
        assert "kp: 1.1" in overlay.read_text()
        command(f, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 2.0)  # reset to factory defaults
        command(f, mavlink.MAV_CMD_DO_SET_HOME, 1.0)
        overlay.unlink()
        tmp_path.rmdir()
        command(f, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 1.0)
        await asyncio.sleep(0.1)
        acks = [
            (m.command, m.result)
            for _, m in f.client.of("COMMAND_ACK")
            if m.get_srcComponent() == 191
        ]
        assert acks == [(245, 0), (245, 3), (179, 3), (245, 4)]
        assert any("not saved" in text for text in f.client.texts)

    fly(scene, overlay=overlay)


def test_nothing_is_saved_while_armed(tmp_path: Path) -> None:
    overlay = tmp_path / "mine.saved.yaml"

    async def scene(f: Flight, tuned: ParameterSet) -> None:
        command(f, mavlink.MAV_CMD_PREFLIGHT_STORAGE, 1.0)  # a slow disk would hold up the loop
        await asyncio.sleep(0.1)
        acks = [
            (m.command, m.result)
            for _, m in f.client.of("COMMAND_ACK")
            if m.get_srcComponent() == 191
        ]
        assert acks == [(245, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)]
        assert not overlay.exists()

    fly(scene, flying=True, overlay=overlay)
