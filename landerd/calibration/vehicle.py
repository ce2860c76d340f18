"""Identifies how a vehicle follows velocity orders, from flight logs, for `landerd tune --from`.

The model is that of ArduCopter in GUIDED: a delay; ArduPilot's shaper, which limits acceleration
and jerk; and a second-order lag of the inner loops. It was fitted to ArduCopter 4.5.7 in SITL; here
its delay, limits and bandwidth are fitted to the set-points and velocities of a log.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from landerd.camera_model import F64
from landerd.flightlog.reader import FlightLog
from landerd.messages import LocalPosition, Phase, PhaseChange, Setpoint

STEP_S = 0.02  # time step of the model
DAMPING = 0.34  # damping ratio of the second-order lag, as measured in SITL
GAP_S = 0.3  # time without an order at which a stretch of orders ends
SETTLED_S = 3.0  # time after which orders from before landerd flew have no effect any more
LEAST_S = 4.0  # least length of a stretch that is used
FIRST_S = 0.3  # time at the beginning of a stretch from which the first acceleration is estimated
LEAST_CHANGE_MPS = 1.0  # least change of the velocity in a stretch: hovering shows no response
# A vehicle that is slower than ordered by the first, and gains less than the third in the second,
# flies as fast as its lean angle and the air allow: no possible delay or jerk explains that.
SHORT_MPS, HELD_S, GAIN_MPS = 0.5, 2.0, 0.3
# Fits whose rms errors differ by less than this factor are equally good, as the log cannot
# distinguish them; nor can it below the error of its own velocities.
SAME_FIT = 1.05
VELOCITY_ERROR_MPS = 0.01


Series = list[tuple[float, tuple[float, float]]]  # time, s; velocity north and east, m/s


class ResponseError(Exception):
    """The response cannot be fitted; the text says why."""


@dataclass(frozen=True)
class Response:
    """Parameters of the model of horizontal velocity.

    Attributes:
        delay_s: time from an order to the first reaction.
        acceleration_mps2: limit of the shaper.
        jerk_mps3: limit of the shaper.
        omega: natural frequency of the second-order lag, rad/s.
    """

    delay_s: float
    acceleration_mps2: float
    jerk_mps3: float
    omega: float

    @property
    def lag_s(self) -> float:
        """Delay by the second-order lag after the shaper, s."""
        return 2.0 * DAMPING / self.omega


# The response of ArduCopter in SITL with ArduPilot's defaults.
REFERENCE = Response(0.0, 2.5, 5.0, 9.0)
# Limits of the parameters, which configuration and simulator accept.
_LEAST = Response(0.0, 0.5, 1.0, 2.7)
_MOST = Response(0.5, 10.0, 50.0, 27.0)


@dataclass
class Stretch:
    """A part of a flight with orders and flown velocities, north and east."""

    orders_t: list[float] = field(default_factory=list)  # times of the orders, s
    orders: list[tuple[float, float]] = field(default_factory=list)  # m/s
    flown_t: list[float] = field(default_factory=list)  # times of the flown velocities, s
    flown: list[tuple[float, float]] = field(default_factory=list)  # m/s


@dataclass(frozen=True)
class Fit:
    """The result of a fit.

    Attributes:
        response: the gentlest of those that fit best.
        rms_mps: rms residual of the velocity in each axis.
        flown_s: length of all stretches.
        limits_reached: whether the flights were brisk enough to determine acceleration and jerk;
            else these are the least that explain the flights, and the vehicle may have more.
    """

    response: Response
    rms_mps: float
    flown_s: float
    limits_reached: bool


def stretches(log: FlightLog) -> list[Stretch]:
    """Return the parts of a log with landerd's orders: without gaps, in the air, with changes.

    Orders that the vehicle is too weak to follow are left out, from when it falls behind until it
    has caught up: with them it would seem to accelerate slowly.
    """
    orders: Series = []
    flown: Series = []
    committed_t = math.inf
    for step in log.steps:
        message = step.message
        if isinstance(message, LocalPosition):
            flown.append((message.t, (message.velocity[0], message.velocity[1])))
        for command in step.commands:
            if isinstance(command, Setpoint):
                orders.append((step.now, (command.velocity[0], command.velocity[1])))
            elif isinstance(command, PhaseChange) and command.phase is Phase.LANDED:
                committed_t = min(committed_t, step.now)  # feet may touch the pad from then on
    orders = [order for order in orders if order[0] < committed_t]
    flown.sort()
    beyond = _out_of_reach(orders, flown)
    orders = [order for order in orders if order[0] not in beyond]
    breaks = [i + 1 for i, (a, b) in enumerate(pairwise(orders)) if b[0] - a[0] > GAP_S]
    pieces = [orders[i:j] for i, j in pairwise([0, *breaks, len(orders)])]
    return [s for piece in pieces if (s := _stretch(piece, flown)) is not None]


def _out_of_reach(orders: Series, flown: Series) -> set[float]:
    """Return the times of the orders that the vehicle was too weak to follow."""
    times = [t for t, _ in flown]
    behind: list[tuple[float, float]] = []  # time, and speed along the order
    found: set[float] = set()
    run: list[float] = []
    is_held = False
    for t, (north, east) in [*orders, (math.inf, (0.0, 0.0))]:
        speed = math.hypot(north, east)
        i = bisect_right(times, t) - 1
        vn, ve = flown[i][1] if i >= 0 else (north, east)
        along = (vn * north + ve * east) / speed if speed > 0.0 else 0.0
        if speed - along <= SHORT_MPS:
            found.update(run if is_held else ())
            behind, run, is_held = [], [], False
            continue
        run.append(t)
        behind.append((t, along))
        while behind[0][0] < t - HELD_S:
            is_held = is_held or along - behind[0][1] < GAIN_MPS
            behind.pop(0)
    return found


def _stretch(orders: Series, flown: Series) -> Stretch | None:
    """Return the stretch of some orders; None: it is too short, or changes too little."""
    if not orders or orders[-1][0] - orders[0][0] < LEAST_S:
        return None
    times = [t for t, _ in flown]
    inside = flown[bisect_left(times, orders[0][0]) : bisect_right(times, orders[-1][0])]
    if len(inside) < LEAST_S / 0.5:
        return None
    velocities = np.array([v for _, v in inside])
    if float(np.ptp(velocities, axis=0).max()) < LEAST_CHANGE_MPS:
        return None
    return Stretch(
        [t for t, _ in orders],
        [v for _, v in orders],
        [t for t, _ in inside],
        [v for _, v in inside],
    )


def fit(flights: Sequence[Stretch], minimise: Callable[..., Sequence[float]]) -> Fit:
    """Return the response that explains the flights best.

    Args:
        flights: of one vehicle.
        minimise: takes a function on the unit cube and a point of it; returns a better point.

    Raises:
        ResponseError: there is nothing to fit to.
    """
    if not flights:
        raise ResponseError(
            f"found no {LEAST_S:g} s of landerd's orders in the air with {LEAST_CHANGE_MPS:g} m/s "
            "of a change"
        )

    def rms(place: Sequence[float]) -> float:
        return _rms(_at(place), flights)

    best = _at(minimise(rms, _place(REFERENCE)))
    same = SAME_FIT * max(_rms(best, flights), VELOCITY_ERROR_MPS)
    reached = _rms(_scaled(best, 1.5), flights) > same
    response = best
    while response.acceleration_mps2 > _LEAST.acceleration_mps2:
        gentler = _scaled(response, 0.92)
        if _rms(gentler, flights) > same:
            break
        response = gentler
    flown_s = sum(s.flown_t[-1] - s.flown_t[0] for s in flights)
    return Fit(response, _rms(response, flights), flown_s, reached)


def _scaled(response: Response, k: float) -> Response:
    """Return a response with both limits of the shaper multiplied by k; their ratio stays."""
    a, j = k * response.acceleration_mps2, k * response.jerk_mps3
    return replace(response, acceleration_mps2=a, jerk_mps3=j)


def _place(response: Response) -> list[float]:
    """Return the point of a response in the unit cube: the delay linear, the rest logarithmic."""

    def share(x: float, least: float, most: float) -> float:
        return math.log(x / least) / math.log(most / least)

    return [
        response.delay_s / _MOST.delay_s,
        share(response.acceleration_mps2, _LEAST.acceleration_mps2, _MOST.acceleration_mps2),
        share(response.jerk_mps3, _LEAST.jerk_mps3, _MOST.jerk_mps3),
        share(response.omega, _LEAST.omega, _MOST.omega),
    ]


def _at(place: Sequence[float]) -> Response:
    """Return the response at a point of the unit cube, see `_place`."""

    def value(share: float, least: float, most: float) -> float:
        return float(least * (most / least) ** share)

    return Response(
        place[0] * _MOST.delay_s,
        value(place[1], _LEAST.acceleration_mps2, _MOST.acceleration_mps2),
        value(place[2], _LEAST.jerk_mps3, _MOST.jerk_mps3),
        value(place[3], _LEAST.omega, _MOST.omega),
    )


def _rms(response: Response, flights: Sequence[Stretch]) -> float:
    """Return the rms residual of the velocities, m/s, without their mean in each stretch."""
    squares = []
    for s in flights:
        settled = np.array(s.flown_t) > s.flown_t[0] + SETTLED_S
        rest = (answer(response, s) - np.array(s.flown))[settled]
        squares.append(((rest - rest.mean(axis=0)) ** 2).mean(axis=1))
    return math.sqrt(float(np.concatenate(squares).mean()))


def answer(response: Response, stretch: Stretch) -> F64:
    """Return the model's velocities (N, 2), m/s, at the times of a stretch's flown ones."""
    times = np.arange(stretch.flown_t[0], stretch.flown_t[-1] + STEP_S, STEP_S)
    due = np.searchsorted(stretch.orders_t, times - response.delay_s, side="right") - 1
    orders = np.array(stretch.orders)[np.maximum(due, 0)]
    first = bisect_right(stretch.flown_t, times[0] + FIRST_S) - 1
    pull = (np.array(stretch.flown[first]) - stretch.flown[0]) / (stretch.flown_t[first] - times[0])
    flown = _fly(response, orders, stretch.flown[0], (float(pull[0]), float(pull[1])))
    return np.stack([np.interp(stretch.flown_t, times, flown[:, i]) for i in (0, 1)], axis=1)


def _fly(
    response: Response, orders: F64, start: tuple[float, float], pull: tuple[float, float]
) -> F64:
    """Return the model's velocities (N, 2), m/s, for orders (N, 2), one for each time step.

    Args:
        response: the model.
        orders: velocities, m/s.
        start: first velocity, m/s.
        pull: first acceleration, m/s^2.
    """
    vn, ve = start
    sn, se = start  # velocity of the shaper
    an, ae = bn, be = pull  # accelerations of the vehicle and of the shaper
    k_jerk = response.jerk_mps3 * STEP_S
    gain = response.jerk_mps3 / response.acceleration_mps2
    stiffness, damping = response.omega**2, 2.0 * DAMPING * response.omega
    out = np.empty_like(orders)
    for i, (n, e) in enumerate(orders.tolist()):
        dn, de = n - sn, e - se
        error = math.hypot(dn, de)
        k = _asked(error, gain, response) / error if error > 0.0 else 0.0
        cn, ce = k * dn - bn, k * de - be
        change = math.hypot(cn, ce)
        limit = k_jerk / change if change > k_jerk else 1.0
        bn, be = bn + limit * cn, be + limit * ce
        sn, se = sn + bn * STEP_S, se + be * STEP_S
        an += (stiffness * (sn - vn) - damping * an) * STEP_S
        ae += (stiffness * (se - ve) - damping * ae) * STEP_S
        vn, ve = vn + an * STEP_S, ve + ae * STEP_S
        out[i] = vn, ve
    return out


def _asked(error: float, gain: float, response: Response) -> float:
    """Return the acceleration that ArduPilot's sqrt_controller demands for a velocity error."""
    knee = response.jerk_mps3 / (gain * gain)
    size = gain * error
    if error > knee:
        size = math.sqrt(2.0 * response.jerk_mps3 * (error - 0.5 * knee))
    return min(size, response.acceleration_mps2)
