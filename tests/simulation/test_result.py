"""The printed result of a flight, from a flight that was put together by hand."""

import dataclasses
import math

import pytest

from hw.sim.judge.monitor import Worst
from hw.sim.judge.score import Contact, Score
from hw.sim.judge.truth import Feet
from landerd.camera_model import load_camera
from landerd.config.files import config_dir
from landerd.config.models import Config, VehicleSection
from landerd.lander import Lander
from landerd.messages import Phase, PhaseChange
from landerd.pad import load_pad
from landerd.simulation.faults import Faults
from landerd.simulation.recording import Recording
from landerd.simulation.result import Flown, result_of
from tests.hw.sim.worlds import world

BEGAN = 3.0


def flown() -> Flown:
    """Return a flight of 20 s without a landing."""
    w, layout = world(), load_pad(config_dir() / "pads" / "thesis.yaml")
    score = Score(w, Feet(w, VehicleSection(), layout.plate))
    camera = load_camera(config_dir() / "cameras" / "thesis.yaml")
    recording = Recording(w, score, camera, lambda: (0.0, 0.0))
    recording.phases.append((BEGAN, PhaseChange(Phase.NOT_LANDING, "not armed")))
    return Flown(
        began=BEGAN,
        ended=BEGAN + 20.0,
        timed_out=False,
        ends_at_contact=False,
        score=score,
        rules_broken={},
        lander=Lander(Config(), layout),
        faults={"image of a wrong size": 2},
        findings={},
        happened=Faults((), lambda number: None, lambda: Phase.NOT_LANDING),  # type: ignore[arg-type,return-value]
        worst=Worst(),
        left_reach_t=BEGAN + 12.0,
        recording=recording,
        innovation_gate=16.0,
    )


def test_a_flight_without_landing_has_no_figures_of_a_touchdown() -> None:
    result = result_of(flown(), "hover", 4)
    assert (result["scenario"], result["seed"], result["landed"]) == ("hover", 4, False)
    assert {result[key] for key in ("touchdown_error_m", "time_s", "energy_hj")} == {None}
    assert (result["nis_ratio"], result["refused_percent"]) == (None, None)
    assert result["simulated_s"] == 20.0
    assert result["faults"] == {"image of a wrong size": 2}
    assert result["pad_out_of_reach_s"] == 12.0


def test_times_count_from_the_first_sighting_and_breaks_from_the_beginning() -> None:
    flight = dataclasses.replace(flown(), rules_broken={"2: too deep": BEGAN + 1.5})
    flight.score.first_sighting_t = BEGAN + 2.0
    flight.score.disarm_t = BEGAN + 12.0
    flight.score.contact = Contact(BEGAN + 10.0, 0.2, 0.3, 0.1, math.pi / 180.0, on_plate=True)
    flight.score.energy_j = 4500.0
    flight.score.touch_and_climbs = 2
    result = result_of(flight, "hover", 1)
    assert (result["energy_hj"], result["touch_and_climbs"]) == (45.0, 2)
    assert result["touchdown_vertical_mps"] == 0.3
    assert result["touchdown_horizontal_mps"] == 0.1
    assert (result["time_s"], result["time_to_touchdown_s"]) == (10.0, 8.0)
    assert result["yaw_error_deg"] == pytest.approx(1.0)
    assert result["rules_broken"] == ["2: too deep (at 1.50 s)"]


def test_a_flight_without_landing_in_time_names_its_phase_and_one_to_contact_counts_as_landed() -> (
    None
):
    flight = dataclasses.replace(flown(), timed_out=True)
    assert result_of(flight, "hover", 1)["outcome"].startswith("not landed in 20 s: NOT_LANDING, ")
    flight = dataclasses.replace(flown(), ends_at_contact=True)
    flight.score.contact = Contact(BEGAN + 10.0, 0.2, 0.3, 0.1, 0.0, on_plate=True)
    result = result_of(flight, "moving", 1)
    assert (result["landed"], result["outcome"]) == (True, "touched down")


def test_a_refused_sighting_counts_in_nis_at_most_as_the_gate() -> None:
    flight = flown()
    flight.recording.nis += [3.0, 3.0, 3.0, 100.0]
    result = result_of(flight, "hover", 1)
    assert result["nis_ratio"] == pytest.approx((3.0 * 3.0 + 16.0) / 4.0 / 3.0)
    assert result["refused_percent"] == 25.0


def test_the_result_has_the_error_of_holding_if_the_flight_held() -> None:
    flight = flown()
    assert result_of(flight, "moving", 1)["hold_error_m_p95"] is None
    flight.recording.hold_errors_m += [0.01] * 96 + [0.5] * 4
    assert result_of(flight, "hold", 1)["hold_error_m_p95"] == 0.01


def test_each_phase_ends_where_the_next_begins() -> None:
    flight = flown()
    flight.recording.phases += [
        (BEGAN + 1.0, PhaseChange(Phase.APPROACH, "seen")),
        (BEGAN + 5.0, PhaseChange(Phase.DESCENT, "near")),
    ]
    phases = result_of(flight, "hover", 1)["phases"]
    assert [(p["name"], p["start"], p["end"]) for p in phases] == [
        ("NOT_LANDING", 0.0, 1.0),
        ("APPROACH", 1.0, 5.0),
        ("DESCENT", 5.0, 20.0),
    ]
