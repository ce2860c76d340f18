"""Checks the configuration for values that are allowed but unsuitable for a first landing."""

import math
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

from landerd.camera_model import CameraModel, load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.guidance.footprint import most_lean
from landerd.guidance.phases import descent_radius, most_widening
from landerd.guidance.relative_state import CAMERA_PLACE_SIGMA_M
from landerd.pad import WHYCODE_CORE, Marker, PadLayout, Plate, Ring, Square, size_m
from landerd.preflight.finding import Finding
from landerd.preflight.sensors import FILE
from landerd.printing.proposal import View

_FIRST_FLIGHT_MPS = 5.0  # highest speed to which a pilot's thumb can still react
_EDGE_M = 1e-3  # of a marker over the plate's, is not told
_HIGHEST_M, _STEP_M = 15.0, 0.25  # heights over the pad that are examined: the highest, the step
_LEAST_MISS_M = 0.05  # guidance.descent.commit_miss_m with which a landing still succeeds
_LEAST_LEAN_DEG = 5.0  # lean that steering and a light wind require
# A marker fills the picture at so much of the distance from which it is whole with a margin; and
# may be out of it so far over the commit height, m: what is left is flown without sight.
_FILLS, _UNSEEN_M = 0.9, 0.1
_SEEN_M = 15.0  # from nearer than this no pad is to be told only


def placeholder(config: Config) -> list[Finding]:
    """Return a finding if a real camera has the calibration of the simulated one."""
    if config.camera.driver == "sim":
        return []
    own = load_camera(config_dir() / "cameras" / "thesis.yaml")
    if not _same_lens(load_camera(config.camera.calibration), own):
        return []
    return [
        Finding(
            "fail",
            "calibration",
            f"{config.camera.calibration} is the thesis's camera and not yours: directions may be "
            "wrong by many degrees",
            "landerd calibrate camera, and name its file in camera.calibration (docs/cameras.md)",
        )
    ]


def _same_lens(a: CameraModel, b: CameraModel) -> bool:
    """Tell whether two calibrations are the same, perhaps scaled to another picture size."""
    if a.width * b.height != a.height * b.width:
        return False
    scaled = a.scaled(b.width, b.height)
    near = max(abs(x - y) for x, y in zip(_numbers(scaled), _numbers(b), strict=True)) < 0.5
    return near and a.distortion == b.distortion


def _numbers(camera: CameraModel) -> tuple[float, ...]:
    return camera.fx, camera.fy, camera.cx, camera.cy


def first_flight(config: Config, state: Path) -> list[Finding]:
    """Return a finding if a vehicle that has not landed yet may fly fast.

    Args:
        config: the configuration.
        state: folder in which a landing leaves what it has found.
    """
    speed = config.guidance.limits.speed_mps
    if speed <= _FIRST_FLIGHT_MPS or (state / FILE).exists():
        return []
    what = f"up to {speed:g} m/s may be ordered, and no landing has been recorded here yet"
    mend = "set guidance.limits.speed_mps to 3 for the first landings (docs/install.md)"
    return [Finding("warn", "speed limit", what, mend)]


def descent_findings(config: Config) -> list[Finding]:
    """Return a finding if the descent region is somewhere too narrow for the lens's uncertainty.

    A vehicle descends with two standard deviations of its place inside the region: where these fill
    it, a landing waits until its time is over.
    """
    o, sigma = config.guidance.descent, math.radians(config.estimation.gimbal_sigma_deg)
    for step in range(int(_HIGHEST_M / _STEP_M)):
        height = _HIGHEST_M - step * _STEP_M
        radius = most_widening(o) * descent_radius(o, height)
        unsure = 2.0 * math.hypot(sigma * height, CAMERA_PLACE_SIGMA_M)
        if unsure >= radius:
            what = (
                f"{height:g} m up it is {radius:.2g} m wide, and the place known to {unsure:.2g} m "
                f"by estimation.gimbal_sigma_deg {math.degrees(sigma):g}: there is no way down"
            )
            mend = "set guidance.descent.k1_m and k2_per_m larger, or calibrate the gimbal better"
            return [Finding("fail", "descent region", what, mend)]
    return []


def stance_findings(config: Config, layout: PadLayout) -> list[Finding]:
    """Return a finding if the vehicle cannot stand on the pad, or only in still air."""
    found, vehicle, plate = [], config.vehicle, layout.plate
    reach = 0.5 * math.hypot(*vehicle.footprint_m)
    edge = min(plate.north_m, plate.south_m, plate.east_m, plate.west_m)
    if reach > edge:
        what = (
            f"the feet reach {reach:.2f} m from their middle, the plate {edge:.2f} m from the "
            "landing point: what touches beside it has not landed"
        )
        mend = (
            "measure vehicle.footprint_m, and the plate of the pad's file; ground that is level "
            "with the print may count as plate"
        )
        found.append(Finding("warn", "feet", what, mend))
    elif (miss_m := config.guidance.descent.commit_miss_m) > edge - reach:
        what = (
            f"a landing is committed up to {miss_m:g} m off, and {edge - reach:.2f} m off a foot "
            "touches beside the plate: from a raised pad the vehicle would fall"
        )
        mend = (
            f"set guidance.descent.commit_miss_m to {max(edge - reach, _LEAST_MISS_M):.2g}; ground "
            "that is level with the print may count as plate, in the pad's file"
        )
        found.append(Finding("warn", "feet", what, mend))
    below = vehicle.camera_offset_m[2] - vehicle.gear_height_m
    if below >= 0.0:
        what = f"the camera is {below:.2f} m lower than the feet: it would touch first"
        mend = "measure vehicle.camera_offset_m (down is positive) and gear_height_m"
        found.append(Finding("fail", "feet", what, mend))
    lean_deg = math.degrees(most_lean(vehicle, config.guidance.descent.commit_height_m))
    if lean_deg < _LEAST_LEAN_DEG:
        wide, high = vehicle.footprint_m, vehicle.gear_height_m
        what = (
            f"a gear {wide[0]:g} by {wide[1]:g} m wide and {high:g} m high touches down with no "
            f"more than {max(lean_deg, 0.0):.0f} degrees of lean, which a light wind takes: it "
            "would tip over, or a foot touch before it is committed"
        )
        mend = "measure vehicle.footprint_m and gear_height_m; guidance.descent.commit_height_m"
        found.append(Finding("warn", "feet", what, mend))
    return found


def view_findings(config: Config, layout: PadLayout, camera: CameraModel) -> list[Finding]:
    """Return findings if the pad cannot be seen from just above it, or from far away."""
    return [*_from_above(config, camera), *_near(config, layout, camera), *_far(config, layout)]


def _near(config: Config, layout: PadLayout, camera: CameraModel) -> list[Finding]:
    """Return a finding if no marker fits into the picture any more before the feet are down."""
    view = View(min(camera.fx, camera.fy), min(camera.width, camera.height))
    whole_m = _FILLS * min(map(view.nearest_m, layout.markers))
    vehicle, commit_m = config.vehicle, config.guidance.descent.commit_height_m
    camera_m = vehicle.gear_height_m - vehicle.camera_offset_m[2]  # over the feet
    feet_m = whole_m - camera_m
    if feet_m <= commit_m + _UNSEEN_M or camera_m <= 0.0:
        return []
    what = (
        f"{feet_m:.2g} m up no marker fits the picture any more: sight is lost there, "
        f"and a landing needs it down to {commit_m:g} m"
    )
    mend = "add a small marker to the pad, as in the heart of a ring (docs/markers.md)"
    return [Finding("fail", "pad", what, mend)]


def _far(config: Config, layout: PadLayout) -> list[Finding]:
    """Return a finding if the configured errors of print and lens make distances too uncertain."""
    vision = config.vision
    share = math.hypot(vision.focal_sigma, layout.print_scale_sigma)
    if share * _SEEN_M <= vision.max_sigma_m:
        return []
    what = (
        f"from farther than {vision.max_sigma_m / share:.2g} m the pad is not told of: its place "
        f"is known to {100.0 * share:.2g} % of the distance, vision.max_sigma_m is "
        f"{vision.max_sigma_m:g}"
    )
    mend = "set vision.focal_sigma and print_scale_sigma of the pad's file to what was measured"
    return [Finding("warn", "pad", what, mend)]


def _from_above(config: Config, camera: CameraModel) -> list[Finding]:
    """Return a finding if the gimbal cannot turn the camera nearly straight down."""
    low, high = config.gimbal.pitch_limits_deg
    up = math.degrees(math.atan2(camera.cy, camera.fy))
    down = math.degrees(math.atan2(camera.height - camera.cy, camera.fy))
    if config.gimbal.camera_rotation_deg != (0.0, 0.0, 0.0) or low - down <= -90.0 <= high + up:
        return []
    what = (
        f"pitch {low:g} to {high:g} degrees: over the pad it is not in the picture, straight down"
    )
    mend = (
        "set gimbal.pitch_limits_deg as far as the gimbal turns, or mount it so that it looks down"
    )
    return [Finding("fail", "gimbal limits", what, mend)]


def pad_findings(layout: PadLayout) -> list[Finding]:
    """Return what is impossible on a printed pad: markers beyond its edge, or overlapping."""
    wrong = [*_over_the_edge(layout), *_over_each_other(layout)]
    return wrong or [
        Finding("ok", "pad", f"{layout.name}: {', '.join(map(_name, layout.markers))}")
    ]


def _over_the_edge(layout: PadLayout) -> Iterator[Finding]:
    for marker in layout.markers:
        if not _is_on(layout.plate, marker):
            yield Finding(
                "warn",
                "pad",
                f"{_name(marker)} reaches over the edge of the plate",
                "measure the pad: position_m and size of the marker, or plate, of the pad's file",
            )


def _is_on(plate: Plate, marker: Marker) -> bool:
    (north, east), reach = marker.position_m, _half(marker) - _EDGE_M
    return (
        -plate.south_m <= north - reach
        and north + reach <= plate.north_m
        and -plate.west_m <= east - reach
        and east + reach <= plate.east_m
    )


def _over_each_other(layout: PadLayout) -> Iterator[Finding]:
    for a, b in combinations(layout.markers, 2):
        (an, ae), (bn, be) = a.position_m, b.position_m
        apart = ((an - bn) ** 2 + (ae - be) ** 2) ** 0.5
        nested = apart + _half(b) <= _heart(a) or apart + _half(a) <= _heart(b)
        if apart + _EDGE_M < _half(a) + _half(b) and not nested:
            yield Finding(
                "warn",
                "pad",
                f"{_name(a)} and {_name(b)} lie over each other",
                "measure the pad: position_m and sizes of the pad's file",
            )


def _half(marker: Marker) -> float:
    """Return the distance to which a marker extends in every direction, m."""
    return 0.5 * size_m(marker)


def _heart(marker: Marker) -> float:
    """Return the radius of the white centre of a ring, where another marker may be, m."""
    if isinstance(marker, Square):
        return 0.0
    ratio = marker.inner_ratio if isinstance(marker, Ring) else WHYCODE_CORE
    return ratio * marker.radius_m


def _name(marker: Marker) -> str:
    size = 2e3 * _half(marker)
    number = "" if isinstance(marker, Ring) else f" {marker.id}"
    return f"{marker.kind}{number} of {size:.0f} mm"
