"""The landing point from whichever markers are seen."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from landerd.camera_model import F64
from landerd.config.models import VisionSection
from landerd.geometry import Vec3
from landerd.messages import Frame, PoseSolution, Sightings
from landerd.pad import PadLayout, Plate, Ring, Square, load_pad
from landerd.vision import Vision
from landerd.vision.marker_errors import MarkerErrors
from landerd.vision.pad_pose import Measurement, pad_poses, ring_measurement
from landerd.vision.pose import Pose, rotation_from, vec3
from tests.vision.scenes import THESIS_CAMERA, THESIS_PAD, Optics, View, look, render

CAMERA = THESIS_CAMERA.scaled(320, 240)
PADS = Path(__file__).parents[2] / "config" / "pads"
TILTED = look(CAMERA, 4.0, 0.5, pixel=(150.0, 120.0), heading=0.8)


# Two markers whose places count for exact, so that poses alone decide.
EXACT = MarkerErrors(
    PadLayout(
        name="exact",
        markers=(Ring(kind="whycon", outer_diameter_m=1.0),) * 2,
        plate=Plate(north_m=1.0, south_m=1.0, east_m=1.0, west_m=1.0),
        print_scale_sigma=0.0,
        placement_sigma_m=0.0,
        flatness_deg=0.0,
    ),
    focal_sigma=0.0,
)


def ring(
    view: View, place: tuple[float, float], sigma_m: float = 0.01, marker: int = 0
) -> Measurement:
    centre = np.array(view.position) + view.R_camera_pad[:, :2] @ np.array(place)
    variance = sigma_m**2
    true = PoseSolution(
        position=vec3(centre),
        normal=vec3(view.normal),
        north=None,
        covariance=((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, variance)),
        sigma_yaw=None,
        sigma_tilt=0.01,
        cost=0.0,
    )
    return ring_measurement(marker, place, (true,))


def tag(view: View, place: tuple[float, float], sigma_m: float, normal: F64 | None = None) -> Pose:
    R = view.R_camera_pad if normal is None else rotation_from(normal, view.R_camera_pad[:, 0])
    centre = np.array(view.position) + view.R_camera_pad[:, :2] @ np.array(place)
    return Pose(R, centre, np.diag([sigma_m**-2.0] * 3 + [1e4] * 3), 0.0)


def test_ring_at_the_landing_point_needs_no_north() -> None:
    (pad,) = pad_poses([ring(TILTED, (0.0, 0.0))], EXACT, None, None)
    assert math.dist(pad.position, TILTED.position) < 1e-9
    assert pad.north is None


def test_ring_beside_the_landing_point_needs_the_estimates_north() -> None:
    beside = [ring(TILTED, (0.5, 0.2))]
    unknown = pad_poses(beside, EXACT, None, None)
    assert all(s.covariance[0][0] + s.covariance[1][1] > 1.0 for s in unknown)
    (pad,) = pad_poses(beside, EXACT, vec3(TILTED.R_camera_pad[:, 0]), None)
    assert math.dist(pad.position, TILTED.position) < 1e-3
    assert pad.north is None  # the estimate's own north is not a measurement of it


def test_two_rings_tell_north() -> None:
    (pad,) = pad_poses(
        [ring(TILTED, (0.5, 0.2)), ring(TILTED, (-0.4, 0.1), marker=1)], EXACT, None, None
    )
    assert math.dist(pad.position, TILTED.position) < 1e-6
    assert pad.north is not None
    assert math.dist(pad.north, TILTED.R_camera_pad[:, 0]) < 1e-6


def test_a_second_marker_settles_the_planar_ambiguity() -> None:
    # The tag alone prefers the mirrored normal; a ring 0.75 m away says where the plane is.
    sight = np.array(TILTED.position) / np.linalg.norm(TILTED.position)
    mirrored = 2.0 * sight * float(sight @ TILTED.normal) - TILTED.normal
    wrong = tag(TILTED, (0.75, 0.0), 0.01, mirrored)
    right = tag(TILTED, (0.75, 0.0), 0.01)
    right = Pose(right.R, right.t, right.information, 2.0)
    square = Measurement(1, np.array([0.75, 0.0, 0.0]), 0.0, (wrong, right))
    assert math.dist(pad_poses([square], EXACT, None, None)[0].normal, TILTED.normal) > 0.5
    pad = pad_poses([square, ring(TILTED, (0.0, 0.0))], EXACT, None, None)[0]
    assert math.dist(pad.normal, TILTED.normal) < 1e-3


def test_a_tag_whose_mirrored_pose_explains_it_better_does_not_displace_the_ring() -> None:
    """Once, no step of the fit led back from the mirrored pose's north: 15 % of the range off."""
    at = look(THESIS_CAMERA, 8.0, 1.0, pixel=(300.0, 200.0), heading=5.27)
    noisy = Optics(noise=8.0, background="grass")
    image = render(at, THESIS_CAMERA, noisy, np.random.default_rng(3), THESIS_PAD)
    seen = Vision(THESIS_PAD, THESIS_CAMERA, VisionSection()).process(Frame(0.0, 0, image))
    assert {m.kind for m in seen.markers} == {"whycon", "apriltag"}
    assert math.dist(seen.pad[0].position, at.position) < 0.02 * 8.0


def test_gravity_puts_the_level_solution_first() -> None:
    sight = np.array(TILTED.position) / np.linalg.norm(TILTED.position)
    mirrored = 2.0 * sight * float(sight @ TILTED.normal) - TILTED.normal
    alike = (tag(TILTED, (0.0, 0.0), 0.01, mirrored), tag(TILTED, (0.0, 0.0), 0.01))
    square = Measurement(1, np.zeros(3), 0.0, alike)
    for level in (TILTED.normal, mirrored):
        first, second = pad_poses([square], EXACT, None, vec3(level))
        assert math.dist(first.normal, level) < 1e-6
        assert second.cost > first.cost


def test_the_mirrored_pose_of_a_tag_on_a_bent_pad_is_not_taken_low_above_it() -> None:
    # Its bend is known: where it would lie unbent the sharp pose is so far off that the other,
    # which the image all but excludes, was nearer.
    layout = load_pad(PADS / "thesis.yaml")
    errors = MarkerErrors(layout, focal_sigma=0.0)
    bend = np.array([0.0, -math.radians(4.3), 0.0])
    mean, _ = errors.of([1])
    errors.learn(0.0, [1], np.concatenate([mean[:3], bend, mean[6:]]), 0.01 * errors.first([1]))
    (square,) = layout.squares
    place = np.array([*square.position_m, 0.0])
    low = look(CAMERA, 1.2, 0.2, pixel=(150.0, 120.0))
    R = low.R_camera_pad @ cv2.Rodrigues(bend)[0]
    t = np.array(low.position) + low.R_camera_pad @ place
    sharp = Pose(R, t, np.diag([2e6, 2e6, 2e6, 7e7, 7e7, 7e7]), 0.0)
    sight = t / np.linalg.norm(t)
    mirrored = rotation_from(2.0 * sight * float(sight @ R[:, 2]) - R[:, 2], R[:, 0])
    hazy = Pose(mirrored, 1.04 * t, np.diag([7e5, 7e5, 7e3, 7e3, 7e3, 7e3]), 4600.0)
    seen = Measurement(1, place, math.radians(square.heading_deg), (sharp, hazy))
    pad, *_ = pad_poses([seen], errors, None, None)
    assert math.dist(pad.position, low.position) < 0.01
    assert math.dist(pad.normal, low.normal) < 0.01


def test_the_more_certain_marker_counts_more() -> None:
    off = View((TILTED.position[0] + 0.1, *TILTED.position[1:]), TILTED.R_camera_pad)
    both = [ring(off, (0.0, 0.0), 0.1, 1), ring(TILTED, (0.0, 0.0), 0.01)]
    (pad,) = pad_poses(both, EXACT, None, None)
    assert math.dist(pad.position, TILTED.position) == pytest.approx(0.001, rel=0.1)


def seen(layout: PadLayout, view: View, hide: set[int]) -> Sightings:
    """Return what a pad with some of its squares painted over shows in its second frame."""
    left = tuple(m for m in layout.markers if not (isinstance(m, Square) and m.id in hide))
    painted = layout.model_copy(update={"markers": left})
    image = render(view, CAMERA, Optics(), np.random.default_rng(5), painted)
    vision = Vision(layout, CAMERA, VisionSection())
    vision.process(Frame(0.0, 0, image))
    vision.process(Frame(0.03, 1, image))  # shows what an edge has left of a ring, too
    return vision.process(Frame(0.06, 2, image))


def sigmas_apart(a: PoseSolution, b: PoseSolution) -> float:
    d = np.array(a.position) - np.array(b.position)
    return math.sqrt(d @ np.linalg.solve(np.array(a.covariance) + np.array(b.covariance), d))


def test_the_landing_point_of_a_bundle_does_not_jump_with_the_set_of_tags() -> None:
    layout = load_pad(PADS / "bundle.yaml")
    view = look(CAMERA, 1.8, 0.4, pixel=(150.0, 120.0), heading=0.5)
    whole = seen(layout, view, set())
    assert {m.id for m in whole.markers} == {10, 11, 12, 13, 14}
    assert math.dist(whole.pad[0].position, view.position) < 0.005
    for hidden in ({10}, {11, 12, 13}, {11, 12, 13, 14}):
        part = seen(layout, view, hidden)
        assert len(part.markers) == 5 - len(hidden)
        assert sigmas_apart(whole.pad[0], part.pad[0]) < 4.0


def test_the_landing_point_of_a_nested_pad_does_not_jump_when_the_ring_leaves_the_image() -> None:
    layout = load_pad(PADS / "nested.yaml")
    far = look(CAMERA, 1.9, 0.2, pixel=(160.0, 120.0))
    both = seen(layout, far, set())
    assert {m.kind for m in both.markers} == {"whycon", "apriltag"}
    tag_only = look(CAMERA, 0.7, 0.2, pixel=(160.0, 120.0))
    near = seen(layout, tag_only, set())
    assert {m.kind for m in near.markers} == {"apriltag"}
    for sightings, view in ((both, far), (near, tag_only)):
        error = np.array(sightings.pad[0].position) - view.position
        covariance = np.array(sightings.pad[0].covariance)
        assert math.sqrt(error @ np.linalg.solve(covariance, error)) < 4.0
        north: Vec3 | None = sightings.pad[0].north
        assert north is not None
        assert math.dist(north, view.R_camera_pad[:, 0]) < 0.02
