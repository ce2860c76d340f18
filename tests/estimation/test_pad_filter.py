import math
import random
from collections.abc import Iterable

import pytest

from landerd.config.models import EstimationSection
from landerd.estimation.noise_adaptation import MIN_ACCELERATION_MPS2
from landerd.estimation.observation import BiasModel, PadObservation
from landerd.estimation.pad_filter import PadEstimate, PadFilter
from landerd.geometry import (
    IDENTITY,
    ZERO,
    Mat3,
    Vec3,
    add,
    diagonal,
    dot,
    horizontal,
    inverse,
    matadd,
    matscale,
    norm,
    outer,
    rot_z,
    rot_zyx,
    rotate,
    rotate_covariance,
    scale,
    sub,
    unit,
    wrap,
)

RATE = 30.0
PAD: Vec3 = (12.0, -7.0, 0.4)
OPTIONS = EstimationSection(clock_sigma_s=0.0)
NOTHING = matscale(IDENTITY, 0.0)
# Seen obliquely: 4 cm across, 20 cm along the line of sight.
R_SIGHT = rot_zyx(0.7, -0.9, 0.0)
SIGMAS: Vec3 = (0.20, 0.04, 0.04)
NEAR = rotate(R_SIGHT, (0.1, 0.0, 0.0))  # m
EXACT = BiasModel(ZERO, ZERO, range_share=0.0)  # by a lens and clocks without errors
# By a camera that looks straight down, its picture's top to the north.
FROM_ABOVE = EXACT._replace(about_x=(0.0, 1.0, 0.0), about_y=(-1.0, 0.0, 0.0))
COVARIANCE = rotate_covariance(
    R_SIGHT,
    ((SIGMAS[0] ** 2, 0.0, 0.0), (0.0, SIGMAS[1] ** 2, 0.0), (0.0, 0.0, SIGMAS[2] ** 2)),
)


def sighting(
    t: float,
    position: Vec3,
    *,
    noise: random.Random | None = None,
    heading: float | None = None,
    tilt: float = 0.0,
    sigma_tilt: float = 0.05,
    cost: float = 0.0,
    covariance: Mat3 = COVARIANCE,
    biases: BiasModel = EXACT,
    arm: Vec3 = NEAR,
) -> PadObservation:
    if noise is not None:
        error = (
            noise.gauss(0.0, SIGMAS[0]),
            noise.gauss(0.0, SIGMAS[1]),
            noise.gauss(0.0, SIGMAS[2]),
        )
        position = add(position, rotate(R_SIGHT, error))
        if heading is not None:
            heading = wrap(heading + noise.gauss(0.0, 0.03))
    sigma_heading = math.inf if heading is None else 0.03
    normal = (math.sin(tilt), 0.0, math.cos(tilt))
    return PadObservation(
        t=t,
        position=position,
        arm=arm,
        range_m=norm(arm),
        sight=unit(arm),
        covariance=covariance,
        telemetry_noise=NOTHING,
        biases=biases,
        heading=heading,
        sigma_heading=sigma_heading,
        normal=normal,
        sigma_tilt=sigma_tilt,
        cost=cost,
    )


def times(count: int, start: float = 0.0) -> Iterable[float]:
    return (start + i / RATE for i in range(count))


def estimate(pad_filter: PadFilter, now: float) -> PadEstimate:
    found = pad_filter.estimate(now)
    assert found is not None
    return found


def settled(position: Vec3 = PAD, velocity: Vec3 = (0.0, 0.0, 0.0), count: int = 90) -> PadFilter:
    """A filter after `count` sightings without noise, the last at (count - 1) / RATE."""
    pad_filter = PadFilter(OPTIONS)
    for t in times(count):
        pad_filter.update([sighting(t, add(position, scale(velocity, t)))])
    return pad_filter


def test_it_converges_on_a_still_pad() -> None:
    noise = random.Random(1)
    pad_filter = PadFilter(OPTIONS)
    for t in times(300):
        pad_filter.update([sighting(t, PAD, noise=noise)])
    found = estimate(pad_filter, t)
    assert norm(sub(found.position, PAD)) < 0.5 * SIGMAS[0]
    assert norm(found.velocity) < 0.3
    assert found.sigma_m < 0.5 * SIGMAS[0]


def test_innovations_are_as_large_as_the_filter_says() -> None:
    # A pad that accelerates as the filter assumes: the normalised innovation squared then has
    # mean 3 (chi-square of 3 degrees of freedom). 4000 samples know it to 0.04.
    noise = random.Random(2)
    pad_filter = PadFilter(OPTIONS)
    position, velocity = PAD, (0.0, 0.0, 0.0)
    dt = 1.0 / RATE
    kick = OPTIONS.pad_acceleration_mps2 * math.sqrt(dt)
    total, count = 0.0, 0
    for t in times(4100):
        seen = sighting(t, position, noise=noise)
        expected = pad_filter.estimate(t)
        if expected is not None and t > 3.0:
            innovation = sub(seen.position, expected.position)
            s = matadd(expected.covariance, COVARIANCE)
            total += dot(innovation, rotate(inverse(s), innovation))
            count += 1
        pad_filter.update([seen])
        change = (noise.gauss(0.0, kick), noise.gauss(0.0, kick), noise.gauss(0.0, kick))
        # White acceleration over dt: velocity steps, position moves with the mean of both.
        spread = kick * dt / math.sqrt(12.0)
        wander = (noise.gauss(0.0, spread), noise.gauss(0.0, spread), noise.gauss(0.0, spread))
        position = add(add(position, scale(add(velocity, scale(change, 0.5)), dt)), wander)
        velocity = add(velocity, change)
    assert count > 4000
    assert total / count == pytest.approx(3.0, abs=0.16)
    assert pad_filter.rejected < 0.005 * count  # beyond 4 sigma: 0.1 % of honest ones


def mean_nis(pad_filter: PadFilter, sightings: Iterable[PadObservation]) -> float:
    """Mean of the normalised innovations from 2 s after the first sighting on."""
    found = []
    for seen in sightings:
        pad_filter.update([seen])
        if seen.t > 2.0:
            found.append(pad_filter.nis)
    return sum(found) / len(found)


def scaled_noise(at: Iterable[float], factor: float, seed: int) -> Iterable[PadObservation]:
    """Yield sightings whose noise is this many times as large as stated."""
    noise = random.Random(seed)
    for t in at:
        off = sub(sighting(t, PAD, noise=noise).position, PAD)
        yield sighting(t, add(PAD, scale(off, factor)))


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_noise_of_another_size_than_stated_is_noticed(factor: float) -> None:
    nis = mean_nis(PadFilter(OPTIONS), scaled_noise(times(900), factor, 7))
    assert nis == pytest.approx(3.0, rel=0.2)


def test_a_slow_camera_learns_the_noise_in_as_many_seconds() -> None:
    at = list(times(120))[::2]
    found = [mean_nis(PadFilter(OPTIONS), scaled_noise(at, 0.3, seed)) for seed in range(8)]
    assert sum(found) / len(found) == pytest.approx(3.0, rel=0.25)


def test_a_heaving_deck_is_tracked_and_its_innovations_stay_white() -> None:
    noise = random.Random(8)
    pad_filter = PadFilter(OPTIONS)
    omega, size = 2.0 * math.pi * 0.3, 0.5
    close = matscale(IDENTITY, 0.01**2)
    worst = 0.0

    def sightings() -> Iterable[PadObservation]:
        nonlocal worst
        for t in times(900):
            heave = size * math.sin(omega * t)
            if t > 3.0:
                late = estimate(pad_filter, t)  # a frame after the last sighting
                worst = max(worst, abs(late.position[2] - PAD[2] - heave))
            off = (noise.gauss(0.0, 0.01), noise.gauss(0.0, 0.01), heave + noise.gauss(0.0, 0.01))
            yield sighting(t, add(PAD, off), covariance=close)

    assert mean_nis(pad_filter, sightings()) == pytest.approx(3.0, rel=0.2)
    assert worst < 0.05


def test_a_heaving_deck_is_known_to_turn_when_it_is_seen_worse_for_a_moment() -> None:
    # From 1 m on by its tag alone: the range is off by 3 % of itself and may be by 7.
    noise = random.Random(15)
    pad_filter = PadFilter(OPTIONS)
    omega, size = 2.0 * math.pi * 0.19, 0.3
    worst = 0.0
    for t in times(480):
        heave, by_tag = size * math.sin(omega * t), t > 14.0
        sigma, of_range = (0.006, 0.08) if by_tag else (0.001, 0.01)
        down = heave + 0.4 * of_range + noise.gauss(0.0, sigma)
        covariance = matscale(IDENTITY, sigma * sigma)
        biases, arm = EXACT._replace(range_share=of_range), (0.0, 0.0, 1.0)
        at = add(PAD, (0.0, 0.0, down))
        pad_filter.update([sighting(t, at, covariance=covariance, biases=biases, arm=arm)])
        if by_tag:
            found = estimate(pad_filter, t)
            error = abs(found.velocity[2] - size * omega * math.cos(omega * t))
            worst = max(worst, error / found.sigma_heave)
    assert worst < 3.0


def test_a_lens_that_swings_with_the_airframe_is_not_taken_for_the_pads_motion() -> None:
    # From 8 m a lens that is 1.5 mrad off one way and the other, once a second.
    noise = random.Random(9)
    pad_filter = PadFilter(OPTIONS)
    close = matscale(IDENTITY, 0.005**2)
    fastest = 0.0
    for t in times(600):
        swing = 0.0015 * 8.0 * math.sin(2.0 * math.pi * t)
        seen_at = add(PAD, (swing + noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005), 0.0))
        pad_filter.update([sighting(t, seen_at, covariance=close, arm=(0.0, 0.0, 8.0))])
        if t > 5.0:
            fastest = max(fastest, horizontal(estimate(pad_filter, t).velocity))
    assert fastest < 0.1


def test_a_late_gimbal_on_a_nimble_airframe_is_not_taken_for_the_pads_motion() -> None:
    """Once, with the gimbal's clock off by 6 ms, a pad at 1 m/s seemed to accelerate at 2 m/s^2."""
    noise = random.Random(9)
    pad_filter = PadFilter(OPTIONS)
    close = matscale(IDENTITY, 0.005**2)
    omega, turn, range_m = 2.0 * math.pi * 1.9, math.radians(5.0), 3.0
    fastest = 0.0
    for t in times(600):
        sweep = turn * omega * range_m * math.cos(omega * t)  # m/s
        late = matscale(outer((sweep, 0.0, 0.0), (sweep, 0.0, 0.0)), 2.0 * 0.002**2)
        off = (0.006 * sweep + noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005), 0.0)
        seen = sighting(t, add(PAD, off), covariance=close, arm=(0.0, 0.0, range_m))
        pad_filter.update([seen._replace(telemetry_noise=late)])
        if t > 5.0:
            fastest = max(fastest, horizontal(estimate(pad_filter, t).velocity))
    assert fastest < 0.25


def test_a_pad_that_sways_is_tracked() -> None:
    noise = random.Random(10)
    pad_filter = PadFilter(OPTIONS)
    omega, size = 2.0 * math.pi * 0.3, 0.5
    close = matscale(IDENTITY, 0.005**2)
    worst = 0.0
    for t in times(600):
        sway = size * math.sin(omega * t)
        seen_at = add(PAD, (noise.gauss(0.0, 0.005), sway + noise.gauss(0.0, 0.005), 0.0))
        if t > 3.0:
            worst = max(worst, abs(estimate(pad_filter, t).position[1] - PAD[1] - sway))
        pad_filter.update([sighting(t, seen_at, covariance=close, arm=(0.0, 0.0, 4.0))])
    assert worst < 0.05


def test_a_lens_that_points_off_moves_a_pad_no_longer_when_the_vehicle_has_stopped() -> None:
    # Approached at 3 m/s from 15 m to 1 m, seen 1 degree off sideways.
    error = math.radians(1.0)
    pad_filter = PadFilter(OPTIONS)
    close = matscale(IDENTITY, 0.01**2)
    for t in times(200):
        arm = max(1.0, 15.0 - 3.0 * t)
        off, down = add(PAD, (0.0, error * arm, 0.0)), (0.0, 0.0, arm)
        pad_filter.update([sighting(t, off, covariance=close, biases=FROM_ABOVE, arm=down)])
        found = pad_filter.estimate(t)
        if found is not None and t > 2.0:
            assert abs(found.velocity[1]) < 1.2 * error * 3.0
    assert found is not None
    assert norm(sub(found.position, PAD)) < 1.2 * error
    assert norm(found.velocity) < 0.02


@pytest.mark.parametrize("seed", range(4))
def test_ranges_that_err_from_picture_to_picture_tell_nothing_of_the_lens(seed: int) -> None:
    # Hovering 2.4 m over the pad. A landing point beside its marker goes with the marker's range.
    noise = random.Random(seed)
    pad_filter = PadFilter(OPTIONS)
    covariance = diagonal(0.004**2, 0.004**2, 0.03**2)
    for t in times(900):
        off = noise.gauss(0.0, 0.02)
        aside = (0.08 * off + noise.gauss(0.0, 0.003), noise.gauss(0.0, 0.003), off)
        biases = FROM_ABOVE._replace(range_share=0.01 + 0.05 * off)
        place, arm = add(PAD, aside), add((0.0, 0.0, 2.4), aside)
        pad_filter.update([sighting(t, place, covariance=covariance, biases=biases, arm=arm)])
    found = pad_filter.sensor_errors
    assert math.degrees(math.hypot(found.up, found.right)) < 1.0
    assert math.degrees(found.sigma_right) > 0.8


@pytest.mark.parametrize("seed", range(4))
def test_a_gimbals_noise_about_the_line_of_sight_tells_nothing_of_the_lens(seed: int) -> None:
    # Hovering 6 m over the pad and 1.2 m aside. The lens's axes are as noisy as what is seen.
    noise = random.Random(seed)
    pad_filter = PadFilter(OPTIONS)
    covariance = diagonal(0.006**2, 0.006**2, 0.003**2)
    for t in times(1800):
        turned = rot_z(noise.gauss(0.0, math.radians(0.07)))
        off = (noise.gauss(0.0, 0.006), noise.gauss(0.0, 0.002), noise.gauss(0.0, 0.003))
        arm = rotate(turned, add((1.2, 0.0, 6.0), off))
        biases = FROM_ABOVE._replace(
            about_x=rotate(turned, FROM_ABOVE.about_x), about_y=rotate(turned, FROM_ABOVE.about_y)
        )
        place = add(PAD, sub(arm, (1.2, 0.0, 6.0)))
        pad_filter.update([sighting(t, place, covariance=covariance, biases=biases, arm=arm)])
    found = pad_filter.sensor_errors
    assert abs(math.degrees(found.up)) < 1.5  # with the newest axes: 3.4 to 4.1


@pytest.mark.parametrize("seed", range(4))
def test_an_error_of_the_pads_place_that_the_vehicle_follows_is_not_taken_for_a_late_clock(
    seed: int,
) -> None:
    # Hovering 1 m over the pad, shown 5 mm to and fro by what stays alike for half a second.
    noise = random.Random(seed)
    pad_filter = PadFilter(EstimationSection(clock_sigma_s=0.03))
    covariance = matscale(IDENTITY, 0.001**2)
    keeps = math.exp(-1.0 / (0.5 * RATE))
    shown, vehicle, velocity = 0.0, 0.0, 0.0
    for t in times(1200):
        shown = keeps * shown + math.sqrt(1.0 - keeps * keeps) * noise.gauss(0.0, 0.005)
        seen = (shown + noise.gauss(0.0, 0.001), noise.gauss(0.0, 0.001), 1.0)
        biases = EXACT._replace(by_clock=(velocity, 0.0, 0.0))
        pad_filter.update(
            [sighting(t, seen, covariance=covariance, biases=biases, arm=scale(NEAR, 10.0))]
        )
        found = pad_filter.estimate(t)
        if found is not None:
            velocity = 1.5 * (found.position[0] - vehicle)
            vehicle += velocity / RATE
    errors = pad_filter.sensor_errors
    assert abs(errors.clock_s) < 2.0 * errors.sigma_clock_s


def test_a_pad_on_a_curve_is_predicted_along_it() -> None:
    pad_filter = PadFilter(OPTIONS)
    rate, speed = math.radians(20.0), 3.0

    def truth(t: float) -> tuple[Vec3, Vec3]:
        r, a = speed / rate, rate * t
        return (r * math.sin(a), -r * math.cos(a), 0.0), (
            speed * math.cos(a),
            speed * math.sin(a),
            0.0,
        )

    close = matscale(IDENTITY, 0.01**2)
    for t in times(150):
        place, velocity = truth(t)
        pad_filter.update([sighting(t, place, heading=wrap(rate * t), covariance=close)])
    later = estimate(pad_filter, t + 0.5)
    place, velocity = truth(t + 0.5)
    assert norm(sub(later.position, place)) < 0.05
    assert norm(sub(later.velocity, velocity)) < 0.1
    assert later.turn_rate == pytest.approx(rate, abs=math.radians(2.0))
    assert wrap((later.heading or 0.0) - rate * (t + 0.5)) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("rate_deg_s", [8.0, 20.0])
def test_a_pad_that_turns_about_itself_drives_straight_on(rate_deg_s: float) -> None:
    # A barge: by the first of its headings it might as well drive where it looks.
    noise = random.Random(4)
    pad_filter = PadFilter(OPTIONS)
    velocity = (2.0, 1.5, 0.0)
    for t in times(300):
        heading = wrap(math.radians(rate_deg_s) * t)
        pad_filter.update([sighting(t, scale(velocity, t), noise=noise, heading=heading)])
    later = estimate(pad_filter, t + 0.5)
    assert later.coupling == pytest.approx(0.0, abs=0.3)
    assert norm(sub(later.velocity, velocity)) < 0.12
    assert later.turn_rate == pytest.approx(math.radians(rate_deg_s), rel=0.2)


@pytest.mark.parametrize("speed", [0.0, 1.0, 10.0])
def test_a_pad_on_a_curve_that_turns_with_its_course_keeps_being_taken_for_one(
    speed: float,
) -> None:
    noise = random.Random(5)
    pad_filter = PadFilter(OPTIONS)
    rate = math.radians(8.0)
    least = 1.0
    for t in times(900):
        a, r = rate * t, speed / rate
        place = (r * math.sin(a), -r * math.cos(a), 0.0)
        pad_filter.update([sighting(t, place, noise=noise, heading=wrap(a))])
        if t > 1.0:
            least = min(least, estimate(pad_filter, t).coupling)
    assert least > 0.5


def test_a_pad_that_has_been_seen_to_lean_keeps_its_leaning_solution() -> None:
    pad_filter = PadFilter(OPTIONS)
    for t in times(30):
        pad_filter.update([sighting(t, PAD, tilt=math.radians(14.0))])
    level = sighting(1.0, add(PAD, (0.1, 0.0, 0.0)), cost=0.0)
    leaning = sighting(1.0, PAD, tilt=math.radians(14.0), cost=1.0)
    pad_filter.update([level, leaning])
    found = estimate(pad_filter, 1.0)
    assert norm(sub(found.position, PAD)) < 0.01
    assert math.acos(found.normal[2]) == pytest.approx(math.radians(14.0), abs=math.radians(2.0))


def test_the_stated_covariance_covers_the_error_on_a_still_pad() -> None:
    squares, count = 0.0, 0
    for seed in range(60):
        noise = random.Random(seed)
        pad_filter = PadFilter(OPTIONS)
        for t in times(90):
            pad_filter.update([sighting(t, PAD, noise=noise)])
        found = estimate(pad_filter, t)
        error = sub(found.position, PAD)
        squares += dot(error, rotate(inverse(found.covariance), error))
        count += 1
    # At most 3, as the pad moves less than assumed; not far below, or sigma would be useless.
    assert 1.0 < squares / count < 3.5


def test_it_tracks_a_pad_at_1_mps() -> None:
    noise = random.Random(3)
    velocity = (0.8, -0.6, 0.0)
    pad_filter = PadFilter(OPTIONS)
    lag: Vec3 = (0.0, 0.0, 0.0)
    error: Vec3 = (0.0, 0.0, 0.0)
    for i, t in enumerate(times(360)):
        true = add(PAD, scale(velocity, t))
        pad_filter.update([sighting(t, true, noise=noise)])
        if i >= 120:
            found = estimate(pad_filter, t)
            lag = add(lag, scale(sub(found.position, true), 1.0 / 240.0))
            error = add(error, scale(sub(found.velocity, velocity), 1.0 / 240.0))
            assert norm(sub(found.position, true)) < 2.0 * SIGMAS[0]
            assert norm(sub(found.velocity, velocity)) < 1.0
    assert norm(lag) < 0.05
    assert norm(error) < 0.1


def test_a_late_sighting_corrects_the_state_it_belongs_to() -> None:
    # 120 ms old when it is taken in, as a picture is: a pad at 1 m/s is 12 cm further by now.
    velocity = (1.0, 0.0, 0.0)
    pad_filter = settled(velocity=velocity, count=150)
    t = 149 / RATE
    now = t + 0.12
    found = estimate(pad_filter, now)
    assert found.position[0] == pytest.approx(PAD[0] + now, abs=0.01)
    # Not knowing more than the sighting it comes from.
    assert found.sigma_m > estimate(pad_filter, t).sigma_m


def test_a_sighting_older_than_the_last_is_not_taken() -> None:
    pad_filter = settled()
    t = 89 / RATE
    before = estimate(pad_filter, t)
    for late in (t, t - 0.01, t - 1.0):
        assert not pad_filter.update([sighting(late, add(PAD, (0.3, 0.0, 0.0)))])
        assert math.isnan(pad_filter.nis)  # it was compared with nothing
    assert estimate(pad_filter, t) == before


@pytest.mark.parametrize(("shown_at", "believed_s"), [(None, 2.0), (10, 0.4), (30, 1.0)])
def test_what_may_be_another_pad_is_believed_once_it_is_shown_not_to_be_or_later(
    shown_at: int | None, believed_s: float
) -> None:
    pad_filter = PadFilter(OPTIONS)
    believed = [
        t
        for i, t in enumerate(times(90))
        if pad_filter.update([sighting(t, PAD)], may_be_another=i != shown_at)
    ]
    assert believed[0] == pytest.approx(believed_s, abs=1.5 / RATE)
    assert len(believed) == 90 - round(believed[0] * RATE)


def test_one_outlier_is_refused_and_moves_nothing() -> None:
    pad_filter = settled()
    t = 90 / RATE
    assert not pad_filter.update([sighting(t, add(PAD, (3.0, 0.0, 0.0)))])
    assert pad_filter.rejected == 1
    assert norm(sub(estimate(pad_filter, t).position, PAD)) < 1e-6
    assert pad_filter.update([sighting(91 / RATE, PAD)])


def test_a_pad_that_stays_elsewhere_is_followed_but_not_at_once() -> None:
    pad_filter = settled()
    elsewhere = add(PAD, (3.0, 0.0, 0.0))
    accepted = [pad_filter.update([sighting(t, elsewhere)]) for t in times(10, 90 / RATE)]
    # Five are refused and the fifth begins anew; two more confirm it.
    assert accepted == [False] * 6 + [True] * 4
    assert norm(sub(estimate(pad_filter, 99 / RATE).position, elsewhere)) < 0.01


def test_outliers_among_good_sightings_never_take_over() -> None:
    noise = random.Random(4)
    pad_filter = settled()
    for i, t in enumerate(times(300, 90 / RATE)):
        far = add(PAD, (noise.uniform(-8.0, 8.0), noise.uniform(-8.0, 8.0), 5.0))
        pad_filter.update([sighting(t, PAD if i % 3 == 0 else far)])
        assert norm(sub(estimate(pad_filter, t).position, PAD)) < 0.05


@pytest.mark.parametrize("flip_first", [True, False])
def test_of_two_solutions_the_level_one_is_taken(flip_first: bool) -> None:
    pad_filter = PadFilter(OPTIONS)
    for t in times(15):
        # The picture slightly prefers the flipped one, which leans 20 degrees.
        level = sighting(t, PAD, tilt=math.radians(4.0), cost=1.0)
        flipped = sighting(t, add(PAD, (0.8, 0.5, 0.0)), tilt=math.radians(20.0), cost=0.5)
        pad_filter.update([flipped, level] if flip_first else [level, flipped])
    assert norm(sub(estimate(pad_filter, t).position, PAD)) < 0.01


def test_of_two_solutions_the_one_that_fits_what_was_seen_before_is_taken() -> None:
    pad_filter = settled()
    for t in times(30, 90 / RATE):
        true = sighting(t, PAD, tilt=math.radians(8.0), cost=1.0)
        flipped = sighting(t, add(PAD, (1.5, 0.0, 0.0)), tilt=math.radians(2.0), cost=0.5)
        assert pad_filter.update([flipped, true])
    assert norm(sub(estimate(pad_filter, t).position, PAD)) < 0.01


def test_one_false_alarm_is_never_a_pad() -> None:
    pad_filter = PadFilter(OPTIONS)
    assert not pad_filter.update([sighting(0.0, PAD)])
    for now in (0.0, 0.1, 1.0, 10.0):
        assert pad_filter.estimate(now) is None


def test_false_alarms_in_different_places_are_no_pad() -> None:
    noise = random.Random(5)
    pad_filter = PadFilter(OPTIONS)
    for t in times(200):
        place = (noise.uniform(-30.0, 30.0), noise.uniform(-30.0, 30.0), 0.0)
        assert not pad_filter.update([sighting(t, place)])
        assert pad_filter.estimate(t) is None


@pytest.mark.parametrize("gap", [0.4, 0.7, 1.0, 1.5, 1.95])
def test_a_false_alarm_before_the_pad_does_not_make_it_a_fast_one(gap: float) -> None:
    pad_filter = PadFilter(OPTIONS)
    pad_filter.update([sighting(0.0, add(PAD, (6.0, 0.0, 0.0)))])
    for t in times(30, gap):
        pad_filter.update([sighting(t, PAD)])
        found = pad_filter.estimate(t)
        assert found is None or norm(found.velocity) < 0.5
    assert norm(sub(estimate(pad_filter, t).position, PAD)) < 0.01


def test_a_marker_on_a_wall_is_not_taken_for_the_pad() -> None:
    pad_filter = PadFilter(OPTIONS)
    for t in times(60):
        assert not pad_filter.update([sighting(t, PAD, tilt=math.radians(60.0))])
    assert pad_filter.estimate(t) is None


@pytest.mark.parametrize(("period_s", "needed"), [(0.02, 21), (0.1, 5), (0.25, 3)])
def test_at_least_three_sightings_that_agree_for_a_moment_are_a_pad(
    period_s: float, needed: int
) -> None:
    pad_filter = PadFilter(OPTIONS)
    accepted = [pad_filter.update([sighting(period_s * i, PAD)]) for i in range(needed)]
    assert accepted == [False] * (needed - 1) + [True]


def test_after_two_seconds_out_of_sight_it_begins_anew() -> None:
    pad_filter = settled()
    elsewhere = add(PAD, (0.2, 0.0, 0.0))
    t = 89 / RATE + 2.1
    assert not pad_filter.update([sighting(t, elsewhere)])
    assert pad_filter.estimate(t) is None


def test_a_pad_out_of_sight_grows_uncertain() -> None:
    pad_filter = settled()
    t = 89 / RATE
    sigmas = [estimate(pad_filter, t + wait).sigma_m for wait in (0.0, 0.5, 1.0, 2.0)]
    assert sigmas == sorted(sigmas)
    # White acceleration alone gives a sqrt(dt^3 / 3); of a pad that stood still, the least.
    assert sigmas[-1] > 0.9 * MIN_ACCELERATION_MPS2 * math.sqrt(2.0**3 / 3.0)


def test_a_pad_that_drove_wildly_and_goes_straight_on_is_known_well_again() -> None:
    # 15 exact sightings a second: each is taken as it is while much acceleration is expected.
    noise, exact = random.Random(8), matscale(COVARIANCE, 1e-4)
    pad_filter = PadFilter(OPTIONS)
    for i in range(45):
        t = i / 15.0
        swung = add(PAD, (0.4 * math.sin(3.0 * t), 0.0, 0.0))
        pad_filter.update([sighting(t, swung, covariance=exact)])
    wild = estimate(pad_filter, t).sigma_velocity
    for i in range(45, 195):
        t = i / 15.0
        still = add(PAD, (noise.gauss(0.0, 3e-4), noise.gauss(0.0, 3e-4), 0.0))
        pad_filter.update([sighting(t, still, covariance=exact)])
    assert wild > 0.1
    assert estimate(pad_filter, t).sigma_velocity < 0.2 * wild


def test_an_empty_frame_changes_nothing() -> None:
    pad_filter = settled()
    before = estimate(pad_filter, 4.0)
    assert not pad_filter.update([])
    assert estimate(pad_filter, 4.0) == before


def test_after_a_reset_nothing_of_the_pad_is_known() -> None:
    pad_filter = settled()
    pad_filter.reset()
    assert pad_filter.estimate(3.0) is None
    # A frame of coordinates of its own, and times that begin again.
    for t in times(15):
        pad_filter.update([sighting(t, (0.0, 0.0, 0.0))])
    assert norm(estimate(pad_filter, t).position) < 1e-9


# ---- heading -----------------------------------------------------------------------------------


def test_headings_on_both_sides_of_180_degrees_are_averaged_the_short_way() -> None:
    noise = random.Random(6)
    pad_filter = PadFilter(OPTIONS)
    for t in times(300):
        pad_filter.update([sighting(t, PAD, noise=noise, heading=math.pi)])
    found = estimate(pad_filter, t)
    assert found.heading is not None
    assert abs(wrap(found.heading - math.pi)) < 0.02
    assert found.sigma_heading < 0.03


def test_a_ring_alone_tells_no_heading() -> None:
    assert estimate(settled(), 3.0).heading is None


def test_a_heading_not_seen_for_long_is_not_known() -> None:
    pad_filter = PadFilter(OPTIONS)
    for t in times(60):
        pad_filter.update([sighting(t, PAD, heading=0.3)])
    assert estimate(pad_filter, t).heading == pytest.approx(0.3)
    for later in times(300, t + 1 / RATE):  # only the ring from here on
        pad_filter.update([sighting(later, PAD)])
    assert estimate(pad_filter, later).heading is None
    # It is known again as soon as the square is.
    pad_filter.update([sighting(later + 1 / RATE, PAD, heading=0.35)])
    again = estimate(pad_filter, later + 1 / RATE).heading
    assert again == pytest.approx(0.35, abs=0.03)


def test_one_flipped_heading_is_refused_and_a_lasting_one_is_taken() -> None:
    pad_filter = PadFilter(OPTIONS)
    for t in times(60):
        pad_filter.update([sighting(t, PAD, heading=0.3)])
    pad_filter.update([sighting(t + 1 / RATE, PAD, heading=0.3 + math.pi)])
    assert estimate(pad_filter, t + 1 / RATE).heading == pytest.approx(0.3)
    for later in times(6, t + 2 / RATE):
        pad_filter.update([sighting(later, PAD, heading=1.3)])
    assert estimate(pad_filter, later).heading == pytest.approx(1.3, abs=0.01)


def test_headings_noisier_than_stated_are_not_taken_for_a_turning_pad() -> None:
    # As in the field: 0.8 degrees, where the picture's fit says 0.1.
    noise = random.Random(12)
    pad_filter = PadFilter(OPTIONS)
    fastest = furthest = 0.0
    for t in (0.1 * i for i in range(600)):
        heading = 1.0 + math.radians(noise.gauss(0.0, 0.8))
        seen = sighting(t, PAD, heading=heading)._replace(sigma_heading=math.radians(0.1))
        pad_filter.update([seen])
        if t > 3.0:
            ahead = estimate(pad_filter, t + 0.2)
            assert ahead.heading is not None
            fastest = max(fastest, abs(ahead.turn_rate))
            furthest = max(furthest, abs(wrap(ahead.heading - 1.0)))
    assert fastest < math.radians(5.0)
    assert furthest < math.radians(2.5)


def test_a_pad_that_begins_to_turn_is_turned_with_at_once() -> None:
    # By 20 degrees a second, before a camera of 8 pictures a second.
    noise = random.Random(13)
    pad_filter = PadFilter(OPTIONS)
    rate = math.radians(20.0)
    for t in (i / 8.0 for i in range(45)):
        true = rate * max(0.0, t - 5.0)
        heading = true + math.radians(noise.gauss(0.0, 0.3))
        pad_filter.update([sighting(t, PAD, heading=heading)._replace(sigma_heading=0.002)])
    found = estimate(pad_filter, t)
    assert found.heading == pytest.approx(true, abs=math.radians(2.0))
    assert found.turn_rate == pytest.approx(rate, rel=0.25)


def test_a_heading_learned_from_two_pictures_does_not_turn_the_pads_velocity() -> None:
    # The last ones through a gimbal that turns and does not say so any more.
    pad_filter = PadFilter(OPTIONS)
    askew = {90: 0.1, 91: 0.14, 92: 0.18}
    for i in range(93):
        t = i / RATE
        seen = sighting(t, (5.0 * t, 0.0, 0.0), heading=askew.get(i, 0.0), covariance=CLOSE)
        pad_filter.update([seen._replace(sigma_heading=0.01)])
    later = estimate(pad_filter, t + 1.0)
    assert later.velocity == pytest.approx((5.0, 0.0, 0.0), abs=0.2)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_position_that_is_no_number_is_refused(bad: float) -> None:
    pad_filter = settled()
    t = 90 / RATE
    assert not pad_filter.update([sighting(t, (bad, 0.0, 0.0))])
    assert norm(sub(estimate(pad_filter, t).position, PAD)) < 1e-6


CLOSE = matscale(IDENTITY, 0.005**2)


def quiet(count: int = 90) -> PadFilter:
    """Return a filter that has seen a pad for some seconds with hardly any noise."""
    noise = random.Random(5)
    pad_filter = PadFilter(OPTIONS)
    for t in times(count):
        error = (noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005))
        pad_filter.update([sighting(t, add(PAD, error), covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
    return pad_filter


def test_a_short_step_of_the_telemetry_does_not_make_sightings_refused() -> None:
    # 10 ms for 150 ms, beside a pad at 5 m/s: 5 cm.
    pad_filter = quiet()
    for t in times(5, 90 / RATE):
        seen_at = add(PAD, (0.05, 0.0, 0.0))
        assert pad_filter.update([sighting(t, seen_at, covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
    for t in times(5, 95 / RATE):
        assert pad_filter.update([sighting(t, PAD, covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
    assert norm(sub(estimate(pad_filter, t).position, PAD)) < 0.05


@pytest.mark.parametrize("brake", [(2.0, 0.0, 0.0), (-0.7, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_pad_that_begins_to_brake_is_followed_although_it_was_steady_for_long(
    brake: Vec3,
) -> None:
    # Its sightings were taken for steps of the telemetry, and its velocity for what it had been.
    noise = random.Random(6)
    pad_filter, refused = quiet(count=300), 0
    for t in times(30, 300 / RATE):
        s = t - 300 / RATE
        error = (noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005))
        seen = add(add(PAD, scale(brake, 0.5 * s * s)), error)
        refused += not pad_filter.update([sighting(t, seen, covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
        found = estimate(pad_filter, t)
        if s > 0.5:
            assert norm(sub(found.velocity, scale(brake, s))) < 0.4
    assert refused <= 1
    assert norm(sub(found.position, seen)) < 0.08


def test_a_pad_that_brakes_gently_before_a_slow_camera_is_followed() -> None:
    # What was made of each sighting hid that the next one had moved on, and was learned as noise.
    noise, every = random.Random(6), 3
    pad_filter = PadFilter(OPTIONS)
    for i, t in enumerate(times(330)):
        s = max(0.0, t - 10.0)
        if i % every:
            continue
        error = (noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005), noise.gauss(0.0, 0.005))
        seen = add(add(PAD, (0.5 * s * s, 0.0, 0.0)), error)
        pad_filter.update([sighting(t, seen, covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
        if s > 0.45:
            found = estimate(pad_filter, t)
            assert norm(sub(found.velocity, (s, 0.0, 0.0))) < 0.25
            assert norm(sub(found.position, seen)) < 0.04


def test_a_step_of_the_position_moves_the_pad_and_forgets_nothing_else() -> None:
    pad_filter = quiet()
    moved = add(PAD, (0.0, 0.3, 0.0))
    refused = 0
    for t in times(20, 90 / RATE):
        taken = pad_filter.update([sighting(t, moved, covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
        refused += not taken
        found = estimate(pad_filter, t)  # known all the time
        assert norm(found.velocity) < 0.2
    assert 1 <= refused <= 4
    assert norm(sub(found.position, moved)) < 0.02


def test_refused_sightings_in_different_places_do_not_replace_the_pad() -> None:
    pad_filter = quiet()
    for i, t in enumerate(times(20, 90 / RATE)):
        elsewhere = add(PAD, (3.0 * (-1) ** i, 2.0 * (i % 3), 0.0))
        assert not pad_filter.update(
            [sighting(t, elsewhere, covariance=CLOSE, arm=(0.0, 0.0, 5.0))]
        )
        assert norm(sub(estimate(pad_filter, t).position, PAD)) < 0.1


def test_a_pad_that_is_elsewhere_for_good_is_another_pad() -> None:
    pad_filter = quiet()
    other = add(PAD, (3.0, 0.0, 0.0))
    for t in times(30, 90 / RATE):
        pad_filter.update([sighting(t, other, covariance=CLOSE, arm=(0.0, 0.0, 5.0))])
    assert norm(sub(estimate(pad_filter, t).position, other)) < 0.05


@pytest.mark.parametrize(("first_s", "then_s"), [(0.1, 0.02), (0.05, 0.01), (0.02, 0.1)])
def test_a_clock_that_gets_known_between_two_pictures_is_as_if_known_from_the_first(
    first_s: float, then_s: float
) -> None:
    # Flown at 10 m/s: the pictures' clock shows the pad ahead.
    ahead = EXACT._replace(by_clock=(10.0, 0.0, 0.0))
    filters = []
    for sigmas in ((first_s, then_s), (then_s, then_s)):
        pad_filter = PadFilter(OPTIONS)
        for t, sigma_s in zip(times(30), (*sigmas, *[then_s] * 28), strict=True):
            pad_filter.on_clock(sigma_s)
            pad_filter.update([sighting(t, PAD, biases=ahead)])
        filters.append(estimate(pad_filter, 29 / RATE))
    settled_late, known = filters
    assert math.dist(settled_late.position, known.position) < 1e-6
    for late, at_once in zip(settled_late.covariance, known.covariance, strict=True):
        assert late == pytest.approx(at_once, rel=1e-6)


def test_an_estimate_without_a_valid_covariance_is_dropped() -> None:
    pad_filter = settled()
    aside, none = add(PAD, (0.1, 0.0, 0.0)), matscale(IDENTITY, -1.0)
    assert not pad_filter.update([sighting(3.0, aside, covariance=none)])
    assert pad_filter.estimate(3.0) is None
    for t in times(20, 3.1):
        pad_filter.update([sighting(t, PAD)])
    assert math.dist(estimate(pad_filter, 3.8).position, PAD) < 0.01
