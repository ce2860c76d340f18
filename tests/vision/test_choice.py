"""Which of what was found belongs to one pad."""

import math

import numpy as np

from landerd.messages import MarkerSighting, PoseSolution, Prior
from landerd.pad import PadLayout, Plate, Ring
from landerd.vision.choice import Candidate, choose
from landerd.vision.marker_errors import MarkerErrors
from landerd.vision.pad_pose import ring_measurement
from tests.vision.scenes import IDEAL_CAMERA

LARGE = Ring(kind="whycon", outer_diameter_m=1.0)
SMALL = Ring(kind="whycon", outer_diameter_m=0.2, inner_ratio=0.5)
PLATE = Plate(north_m=0.62, south_m=0.62, east_m=0.62, west_m=0.62)
NESTED = PadLayout(name="nested", markers=(LARGE, SMALL), plate=PLATE)
N = 1.0 / math.sqrt(3.0)


def candidate(ring: Ring, distance: float) -> Candidate:
    """Return an outline 60 px wide read as one of the rings, seen along (1, 1, 1)."""
    variance = 1e-4
    seen = PoseSolution(
        position=(0.0, 0.0, distance),
        normal=(N, N, N),
        north=None,
        covariance=((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, variance)),
        sigma_yaw=None,
        sigma_tilt=0.01,
        cost=0.0,
    )
    outline = ((290.0, 220.0), (350.0, 220.0), (350.0, 260.0), (290.0, 260.0))
    sighting = MarkerSighting("whycon", None, (seen,), outline)
    return Candidate(
        ring, sighting, ring_measurement(0 if ring == LARGE else 1, ring.position_m, (seen,))
    )


def test_a_ring_is_not_taken_for_one_beside_which_another_would_be_seen_whatever_its_tilt() -> None:
    # Far off and the large one, or near and the small one? Far off both would be wholly in the
    # image, near the large one is not.
    far, near = candidate(LARGE, 3.0), candidate(SMALL, 0.6)
    chosen, poses = choose(
        [far, near], NESTED, IDEAL_CAMERA, MarkerErrors(NESTED, 0.0), Prior(), None
    )
    assert chosen == [near]
    assert np.allclose(poses[0].position, (0.0, 0.0, 0.6))
