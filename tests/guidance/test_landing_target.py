"""The second output, flown: LANDING_TARGET for the autopilot's own precision landing."""

import asyncio
import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.sim.snapshot import Snapshot
from landerd.geometry import Vec3, norm, rotate, sub, transpose
from landerd.messages import Frame
from landerd.simulation.flight import Simulation
from tests.simulated import ABOVE, fly


def test_landing_target_is_the_pad_in_the_body_frame_at_its_exposure_and_no_set_point_is_sent() -> (
    None
):
    """It is sent without the gate, too: ArduPilot's mode decides whether it is used."""
    sent: list[Any] = []
    truth: dict[int, Vec3] = {}  # by time of exposure, us

    async def script(simulation: Simulation) -> None:
        simulation.autopilot.copter.set_mode(5)  # LOITER
        codec, judge = mavlink.MAVLink(None), simulation.rules.from_landerd

        def tap(t: float, data: bytes) -> None:
            sent.extend(codec.parse_buffer(bytearray(data)) or [])
            judge(t, data)

        def delivered(frame: Frame, at: Snapshot) -> None:
            arm = sub(at.pad.position, at.vehicle.position)
            truth[int(frame.t * 1e6)] = rotate(transpose(at.vehicle.R_local_body), arm)

        simulation.link.tap = tap
        simulation.camera._delivered = delivered
        await asyncio.sleep(1.1)
        simulation.autopilot.pilot.set(11, 1100)

    fly(script, longest_s=4.0, overrides=[*ABOVE, "guidance.output=landing_target"])
    targets = [m for m in sent if m.get_type() == "LANDING_TARGET"]
    assert len(targets) > 30
    assert not [m for m in sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert "landerd: left to the autopilot's precision landing" in [
        m.text for m in sent if m.get_type() == "STATUSTEXT"
    ]
    for m in targets:
        assert (m.frame, m.position_valid, m.type) == (12, 1, 2)
        assert m.distance == pytest.approx(norm((m.x, m.y, m.z)), rel=1e-5)
        assert (m.x, m.y, m.z) == pytest.approx(truth[m.time_usec], abs=0.15)
        assert math.tan(m.angle_x) == pytest.approx(m.y / m.z, abs=1e-5)
    assert max(abs(m.x) for m in targets) > 0.3  # the signs were seen
    times = [m.time_usec for m in targets]
    assert times == sorted(set(times))
