"""Which landings a campaign flies, and what is asked of them; read from config/campaigns/."""

import difflib
import itertools
import json
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from landerd.config.files import ConfigError, config_files, read_model
from landerd.section import Positive, Section


class Needed(Section):
    """What a row must reach; each key but the first is a maximum of the row's figure."""

    landed_percent: Annotated[float, Field(ge=0, le=100)] = 100.0  # no rule broken meanwhile
    time_s_mean: Positive | None = None
    touchdown_error_m_p95: Positive | None = None
    touchdown_vertical_mps_p95: Positive | None = None
    yaw_error_deg_p95: Positive | None = None
    pad_velocity_error_mps_p95: Positive | None = None
    nis_deviation: Positive | None = None  # of nis_ratio_mean from 1


class Row(Section):
    """One scenario with settings of its own, flown with every seed."""

    scenario: str
    settings: tuple[str, ...] = ()  # KEY=VALUE, as of --set
    days: bool = False  # every seed is another day: tell what those that fail have in common
    faults: bool = False  # every seed has faults of its own: tell what came of them
    needed: Needed = Needed()

    @property
    def name(self) -> str:
        """What `landerd sim` takes to fly it."""
        return " ".join([self.scenario, *(f"--set '{each}'" for each in self.settings)])


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


class Campaign(Section):
    """Rows, and with how many seeds each is flown: 1, 2, 3 and so on."""

    runs: Annotated[int, Field(ge=1)] = 50
    longest_s: Annotated[float, Field(gt=0, le=3600)] = 150.0  # what is not over then is ended
    rows: tuple[Row, ...] = ()
    sweeps: tuple[Sweep, ...] = ()

    @model_validator(mode="after")
    def _some(self) -> "Campaign":
        if not self.all_rows:
            raise ValueError("found no rows, expected at least one")
        return self

    @cached_property
    def all_rows(self) -> tuple[Row, ...]:
        """The rows, and those of the sweeps after them."""
        swept = itertools.chain.from_iterable(sweep.rows() for sweep in self.sweeps)
        return (*self.rows, *swept)

    def row(self, name: str) -> Row:
        """Return the row of this name. Raises KeyError."""
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, Row]:
        return {row.name: row for row in self.all_rows}


def load_campaign(name: str) -> Campaign:
    """Return a campaign by name; a scenario's name is a campaign of that row alone.

    Raises:
        ConfigError: there is none of that name, or its file cannot be used.
    """
    campaigns, scenarios = config_files("campaigns"), config_files("scenarios")
    if name in campaigns:
        campaign = read_model(campaigns[name], Campaign)
        _check_scenarios(campaign, scenarios, campaigns[name])
        return campaign
    if name in scenarios:
        return Campaign(rows=(Row(scenario=name),))
    near = difflib.get_close_matches(name, [*campaigns, *scenarios], n=1, cutoff=0.0)
    raise ConfigError(
        [
            f"campaign {name!r} is not known; nearest: {near[0]}; all: {', '.join(campaigns)}, "
            "and every scenario"
        ]
    )


def _check_scenarios(campaign: Campaign, scenarios: Mapping[str, Path], path: Path) -> None:
    unknown = [row.scenario for row in campaign.all_rows if row.scenario not in scenarios]
    if unknown:
        raise ConfigError(
            [f"{path.name}: scenario {name!r} is not known" for name in dict.fromkeys(unknown)]
        )
