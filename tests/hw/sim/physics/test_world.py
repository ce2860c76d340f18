import math
import statistics

import pytest
from pydantic import ValidationError

from hw.sim.options import SimOptions
from hw.sim.physics.world import World
from landerd.config.files import config_dir, config_files
from landerd.devices import sim_options
from landerd.drivers import read_configuration
from landerd.geometry import Vec3, cross, dot, norm, rotate, scale, sub, transpose
from tests.hw.sim.worlds import PLATE, over_pad, world

DEFAULT = config_dir() / "default.yaml"


def path(w: World, until_s: float) -> list[Vec3]:
    points = []
    while w.t < until_s - 1e-9:
        w.advance(w.t + 0.05)
        points.append(w.vehicle.position)
    return points


def test_one_seed_gives_one_world() -> None:
    gusts = {"speed_mps": 3.0, "gust_mps": 2.0}
    assert path(world(7, wind=gusts), 5.0) == path(world(7, wind=gusts), 5.0)
    assert path(world(7, wind=gusts), 5.0) != path(world(8, wind=gusts), 5.0)


def test_the_world_does_not_depend_on_how_often_it_is_asked() -> None:
    often, once = world(3), world(3)
    for w in (often, once):
        w.vehicle.order((1.0, 0.0, 0.5), 0.3)
    for i in range(1, 301):
        often.advance(i * 0.00731)
    once.advance(300 * 0.00731)
    assert often.vehicle.position == once.vehicle.position
    assert often.battery.energy_j == once.battery.energy_j


def test_starts_where_it_is_told_to_within_the_spread() -> None:
    starts = []
    for seed in range(10):
        w = world(seed, start={"spread_m": 1.0, "heading_spread_deg": 10.0, "altitude_m": 8.0})
        d = sub(w.vehicle.position, w.pad.position)
        starts.append(d[0])
        assert d[0] == pytest.approx(-30.0, abs=1.0)
        assert d[2] == pytest.approx(-8.0, abs=1e-9)
        assert abs(w.vehicle.yaw) <= math.radians(10.0)
    assert len(set(starts)) == 10


def test_a_picture_of_the_past_shows_the_past() -> None:
    w = world()
    w.vehicle.order((3.0, 0.0, 0.0), 0.0)
    w.advance(5.0)
    then = w.vehicle.position
    w.advance(5.06)
    assert w.snapshot(5.0).vehicle.position == pytest.approx(then, abs=1e-9)
    between = w.snapshot(5.00125).vehicle.position
    assert between[0] - then[0] == pytest.approx(3.0 * 0.00125, rel=0.05)
    with pytest.raises(ValueError, match="forgotten"):
        w.snapshot(3.0)


def test_the_lens_looks_where_body_and_gimbal_point_it() -> None:
    w = world(start={"heading_deg": 90.0})
    w.gimbal.aim(math.radians(-90.0), math.radians(-30.0))
    w.advance(10.0)
    pose = w.snapshot(10.0).camera
    axis = rotate(pose.R_local_camera, (0.0, 0.0, 1.0))
    # Nose to the east, lens to its left: north, and 30 degrees down.
    expected = (math.cos(math.radians(30.0)), 0.0, 0.5)
    assert axis == pytest.approx(expected, abs=0.02)
    image_right = rotate(pose.R_local_camera, (1.0, 0.0, 0.0))
    assert image_right == pytest.approx((0.0, 1.0, 0.0), abs=0.02)
    offset = sub(pose.position, w.vehicle.position)
    assert offset == pytest.approx((0.0, 0.10, 0.04), abs=0.002)


def test_height_is_from_the_feet_to_the_landing_point() -> None:
    w = over_pad(altitude_m=3.0)
    assert w.height == pytest.approx(3.0 - 0.20, abs=0.01)
    assert w.offset == pytest.approx((0.0, 0.0), abs=0.01)


def test_a_tilted_pad_aside_is_as_far_down_as_a_level_one() -> None:
    w = world(pad={"tilt_deg": 15.0}, start={"position_m": (-5.0, 0.0), "altitude_m": 4.0})
    assert w.height == pytest.approx(4.0 - 0.20, abs=1e-6)


@pytest.mark.parametrize("course_deg", [0.0, 130.0])
def test_starts_behind_a_fast_pad_and_at_its_speed(course_deg: float) -> None:
    w = world(pad={"speed_mps": 5.0, "course_deg": course_deg}, start={"position_m": (-30.0, 0.0)})
    assert w.follows
    assert math.degrees(w.vehicle.yaw) == pytest.approx(course_deg)
    w.vehicle.order(w.pad.velocity, 0.0)
    w.advance(3.0)
    assert math.hypot(*w.offset) == pytest.approx(15.0, abs=0.2)
    along = dot(sub(w.pad.position, w.vehicle.position), w.pad.velocity)
    assert along == pytest.approx(15.0 * 5.0, rel=0.02)


def test_a_slow_pad_is_not_followed() -> None:
    w = world(pad={"speed_mps": 4.9}, start={"position_m": (-30.0, 0.0)})
    assert not w.follows
    assert w.offset[0] == pytest.approx(-30.0, abs=1e-6)
    assert w.vehicle.velocity == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "pad",
    [
        {"speed_mps": 5.0, "course_deg": 60.0},
        {"speed_mps": 3.0, "turn_rate_deg_s": 10.0},
        {"heave_m": 0.3, "heave_hz": 0.2, "sway_m": 0.4, "turn_rate_deg_s": 5.0},
        {"tilt_deg": 10.0, "tilt_azimuth_deg": 30.0, "heave_m": 0.1},
    ],
)
def test_the_pads_velocity_is_that_of_its_positions(pad: dict[str, float]) -> None:
    w = world(pad=pad)
    w.advance(3.0)
    before = w.pad
    w.advance(3.01)
    middle = scale(sub(w.pad.position, before.position), 100.0)
    mean = scale(
        (
            before.velocity[0] + w.pad.velocity[0],
            before.velocity[1] + w.pad.velocity[1],
            before.velocity[2] + w.pad.velocity[2],
        ),
        0.5,
    )
    assert middle == pytest.approx(mean, abs=0.01)


def test_a_tilted_heaving_pad_keeps_clear_of_the_ground() -> None:
    w = world(pad={"tilt_deg": 15.0, "heave_m": 0.5, "tilt_azimuth_deg": 40.0})
    for _ in range(100):
        w.advance(w.t + 0.1)
        pad = w.pad
        for x in (PLATE.north_m, -PLATE.south_m):
            for y in (PLATE.east_m, -PLATE.west_m):
                assert pad.position[2] + rotate(pad.R_local_pad, (x, y, 0.0))[2] < 1e-9


def test_tilt_slopes_down_where_it_says() -> None:
    w = world(pad={"tilt_deg": 10.0, "tilt_azimuth_deg": 90.0})
    R = w.pad.R_local_pad
    assert rotate(R, (0.0, 1.0, 0.0))[2] == pytest.approx(math.sin(math.radians(10.0)))
    assert norm(cross(R[0], R[1])) == pytest.approx(1.0)
    assert dot(transpose(R)[2], (0.0, 0.0, 1.0)) == pytest.approx(math.cos(math.radians(10.0)))


def test_directions_of_slope_and_wind_may_be_drawn_by_the_seed() -> None:
    slopes, winds = set(), set()
    for seed in range(8):
        w = world(
            seed,
            pad={"tilt_deg": 10.0, "tilt_azimuth_deg": None},
            wind={"speed_mps": 6.0, "from_deg": None},
        )
        n, e, d = (row[2] for row in w.pad.R_local_pad)
        assert math.degrees(math.acos(d)) == pytest.approx(10.0)
        assert math.hypot(*w.wind) == pytest.approx(6.0)
        slopes.add(round(math.atan2(e, n), 3))
        winds.add(round(math.atan2(*w.wind), 3))
    assert len(slopes) == len(winds) == 8
    assert max(slopes) - min(slopes) > 2.0


def test_heading_of_a_tilted_pad_is_where_its_north_points_from_above() -> None:
    w = world(pad={"tilt_deg": 15.0, "tilt_azimuth_deg": 45.0, "turn_rate_deg_s": 10.0})
    w.advance(2.0)
    north = rotate(w.pad.R_local_pad, (1.0, 0.0, 0.0))
    assert w.pad.heading == pytest.approx(math.atan2(north[1], north[0]))


def test_gusts_reach_their_speed_and_no_more() -> None:
    w = world(wind={"speed_mps": 8.0, "gust_mps": 2.0, "gust_s": 5.0})
    speeds = []
    for _ in range(600):
        w.advance(w.t + 0.1)
        speeds.append(math.hypot(*w.wind))
    assert 9.5 < max(speeds) <= 10.0
    assert 6.0 <= min(speeds) < 7.5
    assert statistics.mean(speeds) == pytest.approx(8.0, abs=0.5)


def test_the_thesis_wind_blows_as_described() -> None:
    w = world(wind={"model": "thesis"})
    speeds = []
    for _ in range(1200):
        w.advance(w.t + 0.1)
        speeds.append(math.hypot(*w.wind))
    # Base of sqrt(2), noise of mean 1, sine of amplitude 1 over whole periods.
    assert statistics.mean(speeds) == pytest.approx(1.0 + math.sqrt(2.0), abs=0.2)
    assert statistics.pstdev(speeds) == pytest.approx(math.hypot(0.5, math.sqrt(0.5)), abs=0.2)


def test_the_reference_world_has_the_stated_flaws() -> None:
    days = [
        read_configuration(DEFAULT, overlays=[config_files("scenarios")["hover"]], seed=seed)
        for seed in range(1, 9)
    ]
    options = [sim_options(day) for day in days]
    for each in options:
        assert each.camera.latency_s == 0.06
        assert each.camera.exposure_s == 0.008
        assert each.gimbal.lag_s == 0.08
        assert each.gimbal.bias_deg == 0.5
        assert each.autopilot.guid_timeout_s == 1.0
    assert {each.camera.clock_offset_s for each in options} == {-0.005, 0.005}
    assert {each.ekf.height_scale_max for each in options} == {-0.05, 0.05}


@pytest.mark.parametrize(
    "options",
    [
        {"wind": {"speed_mps": math.nan}},
        {"pad": {"speed_mps": math.inf}},
        {"pad": {"sped_mps": 1.0}},
        {"camera": {"latency_s": -0.1}},
        {"vehicle": "faster"},
    ],
)
def test_a_world_that_makes_no_sense_is_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SimOptions.model_validate(options)
