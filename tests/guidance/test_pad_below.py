from collections.abc import Sequence
from typing import cast

import pytest

from landerd.config.models import Config
from landerd.estimation.estimator import Estimator
from landerd.estimation.pad_filter import PadEstimate
from landerd.geometry import Vec3
from landerd.guidance.footprint import Footprint
from landerd.guidance.pad_below import PadBelow
from landerd.pad import Plate
from tests.guidance.situations import situation

DT = 0.025


class Seen:
    """An estimator that sees a pad drive; the vehicle's own data are stale."""

    last_fix = None

    def __init__(self) -> None:
        self.velocity: Vec3 = (0.0, 0.0, 0.0)
        self.age_s = 0.1

    def pad(self, now: float) -> PadEstimate:
        none = (0.0, 0.0, 0.0)
        return PadEstimate(
            now, none, self.velocity, (none, none, none), 0.6, 0.1, None, 0.0, 0.0, (0.0, 0.0, 1.0)
        )

    def sight_age(self, now: float) -> float:
        return self.age_s

    def fresh_vehicle(self, now: float) -> None:
        return None


class Riding:
    """Feet on a pad of 1 m/s since 10 s."""

    def __init__(self) -> None:
        self.seen, self.t = Seen(), 10.0
        footprint = Footprint(Plate(south_m=1.0, north_m=1.0, west_m=1.0, east_m=1.0), (0.44, 0.26))
        self.below = PadBelow(Config().guidance, 1.0, cast(Estimator, self.seen), footprint)
        self.below.note(situation(height=0.0, pad_velocity=(1.0, 0.0, 0.0)))
        self.below.touch(self.t)

    def ride(self, seconds: float, velocity: Vec3, age_s: float = 0.1) -> Sequence[float]:
        """See the pad drive like this; return how fast north it is taken to drive."""
        self.seen.velocity, self.seen.age_s = velocity, age_s
        taken = []
        for _ in range(round(seconds / DT)):
            self.t += DT
            self.below.ride(self.t, DT)
            taken.append(self.below.velocity[0])
        return taken


def test_a_pad_that_is_seen_to_drive_otherwise_after_the_touch_is_gone_with() -> None:
    riding = Riding()
    taken = riding.ride(1.0, (2.0, 0.0, 0.3))
    assert taken[0] == 1.0
    assert taken[-1] == 2.0
    assert riding.below.velocity[2] == 0.0  # the touch shows in the height first


@pytest.mark.parametrize(
    ("seconds", "velocity", "age_s"),
    [
        pytest.param(0.25, (2.0, 0.0, 0.0), 0.1, id="for a moment: the touch turns the airframe"),
        pytest.param(2.0, (1.2, 0.0, 0.0), 0.1, id="by little"),
        pytest.param(2.0, (2.0, 0.0, 0.0), 0.6, id="long ago"),
    ],
)
def test_a_pad_that_hardly_seems_to_drive_otherwise_is_gone_with_as_before(
    seconds: float, velocity: Vec3, age_s: float
) -> None:
    riding = Riding()
    riding.ride(seconds, velocity, age_s)
    assert set(riding.ride(0.5, (1.0, 0.0, 0.0))) == {1.0}
