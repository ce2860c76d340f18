"""A pad file that says how large the pad came out, and pad files as text."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from landerd.pad import Marker, PadError, PadLayout, size_m
from landerd.printing.sheets import RULER_MM

RULER = "ruler"
_LARGEST_FACTOR = 2.0  # between what was printed and what was measured; beyond it is a slip
_IN_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_DECIMALS = 6  # of lengths in a file: a micrometre
_CAME_OUT = "as it came out: "  # in the remark of a pad file that was measured


def length_m(text: str) -> float:
    """Return a length that was written with its unit, as 1.2m, 120cm or 99.2mm; m.

    Raises:
        ValueError: it is none, or not positive.
    """
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) ?(mm|cm|m)", text, re.ASCII)
    if match is None or float(match[1]) == 0.0:
        raise ValueError(
            f"found {text!r}, expected a length above 0 with its unit, as 1.2m or 99.2mm"
        )
    return float(match[1]) * _IN_M[match[2]]


def marker_names(layout: PadLayout) -> dict[str, Marker]:
    """Return the markers by what a user calls them: `whycon`, `apriltag-0`, or `whycon-2`."""
    names: dict[str, Marker] = {}
    for i, marker in enumerate(layout.markers):
        number = getattr(marker, "id", None)
        before = sum(m.kind == marker.kind for m in layout.markers[:i])
        alone = sum(m.kind == marker.kind for m in layout.markers) == 1
        name = marker.kind if alone and number is None else f"{marker.kind}-{before + 1}"
        if number is not None:
            name = f"{marker.kind}-{number}"
            if name in names:  # of another dictionary, or of other bits
                name = f"{name}-{before + 1}"
        names[name] = marker
    return names


def measured(layout: PadLayout, sizes_m: Mapping[str, float]) -> PadLayout:
    """Return the layout as it came out.

    Args:
        layout: as it was printed.
        sizes_m: by what was measured. RULER: the bar of 100 mm, by which all is larger or smaller,
            places and plate too; a marker's name: that marker alone.

    Raises:
        PadError: nothing has such a name, or the length is far from what was printed.
    """
    names = marker_names(layout)
    for name, length in sizes_m.items():
        if name != RULER and name not in names:
            known = ", ".join([RULER, *names])
            raise PadError(f"nothing is called {name!r}; on this pad: {known}")
        nominal = RULER_MM / 1e3 if name == RULER else size_m(names[name])
        if not nominal / _LARGEST_FACTOR <= length <= nominal * _LARGEST_FACTOR:
            found, meant = f"{1e3 * length:g} mm", f"{1e3 * nominal:g} mm"
            raise PadError(f"{name}: {found} is far from the {meant} that were printed")
    factor = sizes_m.get(RULER, RULER_MM / 1e3) / (RULER_MM / 1e3)
    data = _scaled(layout.model_dump(exclude_unset=True), factor)
    for marker, name in zip(data["markers"], names, strict=True):
        if name in sizes_m:
            marker[_size_key(marker)] = sizes_m[name]
    return PadLayout.model_validate(data)


def _scaled(data: dict[str, Any], factor: float) -> dict[str, Any]:
    for marker in data["markers"]:
        if "position_m" in marker:
            marker["position_m"] = [factor * p for p in marker["position_m"]]
        marker[_size_key(marker)] *= factor
    data["plate"] = {edge: factor * length for edge, length in data["plate"].items()}
    return data


def _size_key(marker: Mapping[str, Any]) -> str:
    return "size_m" if "size_m" in marker else "outer_diameter_m"


def came_out(name: str, found: str) -> str:
    """Return the remark that heads a pad file made from another by what was found on its print."""
    return f"{name} {_CAME_OUT}{found}"


def was_measured(text: str) -> bool:
    """Tell whether a pad file's text says that its sizes were measured on a print."""
    return any(_CAME_OUT in line for line in text.splitlines() if line.startswith("#"))


def pad_file(layout: PadLayout, remarks: Sequence[str]) -> str:
    """Return a layout as a pad file, headed by lines of remarks."""
    data = layout.model_dump(exclude_unset=True)
    markers = [_on_one_line(marker) for marker in data["markers"]]
    lines = [f"# {remark}" for remark in remarks]
    lines += [_on_one_line({"name": data["name"]})[1:-1], "markers:"]
    lines += [f"  - {marker}" for marker in markers]
    lines.append(f"plate: {_on_one_line(data['plate'])}")
    rest = {k: v for k, v in data.items() if k not in ("name", "markers", "plate")}
    lines += [f"{key}: {value}" for key, value in rest.items()]
    return "\n".join(lines) + "\n"


def _on_one_line(data: Mapping[str, Any]) -> str:
    """Return `{key: value, ...}`, lengths rounded to the micrometre."""

    def plain(value: Any) -> Any:
        if isinstance(value, float):
            return round(value, _DECIMALS)
        return [plain(v) for v in value] if isinstance(value, list | tuple) else value

    tidy = {k: v if k == "inner_ratio" else plain(v) for k, v in data.items()}
    text: str = yaml.safe_dump(tidy, default_flow_style=True, width=10_000, sort_keys=False)
    return text.strip()
