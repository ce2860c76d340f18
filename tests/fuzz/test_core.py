"""Whatever devices say in flight, the core never raises, and its orders keep the limits."""

import math
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd.geometry import Vec3, horizontal
from landerd.messages import (
    Attitude,
    AutopilotRestarted,
    Battery,
    ClockSync,
    GimbalState,
    Heartbeat,
    Input,
    Landed,
    LandedState,
    LocalPosition,
    PoseSolution,
    RcChannels,
    Reference,
    Setpoint,
    Shutdown,
    Tick,
)
from tests.fuzz.budget import examples
from tests.scripted_flight import DT, Flight

pytestmark = pytest.mark.long


# What the daemon lets through: finite, and not from the future.
NUMBER = st.one_of(
    st.floats(-10.0, 10.0),
    st.floats(allow_nan=False, allow_infinity=False, width=32),
    st.sampled_from([0.0, -0.0, 1e-30, 1e30, -1e30, math.pi, 1e9]),
)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
SIGMA = st.floats(0.0, 1e9)


def told() -> st.SearchStrategy[Input]:
    """Strategy for messages whose times count from now."""
    t = st.floats(-3.0, 0.05) | st.floats(-1e6, 0.0) | st.just(0.0)
    return st.one_of(
        st.builds(Attitude, t, NUMBER, NUMBER, NUMBER, VECTOR),
        st.builds(LocalPosition, t, VECTOR, VECTOR),
        st.builds(GimbalState, t, NUMBER, NUMBER, NUMBER, st.sampled_from(Reference)),
        st.builds(
            Heartbeat, t, st.booleans(), st.booleans(), st.sampled_from(["GUIDED", "LOITER", "?"])
        ),
        st.builds(RcChannels, t, st.lists(st.integers(0, 65535), max_size=18).map(tuple)),
        st.builds(LandedState, t, st.sampled_from(Landed)),
        st.builds(ClockSync, t, st.floats(0.0, 1e6)),
        st.builds(Battery, t, st.none() | NUMBER, st.none() | NUMBER),
        st.builds(AutopilotRestarted, t),
        st.builds(Shutdown, st.just(0.0)),
        st.builds(Tick, st.just(0.0)),
    )


def _at(place: Vec3, true: PoseSolution) -> PoseSolution:
    return replace(true, position=place)


STEP = st.tuples(st.booleans(), st.lists(told(), max_size=4), st.floats(0.5, 3.0) | st.just(1.0))


@examples(40)
@given(st.floats(0.3, 9.0), st.lists(STEP, min_size=1, max_size=60), st.lists(VECTOR, max_size=10))
def test_no_message_raises_or_breaks_a_limit(
    height: float, steps: list[tuple[bool, list[Input], float]], places: list[Vec3]
) -> None:
    flight = Flight(position=(-1.5, 0.5, -height - 0.2)).engaged()
    limits = flight.config.guidance.limits
    flown = len(flight.setpoints)
    for i, (visible, messages, ahead) in enumerate(steps):
        flight.visible = visible
        if places:  # sightings at impossible places, too
            flight.distort = partial(_at, places[i % len(places)])
        for message in messages:
            flight.give(replace(message, t=flight.t + message.t))
        flight.t += (ahead - 1.0) * DT
        flight.tick()
    for command in flight.commands:
        if not isinstance(command, Setpoint):
            continue
        assert all(math.isfinite(v) for v in (*command.velocity, command.yaw_rate))
        assert horizontal(command.velocity) <= 1.001 * limits.speed_mps
        assert -1.001 * limits.climb_mps <= command.velocity[2] <= 1.001 * limits.descent_mps
        assert abs(command.yaw_rate) <= 1.001 * math.radians(limits.yaw_rate_deg_s)
    assert len(flight.setpoints) >= flown
