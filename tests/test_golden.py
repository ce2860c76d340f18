"""Recorded simulated flights must replay to the same commands, to the bit, on any machine.

If what the core does was meant to change: `make golden`, and look at what `landerd replay` says of
the old ones first.
"""

from pathlib import Path

import pytest

from landerd.commands.replay import config_of
from landerd.flightlog.reader import read_log
from landerd.flightlog.replay import phases, replay
from landerd.messages import Disarm, Phase

GOLDEN = sorted((Path(__file__).parent / "golden").glob("*.mcap"))


@pytest.mark.parametrize("path", GOLDEN, ids=[path.stem for path in GOLDEN])
def test_recorded_flights_replay_to_the_same_commands(path: Path) -> None:
    log = read_log(path)
    config, unknown = config_of(log, [])
    assert (log.notes, unknown) == ([], [])
    replayed = replay(log, config)
    assert replayed.comparison.compared > 100
    assert replayed.comparison.first is None, "see `landerd replay`; meant so? `make golden`"


def test_one_of_the_recorded_flights_lands() -> None:
    log = read_log(next(path for path in GOLDEN if path.stem == "landing"))
    replayed = replay(log, config_of(log, [])[0])
    assert replayed.outcome == "landed"
    assert any(isinstance(c, Disarm) for _, commands in replayed.steps for c in commands)
    assert Phase.DESCENT in [change.phase for _, change in phases(replayed.steps)]
