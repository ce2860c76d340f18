import math

import pytest

from tests.hw.sim.worlds import descend, over_pad


@pytest.mark.parametrize(("speed_mps", "expected_s"), [(0.2, 2.40), (0.3, 1.94), (0.5, 1.52)])
def test_landing_is_detected_as_late_as_measured(speed_mps: float, expected_s: float) -> None:
    w = over_pad()
    landed = descend(w, speed_mps, 8.0)
    touchdown = w.vehicle.touchdown
    assert landed is not None
    assert touchdown is not None
    assert landed - touchdown.t == pytest.approx(expected_s, abs=0.15)
    assert touchdown.velocity[2] == pytest.approx(speed_mps, abs=0.05)
    assert all(w.vehicle.feet)
    assert w.vehicle.on_pad
    assert w.height == pytest.approx(0.0, abs=0.005)


def test_the_vehicle_stops_falling_at_contact() -> None:
    w = over_pad()
    w.vehicle.order((0.0, 0.0, 0.3), 0.0)
    while w.vehicle.touchdown is None and w.t < 5.0:
        w.advance(w.t + 0.01)
    contact_t = w.t
    rebound = 0.0
    while w.t < contact_t + 1.0:
        w.advance(w.t + 0.01)
        rebound = min(rebound, w.vehicle.velocity[2])
        if w.t > contact_t + 0.1:
            assert w.vehicle.velocity[2] < 0.4 * 0.3  # what was measured as contact
    assert -0.12 < rebound < -0.03  # measured: -0.07 m/s


@pytest.mark.parametrize("order_down", [0.0, -0.2])
def test_no_landing_is_detected_unless_descent_is_ordered(order_down: float) -> None:
    w = over_pad()
    descend(w, 0.3, 2.9)
    assert w.vehicle.touchdown is not None
    w.vehicle.order((0.0, 0.0, order_down), 0.0)
    w.advance(10.0)
    assert not w.vehicle.landed_detected


@pytest.mark.parametrize(("lateral_mps", "detected"), [(0.2, True), (0.3, False), (0.5, False)])
def test_a_lateral_order_keeps_the_detector_from_landing(
    lateral_mps: float, detected: bool
) -> None:
    w = over_pad()
    descend(w, 0.3, 1.0)
    landed = descend(w, 0.3, 8.0, lateral_mps)
    assert w.vehicle.on_pad
    assert (landed is not None) == detected


@pytest.mark.parametrize("cure", [{"level": True}, {"landing": True}])
@pytest.mark.parametrize(("wind_mps", "detected"), [(5.0, True), (8.0, False)])
def test_lean_against_the_wind_keeps_the_detector_from_landing(
    wind_mps: float, detected: bool, cure: dict[str, bool]
) -> None:
    w = over_pad(wind={"speed_mps": wind_mps, "from_deg": 0.0})
    assert (descend(w, 0.3, 8.0) is not None) == detected
    assert w.vehicle.on_pad
    # Nothing but tilt was in the way: neither a level order asks for it, nor a mode for landing.
    w.vehicle.order((0.0, 0.0, 0.3), 0.0, **cure)
    w.advance(11.0)
    assert w.vehicle.landed_detected


@pytest.mark.parametrize(
    ("speed_mps", "vehicle"), [(1.0, "reference"), (5.0, "reference"), (15.0, "fast")]
)
def test_a_moving_pad_carries_the_vehicle_along(speed_mps: float, vehicle: str) -> None:
    w = over_pad(vehicle=vehicle, pad={"speed_mps": speed_mps, "course_deg": 30.0})
    descend(w, 0.3, 5.0)
    w.vehicle.order((0.0, 0.0, 0.3), 0.0, level=True)  # at 15 m/s its tilt keeps it from landing
    w.advance(8.0)
    assert w.vehicle.landed_detected
    w.vehicle.motors_off()
    offset = w.offset
    w.advance(12.0)
    assert w.offset == pytest.approx(offset, abs=0.01)
    assert math.dist(w.vehicle.velocity, w.pad.velocity) < 0.01
    assert w.vehicle.on_pad


def test_a_turning_pad_turns_the_vehicle() -> None:
    w = over_pad(pad={"turn_rate_deg_s": 10.0})
    assert descend(w, 0.3, 6.0) is not None
    error = w.heading_error
    w.advance(9.0)
    assert w.heading_error == pytest.approx(error, abs=math.radians(0.5))


def test_stands_flush_on_a_tilted_heaving_pad() -> None:
    w = over_pad(pad={"tilt_deg": 10.0, "heave_m": 0.3})  # slopes down to the north
    assert descend(w, 0.4, 10.0) is not None
    v = w.vehicle
    assert all(v.feet)
    assert math.degrees(v.pitch) == pytest.approx(-10.0, abs=0.5)
    w.advance(14.0)  # nothing slides down
    assert w.relative_velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert all(v.feet)


@pytest.mark.parametrize("seed", range(4))  # each a phase of its own
def test_touchdown_speed_is_that_against_the_heaving_pad(seed: int) -> None:
    w = over_pad(seed, altitude_m=1.2, pad={"heave_m": 0.3, "heave_hz": 0.2})
    w.vehicle.order((0.0, 0.0, 0.4), 0.0)
    before = w.relative_velocity
    while w.vehicle.touchdown is None:
        before = w.relative_velocity
        w.advance(w.t + 0.0025)
    touchdown = w.vehicle.touchdown
    pad_sinks = w.pad.velocity[2]
    assert touchdown.velocity[2] == pytest.approx(before[2], abs=0.02)
    assert touchdown.velocity[2] == pytest.approx(0.4 - pad_sinks, abs=0.05)


def test_a_turning_pad_passes_under_a_vehicle_aside_of_its_middle() -> None:
    w = over_pad(pad={"turn_rate_deg_s": 30.0})
    w.vehicle.order((0.4, 0.0, 0.0), 0.0)
    while w.offset[0] < 0.5:
        w.advance(w.t + 0.02)
    omega, (n, e) = math.radians(30.0), w.offset
    surface = (-omega * e, omega * n)
    velocity = w.vehicle.velocity
    assert w.relative_velocity[:2] == pytest.approx(
        (velocity[0] - surface[0], velocity[1] - surface[1]), abs=1e-9
    )


def test_sets_down_one_side_first_and_then_the_other_in_wind() -> None:
    w = over_pad(wind={"speed_mps": 5.0, "from_deg": 0.0})
    counts = []
    for _ in range(400):
        w.vehicle.order((0.0, 0.0, 0.3), 0.0)
        w.advance(w.t + 0.01)
        counts.append(sum(w.vehicle.feet))
    first = next(c for c in counts if c)
    assert first == 2
    assert counts[-1] == 4
    assert math.degrees(w.vehicle.pitch) == pytest.approx(0.0, abs=0.5)
    assert math.hypot(*w.offset) < 0.2


@pytest.mark.parametrize(("lateral_mps", "tips"), [(0.5, False), (2.0, True)])
def test_tips_over_only_where_the_energy_suffices(lateral_mps: float, tips: bool) -> None:
    # Lifting the centre over the outer feet takes 0.87 m/s: feet 0.13 m out, centre 0.2 m up.
    w = over_pad(altitude_m=0.6, pad={"position_m": (500.0, 0.0)})
    w.vehicle.order((0.0, lateral_mps, 0.0), 0.0)
    w.advance(3.0)
    w.vehicle.order((0.0, lateral_mps, 0.4), 0.0)
    w.advance(5.0)
    w.vehicle.order((0.0, 0.0, 0.4), 0.0)
    w.advance(8.0)
    assert (abs(math.degrees(w.vehicle.roll)) > 45.0) == tips


def test_beside_the_plate_is_ground() -> None:
    w = over_pad(pad={"height_m": 0.3})
    w.vehicle.order((0.0, 1.5, 0.0), 0.0)
    w.advance(2.5)
    w.vehicle.order((0.0, 0.0, 0.3), 0.0)
    w.advance(8.0)
    touchdown = w.vehicle.touchdown
    assert touchdown is not None
    assert not touchdown.on_pad
    assert w.footprint_centre[2] == pytest.approx(0.0, abs=0.005)


def test_idles_after_a_landing_until_a_climb_is_ordered() -> None:
    w = over_pad()
    assert descend(w, 0.3, 6.0) is not None
    w.vehicle.order((0.0, 0.0, 0.0), 0.0)
    w.advance(7.0)
    assert w.vehicle.landed_detected
    assert w.battery.power_w < 50.0
    w.vehicle.order((0.0, 0.0, -1.0), 0.0)
    w.advance(10.0)
    assert not w.vehicle.landed_detected
    assert w.height > 1.0


def test_a_second_landing_is_a_touchdown_of_its_own() -> None:
    w = over_pad()
    descend(w, 0.3, 3.0)
    first = w.vehicle.touchdown
    w.vehicle.order((0.0, 0.0, -1.0), 0.0)
    w.advance(6.0)
    descend(w, 0.5, 14.0)
    second = w.vehicle.touchdown
    assert first is not None
    assert second is not None
    assert second.t > first.t + 1.0


def test_while_a_lean_is_asked_for_half_of_hover_steers_and_a_level_order_ends_it() -> None:
    """Measured of ArduCopter 4.5.7 in SITL in this wind.

    A body that followed its order, standing or not, was turned at 200 degrees/s by the order to
    stand level, and thrown up.
    """
    w = over_pad(wind={"speed_mps": 8.0, "from_deg": 90.0})
    descend(w, 0.3, 6.0)
    assert all(w.vehicle.feet)
    assert w.vehicle.thrust == pytest.approx(0.5, abs=0.05)
    w.vehicle.order((0.0, 0.0, 0.3), 0.0, level=True)
    most_deg = fastest = 0.0
    while w.t < 6.5:
        w.advance(w.t + 0.005)
        most_deg = max(most_deg, math.degrees(math.hypot(w.vehicle.roll, w.vehicle.pitch)))
        fastest = max(fastest, abs(w.vehicle.velocity[2]))
    assert w.vehicle.thrust < 0.12
    assert most_deg < 1.2
    assert fastest < 0.03


def test_half_lifted_it_slides_in_wind_in_which_it_stands_once_levelled() -> None:
    w = over_pad(
        wind={"speed_mps": 9.8, "from_deg": 0.0}, airframe={"angle_max_deg": 45.0}
    )  # it leans by 28 degrees: half of that weight on rubber holds against 26.6
    descend(w, 0.6, 3.2)
    assert all(w.vehicle.feet)
    assert math.hypot(*w.vehicle.velocity[:2]) > 0.1
    w.vehicle.order((0.0, 0.0, 0.6), 0.0, level=True)
    w.advance(4.0)
    assert math.hypot(*w.vehicle.velocity[:2]) < 0.01
    assert all(w.vehicle.feet)


def test_a_standing_vehicle_is_tipped_by_its_motors_no_farther_than_its_weight_allows() -> None:
    # It is asked to fly on into the wind and leans by all that it may; half of hover is all there
    # is, on two rotors 0.2 m aside, against half of its weight on feet 0.13 m aside, and the wind.
    w = over_pad(wind={"speed_mps": 8.0, "from_deg": 90.0})
    descend(w, 0.3, 4.0)
    w.vehicle.order((0.0, 1.0, 0.3), 0.0)
    w.advance(6.0)
    assert all(w.vehicle.feet)
    assert abs(math.degrees(w.vehicle.roll)) < 1.0
