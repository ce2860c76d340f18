"""Which of the candidates found in a frame belong to one pad.

An image may hold look-alikes, a marker twice, or one ring that could be either of two that differ
only in size. From each of a few seeds a consensus is grown: candidates are added as long as one
pose of the pad (`pad_pose`) explains all of them within what their covariances allow. The best
consensus is the pad.

A distorted picture (rows that wobble, motion in a curve, interlaced fields) moves the outline of a
marker by pixels that its own fit knows nothing about. That turns a small tag by tens of degrees, a
large ring hardly. If a decoded marker and a ring beside it contradict each other, the picture is
therefore taken to be bent, by as little as explains the contradiction.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting, PoseSolution, Prior
from landerd.pad import PadLayout, Ring, Square, WhyCode, size_m
from landerd.vision.linear import solved
from landerd.vision.marker_errors import MarkerErrors
from landerd.vision.pad_pose import Measurement, pad_poses, tilt_information
from landerd.vision.pose import MIN_DEPTH_M, box, circle, rotation_from
from landerd.vision.square_pose import corner_information

# Candidates from which a consensus is grown: bounds the time among look-alikes.
_MAX_SEEDS = 6
# Largest increase of chi-square by one more marker: its six errors exceed it once in 25,000 times.
_MAX_CHI2_PER_MARKER = 30.0
# Bends of a picture that are tried in turn: 1 sigma of each corner of a marker, px. And the largest
# increase of chi-square by one more marker then: it is smaller, so that the least bend is found
# under which the marker's six errors are as large as stated.
_BENDS_PX, _MAX_CHI2_BENT = (0.25, 0.5, 1.0, 2.0), 12.0
# What a plate seen about a ring counts for, in markers: more than one that should be in view and is
# not, as it may be covered, and less than two.
_TOLD_COUNTS = 1.5
# Rings at least this wide, px, and wholly in the image are found 99 times of 100.
_ALWAYS_FOUND_PX = 16.0
# Two outlines are of the same thing if their centres are nearer than the first, a share of the
# smaller one's size, and their sizes differ by less than the second, a factor.
_SAME_MIDDLE, _SAME_SIZE = 0.2, 1.3


@dataclass(frozen=True, slots=True)
class Candidate:
    """Something found in the image that may be a marker of the pad."""

    marker: Ring | WhyCode | Square
    sighting: MarkerSighting
    measurement: Measurement
    may_be_another: bool = False  # a ring that no code or plate in view tells from another pad's


def choose(
    candidates: list[Candidate],
    layout: PadLayout,
    camera: CameraModel,
    errors: MarkerErrors,
    prior: Prior,
    expected: F64 | None,
) -> tuple[list[Candidate], list[PoseSolution]]:
    """Return the candidates that agree on one pad, and the pad's poses, best first.

    Args:
        candidates: all that were found; the same marker or outline may occur twice.
        layout: the pad.
        camera: the lens.
        errors: how the markers may differ from the pad file.
        prior: gravity, and the pad's north where the markers leave it open.
        expected: the landing point where it should be, (3,), camera frame, m; None: unknown. Of
            several pads that are seen equally well the nearest to it is taken.
    """
    if _no_two_alike(candidates):
        poses = _poses(candidates, errors, prior)
        if len(candidates) < 2 or _agree(poses, len(candidates)):
            return candidates, poses
    best: tuple[list[Candidate], list[PoseSolution]] = ([], [])
    best_score: tuple[float, bool, int, float, float] | None = None
    for seed in sorted(candidates, key=_uncertainty)[:_MAX_SEEDS]:
        group, poses = _consensus(seed, candidates, errors, prior)
        if not poses:
            continue
        off = 0.0 if expected is None else float(np.linalg.norm(expected - poses[0].position))
        decoded = any(c.sighting.id is not None for c in group)
        missing = 0 if decoded else _count_missing(group, poses[0], layout, camera)
        is_told = not all(c.may_be_another for c in group)
        counts = len(group) - missing + _TOLD_COUNTS * is_told
        score = (counts, decoded, len(group), -off, -poses[0].cost)
        if best_score is None or score > best_score:
            best, best_score = (group, poses), score
    if len(best[0]) != 1 or len(candidates) == 1:
        return best
    alone = best[0][0]
    if alone.sighting.id is not None:
        return _bent_consensus(alone, candidates, camera, errors, prior) or best
    is_unknown = expected is None and alone.may_be_another
    if is_unknown and _is_ambiguous(alone, candidates, layout, camera):
        return [alone], []
    return best


def _is_ambiguous(
    alone: Candidate, candidates: list[Candidate], layout: PadLayout, camera: CameraModel
) -> bool:
    """Tell whether the outline of a ring may as well be that of another ring of the pad.

    It may not where that one would surely be seen with the others.
    """
    return any(
        c.marker != alone.marker
        and same_outline(c.sighting, alone.sighting)
        and not _would_show_others(c, layout, camera)
        for c in candidates
    )


def _would_show_others(c: Candidate, layout: PadLayout, camera: CameraModel) -> bool:
    """Tell whether a ring is so far off that another of the pad is in view whatever the heading."""
    pose = c.sighting.solutions[0]
    R = rotation_from(np.array(pose.normal))
    for ring in layout.rings:
        reach = math.dist(ring.position_m, c.marker.position_m) + ring.radius_m
        points = np.array(pose.position) + circle(reach) @ R[:, :2].T
        if ring != c.marker and _is_surely_found(camera, points, ring.radius_m / reach):
            return True
    return False


def _bent_consensus(
    seed: Candidate,
    candidates: list[Candidate],
    camera: CameraModel,
    errors: MarkerErrors,
    prior: Prior,
) -> tuple[list[Candidate], list[PoseSolution]] | None:
    """Return the consensus with a seed in the least bent picture that has one; None: none has."""
    for px in _BENDS_PX:
        bend = px / camera.focal
        start, *others = (_bent(c, bend) for c in (seed, *candidates))
        group, poses = _consensus(start, others, errors, prior, _MAX_CHI2_BENT)
        if len(group) > 1:
            return group, poses
    return None


def _bent(candidate: Candidate, bend: float) -> Candidate:
    """Return a candidate with larger covariances, as a bent picture has.

    `bend` is the additional error of each of its corners, 1 sigma, on the plane z = 1.
    """
    size = size_m(candidate.marker)
    poses = []
    for pose in candidate.measurement.poses:
        # The inverse of the sum of both covariances, written so that it holds for a ring, too,
        # whose information of the heading is zero.
        known = pose.information
        both = known + corner_information(pose, size, bend)
        left = known - known @ solved(both, known)
        # What is left of the tilt's information is left of what tells the solutions apart.
        share = tilt_information(left, pose.normal) / tilt_information(known, pose.normal)
        poses.append(replace(pose, information=left, cost=share * pose.cost))
    return replace(candidate, measurement=replace(candidate.measurement, poses=tuple(poses)))


def _consensus(
    seed: Candidate,
    candidates: list[Candidate],
    errors: MarkerErrors,
    prior: Prior,
    most: float = _MAX_CHI2_PER_MARKER,
) -> tuple[list[Candidate], list[PoseSolution]]:
    """Return a seed with the candidates that agree with it, and the poses of the pad they make up.

    One agrees if chi-square stays below `most` for each marker but the first.
    """
    group, poses = [seed], _poses([seed], errors, prior)
    for other in sorted(candidates, key=_uncertainty):
        if not _no_two_alike([*group, other]):
            continue
        joint = _poses([*group, other], errors, prior)
        if _agree(joint, len(group) + 1, most):
            group, poses = [*group, other], joint
    return group, poses


def _poses(candidates: list[Candidate], errors: MarkerErrors, prior: Prior) -> list[PoseSolution]:
    north = prior.pad.north if prior.pad else None
    return pad_poses([c.measurement for c in candidates], errors, north, prior.down)


def _agree(poses: list[PoseSolution], markers: int, most: float = _MAX_CHI2_PER_MARKER) -> bool:
    return bool(poses) and poses[0].cost < most * (markers - 1)


def distinct(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates without those that repeat a marker or an outline of one before.

    Of two rings of one size each may have been found in the place of the other.
    """
    kept: list[Candidate] = []
    for one in candidates:
        if not any(_are_alike(one, other) for other in kept):
            kept.append(one)
    return kept


def _no_two_alike(candidates: list[Candidate]) -> bool:
    """Tell whether no marker and no outline occurs twice."""
    return len(distinct(candidates)) == len(candidates)


def _are_alike(a: Candidate, b: Candidate) -> bool:
    return a.marker == b.marker or same_outline(a.sighting, b.sighting)


def same_outline(a: MarkerSighting, b: MarkerSighting) -> bool:
    """Tell whether two sightings in one image are of the same thing."""
    (x, y, width, height), (u, v, breadth, length) = box(a.outline_px), box(b.outline_px)
    small, large = sorted((max(width, height), max(breadth, length)))
    return math.hypot(x - u, y - v) < _SAME_MIDDLE * small and large < _SAME_SIZE * small


def _uncertainty(candidate: Candidate) -> float:
    """Return a sort key: decoded candidates come first, then those larger in the image."""
    undecoded = 0.0 if candidate.sighting.id is not None else 1e9
    _, _, width, height = box(candidate.sighting.outline_px)
    return undecoded - max(width, height)


def _count_missing(
    group: list[Candidate], pad: PoseSolution, layout: PadLayout, camera: CameraModel
) -> int:
    """Count the rings that a pad at this pose would surely show but that the group lacks."""
    missing = 0
    normal = np.array(pad.normal)
    for ring in layout.rings:
        if any(c.marker == ring for c in group):
            continue
        if pad.north is None and ring.position_m != (0.0, 0.0):
            continue
        R = rotation_from(normal, None if pad.north is None else np.array(pad.north))
        points = np.array(pad.position) + (circle(ring.radius_m) + np.array(ring.position_m)) @ (
            R[:, :2].T
        )
        missing += _is_surely_found(camera, points)
    return missing


def _is_surely_found(camera: CameraModel, points: F64, share: float = 1.0) -> bool:
    """Tell whether a ring would be found, that is as large as a share of the circle (n, 3), m."""
    if points[:, 2].min() < MIN_DEPTH_M:
        return False
    px = camera.pixels(points)
    inside = px.min() > 0 and bool((px < (camera.width - 1, camera.height - 1)).all())
    return inside and share * float(np.ptp(px, axis=0).min()) > _ALWAYS_FOUND_PX
