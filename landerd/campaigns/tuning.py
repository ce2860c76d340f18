"""The plan of a search for gains: what it varies, flies and minimises; from config/tunings/."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, NamedTuple

import yaml
from pydantic import Field, model_validator

from landerd.analysis.intervals import mean_interval
from landerd.campaigns.compare import Pair, compare_row, has_failed
from landerd.campaigns.failures import is_feasible
from landerd.campaigns.plan import Row, check_scenarios
from landerd.campaigns.pool import Run
from landerd.config.files import ConfigError, config_files, read_model
from landerd.config.schema import nearest
from landerd.config.yaml_tree import put
from landerd.section import Finite, NotNegative, Section

DIGITS = 3  # significant digits of the values tried: more would be noise, and hard to read
FRESH_FROM = 1001  # first of the seeds that no search uses
Values = Mapping[str, float]  # by dotted key of the configuration


class Objective(Section):
    """What a landing costs: the sum of its figures, each times its weight."""

    time_s: NotNegative = 0.0
    energy_hj: NotNegative = 0.0
    touchdown_error_m: NotNegative = 0.0
    touchdown_vertical_mps: NotNegative = 0.0
    touchdown_horizontal_mps: NotNegative = 0.0
    yaw_error_deg: NotNegative = 0.0

    @model_validator(mode="after")
    def _some(self) -> "Objective":
        if not any(weight for _, weight in self):
            raise ValueError("found no weight above 0, expected at least one")
        return self

    def of(self, run: Run) -> float | None:
        """Return the cost of a landing; None: a figure that counts is unknown."""
        result = run.result or {}
        weights = [(key, weight) for key, weight in self if weight]
        if any(result.get(key) is None for key, _ in weights):
            return None
        return math.fsum(weight * abs(result[key]) for key, weight in weights)


class Tuning(Section):
    """A search: over which numbers, on which landings, for what."""

    scenarios: Annotated[tuple[str, ...], Field(min_length=1)]
    parameters: Annotated[dict[str, tuple[Finite, Finite]], Field(min_length=1)]  # least and most
    objective: Objective
    settings: tuple[str, ...] = ("sim.sight=modelled",)  # KEY=VALUE, as of --set
    seeds: Annotated[int, Field(ge=3)] = 6  # each scenario, the same ones for every set of values
    fresh: Annotated[int, Field(ge=5)] = 20  # seeds of each scenario that the winner is checked on
    sets: Annotated[int, Field(ge=4)] = 120  # of values that are tried, at most
    steps: Annotated[int, Field(ge=2)] = 3  # of each parameter, in a grid

    @model_validator(mode="after")
    def _ranges(self) -> "Tuning":
        for key, (least, most) in self.parameters.items():
            if not least < most:
                raise ValueError(f"{key}: found {least:g} to {most:g}, expected less to more")
        return self

    def rows(self, values: Values) -> list[Row]:
        """Return the landings that these values are tried in."""
        chosen = settings_of(values)
        return [Row(scenario=s, settings=(*self.settings, *chosen)) for s in self.scenarios]

    def at(self, place: Sequence[float]) -> dict[str, float]:
        """Return the values at a place in the unit cube, rounded to DIGITS."""
        values = {}
        for share, (key, (least, most)) in zip(place, self.parameters.items(), strict=True):
            value = float(f"{least + share * (most - least):.{DIGITS}g}")
            values[key] = min(max(value, least), most)
        return values

    def place(self, values: Values) -> list[float]:
        """Return the place of values in the unit cube; values outside are moved to its edge."""
        ranges = self.parameters.items()
        return [min(1.0, max(0.0, (values[k] - least) / (most - least))) for k, (least, most) in ranges]  # fmt: skip  # noqa: E501


def load_tuning(name: str) -> Tuning:
    """Return a tuning by its name in config/tunings/, or from a file of one's own.

    Raises:
        ConfigError: there is none of that name, or its file cannot be used.
    """
    own = config_files("tunings")
    path = Path(name) if name.endswith(".yaml") else own.get(name)
    if path is None:
        near = nearest(name, own)
        raise ConfigError([f"tuning {name!r} is not known; nearest: {near}; or any file.yaml"])
    tuning = read_model(path, Tuning)
    check_scenarios(tuning.scenarios, path)
    return tuning


def settings_of(values: Values) -> tuple[str, ...]:
    """Return values as --set takes them."""
    return tuple(f"{key}={value:g}" for key, value in values.items())


class Cost(NamedTuple):
    """The cost of several landings, ordered by failures first."""

    failed: float  # share that did not land or broke a rule; impossible days do not count
    mean: float  # of the others' objective; infinite if there is none


def cost_of(runs: Sequence[Run], objective: Objective) -> Cost:
    """Return the cost of these landings."""
    flown = [run for run in runs if is_feasible(run)]
    good = [c for run in flown if not has_failed(run) and (c := objective.of(run)) is not None]
    failed = 1.0 - len(good) / len(flown) if flown else 0.0
    return Cost(failed, fmean(good) if good else math.inf)


# ---- the check on fresh seeds --------------------------------------------------------------------


def check(pairs: Sequence[Pair], objective: Objective) -> dict[str, Any]:
    """Return whether a winner holds against the values that it is to replace.

    It holds if it fails no more often, breaks no rule, and is cheaper by more than chance: the 95 %
    interval of the paired differences lies below zero.

    Args:
        pairs: a: flown with the old values, b: with the winner's, on seeds that no search has seen.
        objective: that was minimised.
    """
    flown = [p for p in pairs if is_feasible(p.a)] or list(pairs)
    known = [
        (a, b)
        for p in flown
        if not has_failed(p.a)
        and not has_failed(p.b)
        and (a := objective.of(p.a)) is not None
        and (b := objective.of(p.b)) is not None
    ]
    interval = mean_interval([b - a for a, b in known])
    row = compare_row("fresh seeds", flown)
    why = []
    if row["succeeded"]["b"] < row["succeeded"]["a"]:
        why.append(f"{row['succeeded']['b']} succeed instead of {row['succeeded']['a']}")
    if any(run.result and run.result["rules_broken"] for run in (p.b for p in flown)):
        why.append("rules were broken")
    if interval is None or interval[1] >= 0.0:
        why.append("the gain may be chance")
    return {
        "holds": not why,
        "why_not": why,
        "cost_a": fmean(a for a, _ in known) if known else None,
        "cost_b": fmean(b for _, b in known) if known else None,
        "change_95": interval,
        "compared": row,
    }


# ---- what is written -----------------------------------------------------------------------------


def overlay(values: Values, remarks: Sequence[str]) -> str:
    """Return a YAML file that sets the values, remarks first; for `include:` of a configuration."""
    tree: dict[str, Any] = {}
    for key, value in values.items():
        put(tree, key.split("."), value)
    return "".join(f"# {line}\n" for line in remarks) + yaml.safe_dump(tree, sort_keys=False)
