"""Which of the markers found belong to one pad.

An image may hold look-alikes, a marker twice, or one ring that could be either of two that differ
only in size. Those are taken that agree on one pose of the pad.

What bends a picture (rows that wobble, motion in a curve, interlaced fields) moves each marker's
outline by pixels of which its own fit knows nothing: a small tag's tilt by tens of degrees, a large
ring's hardly. Where a marker that was decoded and a ring beside it contradict each other, the
picture is taken to be bent by as much as explains that.
"""

from dataclasses import dataclass, replace

import numpy as np

from landerd.camera_model import F64, CameraModel
from landerd.messages import MarkerSighting, PoseSolution, Prior
from landerd.pad import PadLayout, Ring, Square, WhyCode, size_m
from landerd.vision.linear import solved
from landerd.vision.marker_errors import MarkerErrors
from landerd.vision.pad_pose import Measurement, pad_poses
from landerd.vision.pose import MIN_DEPTH_M, circle, rotation_from
from landerd.vision.square_pose import corner_information

_MAX_SEEDS = 6  # candidates from which a consensus is grown: bounds the time among look-alikes
_MAX_CHI2_PER_MARKER = 30.0  # that one more may add: its six errors add more once in 25,000 times
# By how much a picture may be bent, 1 sigma of each corner of a marker, px; and what one more
# marker may add then: the least bend is sought under which its six errors are as large as stated.
_BENDS_PX, _MAX_CHI2_BENT = (0.25, 0.5, 1.0, 2.0), 12.0
_ALWAYS_FOUND_PX = 16.0  # rings so wide and wholly in the image are found 99 times of 100
# Two outlines are of one thing if their middles are nearer and their sizes more alike than this.
_SAME_MIDDLE, _SAME_SIZE = 0.2, 1.3  # of the smaller one's size


@dataclass(frozen=True, slots=True)
class Candidate:
    """A marker of the pad, if what was found is that marker."""

    marker: Ring | WhyCode | Square
    sighting: MarkerSighting
    measurement: Measurement


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
        candidates: all that were found; the same marker or outline may be there twice.
        layout: the pad.
        camera: the lens.
        errors: how the markers may differ from the pad file.
        prior: gravity, and the pad's north where the markers leave it open.
        expected: landing point where it should be, (3,); of several pads the nearest is taken.
    """
    if _no_two_alike(candidates):
        poses = _poses(candidates, errors, prior)
        if len(candidates) < 2 or _agree(poses, len(candidates)):
            return candidates, poses
    best: tuple[list[Candidate], list[PoseSolution]] = ([], [])
    best_score: tuple[float, bool, float] | None = None
    for seed in sorted(candidates, key=_uncertainty)[:_MAX_SEEDS]:
        group, poses = _consensus(seed, candidates, errors, prior)
        if not poses:
            continue
        off = 0.0 if expected is None else float(np.linalg.norm(expected - poses[0].position))
        decoded = any(c.sighting.id is not None for c in group)
        missing = 0 if decoded else _count_missing(group, poses[0], layout, camera)
        score = (float(len(group) - missing), decoded, -off)
        if best_score is None or score > best_score:
            best, best_score = (group, poses), score
    if len(best[0]) == 1 < len(candidates) and best[0][0].sighting.id is not None:
        return _bent_consensus(best[0][0], candidates, camera, errors, prior) or best
    return best


def _bent_consensus(
    seed: Candidate,
    candidates: list[Candidate],
    camera: CameraModel,
    errors: MarkerErrors,
    prior: Prior,
) -> tuple[list[Candidate], list[PoseSolution]] | None:
    """Return what agrees with a seed in a picture that is bent, as little as may be."""
    for px in _BENDS_PX:
        bend = px / camera.focal
        start, *others = (_bent(c, bend) for c in (seed, *candidates))
        group, poses = _consensus(start, others, errors, prior, _MAX_CHI2_BENT)
        if len(group) > 1:
            return group, poses
    return None


def _bent(candidate: Candidate, bend: float) -> Candidate:
    """Return a candidate whose corners may each be off by a bend besides, on z = 1, 1 sigma."""
    size = size_m(candidate.marker)
    poses = []
    for pose in candidate.measurement.poses:
        # The inverse of the sum of both covariances, where a ring's heading has none.
        known = pose.information
        both = known + corner_information(pose, size, bend)
        poses.append(replace(pose, information=known - known @ solved(both, known)))
    return replace(candidate, measurement=replace(candidate.measurement, poses=tuple(poses)))


def _consensus(
    seed: Candidate,
    candidates: list[Candidate],
    errors: MarkerErrors,
    prior: Prior,
    most: float = _MAX_CHI2_PER_MARKER,
) -> tuple[list[Candidate], list[PoseSolution]]:
    """Add to a seed what agrees with it: adds less than `most` to chi-square a marker."""
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


def _no_two_alike(candidates: list[Candidate]) -> bool:
    """Tell whether no marker and no outline is there twice."""
    for i, a in enumerate(candidates):
        for b in candidates[:i]:
            if a.marker == b.marker or _same_outline(a.sighting, b.sighting):
                return False
    return True


def _same_outline(a: MarkerSighting, b: MarkerSighting) -> bool:
    p, q = np.array(a.outline_px), np.array(b.outline_px)
    sizes = np.ptp(p, axis=0).max(), np.ptp(q, axis=0).max()
    apart = np.linalg.norm((p.min(axis=0) + p.max(axis=0) - q.min(axis=0) - q.max(axis=0)) / 2.0)
    return bool(apart < _SAME_MIDDLE * min(sizes) and max(sizes) < _SAME_SIZE * min(sizes))


def _uncertainty(candidate: Candidate) -> float:
    """Return a key that puts what is decoded first, then the larger in the image."""
    undecoded = 0.0 if candidate.sighting.id is not None else 1e9
    return undecoded - float(np.ptp(np.array(candidate.sighting.outline_px), axis=0).max())


def _count_missing(
    group: list[Candidate], pad: PoseSolution, layout: PadLayout, camera: CameraModel
) -> int:
    """Count the rings that should be seen with a pad at this pose, but are not in the group."""
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
        if points[:, 2].min() < MIN_DEPTH_M:
            continue
        px = camera.pixels(points)
        inside = px.min() > 0 and bool((px < (camera.width - 1, camera.height - 1)).all())
        missing += inside and float(np.ptp(px, axis=0).min()) > _ALWAYS_FOUND_PX
    return missing
