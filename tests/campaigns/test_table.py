import pytest

from landerd.analysis.intervals import percentile
from landerd.campaigns.plan import Needed, Row
from landerd.campaigns.pool import Run
from landerd.campaigns.table import as_text, make_row
from tests.campaigns.landings import landing


def runs(*changes: dict[str, object]) -> list[Run]:
    return [Run("radial", n, landing("radial", n, **c)) for n, c in enumerate(changes, start=1)]


def test_a_row_counts_and_averages() -> None:
    row = make_row(
        Row(scenario="radial"),
        [
            *runs(
                {"time_s": 16.0, "energy_hj": 50.0, "touchdown_error_m": 0.01},
                {"time_s": 20.0, "energy_hj": 70.0, "touchdown_error_m": 0.03, "aborts": 2},
                {"landed": False, "outcome": "handed_back", "time_s": None, "energy_hj": None}
                | {"touchdown_error_m": 0.05, "yaw_error_deg": 7.0},
                {"rules_broken": ["3: too fast (at 4.21 s)"], "touchdown_error_m": None},
            ),
            Run("radial", 5, None, "ValueError: no (world.py:1)"),
        ],
    )
    assert (row["runs"], row["landed"], row["exceptions"], row["aborts"]) == (5, 3, 1, 2)
    assert row["time_s_mean"] == pytest.approx((16.0 + 20.0 + 18.0) / 3)
    assert row["energy_hj_mean"] == pytest.approx(60.0)
    assert row["touchdown_error_m_median"] == pytest.approx(0.03)
    assert row["touchdown_error_m_p95"] == pytest.approx(0.048)
    assert row["yaw_error_deg_max"] == 7.0
    assert row["rules_broken"] == 1
    assert row["breaches"] == {"3: too fast": [4]}
    assert row["errors"] == {"5": "ValueError: no (world.py:1)"}
    assert row["failed_seeds"] == [3, 4, 5]


def test_the_error_of_holding_is_a_column_only_if_a_flight_held() -> None:
    held = [make_row(Row(scenario="hold"), runs({"hold_error_m_p95": 0.04}))]
    assert held[0]["hold_error_m_p95"] == pytest.approx(0.04)
    assert "hold m p95" in as_text(held, 400)
    others = [make_row(Row(scenario="radial"), runs({}))]
    assert others[0]["hold_error_m_p95"] is None
    assert "hold m p95" not in as_text(others, 400)


def test_figures_of_a_row_without_landings_are_unknown() -> None:
    row = make_row(Row(scenario="radial"), [Run("radial", 1, None, "ValueError: no (x.py:1)")])
    assert row["time_s_mean"] is None
    assert row["touchdown_error_m_p95"] is None
    assert " - " in as_text([row], 200)


@pytest.mark.parametrize(
    ("needed", "changes", "missed"),
    [
        ({"time_s_mean": 18.5}, {}, None),
        ({"time_s_mean": 17.5}, {}, "time_s_mean 18, needed at most 17.5"),
        ({"touchdown_error_m_p95": 0.1}, {"touchdown_error_m": 0.2}, "touchdown_error_m_p95 0.2"),
        ({"touchdown_error_m_p95": 0.1}, {"touchdown_error_m": None}, "unknown, needed at most"),
        ({"yaw_error_deg_p95": 1.0}, {}, "yaw_error_deg_p95 2, needed at most 1"),
        ({"nis_deviation": 0.2}, {}, None),
        ({"nis_deviation": 0.2}, {"nis_ratio": 0.7}, "nis_deviation 0.3, needed at most 0.2"),
        ({"nis_deviation": 0.2}, {"nis_ratio": 1.3}, "nis_deviation 0.3, needed at most 0.2"),
        ({}, {"landed": False}, "0 % landed by the rules, needed 100 %"),
        ({"landed_percent": 0.0}, {"landed": False}, None),
        ({"landed_percent": 0.0}, {"rules_broken": ["3: too fast"]}, "needed none"),
    ],
)
def test_a_row_misses_its_requirement_if_a_figure_is_too_large_or_unknown(
    needed: dict[str, float], changes: dict[str, object], missed: str | None
) -> None:
    row = make_row(Row(scenario="radial", needed=Needed(**needed)), runs(changes))
    if missed is None:
        assert row["missed"] == []
    else:
        (text,) = row["missed"]
        assert missed in text


def test_the_table_names_failed_seeds_below() -> None:
    good = make_row(Row(scenario="radial"), runs({}, {}))
    bad = make_row(Row(scenario="moving"), runs({}, {"rules_broken": ["3: too fast (at 1.00 s)"]}))
    head, first, second, *notes = as_text([good, bad], 200).splitlines()
    assert head.split()[:2] == ["scenario", "landed"]
    assert first.split()[:5] == ["radial", "2/2", "34-100", "%", "18.0"]
    assert len(head) == len(first) == len(second)
    assert "moving: failed with seeds 2" in notes
    assert "moving: rule 3: too fast (seeds 2)" in notes
    assert not any(note.startswith("radial") for note in notes)


def test_percentiles_lie_between_the_values() -> None:
    assert percentile([3.0, 1.0, 2.0], 50.0) == 2.0
    assert percentile([0.0, 10.0], 95.0) == pytest.approx(9.5)
    assert percentile([4.0], 95.0) == 4.0
    assert percentile([], 50.0) is None


def test_on_a_narrow_terminal_no_line_is_broken() -> None:
    rows = [make_row(Row(scenario="radial"), runs({}))]
    wide, narrow = as_text(rows, 200).splitlines(), as_text(rows, 80).splitlines()
    assert len(wide) == 2
    assert max(map(len, narrow)) <= 80
    heads = [line for line in narrow if line.startswith("scenario")]
    assert len(heads) == 3
    assert [cell for line in heads for cell in line.split("  ")[1:] if cell] == [
        cell for cell in wide[0].split("  ")[1:] if cell
    ]
