"""The configuration itself: what is allowed, and yet no way to a first landing."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

from landerd.camera_model import CameraModel, load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config
from landerd.pad import WHYCODE_CORE, Marker, PadLayout, Plate, Ring, Square, size_m
from landerd.preflight.finding import Finding
from landerd.preflight.sensors import FILE

_FIRST_FLIGHT_MPS = 5.0  # a person's thumb can still answer it
_EDGE_M = 1e-3  # of a marker over the plate's, is not told


def placeholder(config: Config) -> list[Finding]:
    """Return whether a real camera has the calibration of the simulated one."""
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
    """Tell whether two calibrations are one: also a copy at another size."""
    if a.width * b.height != a.height * b.width:
        return False
    scaled = a.scaled(b.width, b.height)
    near = max(abs(x - y) for x, y in zip(_numbers(scaled), _numbers(b), strict=True)) < 0.5
    return near and a.distortion == b.distortion


def _numbers(camera: CameraModel) -> tuple[float, ...]:
    return camera.fx, camera.fy, camera.cx, camera.cy


def first_flight(config: Config, state: Path) -> list[Finding]:
    """Return whether a vehicle that has not landed yet may fly fast.

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


def pad_findings(layout: PadLayout) -> list[Finding]:
    """Return what cannot be so on a printed pad: markers over its edge, or over each other."""
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
    """Return how far a marker reaches to any side at least, m."""
    return 0.5 * size_m(marker)


def _heart(marker: Marker) -> float:
    """Return the radius of the white in a ring, in which another marker may lie, m."""
    if isinstance(marker, Square):
        return 0.0
    ratio = marker.inner_ratio if isinstance(marker, Ring) else WHYCODE_CORE
    return ratio * marker.radius_m


def _name(marker: Marker) -> str:
    size = 2e3 * _half(marker)
    number = "" if isinstance(marker, Ring) else f" {marker.id}"
    return f"{marker.kind}{number} of {size:.0f} mm"
