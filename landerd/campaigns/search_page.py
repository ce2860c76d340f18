"""A picture of a search for gains: what each set of values cost, and where the best ones lie."""

import importlib.util
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from landerd.analysis.page import Block, Figures, Heading, Lines, Table, as_html, drawing
from landerd.campaigns.search import Tried
from landerd.campaigns.tuning import Tuning, Values

WIDTH_IN, HEIGHT_IN = 5.2, 3.2
GOOD, BAD, WINNER = "#1f77b4", "#d62728", "#2ca02c"


def page_of(
    title: str,
    said: Sequence[str],
    tuning: Tuning,
    generations: Sequence[Sequence[Tried]],
    sets: Mapping[str, Values],
) -> str:
    """Return the page; without figures if matplotlib is not installed.

    Args:
        title: of the page.
        said: what came of the search.
        tuning: what was searched.
        generations: all that was tried, in its order.
        sets: values that are worth a column of their own, by name; the last is the winner.
    """
    rows = [
        [key, f"{least:g} to {most:g}", *(f"{values[key]:.3g}" for values in sets.values())]
        for key, (least, most) in tuning.parameters.items()
    ]
    blocks: list[Block] = [
        Heading(title, 1),
        Lines(said),
        Table(["parameter", "range", *sets], rows),
    ]
    if importlib.util.find_spec("matplotlib") is not None:
        winner = list(sets.values())[-1]
        blocks += [_over_time(generations), _over_values(tuning, generations, winner)]
    return as_html(title, blocks)


def _over_time(generations: Sequence[Sequence[Tried]]) -> Figures:
    def draw(figure: Any) -> None:
        axes = figure.add_subplot()
        best: list[float] = []
        for number, generation in enumerate(generations, start=1):
            _dots(axes, [(number, tried) for tried in generation])
            whole = [t.cost for t in generation if t.whole]
            leader = min(whole, default=None)
            costs = [leader.mean] if leader is not None and not leader.failed else []
            best.append(min([*best[-1:], *costs], default=math.nan))
        axes.plot(range(1, len(best) + 1), best, color=WINNER, label="best so far")
        axes.set(xlabel="generation", ylabel="cost")
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)

    caption = (
        "What each set of values cost, over all its seeds (dots) or given up after a third of them "
        "(crosses). Red: a landing failed, and the cost is that of the others."
    )
    return Figures([drawing(WIDTH_IN, HEIGHT_IN, draw)], caption)


def _over_values(tuning: Tuning, generations: Sequence[Sequence[Tried]], winner: Values) -> Figures:
    every = [tried for generation in generations for tried in generation]

    def draw(key: str, figure: Any) -> None:
        axes = figure.add_subplot()
        _dots(axes, [(tuning.at(tried.place)[key], tried) for tried in every])
        axes.axvline(winner[key], color=WINNER, lw=1.0)
        axes.set(xlabel=key, ylabel="cost", xlim=tuning.parameters[key])
        axes.grid(alpha=0.3)

    drawings = [drawing(WIDTH_IN, HEIGHT_IN, partial(draw, key)) for key in tuning.parameters]
    return Figures(drawings, "The same over each parameter; the green line is the winner's value.")


def _dots(axes: Any, places: Sequence[tuple[float, Tried]]) -> None:
    """Draw costs over something; where nothing landed there is none."""
    for whole, marker in ((True, "o"), (False, "x")):
        for failed, colour in ((False, GOOD), (True, BAD)):
            shown = [
                (x, t.cost.mean)
                for x, t in places
                if t.whole is whole and (t.cost.failed > 0.0) is failed and t.cost.mean < math.inf
            ]
            axes.plot([x for x, _ in shown], [y for _, y in shown], marker, color=colour, ms=4)
