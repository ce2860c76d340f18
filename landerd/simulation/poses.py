"""Errors of markers' poses in pictures along the thesis's approach (3.3, 3.4).

Nothing flies: every picture is taken by a camera that stands still, and is searched as the first of
a flight, with gravity as the autopilot's attitude would give it.
"""

import math
from typing import Any

import numpy as np

from hw.sim.physics.world import stream
from hw.sim.picture.lens import true_camera
from hw.sim.picture.pad_print import printed
from hw.sim.picture.renderer import Renderer
from hw.sim.snapshot import CameraPose, PadPose
from landerd.camera_model import load_camera
from landerd.config.files import Loaded
from landerd.devices import sim_options
from landerd.geometry import (
    R_GIMBAL_CAMERA,
    Mat3,
    Vec3,
    add,
    dot,
    heading_of,
    matmul,
    norm,
    rot_z,
    rot_zyx,
    rotate,
    sub,
    transpose,
    unit,
    wrap,
)
from landerd.messages import Frame, MarkerSighting, PoseSolution, Prior
from landerd.pad import Marker, PadLayout, load_pad
from landerd.vision import Vision

# The thesis's approach: level flight at the first height, from the distance at which the pad comes
# into view, and then down to the last height.
HEIGHT_M = 10.0
FROM_M = 16.0
DOWN_TO_M = 0.5
PICTURES = 40  # number of pictures, half of them in level flight
# Standard deviations: of the camera's place from that path, of its aim, and of the direction of
# gravity by attitude and gimbal angles.
ASIDE_M = 0.3
AIM_DEG = 3.0
GRAVITY_DEG = 0.5
# A pad's normal with a larger error is that of the other solution of the planar ambiguity.
FLIPPED = math.cos(math.radians(20.0))


def see_poses(loaded: Loaded, scenario: str, seed: int) -> dict[str, Any]:
    """Take and search the pictures of one approach.

    Args:
        loaded: configuration of landerd and of the simulated world.
        scenario: its name, which is returned.
        seed: of all that is random.

    Returns:
        `scenario`; `seed`; and `poses`: for each picture a mapping with `distance_m` from lens to
        pad, `markers` (by kind: `distance_m`; `error_m` north, east, up; `yaw_error_rad`, None for
        plain rings), `flipped`: whether the pad's normal is that of the other solution, None if the
        pad was not seen, and `flipped_alone`: the same without knowledge of gravity.

    Raises:
        CalibrationError: the camera's calibration cannot be used.
        PadError: the pad's layout cannot be used.
    """
    config, options = loaded.config, sim_options(loaded)
    layout = load_pad(config.pad.layout)
    camera = load_camera(config.camera.calibration)
    lens = true_camera(camera, options.camera.calibration_error)
    print_ = printed(layout, options.pad, seed)
    renderer = Renderer(print_, lens, options.render, seed, options.camera, options.pad)
    north, east = options.pad.position_m
    position = (north, east, -options.pad.height_m)
    pad = PadPose(position, rot_z(math.radians(options.pad.heading_deg)))
    rng = np.random.default_rng(stream(seed, "poses").getrandbits(64))
    poses = []
    for i in range(PICTURES):
        pose = _on_the_way(i / (PICTURES - 1), pad, rng)
        image = renderer.render(i, pose, pose, pad, None)
        down = _gravity(pose.R_local_camera, rng)
        found = [
            Vision(layout, camera, config.vision).process(Frame(0.0, i, image), prior)
            for prior in (Prior(down=down), Prior())
        ]
        poses.append(
            {
                "distance_m": norm(sub(pad.position, pose.position)),
                "markers": _errors(found[0].markers, print_, pose, pad),
                "flipped": _flipped(found[0].pad, pose, pad),
                "flipped_alone": _flipped(found[1].pad, pose, pad),
            }
        )
    return {"scenario": scenario, "seed": seed, "poses": poses}


def _on_the_way(share: float, pad: PadPose, rng: np.random.Generator) -> CameraPose:
    """Return the pose of a camera that looks at the pad, roughly, from a point of the approach.

    The approach comes from the south; `share` of it, 0 to 1, has been flown.
    """
    along = 2.0 * share
    north = -FROM_M * max(0.0, 1.0 - along)
    height = HEIGHT_M - (HEIGHT_M - DOWN_TO_M) * max(0.0, along - 1.0)
    aside = rng.normal(0.0, ASIDE_M, 2) * min(1.0, height / HEIGHT_M)
    position = add(pad.position, (north + float(aside[0]), float(aside[1]), -height))
    to_pad = sub(pad.position, position)
    level = math.hypot(to_pad[0], to_pad[1])
    aim = np.radians(rng.normal(0.0, AIM_DEG, 2))
    yaw = math.atan2(to_pad[1], to_pad[0]) * (level > 1.0) + float(aim[0])
    pitch = -math.atan2(to_pad[2], level) - float(aim[1])
    return CameraPose(position, matmul(rot_zyx(yaw, pitch, 0.0), R_GIMBAL_CAMERA))


def _gravity(R_local_camera: Mat3, rng: np.random.Generator) -> Vec3:
    """Return the direction of gravity in the camera frame, with a random error."""
    x, y = np.radians(rng.normal(0.0, GRAVITY_DEG, 2))
    return rotate(transpose(R_local_camera), unit((float(x), float(y), 1.0)))


def _errors(
    seen: tuple[MarkerSighting, ...], print_: PadLayout, pose: CameraPose, pad: PadPose
) -> dict[str, Any]:
    """Return distance and errors of each marker seen, by kind; see `see_poses`."""
    errors: dict[str, Any] = {}
    for sighting in seen:
        true = next(m for m in print_.markers if m.kind == sighting.kind)
        place = add(pad.position, rotate(pad.R_local_pad, (*true.position_m, 0.0)))
        best = sighting.solutions[0]
        found = add(pose.position, rotate(pose.R_local_camera, best.position))
        n, e, d = sub(found, place)
        errors[sighting.kind] = {
            "distance_m": norm(sub(place, pose.position)),
            "error_m": (n, e, -d),
            "yaw_error_rad": _yaw_error(best, true, pose, pad),
        }
    return errors


def _yaw_error(found: PoseSolution, true: Marker, pose: CameraPose, pad: PadPose) -> float | None:
    """Return the error of a marker's heading, rad; None: the marker has none."""
    if found.north is None:
        return None
    heading = math.radians(getattr(true, "heading_deg", 0.0)) + heading_of(
        rotate(pad.R_local_pad, (1.0, 0.0, 0.0))
    )
    return wrap(heading_of(rotate(pose.R_local_camera, found.north)) - heading)


def _flipped(found: tuple[PoseSolution, ...], pose: CameraPose, pad: PadPose) -> bool | None:
    """Tell whether the likelier solution is the wrong one; None: the pad was not seen."""
    if not found:
        return None
    normal = rotate(pose.R_local_camera, found[0].normal)
    return dot(normal, rotate(pad.R_local_pad, (0.0, 0.0, 1.0))) < FLIPPED
