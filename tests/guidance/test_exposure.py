"""Exposure by what is seen: a camera's pictures in, orders out, and what comes of them."""

import itertools
import math
from collections.abc import Callable

import pytest

from landerd.config.models import MeteringSection
from landerd.guidance.exposure import ExposureControl
from landerd.messages import CLIPPED_LEVEL, ExposureOrder, Light, Sightings

PERIOD_S, LATENCY_S, FRAMES_LATE = 1 / 30, 0.1, 2
SEEN_LEVELS = 60.0, 250.0  # of white: a pad is found between them
OPTIONS = MeteringSection(shortest_s=1e-4, short_s=0.004, longest_s=0.015, gain_max=8.0)


class Camera:
    """A camera that applies orders two pictures late and reports levels 0.1 s after exposure."""

    def __init__(
        self, tone: Callable[[float], float] = lambda light: light, period_s: float = PERIOD_S
    ) -> None:
        self.tone = tone
        self.period_s = period_s
        self.control = ExposureControl(OPTIONS)
        self.orders: list[tuple[float, ExposureOrder]] = []
        self.levels: list[float] = []
        self.whites: list[float] = []
        self.frame = 0
        self.automatic_s = 0.008  # exposure before the first order

    def amount(self, t: float) -> float:
        """Return exposure time times gain of the picture at time t."""
        taken = [o for at, o in self.orders if at + FRAMES_LATE * self.period_s <= t]
        return taken[-1].time_s * taken[-1].gain if taken else self.automatic_s

    def level(self, t: float, light: float) -> float:
        """Return the grey level of a brightness; brightness 1 is full scale at 8 ms."""
        share = light * self.amount(t) / 0.008
        return 255.0 * min(1.0, self.tone(min(1.0, share)))

    def run(
        self, seconds: float, light: float, *, on_pad: bool, bright: float | None = None
    ) -> float:
        """Take pictures so long, of something bright too; return the last one's level."""
        level = 0.0
        for _ in range(round(seconds / self.period_s)):
            t = self.frame * self.period_s
            level = self.level(t, light)
            self.levels.append(level)
            white = 0.0 if bright is None else self.level(t, bright)
            self.whites.append(white)
            clipped = 0.005 if white >= CLIPPED_LEVEL else 0.0
            if level >= CLIPPED_LEVEL and not on_pad:
                clipped = 0.95
            seen = Sightings(t, self.frame, (), (), Light(level, on_pad, clipped))
            order = self.control.on_sightings(t + LATENCY_S, seen)
            if order is not None:
                self.orders.append((t + LATENCY_S, order))
            self.frame += 1
        return level

    def look(self, seconds: float, ground: float, white: float) -> list[bool]:
        """Take pictures so long of a pad on the ground; return in which ones it was found."""
        found = []
        for _ in range(round(seconds / self.period_s)):
            is_found = (
                SEEN_LEVELS[0] < self.level(self.frame * self.period_s, white) < SEEN_LEVELS[1]
            )
            if is_found:
                self.run(self.period_s, white, on_pad=True)
            else:
                self.run(self.period_s, ground, on_pad=False, bright=white)
            found.append(is_found)
        return found

    @property
    def last(self) -> ExposureOrder:
        return self.orders[-1][1]


def gamma(light: float) -> float:
    return float(light ** (1 / 2.2))


def s_curve(light: float) -> float:
    return light * light * (3.0 - 2.0 * light)


@pytest.mark.parametrize("tone", [lambda light: light, gamma, s_curve])
def test_white_far_over_full_scale_is_below_it_within_a_second(
    tone: Callable[[float], float],
) -> None:
    camera = Camera(tone)
    camera.run(1.0, 0.8, on_pad=True)
    assert camera.run(1.0, 2.5, on_pad=True) < 250.0


@pytest.mark.parametrize("tone", [lambda light: light, gamma, s_curve])
@pytest.mark.parametrize(
    ("light", "least"), [(0.1, 33.0), (0.5, 35.0), (1.6, 160.0), (2.5, 160.0), (5.0, 160.0)]
)
def test_the_pads_white_settles_near_four_fifths_or_where_gain_begins_and_orders_end(
    light: float, least: float, tone: Callable[[float], float]
) -> None:
    camera = Camera(tone)
    assert least < camera.run(3.0, light, on_pad=True) < 245.0
    count = len(camera.orders)
    camera.run(1.0, light, on_pad=True)
    assert len(camera.orders) == count


def test_exposure_is_short_and_gain_comes_before_a_longer_one() -> None:
    camera = Camera()
    camera.run(2.0, 0.1, on_pad=True)
    assert camera.last.time_s == pytest.approx(0.004)
    assert camera.last.gain == pytest.approx(0.16 / 0.05, rel=0.2)
    camera.run(2.0, 0.02, on_pad=True)
    assert camera.last.gain == pytest.approx(8.0)
    assert 0.004 < camera.last.time_s <= 0.015
    camera.run(2.0, 5.0, on_pad=True)
    assert camera.last.gain == 1.0
    assert camera.last.time_s < 0.004


def test_no_order_is_beyond_the_limits_of_exposure_and_gain() -> None:
    camera = Camera()
    camera.run(3.0, 1e-5, on_pad=False)
    assert camera.last.time_s == pytest.approx(0.015)
    assert camera.last.gain == 8.0
    camera.run(5.0, 1e5, on_pad=False)
    assert camera.last.time_s == pytest.approx(1e-4)
    assert camera.last.gain == 1.0


def test_before_the_pad_is_seen_the_ground_is_dark_enough_to_leave_room_for_white() -> None:
    camera = Camera()
    ground = camera.run(2.0, 2.0, on_pad=False)
    assert ground < 75.0


def test_a_pad_that_is_white_on_dark_ground_is_shown_unclipped_within_a_second_and_again() -> None:
    camera = Camera()
    white = 8.0
    camera.run(1.5, white / 15.0, on_pad=False, bright=white)  # dark water
    shown = camera.whites[-round(1.1 / PERIOD_S) :]
    assert any(90.0 < level < 248.0 for level in shown)
    # Nor is what lies on the ground lost for good: its own exposure takes turns with the others.
    assert any(45.0 < level < 95.0 for level in camera.levels[-round(1.1 / PERIOD_S) :])
    camera.run(2.0, white, on_pad=True)
    assert 160.0 < camera.levels[-1] < 245.0


def test_ground_without_anything_glaring_keeps_its_exposure() -> None:
    camera = Camera()
    camera.run(2.0, 0.3, on_pad=False, bright=0.6)
    count = len(camera.orders)
    camera.run(2.0, 0.3, on_pad=False, bright=0.6)
    assert len(camera.orders) == count


@pytest.mark.parametrize("period_s", [1 / 30, 1 / 15, 1 / 10])
@pytest.mark.parametrize("tone", [lambda light: light, gamma, s_curve])
def test_a_white_pad_on_dark_ground_that_is_found_is_not_lost_again(
    tone: Callable[[float], float], period_s: float
) -> None:
    """Orders under way when it is found, and slow cameras, must not overexpose it again."""
    camera = Camera(tone, period_s)
    found = camera.look(6.0, 0.3, 6.0)
    first = found.index(True)
    assert first * period_s < 3.0
    late = found[first + round(1.0 / period_s) :]
    assert sum(late) > 0.95 * len(late)


def test_a_pad_out_of_sight_for_a_moment_does_not_change_the_exposure() -> None:
    camera = Camera()
    camera.run(2.0, 0.8, on_pad=True)
    count = len(camera.orders)
    camera.run(1.5, 0.05, on_pad=False)
    assert len(camera.orders) == count
    camera.run(1.5, 0.05, on_pad=False)
    assert len(camera.orders) > count


def test_a_pad_overexposed_by_the_first_order_is_seen_again_within_a_second() -> None:
    # Bright sun, which the camera's own automatic had shown: 4 ms are eight times over full scale.
    camera = Camera()
    camera.automatic_s = 4e-4
    found = camera.look(2.0, ground=4.0, white=16.0)
    assert not all(found[:10])
    assert all(found[30:])


def test_an_order_is_not_repeated_before_its_pictures_come() -> None:
    camera = Camera()
    camera.run(2.0, 0.02, on_pad=True)
    times = [t for t, _ in camera.orders]
    assert min(b - a for a, b in itertools.pairwise(times)) > LATENCY_S
    amounts = [o.time_s * o.gain for _, o in camera.orders]
    assert all(math.isfinite(a) for a in amounts)


def test_pictures_without_a_measured_brightness_order_no_exposure() -> None:
    assert ExposureControl(OPTIONS).on_sightings(1.0, Sightings(0.9, 1, (), ())) is None
