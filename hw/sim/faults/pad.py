"""Unexpected motion of the pad: it stops, starts, jerks, turns, is lifted, is carried away."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from hw.sim.faults.bench import Bench, Effect
from hw.sim.physics.pad_motion import Disturbance, PadState
from landerd.geometry import Vec3, add, horizontal, matmul, rot_z, scale, wrap

_STARTS_MPS2 = 2.0
_LIFTS_MPS, _LIFTS_MPS2 = 0.5, 1.0
_JERK_S = 0.2
_UP: Vec3 = (0.0, 0.0, -1.0)


def _speeding(t: float, speed: float, acceleration: float) -> tuple[float, float]:
    """Return distance (m) and speed (m/s) t seconds after accelerating to a speed began."""
    ramp = min(t, speed / acceleration)
    v = acceleration * ramp
    return 0.5 * v * ramp + v * (t - ramp), v


def _going(onset: float, way: Vec3, speed: float, acceleration: float) -> Disturbance:
    """Return a disturbance: from onset (s) the pad also moves along a unit vector (local)."""

    def disturb(t: float, state: PadState) -> PadState:
        if t <= onset:
            return state
        distance, v = _speeding(t - onset, speed, acceleration)
        return _moved(state, scale(way, distance), scale(way, v))

    return disturb


def _moved(state: PadState, by: Vec3, velocity: Vec3) -> PadState:
    position, faster = add(state.position, by), add(state.velocity, velocity)
    return replace(state, position=position, velocity=faster)


def _stopping(onset: float, before: PadState, brake: float) -> Disturbance:
    """Return a disturbance: from onset (s), with the state then, the pad brakes to a stop."""
    speed = horizontal(before.velocity)

    def disturb(t: float, state: PadState) -> PadState:
        if t <= onset or speed == 0.0:
            return state
        ramp = min(t - onset, speed / brake)
        v = speed - brake * ramp
        way = scale(before.velocity, 1.0 / speed)
        place = add(before.position, scale((way[0], way[1], 0.0), 0.5 * (speed + v) * ramp))
        velocity = (v * way[0], v * way[1], state.velocity[2])
        heading_change = rot_z(before.heading - state.heading)
        return PadState(
            (place[0], place[1], state.position[2]),
            matmul(heading_change, state.R_local_pad),
            velocity,
            0.0,
            before.heading,
        )

    return disturb


def _turning(onset: float, end: Callable[[], float], rate: float) -> Disturbance:
    def disturb(t: float, state: PadState) -> PadState:
        if t <= onset:
            return state
        turns = t < end()
        angle = rate * (min(t, end()) - onset)
        return replace(
            state,
            R_local_pad=matmul(rot_z(angle), state.R_local_pad),
            turn_rate=state.turn_rate + (rate if turns else 0.0),
            heading=wrap(state.heading + angle),
        )

    return disturb


def _jerking(onset: float, way: Vec3, distance: float) -> Disturbance:
    """Return a disturbance: the pad moves aside, its speed being a sine squared over _JERK_S."""

    def disturb(t: float, state: PadState) -> PadState:
        if t <= onset:
            return state
        share = min(1.0, (t - onset) / _JERK_S)
        moved = distance * (share - math.sin(2.0 * math.pi * share) / (2.0 * math.pi))
        v = distance / _JERK_S * (1.0 - math.cos(2.0 * math.pi * share)) if share < 1.0 else 0.0
        return _moved(state, scale(way, moved), scale(way, v))

    return disturb


def _lifting(onset: float, height: float) -> Disturbance:
    def disturb(t: float, state: PadState) -> PadState:
        if t <= onset:
            return state
        risen, v = _speeding(t - onset, _LIFTS_MPS, _LIFTS_MPS2)
        if risen >= height:
            risen, v = height, 0.0
        return _moved(state, scale(_UP, risen), scale(_UP, v))

    return disturb


def _along(bench: Bench) -> Vec3:
    """Return the pad's course as a unit vector; a random one if it stands still."""
    velocity = bench.world.pad.velocity
    if horizontal(velocity) > 0.0:
        return scale((velocity[0], velocity[1], 0.0), 1.0 / horizontal(velocity))
    return _anywhere(bench)


def _anywhere(bench: Bench) -> Vec3:
    """Return a random horizontal direction as a unit vector."""
    course = bench.rng.uniform(-math.pi, math.pi)
    return (math.cos(course), math.sin(course), 0.0)


def _once(disturbance: Callable[[Bench, float], list[Disturbance]]) -> Effect:
    """Return a fault whose disturbances of the pad last until the flight ends."""

    @contextmanager
    def effect(bench: Bench, severity: float) -> Iterator[None]:
        for each in disturbance(bench, severity):
            bench.world.disturb_pad(each)
        yield

    return effect


@contextmanager
def _turns(bench: Bench, severity: float) -> Iterator[None]:
    rate = math.radians(bench.between(5.0, 40.0, severity)) * bench.rng.choice((-1.0, 1.0))
    end = [math.inf]
    bench.world.disturb_pad(_turning(bench.world.elapsed_s, lambda: end[0], rate))
    yield
    end[0] = bench.world.elapsed_s


FAULTS: Mapping[str, Effect] = {
    "pad-stops": _once(
        lambda b, s: [_stopping(b.world.elapsed_s, b.world.pad, b.between(1.0, 8.0, s))]
    ),
    "pad-starts": _once(
        lambda b, s: [_going(b.world.elapsed_s, _along(b), b.between(0.5, 3.0, s), _STARTS_MPS2)]
    ),
    "pad-jerks": _once(
        lambda b, s: [_jerking(b.world.elapsed_s, _anywhere(b), b.between(0.1, 1.0, s))]
    ),
    "pad-turns": _turns,
    "pad-lifted": _once(lambda b, s: [_lifting(b.world.elapsed_s, b.between(0.1, 1.0, s))]),
    "pad-carried-away": _once(
        lambda b, s: [
            _lifting(b.world.elapsed_s, 1.0),
            _going(b.world.elapsed_s, _anywhere(b), b.between(1.0, 5.0, s), _STARTS_MPS2),
        ]
    ),
}
