"""The safety monitor: dangerous outcomes of a flight, whatever was ordered."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from hw.sim.judge.bounds import RuleBounds
from hw.sim.judge.evidence import Order
from hw.sim.judge.monitor import SafetyMonitor
from hw.sim.judge.truth import Feet
from hw.sim.physics.world import World
from landerd.geometry import Vec3
from tests.hw.sim.judge.bounds import BOUNDS
from tests.hw.sim.worlds import PLATE, over_pad


class Watched:
    """A vehicle over the pad that obeys the test; `flies`: whether landerd flies it."""

    def __init__(self, bounds: RuleBounds = BOUNDS, **options: object) -> None:
        self.flies = True
        self.world: World = over_pad(**options)  # type: ignore[arg-type]
        self.feet = Feet(self.world, self.world.airframe, PLATE)
        self.monitor = SafetyMonitor(
            self.world, self.feet, bounds, lambda: self.flies, lambda: not self.flies
        )

    def order(self, velocity: Vec3, seconds: float, *, told: bool = True) -> "Watched":
        """Fly a velocity; told: landerd orders it, too, 40 times a second."""
        for _ in range(round(seconds / 0.025)):
            if told:
                self.monitor.on_order(Order(self.world.t, velocity, 0.0, truth=self.feet.truth()))
            self.world.vehicle.order(velocity, 0.0)
            self.world.advance(self.world.t + 0.025)
        return self

    @property
    def found(self) -> list[str]:
        return list(self.monitor.found)


def test_a_gentle_landing_gives_no_finding() -> None:
    watched = Watched().order((0.0, 0.0, 0.3), 6.0)
    assert watched.found == []
    assert 0.1 < watched.monitor.worst.down_mps < 0.5


def test_motion_on_an_old_set_point_is_a_finding() -> None:
    watched = Watched(altitude_m=5.0).order((1.0, 0.0, 0.0), 2.0)
    assert watched.found == []
    watched.order((1.0, 0.0, 0.0), 0.5, told=False)
    assert watched.found == ["motion on a set-point older than 0.2 s"]


def test_a_set_point_is_older_while_the_world_lets_the_computer_stand_still() -> None:
    watched = Watched(replace(BOUNDS, stall_s=0.25), altitude_m=5.0).order((1.0, 0.0, 0.0), 2.0)
    watched.order((1.0, 0.0, 0.0), 0.4, told=False)
    assert watched.found == []
    watched.order((1.0, 0.0, 0.0), 0.2, told=False)
    assert watched.found == ["motion on a set-point older than 0.2 s"]


def test_standing_still_on_an_old_stop_order_is_no_finding() -> None:
    watched = Watched(altitude_m=5.0).order((1.0, 0.0, 0.0), 2.0).order((0.0, 0.0, 0.0), 0.05)
    watched.order((0.0, 0.0, 0.0), 1.0, told=False)
    assert watched.found == []


def test_flight_by_others_than_landerd_gives_no_finding() -> None:
    watched = Watched(altitude_m=5.0).order((1.0, 0.0, 0.0), 2.0)
    watched.flies = False
    watched.order((3.0, 0.0, 0.0), 2.0, told=False)
    assert watched.found == []


def test_a_hard_contact_beside_the_pad_is_a_finding() -> None:
    watched = Watched(altitude_m=3.0).order((2.0, 0.0, 0.0), 3.0).order((0.0, 0.0, 0.0), 2.0)
    watched.order((0.0, 0.0, 0.9), 5.0)
    assert "ground contact off the pad above 0.5 m/s" in watched.found
    assert "descends below 1 m, more than 1 m off" in watched.found
    assert watched.monitor.worst.down_mps > 0.5


def test_a_vehicle_pressed_down_as_it_hops_beside_the_pad_does_not_descend_there() -> None:
    watched = Watched(altitude_m=1.2).order((0.0, 2.0, -0.3), 2.0, told=False)
    vehicle = watched.world.vehicle
    while not any(vehicle.feet):  # as where landerd stands still, and the wind carries it off
        watched.order((0.0, 2.0, 0.5), 0.025, told=False)
    hopped_s = 0.0
    for _ in range(40):
        watched.order((0.0, 0.0, 0.6), 0.025)
        hopped_s += 0.0 if any(vehicle.feet) else 0.025
    assert 0.1 < hopped_s < 0.2
    assert "descends below 1 m, more than 1 m off" not in watched.found


def test_a_vehicle_that_tips_over_is_a_finding() -> None:
    watched = Watched(pad={"speed_mps": 8.0}).order((0.0, 0.0, 0.6), 4.0)
    assert "tipped over 30 degrees" in watched.found
    assert watched.monitor.worst.tilt_deg > 30.0


def test_a_vehicle_that_others_tip_over_is_a_finding_of_its_own() -> None:
    watched = Watched(pad={"speed_mps": 8.0}).order((8.0, 0.0, 0.0), 5.0)
    while not all(watched.world.vehicle.feet):
        watched.order((8.0, 0.0, 0.3), 0.025)
    watched.order((8.0, 0.0, 0.3), 0.5)
    watched.flies = False
    watched.order((8.0, 0.0, 0.3), 1.0, told=False).order((0.0, 0.0, 0.6), 2.0, told=False)
    assert "tipped over in the hands of others" in watched.found
    assert "tipped over 30 degrees" not in watched.found


def test_a_vehicle_that_others_set_down_on_a_driving_pad_is_not_blamed_on_landerd() -> None:
    quick = {"acceleration_mps2": 5.0, "jerk_mps3": 20.0}
    watched = Watched(pad={"speed_mps": 6.0}, response=quick).order((6.0, 0.0, 0.0), 5.0)
    while watched.world.height > 0.2:
        watched.order((6.0, 0.0, 0.3), 0.025)
    watched.flies = False
    watched.order((0.0, 0.0, 0.6), 0.9, told=False)
    assert "tipped over in the hands of others" in watched.found
    assert "tipped over 30 degrees" not in watched.found


@pytest.mark.parametrize(("silent_s", "by_others"), [(1.0, False), (4.5, True)])
def test_landerd_does_not_tip_over_what_hovers_long_after_it_fell_silent(
    silent_s: float, *, by_others: bool
) -> None:
    watched = Watched(pad={"speed_mps": 8.0}).order((8.0, 0.0, 0.0), 5.0)
    watched.order((8.0, 0.0, 0.0), silent_s, told=False)
    watched.order((0.0, 0.0, 0.6), 3.0, told=False)
    assert ("tipped over in the hands of others" in watched.found) is by_others
    assert ("tipped over 30 degrees" in watched.found) is not by_others


def test_a_vehicle_that_lies_there_as_landerd_takes_it_back_was_tipped_over_by_others() -> None:
    watched = Watched(pad={"speed_mps": 8.0}).order((8.0, 0.0, 0.0), 5.0)
    while not all(watched.world.vehicle.feet):
        watched.order((8.0, 0.0, 0.3), 0.025)
    watched.flies = False
    watched.order((8.0, 0.0, 0.3), 1.1, told=False).order((0.0, 0.0, 0.6), 2.0, told=False)
    watched.flies = True
    watched.order((0.0, 0.0, 0.3), 0.5)
    assert "tipped over in the hands of others" in watched.found
    assert "tipped over 30 degrees" not in watched.found


def test_a_vehicle_thrown_off_the_pad_where_others_tipped_it_over_is_not_blamed_on_landerd() -> (
    None
):
    watched = Watched(pad={"speed_mps": 8.0}).order((8.0, 0.0, 0.0), 5.0)
    world, vehicle = watched.world, watched.world.vehicle
    while not all(vehicle.feet):
        watched.order((8.0, 0.0, 0.3), 0.025)
    watched.flies = False
    watched.order((8.0, 0.0, 0.3), 1.1, told=False)
    while not watched.found:
        watched.order((0.0, 0.0, 0.6), 0.025, told=False)
    watched.flies = True
    beside_mps = 0.0
    for _ in range(80):
        truth = watched.feet.truth()
        watched.monitor.on_order(Order(world.t, (0.0, 0.0, 0.0), 0.0, truth=truth, level=True))
        vehicle.order((0.0, 0.0, 1.0), 0.0, level=True)
        world.advance(world.t + 0.025)
        beside_mps = max(beside_mps, 0.0 if vehicle.on_pad else math.hypot(*vehicle.velocity))
    assert beside_mps > 2.0
    assert "tipped over in the hands of others" in watched.found
    assert "ground contact off the pad above 0.5 m/s" not in watched.found


def test_a_vehicle_handed_over_while_it_tips_is_blamed_on_landerd() -> None:
    watched = Watched(pad={"speed_mps": 8.0}).order((0.0, 0.0, 0.6), 0.5)
    vehicle = watched.world.vehicle
    while not (any(vehicle.feet) and math.hypot(vehicle.roll, vehicle.pitch) > math.radians(20.0)):
        watched.order((0.0, 0.0, 0.6), 0.025)
    watched.flies = False
    watched.order((0.0, 0.0, 0.6), 2.0, told=False)
    assert "tipped over 30 degrees" in watched.found


def test_a_lean_against_wind_at_touch_down_is_not_taken_for_tipping() -> None:
    airframe = {"mass_kg": 1.2, "angle_max_deg": 40.0}
    watched = Watched(wind={"speed_mps": 9.5, "from_deg": 0.0}, airframe=airframe)
    while not any(watched.world.vehicle.feet):
        watched.order((0.0, 0.0, 0.3), 0.025)
    watched.order((0.0, 0.0, 0.3), 0.05)
    assert watched.monitor.worst.tilt_deg > 30.0
    assert watched.found == []


def test_a_lean_while_climbing_away_is_not_taken_for_tipping() -> None:
    watched = Watched(
        wind={"speed_mps": 6.0, "from_deg": 0.0},
        airframe={"mass_kg": 1.5, "angle_max_deg": 45.0},
        response={"acceleration_mps2": 5.0, "jerk_mps3": 20.0},
    )
    while not any(watched.world.vehicle.feet):
        watched.order((0.0, 0.0, 0.3), 0.025)
    watched.order((0.0, 0.0, -1.0), 0.9)  # a gust, say, that it flies against:
    most_deg = 0.0
    while watched.monitor.touches:
        watched.order((4.0, 0.0, -1.0), 0.025)
        most_deg = max(most_deg, abs(math.degrees(watched.world.vehicle.pitch)))
    assert most_deg > 32.0
    assert watched.found == []


def test_sinking_faster_than_the_limits_is_a_finding() -> None:
    watched = Watched(altitude_m=30.0).order((0.0, 0.0, 2.0 * BOUNDS.descent_mps + 1.5), 5.0)
    assert "climbs or sinks faster than the limits" in watched.found


def test_taking_over_above_the_speed_limit_landerd_may_brake_it() -> None:
    slow = replace(BOUNDS, speed_mps=0.5)
    watched = Watched(slow, altitude_m=5.0).order((4.0, 0.0, 0.0), 4.0, told=False)
    watched.order((0.5, 0.0, 0.0), 4.0)
    assert watched.found == []
    watched.order((2.0, 0.0, 0.0), 4.0)
    assert watched.found == ["faster than the limits"]


def test_taking_over_above_the_speed_limit_landerd_must_not_go_faster() -> None:
    slow = replace(BOUNDS, speed_mps=0.5)
    watched = Watched(slow, altitude_m=5.0).order((2.0, 0.0, 0.0), 4.0, told=False)
    watched.order((4.0, 0.0, 0.0), 4.0)
    assert watched.found == ["faster than the limits"]


def _moving(watched: Watched) -> None:
    watched.order((3.0, 0.0, 0.0), 8.0)


def _still(watched: Watched) -> None:
    watched.order((0.0, 0.0, 0.0), 8.0)


def _down(watched: Watched) -> None:
    watched.order((0.0, 0.0, 0.5), 8.0)


@pytest.mark.parametrize(
    ("text", "fly", "finding"),
    [
        ("landerd: pad not in sight, holding", _moving, "told to hold, and it does not hover"),
        ("landerd: pad not in sight, holding", _still, None),
        ("landerd: pad missed, climbing away", _down, "told to climb away, and it sinks"),
        ("landerd: landed and disarmed", _still, "told to have landed, and it flies"),
        ("landerd: disarmed beside the pad", _still, "told to have missed, and it stands on it"),
        (
            "landerd: touch-down not confirmed, disarm by",
            _still,
            "told to have touched, and no foot is down",
        ),
    ],
)
def test_a_text_to_the_pilot_that_does_not_come_true_is_a_finding(
    text: str, fly: Callable[[Watched], None], finding: str | None
) -> None:
    watched = Watched(altitude_m=12.0)
    watched.order((0.0, 0.0, 0.0), 0.1)
    watched.monitor.on_text(watched.world.t, text)
    fly(watched)
    assert [each for each in watched.found if each.startswith("told")] == [finding] * bool(finding)


def test_a_fast_vehicle_may_take_as_long_to_hover_as_its_autopilot_brakes() -> None:
    watched = Watched(replace(BOUNDS, braking_mps2=0.5), altitude_m=12.0)
    watched.order((3.0, 0.0, 0.0), 4.0)
    watched.monitor.on_text(watched.world.t, "landerd: attitude is stale, holding")
    watched.order((2.0, 0.0, 0.0), 7.5)
    assert watched.found == []
    watched.order((2.0, 0.0, 0.0), 1.0)
    assert watched.found == ["told to hold, and it does not hover"]


@pytest.mark.parametrize(("speed_mps", "found"), [(3.0, False), (0.0, True)])
def test_holding_over_a_moving_pad_includes_moving_with_it(speed_mps: float, found: bool) -> None:
    watched = Watched(altitude_m=12.0, pad={"speed_mps": 3.0})
    watched.order((speed_mps, 0.0, 0.0), 4.0)
    watched.monitor.on_text(watched.world.t, "landerd: holding over the marker, switch to land")
    watched.order((speed_mps, 0.0, 0.0), 8.0)
    told = "told to hold over the pad, and it does not"
    assert [each for each in watched.found if each.startswith("told")] == [told] * found


def test_a_text_that_a_later_one_replaces_is_not_judged() -> None:
    watched = Watched(altitude_m=12.0)
    watched.monitor.on_text(watched.world.t, "landerd: pad not in sight, holding")
    watched.order((2.0, 0.0, 0.0), 2.0)
    watched.monitor.on_text(watched.world.t, "landerd: approach: pad in sight")
    _moving(watched)
    assert watched.found == []


def test_a_false_text_about_the_present_is_a_finding_whatever_follows() -> None:
    watched = Watched(altitude_m=12.0)
    watched.order((0.0, 0.0, 0.0), 0.1)
    watched.monitor.on_text(watched.world.t, "landerd: landed and disarmed")
    watched.monitor.on_text(watched.world.t, "landerd: not armed")
    assert watched.found == ["told to have landed, and it flies"]
