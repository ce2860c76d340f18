"""The judge itself: what it holds against landerd, from single messages and a given truth."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from hw.autopilots.mavlink_codec import MavlinkCodec
from hw.sim.judge.rules import Rules, Truth
from tests.hw.sim.judge.bounds import BOUNDS

OVER_PAD = Truth(
    t=0.0,
    distance=0.0,
    height=5.0,
    heading_error=0.0,
    yaw=0.0,
    pad_velocity=(0.0, 0.0, 0.0),
    feet_down=0,
)


class Court:
    """A judge and the messages he sees: everything in order unless a test says otherwise."""

    def __init__(self) -> None:
        self.t = 0.0
        self.truth = OVER_PAD
        self.rules = Rules(BOUNDS, lambda: self.truth)
        self._autopilot = MavlinkCodec(1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._landerd = MavlinkCodec(1, 191)
        for pulse in (1100, 1900):  # the gate was low once, and is high
            self.listen(pulse)

    def listen(self, pulse: int = 1900, *, sees: bool = True) -> None:
        """Let the autopilot and the sensors report."""
        self.t += 0.025
        mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        ms = int(1e3 * self.t)
        channels = (*(1500,) * 10, pulse, *(0,) * 7)
        for message in (
            mavlink.MAVLink_heartbeat_message(2, 3, mode, mavlink.COPTER_MODE_GUIDED, 4, 3),
            mavlink.MAVLink_rc_channels_message(ms, 16, *channels, 255),
            mavlink.MAVLink_attitude_message(ms, *(0.0,) * 6),
            mavlink.MAVLink_local_position_ned_message(ms, *(0.0,) * 6),
        ):
            self.rules.to_landerd(self.t, self._autopilot.encode(message))
        self.rules.on_gimbal(self.t)
        if sees:
            self.rules.on_sighting(self.t)

    def say(self, text: str) -> None:
        """Let landerd tell the pilot something."""
        message = mavlink.MAVLink_statustext_message(4, text.encode())
        self.rules.from_landerd(self.t, self._landerd.encode(message))

    def order(self, down_mps: float, *, sees: bool = True) -> None:
        """Let landerd order a descent."""
        self.listen(sees=sees)
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            *(int(1e3 * self.t), 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0x5C7),
            *(0.0, 0.0, 0.0, 0.0, 0.0, down_mps, 0.0, 0.0, 0.0, 0.0, 0.0),
        )
        self.rules.from_landerd(self.t, self._landerd.encode(message))


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
def test_descent_outside_the_region_is_judged_against_the_pads_own_motion(
    pad_sinks_mps: float, order_mps: float, broken: bool
) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, distance=3.0, pad_velocity=(0.0, 0.0, pad_sinks_mps))
    court.order(order_mps)
    rule = "2: a downward set-point outside the descent region"
    assert list(court.rules.broken) == ([rule] if broken else [])


def test_who_climbs_away_after_a_touch_is_judged_as_in_the_air() -> None:
    court = Court()
    court.truth = replace(OVER_PAD, height=0.0, distance=3.0, feet_down=1)
    court.order(0.01)
    assert court.rules.broken == {}
    court.truth = replace(OVER_PAD, height=0.3, distance=3.0)
    court.order(0.01)
    assert list(court.rules.broken) == ["2: a downward set-point outside the descent region"]


@pytest.mark.parametrize(("order_mps", "broken"), [(0.01, False), (0.0, True)])
def test_once_a_foot_was_down_descent_must_be_ordered(order_mps: float, broken: bool) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, height=0.0)
    for _ in range(8):
        court.order(0.01)
    for i in range(40):
        bounces = i in (2, 3)
        court.truth = replace(OVER_PAD, height=0.0, feet_down=0 if bounces else 1)
        court.order(order_mps)
    rule = "4: no descent ordered after contact"
    assert list(court.rules.broken) == ([rule] if broken else [])


def level(court: Court, *, q: Sequence[float] = (1.0, 0.0, 0.0, 0.0), thrust: float = 0.0) -> None:
    court.listen()
    message = mavlink.MAVLink_set_attitude_target_message(
        int(1e3 * court.t), 1, 1, 7, q, 0.0, 0.0, 0.0, thrust
    )
    court.rules.from_landerd(court.t, court._landerd.encode(message))


@pytest.mark.parametrize(
    ("pressed_s", "order", "rule"),
    [
        (0.7, {}, None),
        (0.7, {"q": (0.7, 0.0, 0.0, 0.7)}, None),  # any heading
        (0.3, {}, "4: did not go with the pad after contact"),
        (0.0, {}, "4: level and without thrust while no foot is down"),
        (0.7, {"q": (0.99, 0.1, 0.0, 0.0)}, "4: an attitude ordered other than level"),
        (0.7, {"thrust": 0.4}, "4: an attitude ordered other than level"),
    ],
)
def test_it_stands_level_only_on_the_pad_and_not_at_once(
    pressed_s: float, order: dict[str, Any], rule: str | None
) -> None:
    court = Court()
    court.truth = replace(OVER_PAD, height=0.0, feet_down=4 if pressed_s else 0)
    for _ in range(max(1, round(pressed_s / 0.025))):
        court.order(0.01)
    for _ in range(4):
        level(court, **order)
    assert [broken[: len(rule or "")] for broken in court.rules.broken] == ([rule] if rule else [])


UNTOLD = "6: an abort that the pilot was not told of"


def lose(court: Court, seconds: float) -> None:
    for _ in range(round(seconds / 0.025)):
        court.order(-0.005, sees=False)  # zero would be the end of flying


def test_a_loss_of_sight_must_be_told() -> None:
    court = Court()
    court.order(0.0)
    lose(court, 1.4)
    assert court.rules.broken == {}
    lose(court, 0.4)
    assert list(court.rules.broken) == [UNTOLD]


@pytest.mark.parametrize("resumes", [False, True])
def test_a_loss_is_told_again_only_if_the_pilot_was_told_better_news(resumes: bool) -> None:
    court = Court()
    court.order(0.0)
    lose(court, 1.0)
    court.say("landerd: pad not in sight, holding")
    lose(court, 3.0)
    court.order(0.0)  # a marker is in one frame
    if resumes:
        court.say("landerd: approach: pad in sight")
        for _ in range(60):
            court.order(0.0)
    lose(court, 3.0)
    assert list(court.rules.broken) == ([UNTOLD] if resumes else [])
