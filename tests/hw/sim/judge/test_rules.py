"""Every rule of the judge, by bytes on the wire and a given truth: what breaks it, what not."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec, Message
from hw.sim.judge.table import ORDER_RULES, TIME_RULES
from hw.sim.judge.truth import Truth
from tests.hw.sim.judge.bounds import BOUNDS
from tests.hw.sim.judge.court import (
    ATTITUDE,
    CLIMB,
    DT,
    EXTENDED,
    HEARTBEAT,
    LOITER,
    LOW,
    ON_PAD,
    OVER_PAD,
    POSITION,
    RC,
    SINK,
    STOP,
    Court,
)

Trace = Callable[[Court], None]
EAST_1 = (0.0, 1.0, 0.0)


# ---- 1: who flies ------------------------------------------------------------------------------

NOT_GUIDED = "1a: a set-point while not armed or not GUIDED"
NOT_ZERO = "1b: a set-point other than zero with the gate low or stale"
TOO_LONG = "1b: set-points after the release time"
NO_STOP = "1b: silent without stop orders first"
TIPS = "1b: a stop relative to the ground over a moving pad"
GETS_UP = "1b: released on the pad and not level without thrust"
LATCHED = "1: a set-point before the gate was seen low again"


def leaves_guided(c: Court, flies_on_s: float) -> None:
    c.fly(1.0)
    c.mode = LOITER
    c.fly(flies_on_s)
    c.wait(1.0)


def disarmed(c: Court) -> None:
    c.fly(1.0)
    c.armed = False
    c.fly(0.1)


def gate_low(c: Court, flies_on_s: float, stops_s: float) -> None:
    c.fly(1.0)
    c.pulse = 1100
    if flies_on_s:
        c.fly(flies_on_s)
    if stops_s:
        c.fly(stops_s, STOP)
    c.wait(1.0)


def goes_stale(c: Court, kind: int, flies_on_s: float, stops_s: float) -> None:
    c.fly(1.0)
    c.mute.add(kind)
    c.fly(flies_on_s)
    if stops_s:
        c.fly(stops_s, STOP)
    c.wait(1.0)


def restarts(c: Court, stops_s: float) -> None:
    c.fly(1.0)
    c.boot_s = -c.t
    c.listen()
    if stops_s:
        c.fly(stops_s, STOP)
    c.wait(0.5)


def boot_time_wraps(c: Court) -> None:
    c.boot_s = 2.0**32 / 1e3 - c.t - 0.5
    c.pulse = 1100  # that this was a restart does not matter
    c.wait(0.1)
    c.pulse = 1900
    c.fly(0.4)
    c.boot_s = -c.t
    c.fly(0.5)


def boot_time_goes_back_over_the_wrap(c: Court, stops_s: float) -> None:
    boot_time_wraps(c)
    c.boot_s = 2.0**32 / 1e3 - c.t - 5.0
    c.listen()
    if stops_s:
        c.fly(stops_s, STOP)
    c.wait(0.5)


def restarts_before_the_wrap(c: Court, stops_s: float) -> None:
    """Its milliseconds might have wrapped; TIMESYNC tells that they have not."""
    c.boot_s = 2.0**32 / 1e3 - c.t - 5.0
    c.pulse = 1100
    c.wait(0.1)
    c.pulse = 1900
    c.fly(0.4)
    c.boot_s = -c.t
    c.hear(mavlink.MAVLink_timesync_message(10_000_000, 1))
    if stops_s:
        c.fly(stops_s, STOP)
    c.wait(0.5)


def back_in_guided(c: Court, low: bool) -> None:
    c.fly(1.0)
    c.mode = LOITER
    c.wait(1.0)
    c.mode = mavlink.COPTER_MODE_GUIDED
    if low:
        c.pulse = 1100
    c.wait(0.2)
    c.pulse = 1900
    c.wait(0.1)
    c.fly(0.5)


def handed_back(c: Court, flies_on_s: float) -> None:
    c.fly(1.0)
    c.say("landerd: pad not found: pilot, take over")
    c.fly(flies_on_s)
    c.fly(0.9, STOP)


def gate_low_over_moving_pad(
    c: Court,
    pad_mps: float,
    climb_s: float,
    aside_mps: float,
    height: float = LOW.height,
    *,
    sinking: float = 0.0,
    led_s: float = math.inf,
) -> None:
    velocity, pad_velocity = (pad_mps, 0.0, sinking), (pad_mps, 0.0, 0.0)
    c.truth = replace(c.truth, height=height, velocity=velocity, pad_velocity=pad_velocity)
    c.fly(1.0, (pad_mps, 0.0, 0.0))
    c.pulse = 1100
    for i in range(round(climb_s / 0.025)):
        c.truth = replace(c.truth, height=height + 0.5 * 0.025 * i)
        aside = aside_mps if i * 0.025 < led_s else 0.0
        c.order((pad_mps + aside, 0.0, -0.5))
    c.fly(max(0.4, 0.95 - climb_s), STOP)
    c.wait(0.5)


def gate_low_as_it_slides(c: Court) -> None:
    c.truth = replace(c.truth, slip=1.0)
    gate_low_over_moving_pad(c, 0.0, 0.6, 0.5)


def gate_low_far_from_the_pad(c: Court) -> None:
    c.truth = replace(c.truth, distance=50.0)
    gate_low_over_moving_pad(c, 1.0, 0.0, 0.0)


def gate_low_on_the_pad(c: Court, gets_up: bool) -> None:
    c.truth = ON_PAD
    c.fly(0.7, SINK)
    c.level(0.5)
    c.pulse = 1100
    if gets_up:
        c.fly(0.9, STOP)
    else:
        c.level(0.9)
    c.wait(1.0)


def gate_low_on_the_pad_unknown(c: Court) -> None:
    c.truth = ON_PAD
    c.fly(0.3, SINK)
    c.mute |= {ATTITUDE, POSITION}
    c.fly(0.9, SINK)
    c.pulse = 1100
    c.fly(0.9, STOP)
    c.wait(1.0)


WHO_FLIES: list[tuple[Trace, str | None]] = [
    (lambda c: leaves_guided(c, 0.025), None),
    (lambda c: leaves_guided(c, 0.1), NOT_GUIDED),
    (disarmed, NOT_GUIDED),
    (lambda c: gate_low(c, 0.025, 0.95), None),
    (lambda c: gate_low(c, 0.1, 0.95), NOT_ZERO),
    (lambda c: gate_low(c, 0.0, 1.3), TOO_LONG),
    (lambda c: gate_low(c, 0.025, 0.5), NO_STOP),
    (lambda c: goes_stale(c, RC, 0.45, 0.95), None),
    (lambda c: goes_stale(c, RC, 0.7, 0.8), NOT_ZERO),
    (lambda c: goes_stale(c, HEARTBEAT, 2.95, 0.95), None),
    (lambda c: goes_stale(c, HEARTBEAT, 3.2, 0.8), NOT_ZERO),
    (lambda c: goes_stale(c, HEARTBEAT, 3.0, 0.0), NO_STOP),
    (lambda c: restarts(c, 0.95), None),
    (lambda c: restarts(c, 0.0), NO_STOP),
    (boot_time_wraps, None),
    (lambda c: boot_time_goes_back_over_the_wrap(c, 0.95), None),
    (lambda c: boot_time_goes_back_over_the_wrap(c, 0.0), NO_STOP),
    (lambda c: restarts_before_the_wrap(c, 0.95), None),
    (lambda c: restarts_before_the_wrap(c, 0.0), NO_STOP),
    (lambda c: handed_back(c, 0.025), None),
    (lambda c: handed_back(c, 0.1), NOT_ZERO),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.6, 0.0), None),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.6, 0.5), NOT_ZERO),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.6, 0.5, led_s=0.4), None),  # within the limits
    (lambda c: gate_low_over_moving_pad(c, 1.0, 1.5, 0.0), NOT_ZERO),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.0, 0.0), TIPS),
    # Over where it commits it may do either; and how low it is it knows to a few centimetres.
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.0, 0.0, 0.18), None),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.6, 0.0, 0.18), None),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.6, 0.0, 0.22), NOT_ZERO),
    (lambda c: gate_low_over_moving_pad(c, 1.0, 0.6, 0.0, 0.22, sinking=0.3), None),
    (lambda c: gate_low_over_moving_pad(c, 0.4, 0.0, 0.0), None),
    (lambda c: gate_low_over_moving_pad(c, 0.4, 0.6, 0.0), NOT_ZERO),
    (gate_low_far_from_the_pad, None),
    (gate_low_as_it_slides, None),
    (lambda c: gate_low_on_the_pad(c, gets_up=False), None),
    (lambda c: gate_low_on_the_pad(c, gets_up=True), GETS_UP),
    (gate_low_on_the_pad_unknown, None),
    (lambda c: back_in_guided(c, low=True), None),
    (lambda c: back_in_guided(c, low=False), LATCHED),
]


@pytest.mark.parametrize(("trace", "rule"), WHO_FLIES)
def test_1_landerd_orders_only_while_it_may_fly(trace: Trace, rule: str | None) -> None:
    court = Court()
    trace(court)
    assert court.broken == ([rule] if rule else [])


def test_1b_the_gate_closes_when_the_channels_were_measured_too_long_ago() -> None:
    court = Court()
    court.fly(1.0)
    court.late_s = 0.6
    court.truth = ON_PAD  # where the age of the rest does not matter
    court.fly(0.7, SINK)
    assert NOT_ZERO in court.broken


def test_1b_channels_that_were_held_back_are_as_old_as_they_are() -> None:
    court = Court()
    court.fly(1.0)
    court.rc_held_back_s = 0.6
    court.fly(1.0, STOP)
    court.wait(1.0)  # nothing is owed any more
    assert court.broken == []


def test_1b_channels_that_come_after_newer_ones_say_nothing_of_the_switch() -> None:
    court = Court()
    court.fly(1.0)
    court.pulse, court.rc_held_back_s = 1100, 0.3  # of before the switch was high
    court.listen()
    court.mute.add(RC)
    court.fly(0.3)
    assert court.broken == []


def test_1d_it_need_not_brake_harder_than_the_autopilot_can() -> None:
    court = Court(replace(BOUNDS, braking_mps2=1.0))
    lose(court, 5.0, EAST_1)
    assert court.broken == []


def test_1c_nothing_is_ordered_before_the_first_sighting() -> None:
    court = Court(sees=False)
    court.order(STOP)
    assert court.broken == ["1c: a set-point before the first sighting"]
    court = Court(sees=False)
    court.sees = True
    court.order(STOP)
    assert court.broken == []


def lose(
    court: Court,
    seconds: float,
    velocity: tuple[float, float, float] = CLIMB,
    turns: float = 0.0,
) -> None:
    court.fly(0.1)
    court.sees = False
    court.fly(0.5, velocity)
    court.say("landerd: pad not in sight, holding")
    court.fly(seconds - 0.5, velocity, turns)


@pytest.mark.parametrize(
    ("trace", "rule"),
    [
        (lambda c: lose(c, 3.0), None),
        (lambda c: lose(c, 3.0, EAST_1), None),  # it is still braking
        (lambda c: lose(c, 5.0, EAST_1), "1d: not hovering while the pad is out of sight"),
        (lambda c: lose(c, 1.0, turns=0.1), "1d: turning while the pad is out of"),
        (lambda c: lose(c, 1.0, turns=0.0009), None),
    ],
)
def test_1d_out_of_sight_it_slows_down_and_does_not_turn(trace: Trace, rule: str | None) -> None:
    court = Court()
    trace(court)
    assert [text[: len(rule or "")] for text in court.broken] == ([rule] if rule else [])


def test_1d_a_descent_out_of_sight_breaks_it() -> None:
    court = Court()
    lose(court, 1.0)
    court.truth = replace(OVER_PAD, pad_velocity=(0.0, 0.0, 0.3))  # not even with the pad
    court.order((0.0, 0.0, 0.2))
    assert court.broken == ["1d: descending while the pad is out of sight"]


# ---- what may be sent --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message", "rule"),
    [
        (mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), None),
        (mavlink.MAVLink_named_value_float_message(0, b"x", 1.0), None),
        (mavlink.MAVLink_set_mode_message(1, 1, 5), "1: sent SET_MODE"),
        (
            mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, *(0.0,) * 4, 0, 0, 0.0),
            "1: sent COMMAND_INT",
        ),
        (
            mavlink.MAVLink_rc_channels_override_message(1, 1, *(1500,) * 8),
            "1: sent RC_CHANNELS_OVERRIDE",
        ),
        (mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0), "1: sent MANUAL_CONTROL"),
        (
            mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 9.0, 9),
            "1: sent PARAM_SET",
        ),
    ],
)
def test_messages_that_are_not_allowed_break_a_rule(message: Message, rule: str | None) -> None:
    court = Court()
    court.send(message)
    assert court.broken == ([rule] if rule else [])


@pytest.mark.parametrize(
    ("command", "params", "rule"),
    [
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (30.0, 2e4), None),
        (mavlink.MAV_CMD_DO_MOUNT_CONTROL, (), None),
        (mavlink.MAV_CMD_DO_SET_SERVO, (9.0, 1500.0), None),
        (mavlink.MAV_CMD_DO_SET_SERVO, (1.0, 1500.0), "1: sent command 183"),  # a motor's
        (mavlink.MAV_CMD_DO_SET_MODE, (1.0, 5.0), "1: sent command 176"),
        (mavlink.MAV_CMD_NAV_TAKEOFF, (), "1: sent command 22"),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), "4: arming, or a forced disarm"),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, 21196.0), "4: arming, or a forced disarm"),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (), None),
    ],
)
def test_commands_that_are_not_allowed_break_a_rule(
    command: int, params: tuple[float, ...], rule: str | None
) -> None:
    court = Court()
    court.truth = ON_PAD
    court.on_ground = True
    court.fly(0.1, SINK)
    court.command(command, *params)
    assert court.broken == ([rule] if rule else [])


def test_unknown_bytes_and_targets_other_than_velocity_break_a_rule() -> None:
    court = Court()
    court.rules.from_landerd(court.t, b"\xfe\x00\x00\x01\x01\x00\x00\x00")  # MAVLink 1
    assert court.broken == ["1: sent bytes that are no known message"]
    court = Court()
    court.order(mask=0xDF8)  # a position
    assert court.broken == ["1: sent a target other than a velocity with a yaw rate"]


# ---- 2: never blind ----------------------------------------------------------------------------

BLIND = "2: a downward set-point without a young sighting"
BUDGET = "2: contact too long after the last sighting"
OUTSIDE = "2: a downward set-point outside the descent region"
MISSED = "2: descending to a pad that will be missed"


@pytest.mark.parametrize(
    ("height_m", "age_s", "broken"),
    [(5.0, 0.475, False), (5.0, 0.525, True), (0.15, 0.975, False), (0.15, 1.025, True)],
)
def test_2_no_descent_without_a_young_sighting(height_m: float, age_s: float, broken: bool) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, height=height_m)
    court.fly(0.1, SINK)
    court.sees = False
    court.fly(age_s, SINK)
    assert court.broken == ([BLIND] if broken else [])


@pytest.mark.parametrize(("age_s", "broken"), [(0.75, False), (0.85, True)])
def test_2_contact_is_noticed_within_the_blind_budget(age_s: float, broken: bool) -> None:
    court = Court()
    court.truth = LOW
    court.fly(0.1, SINK)
    court.sees = False
    court.fly(age_s - 0.025, SINK)
    court.truth = ON_PAD
    court.fly(0.1, SINK)
    assert court.broken == ([BUDGET] if broken else [])


@pytest.mark.parametrize(
    ("speed_mps", "late_s", "broken"),
    [(3.0, 0.2, False), (3.0, 0.6, True), (0.0, 0.2, True)],  # what stands never surprises
)
def test_2_motion_of_the_pad_that_no_picture_has_shown_yet_is_not_judged(
    speed_mps: float, late_s: float, broken: bool
) -> None:
    """At the edge of the region the pad becomes 1.5 m/s slower at once."""
    court = Court()
    edge_m = BOUNDS.k1_m * math.exp(BOUNDS.k2_per_m * 5.0)

    def fly(seconds: float, pad_mps: float, away_mps: float) -> None:
        for _ in range(round(seconds / 0.025)):
            north, truth = court.truth.landing_point[0] + 0.025 * pad_mps, court.truth
            court.truth = replace(
                truth, landing_point=(north, 0.0, 0.0), distance=truth.distance + 0.025 * away_mps
            )
            court.order(SINK)

    court.truth = replace(OVER_PAD, distance=edge_m - 0.01)
    fly(1.0, speed_mps, 0.0)
    slower = 1.5 if speed_mps else 0.0
    fly(late_s, speed_mps - slower, 1.5)
    assert court.broken == ([OUTSIDE] if broken else [])


@pytest.mark.parametrize(
    ("pad_sinks_mps", "order_mps", "broken"),
    [
        (0.0, 0.01, True),
        (0.3, 0.29, False),  # goes down with the pad and no faster
        (0.3, 0.32, True),
        (-0.3, 0.0, False),  # the pad rises: nobody must flee from it
        (-0.3, 0.01, True),
    ],
)
def test_2_descent_outside_the_region_is_judged_against_the_pads_own_motion(
    pad_sinks_mps: float, order_mps: float, broken: bool
) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, distance=3.0, pad_velocity=(0.0, 0.0, pad_sinks_mps))
    court.order((0.0, 0.0, order_mps))
    assert court.broken == ([OUTSIDE] if broken else [])


def test_2_climbing_away_after_a_touch_it_is_judged_as_in_the_air() -> None:
    court = Court()
    court.truth = replace(ON_PAD, distance=3.0, feet_down=1)
    court.order(SINK)
    assert court.broken == []
    court.truth = replace(OVER_PAD, height=0.3, distance=3.0)
    court.order(CLIMB)
    court.order(SINK)
    assert court.broken == [OUTSIDE]


@pytest.mark.parametrize(
    ("below_m", "climbs", "above_m", "broken"),
    [
        (0.19, False, 0.25, False),
        (0.21, False, 0.25, True),  # it had not committed
        (0.19, True, 0.25, True),  # broken off, it begins anew
        (0.19, False, 0.31, True),
    ],
)
def test_2_after_commit_a_deck_that_falls_away_does_not_bind_it_to_the_region(
    below_m: float, climbs: bool, above_m: float, broken: bool
) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, height=below_m)
    court.order(SINK)
    if climbs:
        court.order(CLIMB)
    court.truth = replace(OVER_PAD, height=above_m, distance=0.17)
    court.order(SINK)
    assert court.broken == ([OUTSIDE] if broken else [])


@pytest.mark.parametrize(
    ("height_m", "off_rad", "broken"), [(1.9, 0.09, True), (1.9, 0.08, False), (2.1, 0.09, False)]
)
def test_2_no_descent_with_the_heading_off(height_m: float, off_rad: float, broken: bool) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, height=height_m, heading_error=off_rad)
    court.order(SINK)
    rule = "2: a downward set-point with the heading off"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(("hidden_rad", "broken"), [(0.04, False), (-0.04, True), (0.25, True)])
def test_2_an_error_of_heading_by_a_camera_mounted_askew_is_not_judged(
    hidden_rad: float, broken: bool
) -> None:
    court = Court()
    court.rules.on_mounted(hidden_rad)
    court.truth = replace(OVER_PAD, height=1.5, heading_error=0.1)
    court.order(SINK)
    rule = "2: a downward set-point with the heading off"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(
    ("turned_before", "late_s", "broken"),
    [
        (False, 0.2, False),  # nobody can know of it yet
        (False, 0.5, True),
        (True, 0.2, True),  # it turned so all the time
    ],
)
def test_2_turning_of_the_pad_that_no_picture_has_shown_yet_is_not_judged(
    turned_before: bool, late_s: float, broken: bool
) -> None:
    """The pad turns at 30 degrees/s; the vehicle turned with it, and does so no longer."""
    court = Court()

    def fly(seconds: float, pad_turns: bool, vehicle_turns: bool) -> None:
        step = math.radians(30.0) * 0.025
        for _ in range(round(seconds / 0.025)):
            yaw = court.truth.yaw + step * vehicle_turns
            off = court.truth.heading_error + step * (vehicle_turns - pad_turns)
            court.truth = replace(court.truth, yaw=yaw, heading_error=off)
            court.order(SINK)

    court.truth = replace(OVER_PAD, height=1.5)
    fly(1.0, turned_before, turned_before)
    fly(late_s, True, False)
    rule = "2: a downward set-point with the heading off"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(
    ("timeout_s", "height_m", "sink_mps", "broken"),
    [
        (1.0, 0.5, 0.45, False),  # slow enough to touch so
        (1.0, 0.5, 0.55, True),
        (1.0, 1.3, 0.9, False),  # 0.4 m are left to brake in
        (1.0, 1.1, 0.9, True),
        (3.0, 1.3, 0.9, True),
        (None, 0.5, 0.9, False),
    ],
)
def test_2_a_companion_that_dies_lets_the_vehicle_down_gently(
    timeout_s: float | None, height_m: float, sink_mps: float, broken: bool
) -> None:
    court = Court(replace(BOUNDS, guid_timeout_s=timeout_s))
    court.truth = replace(OVER_PAD, height=height_m)
    court.order((0.0, 0.0, sink_mps))
    rule = "2: sinking faster than the autopilot's timeout allows"
    assert court.broken == ([rule] if broken else [])


def test_2_a_companion_that_dies_leaves_it_to_what_the_autopilot_brakes_with() -> None:
    court = Court(replace(BOUNDS, guid_timeout_s=1.0, vertical_braking_mps2=0.5))
    court.truth = replace(OVER_PAD, height=1.3)
    court.order((0.0, 0.0, 0.9))
    assert court.broken == ["2: sinking faster than the autopilot's timeout allows"]


HOLDS = replace(BOUNDS, gate_threshold_us=1300, land_threshold_us=1700, hold_height_m=2.0)
BELOW_HOLD = "2: descending below the height to hold at"


@pytest.mark.parametrize(
    ("pulse", "height_m", "velocity", "broken"),
    [
        (1500, 1.7, SINK, True),
        (1500, 1.9, SINK, False),
        (1500, 1.7, CLIMB, False),
        (1500, 1.7, STOP, False),
        (1500, 0.1, SINK, True),
        (1900, 1.7, SINK, False),
    ],
)
def test_2_asked_to_hold_it_does_not_descend_below_that_height(
    pulse: int, height_m: float, velocity: tuple[float, float, float], broken: bool
) -> None:
    court = Court(HOLDS)
    court.truth = replace(OVER_PAD, height=height_m)
    court.fly(0.1, SINK)
    court.pulse = pulse
    court.fly(0.5, velocity)
    assert court.broken == ([BELOW_HOLD] if broken else [])


@pytest.mark.parametrize(
    ("truth", "velocity", "rule"),
    [
        (replace(LOW, slip=0.35), SINK, None),
        (replace(LOW, slip=0.45), SINK, MISSED),
        (replace(LOW, slip=0.45), CLIMB, None),  # waved off
        (replace(LOW, misses=True), SINK, MISSED),
        (replace(LOW, misses=True, height=0.25), SINK, None),
        (replace(LOW, misses=True, height=0.17), SINK, None),  # it has not committed yet
    ],
)
def test_2_a_pad_that_will_be_missed_is_waved_off(
    truth: object, velocity: tuple[float, float, float], rule: str | None
) -> None:
    court = Court()
    court.truth = truth  # type: ignore[assignment]
    court.fly(0.2, velocity)
    assert court.broken == []  # it must be noticed first
    court.fly(0.2, velocity)
    assert court.broken == ([rule] if rule else [])


def test_2_that_a_pad_will_be_missed_must_have_been_in_a_picture() -> None:
    court = Court()
    court.fly(0.1, SINK)
    court.truth, court.sees = replace(LOW, slip=0.45), False
    court.fly(0.4, SINK)
    assert court.broken == []
    court.sees = True
    court.fly(0.1, SINK)
    assert court.broken == [MISSED]


# ---- 3: limits (see test_limits too) -----------------------------------------------------------

SELDOM = "3: set-points less often than 20 Hz"


@pytest.mark.parametrize(("pause_s", "broken"), [(0.025, False), (0.05, True)])
def test_3_set_points_come_at_20_hz(pause_s: float, broken: bool) -> None:
    court = Court()
    court.fly(0.5)
    court.wait(pause_s)
    court.fly(0.5)
    assert court.broken == ([SELDOM] if broken else [])


def test_3_over_a_dead_link_set_points_come_all_the_same_until_it_is_stale() -> None:
    for flies_on_s, stops_s, broken in (
        (0.3, 0.0, [SELDOM, NO_STOP]),
        (0.5, 0.0, [NO_STOP]),
        (0.5, 1.0, []),
    ):
        court = Court()
        court.fly(0.5)
        court.mute |= {HEARTBEAT, RC, ATTITUDE, POSITION, EXTENDED}
        court.measures = False
        court.fly(flies_on_s)
        if stops_s:
            court.fly(stops_s, STOP)
        court.wait(5.0)
        assert court.broken == broken


def test_3_no_set_points_come_while_the_world_lets_the_computer_stand_still() -> None:
    court = Court(replace(BOUNDS, stall_s=0.1))
    court.fly(0.5)
    court.wait(0.1)
    court.fly(0.5)
    assert court.broken == []
    court.wait(0.15)
    court.fly(0.1)
    assert court.broken == [SELDOM]


def test_3_the_limits_are_judged_but_for_the_climb_of_a_wave_off() -> None:
    down, up = (0.0, 0.0, 0.3), (0.0, 0.0, -0.5)
    court = Court(limits=True)
    court.truth = LOW
    court.fly(0.5, down)
    court.fly(0.5, up)
    assert court.broken == []
    court.truth = OVER_PAD
    court.fly(1.5, down)
    court.fly(0.5, up)
    assert court.broken == ["3: vertical acceleration", "3: vertical jerk"]


def test_3_a_leaning_vehicle_may_wave_off_with_its_lowest_foot_just_over_the_pad() -> None:
    for lean_m, broken in ((0.1, False), (0.03, True)):
        court = Court(limits=True)
        court.truth = replace(OVER_PAD, height=0.25, lean_m=lean_m)
        court.fly(0.5, (0.0, 0.0, 0.3))
        court.fly(0.5, (0.0, 0.0, -0.5))
        assert bool(court.broken) == broken


def test_3_a_set_point_that_is_not_finite_breaks_it() -> None:
    court = Court()
    court.order((0.0, float("nan"), 0.0))
    assert court.broken == ["3: a set-point is not finite"]


# ---- 4: after contact --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "misses", "broken"),
    [
        (SINK, False, False),
        (STOP, False, True),
        (CLIMB, False, True),
        (CLIMB, True, False),  # blown off the pad
        (STOP, True, True),
    ],
)
def test_4_once_a_foot_was_down_descent_must_be_ordered(
    order: tuple[float, float, float], misses: bool, broken: bool
) -> None:
    court = Court()
    court.truth = LOW
    court.fly(0.2, SINK)
    for i in range(40):
        bounces = i in (2, 3)
        court.truth = replace(ON_PAD, feet_down=0 if bounces else 1, misses=misses)
        court.order(order)
    rule = "4: no descent ordered after contact"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(("brushes_s", "broken"), [(1.3, False), (1.6, True)])
def test_4_a_vehicle_told_to_climb_may_brush_the_pad_until_its_thrust_comes(
    brushes_s: float, broken: bool
) -> None:
    court = Court()
    court.truth = LOW
    court.fly(0.2, CLIMB)
    court.truth = replace(ON_PAD, feet_down=1)
    court.fly(brushes_s, CLIMB)
    rule = "4: no descent ordered after contact"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(("zeroes", "broken"), [(1, False), (3, True)])
def test_4_it_goes_from_climbing_to_pressing_down_by_one_order_at_zero(
    zeroes: int, broken: bool
) -> None:
    court = Court()
    court.truth = LOW
    court.fly(0.2, CLIMB)
    court.truth = ON_PAD
    court.fly(1.0, CLIMB)
    for _ in range(zeroes):
        court.order(STOP)
    court.fly(0.3, SINK)
    assert ("4: no descent ordered after contact" in court.broken) == broken


@pytest.mark.parametrize(("brushes_s", "broken"), [(1.3, False), (1.6, True)])
def test_4_a_climb_ordered_before_the_deck_came_up_may_brush_it_for_a_while(
    brushes_s: float, broken: bool
) -> None:
    court = Court()
    court.truth = LOW
    court.fly(0.2, CLIMB)
    court.truth = ON_PAD
    court.fly(brushes_s, CLIMB)
    assert ("4: a climb ordered while standing on the pad" in court.broken) == broken


def test_4_a_vehicle_that_stood_before_a_cut_of_the_link_stands_after_it() -> None:
    court = Court()
    court.truth = ON_PAD
    court.fly(1.0, SINK)
    court.level(0.2)
    court.wait(0.6)
    court.level(0.2)
    assert "4: did not go with the pad after contact" not in court.broken


@pytest.mark.parametrize(("carried_mps", "broken"), [(0.1, True), (0.6, False)])
def test_4_a_vehicle_whose_pad_outruns_its_set_points_may_be_levelled_early(
    carried_mps: float, broken: bool
) -> None:
    court = Court()
    court.truth = replace(ON_PAD, velocity=(carried_mps, 0.0, 0.0))
    court.fly(0.3, SINK)
    court.level(0.1)
    assert ("4: did not go with the pad after contact" in court.broken) == broken


def test_4_a_vehicle_levelled_for_a_release_may_stay_levelled() -> None:
    court = Court()
    court.truth = ON_PAD
    court.fly(0.2, SINK)
    court.pulse = 1100
    court.level(0.05)
    court.pulse = 1900
    court.level(0.3)
    assert "4: did not go with the pad after contact" not in court.broken


def left_standing(silent_s: float) -> Court:
    """Released on the pad, levelled without thrust, silent for a time, and granted again."""
    court = Court()
    court.truth = ON_PAD
    court.fly(1.0, SINK)
    court.pulse = 1100
    court.level(1.0)
    court.wait(silent_s)
    court.pulse = 1900
    return court


@pytest.mark.parametrize(("presses_s", "broken"), [(6.0, False), (7.0, True)])
def test_6_a_vehicle_left_standing_is_unconfirmed_from_when_it_may_fly_again(
    presses_s: float, broken: bool
) -> None:
    court = left_standing(5.0)
    court.fly(presses_s, SINK)
    rule = "6: a touch-down not confirmed, and the pilot not told"
    assert (rule in court.broken) == broken


def test_6_without_a_pad_and_silent_it_need_not_report_an_unconfirmed_touch_down() -> None:
    """The heartbeat is back, but the gimbal is silent: landerd cannot know where it stands."""
    court = left_standing(2.0)
    court.wait(9.0)
    court.fly(6.0, SINK)
    assert court.broken == []
    court.fly(1.0, SINK)
    assert court.broken == ["6: a touch-down not confirmed, and the pilot not told"]


def test_4_it_may_stop_as_soon_as_half_the_round_trip_makes_its_data_stale() -> None:
    for goes_on_s, broken in ((0.45, False), (0.3, True)):
        court = Court()
        court.truth = LOW
        court.fly(0.2, SINK)
        court.truth = ON_PAD
        court.fly(0.7, SINK)
        court.mute.add(RC)
        court.fly(goes_on_s, SINK)
        court.fly(0.1, STOP)
        assert ("4: no descent ordered after contact" in court.broken) == broken


def test_4_contact_on_stale_data_need_not_be_known() -> None:
    court = Court()
    court.truth = LOW
    court.fly(0.5, SINK)
    court.frozen = True
    court.fly(0.3, SINK)
    court.truth = ON_PAD
    court.fly(0.8, CLIMB)
    court.frozen = False
    court.fly(0.7, CLIMB)  # its thrust comes late
    assert "4: no descent ordered after contact" not in court.broken
    court.fly(0.3, CLIMB)
    assert "4: no descent ordered after contact" in court.broken


@pytest.mark.parametrize(("later_s", "broken"), [(0.0, False), (0.1, True)])
def test_1_killed_its_last_order_may_be_on_its_way(later_s: float, broken: bool) -> None:
    court = Court()
    court.fly(0.2, SINK)
    court.rules.on_death(court.t)
    court.wait(later_s)
    court.order(SINK)
    assert ("1: a set-point before the gate was seen low again" in court.broken) == broken


@pytest.mark.parametrize(("goes_on_s", "broken"), [(0.5, False), (1.1, True)])
def test_4_a_climb_away_that_began_released_need_not_end_at_once(
    goes_on_s: float, broken: bool
) -> None:
    court = Court()
    away = (2.0, 0.0, -0.5)
    court.truth = replace(LOW, pad_velocity=(2.0, 0.0, 0.0))
    court.fly(0.3, (2.0, 0.0, 0.01))
    court.pulse = 1100
    court.fly(0.2, away)
    court.truth = replace(court.truth, height=0.0, feet_down=1)
    court.fly(0.5, away)
    court.pulse = 1900
    court.fly(goes_on_s, away)
    assert ("4: no descent ordered after contact" in court.broken) == broken


def test_4_released_it_may_stand_level_sooner() -> None:
    court = Court()
    court.truth = ON_PAD
    court.fly(0.2, SINK)
    court.pulse = 1100
    court.level(0.1)
    assert court.broken == []


@pytest.mark.parametrize(("aside_mps", "broken"), [(0.25, False), (0.35, True), (5.0, True)])
def test_4_after_contact_orders_go_with_the_pad(aside_mps: float, broken: bool) -> None:
    court = Court()
    court.truth = replace(ON_PAD, pad_velocity=(5.0, 0.0, 0.0))
    court.fly(0.9, (5.0 - aside_mps, 0.0, 0.1))  # it must be noticed, and rule 3 kept
    assert court.broken == []
    court.fly(0.3, (5.0 - aside_mps, 0.0, 0.1))
    rule = "4: not going with the pad after contact"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(("late_s", "broken"), [(0.8, False), (1.2, True)])
def test_4_it_goes_with_a_pad_that_stops_as_soon_as_it_can_know(
    late_s: float, broken: bool
) -> None:
    court = Court()
    moving = replace(ON_PAD, pad_velocity=(1.0, 0.0, 0.0))
    court.truth = moving
    court.fly(1.5, (1.0, 0.0, 0.1))
    court.truth = ON_PAD
    court.fly(late_s, (1.0, 0.0, 0.1))
    court.fly(0.3, SINK)
    rule = "4: not going with the pad after contact"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(("levelled", "broken"), [(True, True), (False, False)])
def test_4_a_vehicle_that_stands_on_the_pad_is_not_told_to_climb(
    levelled: bool, broken: bool
) -> None:
    court = Court()
    court.truth = ON_PAD
    court.fly(0.6, SINK)
    if levelled:
        court.level(0.3)
    court.order(CLIMB)
    rule = "4: a climb ordered while standing on the pad"
    assert (rule in court.broken) == broken


@pytest.mark.parametrize(
    ("pressed_s", "trace", "rule"),
    [
        (0.7, lambda c: c.level(0.1), None),
        (0.7, lambda c: c.level(0.1, q=(0.7, 0.0, 0.0, 0.7)), None),  # any heading
        (0.3, lambda c: c.level(0.1), "4: did not go with the pad after contact"),
        (0.0, lambda c: c.level(0.1), "4: level and without thrust while no foot is down"),
        (0.7, lambda c: c.level(0.1, q=(0.99, 0.1, 0.0, 0.0)), "4: an attitude ordered other"),
        (0.7, lambda c: c.level(0.1, thrust=0.4), "4: an attitude ordered other"),
        (0.7, lambda c: c.level(0.1, mask=0), "4: an attitude ordered other"),
    ],
)
def test_4_it_stands_level_only_on_the_pad_and_not_at_once(
    pressed_s: float, trace: Trace, rule: str | None
) -> None:
    court = Court()
    court.truth = ON_PAD if pressed_s else LOW
    court.fly(pressed_s, SINK)
    trace(court)
    assert [text[: len(rule or "")] for text in court.broken] == ([rule] if rule else [])


@pytest.mark.parametrize(
    ("slip_mps", "lean_m", "broken"), [(0.4, 0.02, 0), (0.2, 0.02, 1), (0.4, 0.05, 2)]
)
def test_4_a_vehicle_dragged_across_the_plate_may_stand_level_sooner(
    slip_mps: float, lean_m: float, broken: int
) -> None:
    court = Court()
    court.truth = replace(ON_PAD, feet_down=2, slip=slip_mps, foot_slip=slip_mps, lean_m=lean_m)
    court.fly(0.4, SINK)
    court.level(0.05)
    assert len(court.broken) == broken


@pytest.mark.parametrize(
    ("feet", "slip_mps", "foot_mps", "lean_m", "broken"),
    [
        (2, 0.2, 0.2, 0.05, False),
        (2, 0.4, 0.4, 0.05, True),
        (2, 0.4, 0.4, 0.02, False),  # it rocks on its gear
        (2, 0.4, 0.0, 0.05, False),  # it falls onto its feet
        (4, 0.4, 0.4, 0.0, False),  # flat on the plate nothing else ends it
    ],
)
def test_4_it_stands_level_only_when_it_does_not_slide_on_an_edge(
    feet: int, slip_mps: float, foot_mps: float, lean_m: float, broken: bool
) -> None:
    court = Court()
    stands = replace(ON_PAD, feet_down=feet, lean_m=lean_m)
    court.truth = replace(stands, slip=slip_mps, foot_slip=foot_mps)
    court.fly(0.7, SINK)
    court.level(0.1)
    rule = "4: level and without thrust while it slides"
    assert court.broken == ([rule] if broken else [])


def test_4_a_vehicle_that_turns_over_as_it_slides_gets_no_thrust() -> None:
    court = Court()
    stands = replace(ON_PAD, feet_down=2, lean_m=0.12, slip=1.0, foot_slip=1.0)
    court.truth = replace(stands, tilt=math.radians(70.0))
    court.fly(0.7, SINK)
    court.level(0.1)
    court.truth = stands  # it falls back onto its feet
    court.level(0.1)
    assert court.broken == []


def test_an_order_on_its_way_when_the_motors_stop_is_no_touch_down() -> None:
    # The last picture with a marker in it is old by then.
    court = Court()
    court.sees = False
    lands(court)
    court.armed = False
    court.level(DT)
    assert court.broken == []


def lands(
    c: Court,
    *,
    says: bool = True,
    disarms_after_s: float = 0.2,
    feet: int = 4,
    disarms: bool = True,
) -> None:
    c.truth = ON_PAD
    c.fly(0.7, SINK)
    c.level(0.5)
    c.on_ground = says
    c.level(disarms_after_s)
    if feet < 4:
        c.truth = replace(OVER_PAD, height=0.15)
        c.fly(0.3, SINK)
    if disarms:
        c.disarm()


@pytest.mark.parametrize(
    ("trace", "rule"),
    [
        (lands, None),
        (lambda c: lands(c, says=False), "4: disarm before the autopilot said ON_GROUND"),
        (lambda c: lands(c, disarms_after_s=0.9), None),
        (lambda c: lands(c, disarms_after_s=1.3), "4: no disarm ordered after ON_GROUND"),
        (lambda c: lands(c, feet=0), "4: disarm while no foot is down"),
    ],
)
def test_4_it_disarms_on_the_ground_and_not_before(trace: Trace, rule: str | None) -> None:
    court = Court()
    trace(court)
    assert court.broken == ([rule] if rule else [])


@pytest.mark.parametrize(("sinks_s", "broken"), [(0.9, False), (1.3, True)])
def test_4_after_on_ground_while_it_might_not_fly_a_disarm_is_due_once_it_may(
    sinks_s: float, *, broken: bool
) -> None:
    court = Court()
    lands(court, disarms=False)
    court.mode = LOITER
    court.wait(2.0)
    court.mode, court.pulse = mavlink.COPTER_MODE_GUIDED, 1100
    court.wait(1.5)
    court.pulse = 1900
    court.fly(sinks_s, SINK)
    assert court.broken == (["4: no disarm ordered after ON_GROUND"] if broken else [])


def test_4_a_false_on_ground_in_the_air_asks_for_no_disarm() -> None:
    court = Court()
    court.truth = LOW
    court.on_ground = True
    court.fly(0.3, SINK)
    court.on_ground = False
    lands(court, says=False, disarms=False)
    court.level(1.0)
    assert court.broken == []


def test_1a_no_disarm_out_of_guided() -> None:
    court = Court()
    court.truth = ON_PAD
    court.fly(0.7, SINK)
    court.on_ground = True
    court.mode = LOITER
    court.wait(0.1)
    court.disarm()
    assert court.broken == ["1a: a disarm order while not armed or not GUIDED"]


# ---- 5: freshness ------------------------------------------------------------------------------

STALE = "5: descending on stale or frozen data"


@pytest.mark.parametrize(
    ("kind", "silent_s", "broken"),
    [
        (ATTITUDE, 0.2, False),
        (ATTITUDE, 0.25, True),
        (POSITION, 0.3, False),
        (POSITION, 0.35, True),
    ],
)
def test_5_silent_telemetry_is_not_flown_on(kind: int, silent_s: float, broken: bool) -> None:
    court = Court()
    court.fly(0.5, SINK)
    court.mute.add(kind)
    court.fly(silent_s, SINK)
    assert court.broken == ([STALE] if broken else [])


@pytest.mark.parametrize(("late_s", "broken"), [(0.15, False), (0.25, True)])
def test_5_data_are_as_old_as_their_measurement(late_s: float, broken: bool) -> None:
    court = Court()
    court.late_s = late_s
    court.fly(0.5, SINK)  # fresh stamps and a steady stream: but all of it late
    assert court.broken == ([STALE] if broken else [])


@pytest.mark.parametrize("frozen", [False, True])
def test_5_a_frozen_attitude_is_an_old_one(frozen: bool) -> None:
    court = Court()
    court.fly(0.1, SINK)
    court.frozen = frozen
    court.fly(0.5, SINK)
    assert court.broken == ([STALE] if frozen else [])


@pytest.mark.parametrize(
    ("truth", "silent_s", "broken"),
    [
        (OVER_PAD, 0.8, False),
        (OVER_PAD, 0.85, True),
        # Committed, what was seen before is flown on for as long as without any sight (2).
        (LOW, 1.3, False),
        (LOW, 1.35, True),
    ],
)
def test_5_old_gimbal_angles_are_not_flown_on(truth: Truth, silent_s: float, broken: bool) -> None:
    court = Court()
    court.truth = truth
    court.fly(0.1, SINK)
    court.measures = False
    court.fly(silent_s, SINK)
    assert court.broken == ([STALE] if broken else [])


@pytest.mark.parametrize(
    ("trace", "rule"),
    [
        (lambda c: c.fly(3.0, EAST_1), None),
        (lambda c: c.fly(5.0, EAST_1), "5: not hovering on stale or frozen data"),
        (lambda c: c.fly(0.5, CLIMB, 0.1), "5: turning on stale or frozen data"),
    ],
)
def test_5_on_stale_data_it_hovers(trace: Trace, rule: str | None) -> None:
    court = Court()
    court.fly(0.1)
    court.mute.add(POSITION)
    court.say("landerd: position is stale, holding")
    trace(court)
    assert court.broken == ([rule] if rule else [])


# ---- 6: every abort has an outcome that is told ------------------------------------------------

UNTOLD = "6: an abort that the pilot was not told of"


def lose_untold(court: Court, seconds: float) -> None:
    court.sees = False
    court.fly(seconds)


def test_6_a_loss_of_sight_must_be_told() -> None:
    court = Court()
    court.order(STOP)
    lose_untold(court, 1.4)
    assert court.broken == []
    lose_untold(court, 0.4)
    assert court.broken == [UNTOLD]


@pytest.mark.parametrize("resumes", [False, True])
def test_6_a_loss_is_told_again_only_if_the_pilot_was_told_better_news(resumes: bool) -> None:
    court = Court()
    court.order(STOP)
    lose_untold(court, 1.0)
    court.say("landerd: pad not in sight, holding")
    lose_untold(court, 3.0)
    court.sees = True
    court.order(STOP)  # a marker is in one frame
    if resumes:
        court.say("landerd: approach: pad in sight")
        court.fly(1.5)
    lose_untold(court, 3.0)
    assert court.broken == ([UNTOLD] if resumes else [])


@pytest.mark.parametrize("told", [False, True])
def test_6_a_touch_down_that_is_not_confirmed_is_told(told: bool) -> None:
    court = Court()
    court.truth = ON_PAD
    court.fly(0.7, SINK)
    court.level(4.5)
    if told:
        court.say("landerd: touch-down not confirmed, disarm by hand")
    court.level(2.0)
    rule = "6: a touch-down not confirmed, and the pilot not told"
    assert court.broken == ([] if told else [rule])


@pytest.mark.parametrize("on_plate", [False, True])
def test_6_landed_is_said_only_of_feet_on_the_plate(on_plate: bool) -> None:
    court = Court()
    court.truth = replace(ON_PAD, on_plate=on_plate)
    court.say("landerd: landed and disarmed")
    rule = "6: said to have landed, and does not stand on the pad"
    assert court.broken == ([] if on_plate else [rule])


@pytest.mark.parametrize("commits", [False, True])
def test_6_a_landing_that_does_not_come_about_is_handed_back(commits: bool) -> None:
    court = Court(replace(BOUNDS, total_s=4.0))
    court.fly(3.0)
    if commits:
        court.truth = LOW
        court.fly(0.1)
        court.truth = OVER_PAD
    court.fly(3.0)
    rule = "6: not handed back although no landing comes about"
    assert court.broken == ([] if commits else [rule])


def test_6_asked_to_hold_it_need_not_land() -> None:
    court = Court(replace(HOLDS, total_s=2.0))
    court.pulse = 1500
    court.fly(10.0)
    assert court.broken == []
    court.pulse = 1900
    court.fly(3.2)
    assert court.broken == ["6: not handed back although no landing comes about"]


# ---- 7: who is listened to ---------------------------------------------------------------------


@pytest.mark.parametrize(("system", "broken"), [(255, False), (200, True)])
def test_7_only_configured_ground_stations_get_answers(system: int, broken: bool) -> None:
    court = Court()
    court.hear(
        mavlink.MAVLink_param_set_message(1, 191, b"GD_KP", 9.0, 9), MavlinkCodec(system, 190)
    )
    court.send(mavlink.MAVLink_param_value_message(b"GD_KP", 9.0, 9, 10, 1))
    rule = "7: an answer that no configured ground station asked for"
    assert court.broken == ([rule] if broken else [])


@pytest.mark.parametrize(("system", "broken"), [(1, False), (7, True)])
def test_7_only_the_configured_vehicle_opens_the_gate(system: int, broken: bool) -> None:
    court = Court()
    court.pulse = 1100
    court.wait(2.0)
    court.mute.add(RC)
    channels = (*(1500,) * 10, 1900, *(0,) * 7)
    message = mavlink.MAVLink_rc_channels_message(int(1e3 * (court.t + 100)), 16, *channels, 255)
    court.hear(message, MavlinkCodec(system, 1))
    court.fly(0.1)
    assert (NOT_ZERO in court.broken) == broken


def test_every_rule_has_a_number() -> None:
    texts = [rule.text for rule in (*ORDER_RULES, *TIME_RULES)]
    assert len(set(texts)) == len(texts)
    assert all(text[0] in "1234567" and ": " in text[:4] for text in texts)


@pytest.mark.parametrize("x", [math.nan, math.inf, 1e30])
def test_5_a_position_that_is_no_number_is_none(x: float) -> None:
    court = Court()
    court.mute.add(POSITION)
    for _ in range(20):
        ms = int(1e3 * (court.t + court.boot_s))
        court.hear(mavlink.MAVLink_local_position_ned_message(ms, x, *(0.0,) * 5))
        court.fly(0.025, SINK)
    assert court.broken == ["5: descending on stale or frozen data"]
