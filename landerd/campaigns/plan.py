"""Which landings a campaign flies, and what is asked of them; read from config/campaigns/."""

import itertools
import json
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from landerd.config.files import ConfigError, config_files, read_model
from landerd.config.schema import nearest
from landerd.config.yaml_tree import shown
from landerd.section import Finite, Positive, Section


class Needed(Section):
    """What a row must reach; each key but the first is a maximum of the row's figure."""

    landed_percent: Annotated[float, Field(ge=0, le=100)] = 100.0  # no rule broken meanwhile
    time_s_mean: Positive | None = None
    touchdown_error_m_p95: Positive | None = None
    hold_error_m_p95: Positive | None = None
    touchdown_vertical_mps_p95: Positive | None = None
    yaw_error_deg_p95: Positive | None = None
    pad_velocity_error_mps_p95: Positive | None = None
    nis_deviation: Positive | None = None  # of nis_ratio_mean from 1


class Published(Section):
    """What the thesis says of a row; printed beside ours."""

    time_s: Positive | None = None
    energy_hj: Positive | None = None


class Poses(Section):
    """Which marker's poses are looked at, and what the thesis says of them."""

    marker: Literal["whycon", "whycode", "apriltag", "aruco"]
    error_m: tuple[Finite, ...] | None = None  # over distance, highest power first (eq. 3.3, 3.4)
    yaw_error_rad: tuple[Finite, ...] | None = None  # the same (eq. 3.5)
    sd_m: tuple[Finite, Finite, Finite] | None = None  # north, east, up (Tables 3.2, 3.3)
    yaw_sd_rad: Finite | None = None  # (Table 3.4)


# landing: to the ground. approach: near the pad, held there (3.5.1). turn: to the pad's heading
# (3.5.3). poses: pictures are made and searched, nothing flies (3.3, 3.4).
Goal = Literal["landing", "approach", "turn", "poses"]


# Figures of a report. Of flights: camera, the pad in the camera's frame; distance, over time;
# descent, height and speed over time; heading, over time; paths, from above and from the side;
# estimated, the same as the vehicle took it to be. Of poses: errors and yaw_errors, over distance;
# flips, of the axis.
Figure = Literal[
    "camera",
    "distance",
    "descent",
    "heading",
    "paths",
    "estimated",
    "errors",
    "yaw_errors",
    "flips",
]
OF_POSES: tuple[Figure, ...] = ("errors", "yaw_errors", "flips")


class Row(Section):
    """One scenario with settings of its own, flown with every seed."""

    scenario: str
    label: str | None = None  # in tables, instead of the name
    goal: Goal = "landing"
    settings: tuple[str, ...] = ()  # KEY=VALUE, as of --set
    days: bool = False  # every seed is another day: tell what those that fail have in common
    # Every seed has faults of its own: tell what came of them. low: they begin just over the pad.
    faults: bool | Literal["low"] = False
    needed: Needed = Needed()
    poses: Poses | None = None  # for this goal
    thesis: Published = Published()

    @model_validator(mode="after")
    def _asks_for_poses(self) -> "Row":
        if (self.goal == "poses") != (self.poses is not None):
            raise ValueError("expected poses with goal: poses, and only then")
        return self

    @property
    def name(self) -> str:
        """What `landerd sim` takes to fly it; another goal than landing is a shell's comment."""
        name = " ".join([self.scenario, *(f"--set '{each}'" for each in self.settings)])
        return name if self.goal == "landing" else f"{name} # {self.goal}"


class Sweep(Section):
    """One key with several values, each a row in each of the scenarios."""

    scenarios: tuple[str, ...]
    key: str
    values: tuple[Any, ...]
    settings: tuple[str, ...] = ()  # the same for all values

    def rows(self) -> Iterator[Row]:
        """Return a row for each scenario and value."""
        for scenario, value in itertools.product(self.scenarios, self.values):
            setting = f"{self.key}={json.dumps(value)}"
            yield Row(scenario=scenario, settings=(*self.settings, setting))


class Grid(Section):
    """Several keys: a row for every combination of their values, labelled with these."""

    scenario: str
    keys: Annotated[dict[str, tuple[int | float, ...]], Field(min_length=1)]
    goal: Goal = "landing"
    settings: tuple[str, ...] = ()  # the same for all
    needed: Needed = Needed()
    thesis: Mapping[str, Published] = Field(default_factory=dict)  # by the row's label

    @model_validator(mode="after")
    def _published_rows_are_there(self) -> "Grid":
        for label in self.thesis.keys() - {row.label for row in self.rows()}:
            raise ValueError(f"thesis: {label!r} is no combination of the values")
        return self

    def rows(self) -> Iterator[Row]:
        """Return a row for each combination."""
        for values in itertools.product(*self.keys.values()):
            label = " ".join(f"{value:g}" for value in values)
            chosen = [
                f"{key}={json.dumps(value)}" for key, value in zip(self.keys, values, strict=True)
            ]
            yield Row(
                scenario=self.scenario,
                label=label,
                goal=self.goal,
                settings=(*self.settings, *chosen),
                needed=self.needed,
                thesis=self.thesis.get(label, Published()),
            )


class Campaign(Section):
    """Rows, and with how many seeds each is flown: 1, 2, 3 and so on."""

    title: str | None = None  # what reports call it, instead of its file's name
    figures: Mapping[Figure, str] = Field(default_factory=dict)  # of a report: the thesis's number
    runs: Annotated[int, Field(ge=1)] = 50
    longest_s: Annotated[float, Field(gt=0, le=3600)] = 150.0  # what is not over then is ended
    best: Annotated[int, Field(ge=1)] | None = None  # tables show so many rows, and the thesis's
    campaigns: tuple[str, ...] = ()  # flown one after the other, and nothing else
    rows: tuple[Row, ...] = ()
    sweeps: tuple[Sweep, ...] = ()
    grids: tuple[Grid, ...] = ()

    @model_validator(mode="after")
    def _some(self) -> "Campaign":
        if self.campaigns and self.all_rows:
            raise ValueError("expected campaigns, or rows of its own")
        if self.campaigns:
            return self
        if not self.all_rows:
            raise ValueError("found no rows, expected at least one")
        name, count = Counter(row.name for row in self.all_rows).most_common(1)[0]
        if count > 1:
            raise ValueError(f"found the row {name!r} twice")
        return self

    @cached_property
    def all_rows(self) -> tuple[Row, ...]:
        """The rows, those of the sweeps after them, and those of the grids."""
        swept = [row for sweep in self.sweeps for row in sweep.rows()]
        return (*self.rows, *swept, *(row for grid in self.grids for row in grid.rows()))

    @property
    def keeps_paths(self) -> bool:
        """Whether results hold where the vehicle flew, for the figures."""
        return any(figure not in OF_POSES for figure in self.figures)

    def row(self, name: str) -> Row:
        """Return the row of this name. Raises KeyError."""
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, Row]:
        return {row.name: row for row in self.all_rows}


def campaign_of(names: Iterable[str]) -> Campaign:
    """Return a campaign with rows of these names: what differs in its last setting is a sweep."""
    rows: list[Row] = []
    swept: dict[tuple[str, tuple[str, ...]], tuple[dict[str, None], dict[str, Any]]] = {}
    for name in names:
        row = _row_of(name)
        key, _, text = (row.settings[-1] if row.settings else "").partition("=")
        try:
            value = json.loads(text)
        except ValueError:
            rows.append(row)
            continue
        scenarios, values = swept.setdefault((key, row.settings[:-1]), ({}, {}))
        scenarios[row.scenario], values[text] = None, value
    sweeps = [
        Sweep(scenarios=tuple(scenarios), key=key, values=tuple(values.values()), settings=settings)
        for (key, settings), (scenarios, values) in swept.items()
    ]
    return Campaign(rows=tuple(rows), sweeps=tuple(sweeps))


def _row_of(name: str) -> Row:
    """Return the row of this name, as far as its name tells."""
    scenario, *settings = shlex.split(name, comments=True)
    return Row(scenario=scenario, settings=tuple(settings[1::2]))


def load_campaigns(name: str) -> dict[str, Campaign]:
    """Return a campaign by name, or those that it consists of.

    Args:
        name: of a packaged campaign, of a file of one's own (with its .yaml), or of a scenario,
            which is a campaign of that row alone.

    Raises:
        ConfigError: there is none of that name, or its file cannot be used.
    """
    campaign = _load(name)
    if not campaign.campaigns:
        return {name: campaign}
    parts = {part: _load(part) for part in campaign.campaigns}
    for part, loaded in parts.items():
        if loaded.campaigns:
            raise ConfigError([f"{name}: campaign {part!r} is made of others, expected rows"])
    return parts


def _load(name: str) -> Campaign:
    campaigns, scenarios = config_files("campaigns"), config_files("scenarios")
    path = Path(name) if name.endswith(".yaml") else campaigns.get(name)
    if path is not None:
        campaign = read_model(path, Campaign)
        check_scenarios((row.scenario for row in campaign.all_rows), path)
        return campaign
    if name in scenarios:
        return Campaign(rows=(Row(scenario=name),))
    near = nearest(name, [*campaigns, *scenarios])
    raise ConfigError(
        [
            f"campaign {name!r} is not known; nearest: {near}; all: {', '.join(campaigns)}, "
            "every scenario, and any file.yaml"
        ]
    )


def check_scenarios(names: Iterable[str], path: Path) -> None:
    """Raise ConfigError if the file of a campaign or tuning names scenarios that there are not."""
    known = config_files("scenarios")
    faults = []
    for name in dict.fromkeys(names):
        if name not in known:
            near = nearest(name, known)
            faults.append(f"{shown(path)}: scenario {name!r} is not known; nearest: {near}")
    if faults:
        raise ConfigError(faults)
