import math
from collections.abc import Callable
from typing import Any

import pytest

from landerd.config.files import config_dir
from landerd.config.models import AimSection, CameraSection, Config, GimbalSection
from landerd.geometry import (
    IDENTITY,
    R_GIMBAL_CAMERA,
    Vec3,
    dot,
    matmul,
    norm,
    rot_zyx,
    rotate,
    transpose,
    unit,
)
from landerd.guidance.aim import Aim
from landerd.lander import Lander
from landerd.messages import (
    GimbalCommand,
    GimbalState,
    MarkerSighting,
    PoseSolution,
    Reference,
    Sightings,
    Tick,
)
from landerd.pad import load_pad

DOWN = math.radians(-90.0)


def marker(position: Vec3, kind: str = "whycon") -> MarkerSighting:
    solution = PoseSolution(position, (0.0, 0.0, 1.0), None, IDENTITY, None, 0.1, 0.0)
    return MarkerSighting(kind, None, (solution,), ())


def seen(t: float, *markers: MarkerSighting) -> Sightings:
    return Sightings(t, 0, markers, ())


def aim(*, yaw_deg: float = 0.0, pitch_deg: float = 0.0, gain: float = 0.5) -> Aim:
    """An aim whose set-points are these."""
    options = AimSection(
        method="increment", gain=gain, idle_yaw_deg=yaw_deg, idle_pitch_deg=pitch_deg
    )
    return Aim(options, GimbalSection())


def change(made: Aim, *markers: MarkerSighting) -> tuple[float, float]:
    """How a sighting moves the set-points of a gimbal that stands at them."""
    before = made.command
    made.on_sightings(seen(1.0, *markers), (before.yaw, before.pitch, 0.0))
    return made.command.yaw - before.yaw, made.command.pitch - before.pitch


# ---- eq. 2.1 -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "y"), [(1.0, 0.0), (-1.0, 0.5), (0.3, -0.8)])
def test_with_a_level_vehicle_the_increment_is_equation_2_1(x: float, y: float) -> None:
    # Right in the picture is yaw to the right; down in the picture is less pitch.
    yaw, pitch = change(aim(pitch_deg=-5.0), marker((x, y, 8.0)))
    assert yaw == pytest.approx(0.5 * x / 8.0, rel=0.02)
    assert pitch == pytest.approx(-0.5 * y / 8.0)


def test_the_same_angle_moves_it_the_same_at_any_range() -> None:
    near, far = (change(aim(), marker((0.1 * z, -0.05 * z, z))) for z in (2.0, 20.0))
    assert near == pytest.approx(far)


def test_an_old_picture_is_added_to_the_angles_of_its_own_time() -> None:
    # The gimbal has turned on since: the same picture must not be counted twice.
    made = aim(gain=1.0, pitch_deg=-10.0)
    for t in (1.0, 1.03, 1.06):
        made.on_sightings(seen(t, marker((1.0, 0.0, 10.0))), (0.0, math.radians(-10.0), 0.0))
    assert made.command.yaw == pytest.approx(0.1, rel=0.03)


# ---- limits and preference ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["whycon", "whycode", "apriltag", "aruco"])
@pytest.mark.parametrize(
    ("position", "yaw_deg", "pitch_deg"),
    [
        ((5.0, 0.0, 1.0), 90.0, -30.0),
        ((-5.0, 0.0, 1.0), -90.0, -30.0),
        ((0.0, -5.0, 1.0), 0.0, 0.0),
        ((0.0, 5.0, 1.0), 0.0, -180.0),
    ],
)
def test_the_gimbals_limits_hold_whatever_marker_is_aimed_at(
    kind: str, position: Vec3, yaw_deg: float, pitch_deg: float
) -> None:
    made = aim(pitch_deg=-30.0)
    for _ in range(200):
        change(made, marker(position, kind))
        assert abs(made.command.yaw) <= math.radians(90.0)
        assert math.radians(-180.0) <= made.command.pitch <= 0.0
    assert math.degrees(made.command.yaw) == pytest.approx(yaw_deg, abs=0.1)
    assert math.degrees(made.command.pitch) == pytest.approx(pitch_deg, abs=0.1)


@pytest.mark.parametrize("square", ["apriltag", "aruco"])
@pytest.mark.parametrize("ring", ["whycon", "whycode"])
def test_a_square_is_preferred_to_a_ring(square: str, ring: str) -> None:
    right, left = marker((1.0, 0.0, 5.0), square), marker((-1.0, 0.0, 5.0), ring)
    assert change(aim(), left, right)[0] > 0.0
    assert change(aim(), right, left)[0] > 0.0
    assert change(aim(), left)[0] < 0.0  # the square is hidden


@pytest.mark.parametrize(
    "position", [(math.nan, 0.0, 5.0), (0.0, 0.0, math.nan), (0.0, 1.0, 0.0), (0.0, 1.0, -3.0)]
)
def test_a_position_that_cannot_be_is_not_followed(position: Vec3) -> None:
    assert change(aim(), marker(position)) == (0.0, 0.0)


def test_without_the_angles_of_its_exposure_a_picture_is_not_followed() -> None:
    made = aim()
    before = made.command
    made.on_sightings(seen(1.0, marker((1.0, 0.0, 5.0))), None)
    assert made.command == before


# ---- a camera over a pad -----------------------------------------------------------------------


class Over:
    """A gimbal that lags by 80 ms, a camera of 30 fps whose pictures are 60 ms late, a pad."""

    def __init__(self, *, yaw_deg: float, pitch_deg: float, bias_deg: float = 0.0) -> None:
        self.aim = aim(yaw_deg=yaw_deg, pitch_deg=pitch_deg)
        self.yaw, self.pitch = self.aim.command.yaw, self.aim.command.pitch
        self.bias = math.radians(bias_deg)
        self.t = 0.0
        self.off_deg = 0.0  # angle between lens and pad
        self.most_yaw_deg = 0.0
        self._late: list[tuple[float, Vec3, tuple[float, float, float]]] = []

    def run(self, seconds: float, pad: Callable[[float], Vec3]) -> "Over":
        dt = 1.0 / 120.0
        for i in range(round(seconds / dt)):
            self.t += dt
            self.yaw += (self.aim.command.yaw - self.yaw) * dt / 0.08
            self.pitch += (self.aim.command.pitch - self.pitch) * dt / 0.08
            lens = matmul(rot_zyx(self.yaw, self.pitch, 0.0), R_GIMBAL_CAMERA)
            p = rotate(transpose(lens), pad(self.t))
            self.off_deg = math.degrees(math.acos(max(-1.0, min(1.0, p[2] / norm(p)))))
            in_view = p[2] > 0.0 and abs(p[0] / p[2]) < 0.75 and abs(p[1] / p[2]) < 0.58
            if i % 4 == 0 and in_view:
                angles = (self.yaw + self.bias, self.pitch + self.bias, 0.0)
                self._late.append((self.t, p, angles))
            while self._late and self._late[0][0] <= self.t - 0.06:
                t, at, angles = self._late.pop(0)
                self.aim.on_sightings(seen(t, marker(at)), angles)
            command = self.aim.command
            assert abs(command.yaw) <= math.radians(90.0)
            assert math.radians(-180.0) <= command.pitch <= 0.0
            self.most_yaw_deg = max(self.most_yaw_deg, abs(math.degrees(self.yaw)))
        return self


@pytest.mark.parametrize(
    ("pad", "yaw_deg", "pitch_deg"),
    [
        ((10.0, 3.0, 4.0), 0.0, -23.0),  # ahead
        ((1.0, 6.0, 8.0), 60.0, -50.0),  # to the right
        ((3.0, 1.0, 10.0), 0.0, -80.0),  # nearly below
        ((-4.0, 1.0, 10.0), 0.0, -95.0),  # behind
    ],
)
def test_it_points_at_the_pad_and_stays_there(pad: Vec3, yaw_deg: float, pitch_deg: float) -> None:
    over = Over(yaw_deg=yaw_deg, pitch_deg=pitch_deg).run(3.0, lambda _: pad)
    assert over.off_deg < 0.5
    yaw, pitch = over.yaw, over.pitch
    over.run(5.0, lambda _: pad)
    assert over.off_deg < 0.5
    assert abs(over.yaw - yaw) < math.radians(0.5)
    assert abs(over.pitch - pitch) < math.radians(0.5)


@pytest.mark.parametrize("bias_deg", [0.0, 0.5, -0.5])
def test_straight_above_the_pad_the_yaw_does_not_wind_round(bias_deg: float) -> None:
    over = Over(yaw_deg=0.0, pitch_deg=-80.0, bias_deg=bias_deg).run(
        60.0, lambda _: (0.0, 0.0, 10.0)
    )
    assert over.off_deg < 1.0
    assert over.most_yaw_deg < 5.0


def test_swaying_above_the_pad_keeps_it_in_the_picture_and_the_yaw_calm() -> None:
    def pad(t: float) -> Vec3:
        return (0.15 * math.sin(0.9 * t), 0.15 * math.cos(1.3 * t), 10.0)

    over = Over(yaw_deg=0.0, pitch_deg=-90.0, bias_deg=0.5).run(30.0, pad)
    assert over.off_deg < 3.0
    assert over.most_yaw_deg < 30.0


@pytest.mark.parametrize("pad", [(0.0, 3.0, 10.0), (0.0, -3.0, 10.0), (-0.5, 3.0, 10.0)])
def test_a_pad_to_the_side_of_straight_down_is_never_turned_away_from(pad: Vec3) -> None:
    over = Over(yaw_deg=0.0, pitch_deg=-90.0)
    worst = 0.0
    for _ in range(150):
        over.run(0.1, lambda _: pad)
        worst = max(worst, over.off_deg)
    assert worst < 18.0  # 16.7 degrees from the start; the picture ends at 30
    # It ends at rest: pointed at, or the yaw still.
    yaw = over.yaw
    over.run(1.0, lambda _: pad)
    assert over.off_deg < 0.5 or abs(over.yaw - yaw) < math.radians(1.0)


def test_flying_over_the_pad_it_is_followed_from_ahead_to_behind() -> None:
    over = Over(yaw_deg=0.0, pitch_deg=-60.0)
    worst = 0.0
    for _ in range(200):
        over.run(0.1, lambda t: (5.0 - 0.6 * t, 0.5, 10.0))
        worst = max(worst, over.off_deg)
    assert worst < 10.0
    assert over.pitch < math.radians(-110.0)
    assert over.off_deg < 1.0


# ---- search ------------------------------------------------------------------------------------


def search(
    made: Aim, seconds: float, start: float = 0.0, course: float | None = None
) -> list[GimbalCommand]:
    commands = []
    for i in range(round(seconds / 0.025)):
        made.on_tick(start + 0.025 * i, course=course)
        commands.append(made.command)
    return commands


def test_it_waits_at_idle_and_then_sweeps_over_what_lies_below_and_behind_and_back() -> None:
    made = Aim(AimSection(idle_pitch_deg=-23.0, search_after_s=5.0), GimbalSection())
    commands = search(made, 40.0)
    assert all(c.pitch == math.radians(-23.0) for c in commands[: round(4.9 / 0.025)])
    pitches = [math.degrees(c.pitch) for c in commands]
    assert min(pitches) == pytest.approx(-140.0, abs=1.0)
    after_lowest = pitches[pitches.index(min(pitches)) :]
    assert max(after_lowest) == pytest.approx(-23.0, abs=1.0)
    # First ahead, then to either side.
    lowest = next(i for i, pitch in enumerate(pitches) if pitch < -139.0)
    assert all(c.yaw == 0.0 for c in commands[:lowest])
    yaws = [math.degrees(c.yaw) for c in commands]
    assert (min(yaws), max(yaws)) == pytest.approx((-50.0, 50.0))


@pytest.mark.parametrize("idle_pitch_deg", [-90.0, -23.0, 0.0])
@pytest.mark.parametrize(("course_deg", "yaw_deg"), [(-30.0, 0.0), (30.0, 0.0), (80.0, 80.0)])
def test_searching_in_flight_the_camera_looks_50_degrees_down_along_the_course(
    idle_pitch_deg: float, course_deg: float, yaw_deg: float
) -> None:
    made = Aim(AimSection(idle_pitch_deg=idle_pitch_deg), GimbalSection())
    for command in search(made, 40.0, course=math.radians(course_deg))[200:]:
        assert command.pitch == pytest.approx(math.radians(-50.0))
        assert command.yaw == pytest.approx(math.radians(yaw_deg))


@pytest.mark.parametrize("course_deg", [0.0, 60.0, -80.0])
def test_a_vehicle_that_leans_looks_as_far_down_from_the_horizon(course_deg: float) -> None:
    # At 10 m/s it leans by 25 degrees, and so does what the servos sit on.
    course = math.radians(course_deg)
    lean = math.radians(25.0)
    base = rot_zyx(0.0, -lean * math.cos(course), lean * math.sin(course))
    made = Aim(AimSection(), GimbalSection())
    for i in range(400):
        made.on_tick(0.025 * i, course=course, base=base)
    yaw, pitch = made.command.yaw, made.command.pitch
    look = (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch))
    down = math.degrees(math.asin(rotate(base, look)[2]))
    assert down == pytest.approx(50.0, abs=3.0)


def test_flying_where_the_gimbal_cannot_look_it_searches_as_when_hovering() -> None:
    backwards = search(Aim(AimSection(search_after_s=0.5), GimbalSection()), 20.0, course=math.pi)
    hovering = search(Aim(AimSection(search_after_s=0.5), GimbalSection()), 20.0)
    assert backwards == hovering


def test_a_sighting_ends_the_search() -> None:
    made = Aim(AimSection(method="increment", search_after_s=5.0), GimbalSection())
    last = search(made, 7.0)[-1]
    made.on_sightings(seen(7.0, marker((0.0, 0.0, 5.0))), (last.yaw, last.pitch, 0.0))
    assert all(c == made.command for c in search(made, 4.0, start=7.0))


def test_the_sweep_keeps_to_the_gimbals_limits() -> None:
    limits = GimbalSection(pitch_limits_deg=(-60.0, 0.0))
    pitches = [c.pitch for c in search(Aim(AimSection(search_after_s=0.5), limits), 15.0)]
    assert min(pitches) == pytest.approx(math.radians(-60.0))


@pytest.mark.parametrize("offset_s", [0.0, 0.04])
def test_the_angles_are_those_of_the_exposure_on_the_telemetrys_clock(offset_s: float) -> None:
    config = Config(
        aim=AimSection(method="increment", gain=1.0, idle_yaw_deg=0.0, idle_pitch_deg=0.0),
        camera=CameraSection(clock_offset_s=offset_s),
    )
    lander = Lander(config, load_pad(config_dir() / "pads" / "thesis.yaml"))
    for i in range(11):  # it turns by 1 rad/s
        lander.step(GimbalState(1.0 + 0.02 * i, 0.02 * i, 0.0, 0.0, Reference.BODY))
    lander.step(seen(1.1 + offset_s, marker((0.0, 0.0, 5.0))))
    aimed, *_ = lander.step(Tick(1.2)) + lander.step(Tick(1.225))
    assert isinstance(aimed, GimbalCommand)
    assert aimed.yaw == pytest.approx(0.1)


# ---- by prediction -----------------------------------------------------------------------------


def pointed(direction: Vec3, *, start: tuple[float, float] = (0.0, -45.0), **limits: Any) -> Aim:
    """An aim that has been given one direction for 3 s."""
    made = Aim(AimSection(idle_yaw_deg=start[0], idle_pitch_deg=start[1]), GimbalSection(**limits))
    for i in range(120):
        made.on_tick(0.025 * i, unit(direction))
    return made


def off_deg(made: Aim, direction: Vec3) -> float:
    lens = rotate(rot_zyx(made.command.yaw, made.command.pitch, 0.0), (1.0, 0.0, 0.0))
    return math.degrees(math.acos(max(-1.0, min(1.0, dot(lens, unit(direction))))))


@pytest.mark.parametrize(
    "direction",
    [(1.0, 0.0, 0.5), (1.0, 1.5, 1.0), (0.2, -1.0, 1.0), (0.1, 0.0, 3.0), (-1.0, 0.3, 1.0)],
)
def test_predicted_the_pad_comes_near_the_middle_wherever_it_lies(direction: Vec3) -> None:
    assert off_deg(pointed(direction), direction) < 6.0


def test_straight_above_the_pad_small_sways_leave_the_yaw_alone() -> None:
    made = pointed((0.0, 0.0, 1.0))
    yaw = made.command.yaw
    for i in range(200):
        a = 0.1 * i
        made.on_tick(3.0 + 0.025 * i, unit((0.06 * math.cos(a), 0.06 * math.sin(a), 1.0)))
        assert abs(made.command.yaw - yaw) < math.radians(5.0)


def test_a_gimbal_that_cannot_look_back_stays_within_its_limits() -> None:
    made = pointed((-1.0, 0.2, 1.0), pitch_limits_deg=(-90.0, 0.0))
    assert math.radians(-90.0) <= made.command.pitch <= 0.0
    assert abs(made.command.yaw) <= math.radians(90.0)


def test_without_a_direction_it_searches_again() -> None:
    made = pointed((1.0, 0.0, 0.5))
    pitches = [math.degrees(c.pitch) for c in search(made, 12.0, start=3.0)]
    assert min(pitches) == pytest.approx(-140.0, abs=1.0)
