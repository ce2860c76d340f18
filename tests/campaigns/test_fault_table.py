from typing import Any

import pytest

from landerd.campaigns.fault_table import as_lines, failures, is_short, summary
from landerd.campaigns.pool import Run
from tests.campaigns.landings import landing


def flown(
    seed: int = 1,
    *,
    fault: str = "gust",
    phase: str = "DESCENT",
    lasts_s: float | None = 1.0,
    **more: Any,
) -> Run:
    note = {
        "fault": fault,
        "severity": 0.5,
        "lasts_s": lasts_s,
        "lands": True,
        "began": 5.0,
        "ended": 6.0,
        "phase": phase,
        "height_m": 1.0,
    }
    result: dict[str, Any] = {
        "findings": [],
        "excused": [],
        "faults_flown": [note],
        "worst_contact": {"down_mps": 0.3, "across_mps": 0.0, "tilt_deg": 2.0},
        **more,
    }
    return Run("field", seed, landing(seed=seed, **result))


UNSTOOD = "6: said to have landed, and does not stand on the pad (at 5.20 s)"
LED = "tipped over in the hands of others (at 5.20 s)"
RULE = "3: set-points less often than 20 Hz (at 5.20 s)"


@pytest.mark.parametrize(
    ("run", "found"),
    [
        (flown(), []),
        (Run("field", 1, None, "ZeroDivisionError"), ["exception"]),
        (flown(rules_broken=[RULE]), ["3: set-points less often than 20 Hz"]),
        (flown(rules_broken=[RULE], excused=[RULE]), []),
        (
            flown(findings=["tipped over 30 degrees (at 9.00 s)"]),
            ["tipped over 30 degrees"],
        ),
        (
            flown(worst_contact={"down_mps": 0.8, "across_mps": 0.0, "tilt_deg": 0.0}),
            ["contact above 0.7 m/s"],
        ),
        (
            flown(landed=False, lasts_s=None),
            ["told to have landed, and has not"],
        ),
        (
            flown(landed=False, outcome="handed_back"),
            ["not landed, though the faults were soon over"],
        ),
        (flown(landed=False, outcome="handed_back", lasts_s=9.0), []),
        (flown(landed=False, rules_broken=[UNSTOOD], excused=[UNSTOOD]), []),
        (flown(landed=False, outcome="taken_over", findings=[LED], excused=[LED]), []),
        (flown(landed=False, outcome="handed_back", pad_out_of_reach_s=9.0), []),
    ],
)
def test_a_flight_fails_by_exceptions_broken_rules_dangers_and_hard_contacts(
    run: Run, found: list[str]
) -> None:
    assert failures(run) == found


def test_a_fault_that_never_began_does_not_count_as_short() -> None:
    run = flown()
    assert is_short(run)
    assert run.result is not None
    run.result["faults_flown"][0]["began"] = None
    assert not is_short(run)


def test_the_table_counts_by_fault_and_phase() -> None:
    runs = [
        flown(1),
        flown(2, phase="LANDED", rules_broken=[RULE]),
        flown(3, fault="killed", landed=False, outcome="handed_back", lasts_s=None),
    ]
    found = summary(runs)
    assert found["failed_seeds"] == [2]
    assert found["by_fault"]["gust"] == {"drawn": 2, "flown": 2, "landed": 2, "failed": 1}
    assert found["coverage"]["gust"] == {"DESCENT": 1, "LANDED": 1}
    assert (found["short"], found["short_landed"]) == (2, 2)
    lines = "\n".join(as_lines(found))
    assert "3 flights, 1 failed" in lines
    assert "seeds 2" in lines


def test_a_pad_that_drove_out_of_reach_is_counted_apart() -> None:
    runs = [flown(1), flown(2, landed=False, outcome="handed_back", pad_out_of_reach_s=9.0)]
    found = summary(runs)
    assert (found["short"], found["short_landed"], found["out_of_reach"]) == (1, 1, 1)
    assert "not counted there: 1 whose pad drove out of reach" in as_lines(found)
