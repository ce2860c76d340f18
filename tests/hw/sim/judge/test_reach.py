import pytest

from hw.sim.judge.reach import Reach
from tests.hw.sim.judge.bounds import BOUNDS
from tests.hw.sim.worlds import over_pad

RING_PX = 400.0  # of 1 m, from 1 m


class Held:
    """A vehicle over a driving pad; for a time landerd is kept from following."""

    def __init__(self, *, height_m: float, pad_mps: float) -> None:
        self.world = over_pad(altitude_m=height_m, pad={"speed_mps": pad_mps})
        self.follows = True
        self.reach = Reach(self.world, RING_PX, BOUNDS, lambda t: self.follows)

    def fly(self, seconds: float, *, along: bool) -> None:
        """Let the vehicle go with the pad, or hover."""
        w = self.world
        for _ in range(round(seconds / 0.02)):
            north, east, _ = w.pad.velocity
            w.vehicle.order((north, east, 0.0) if along else (0.0, 0.0, 0.0), 0.0)
            w.advance(w.t + 0.02)

    def wait(self, seconds: float) -> float | None:
        """Hold landerd for a while, then let it; return when the pad was out of reach."""
        self.fly(2.0, along=True)
        self.follows = False
        self.fly(seconds, along=False)
        self.follows = True
        self.fly(0.3, along=True)
        return self.reach.left_t


@pytest.mark.parametrize(
    ("height_m", "pad_mps", "held_s", "is_out"),
    [
        (0.5, 5.0, 4.0, True),  # 15 m away, a hand's breadth over the ground
        (2.0, 10.0, 5.0, True),
        (6.0, 5.0, 3.0, False),  # seen steeply enough until it is caught up with
        (0.5, 5.0, 1.0, False),  # it is not far yet
        (0.5, 0.0, 9.0, False),  # nor ever, of a pad that stands
    ],
)
def test_a_pad_that_drives_on_gets_out_of_reach(
    height_m: float, pad_mps: float, held_s: float, is_out: bool
) -> None:
    left_t = Held(height_m=height_m, pad_mps=pad_mps).wait(held_s)
    assert (left_t is not None) is is_out
    if left_t is not None:  # not before landerd could have flown on
        assert left_t == pytest.approx(2.0 + held_s, abs=0.15)


def test_a_pad_that_the_vehicle_flies_away_from_is_not_out_of_reach() -> None:
    held = Held(height_m=0.5, pad_mps=5.0)
    held.fly(2.0, along=True)
    held.fly(6.0, along=False)  # nothing held it
    assert held.reach.left_t is None


def test_a_pad_that_was_never_near_has_not_left() -> None:
    held = Held(height_m=0.5, pad_mps=5.0)
    held.follows = False
    held.fly(8.0, along=False)
    held.follows = True
    held.fly(1.0, along=True)
    assert held.reach.left_t is None


@pytest.mark.parametrize("on_pad", [True, False])
def test_a_vehicle_that_touched_the_ground_does_not_count_as_left_by_the_pad(
    *, on_pad: bool
) -> None:
    held = Held(height_m=0.5, pad_mps=5.0)
    held.fly(2.0, along=True)
    held.follows = False
    w = held.world
    w.vehicle.feet, w.vehicle.on_pad = (True, True, False, False), on_pad
    held.reach._on_step(w)
    w.vehicle.feet = (False,) * 4
    held.fly(5.0, along=False)
    held.follows = True
    held.fly(0.3, along=True)
    assert (held.reach.left_t is not None) is on_pad
