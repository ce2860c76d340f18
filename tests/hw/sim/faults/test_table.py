"""The table of faults, and what is drawn from it."""

from hypothesis import given
from hypothesis import strategies as st

from hw.sim.fault_options import FAULTS, FaultOptions, OnsetOptions
from hw.sim.faults.draw import as_setting, draw_faults
from hw.sim.faults.strangers import PARAMETERS
from hw.sim.faults.table import EFFECTS
from landerd.config.files import config_dir
from landerd.config.parameters import parameters
from landerd.devices import sim_options
from landerd.drivers import read_configuration


def test_every_fault_of_the_table_can_happen() -> None:
    assert EFFECTS.keys() == FAULTS.keys()


@given(st.integers(0, 10**6))
def test_the_printed_setting_flies_the_same_faults_again(seed: int) -> None:
    drawn = draw_faults(seed)
    loaded = read_configuration(config_dir() / "default.yaml", overrides=[as_setting(drawn)])
    assert list(sim_options(loaded).faults) == drawn


def test_every_fault_is_drawn_alone_and_in_pairs() -> None:
    flights = [draw_faults(seed) for seed in range(4000)]
    for count in (1, 2):
        drawn = {fault.fault for faults in flights if len(faults) == count for fault in faults}
        assert drawn == FAULTS.keys()


def test_low_faults_begin_in_the_last_half_metre_or_just_after_commit() -> None:
    drawn = [fault for seed in range(2000) for fault in draw_faults(seed, low=True)]
    assert {fault.fault for fault in drawn} == FAULTS.keys()
    for at in (fault.at for fault in drawn):
        is_low = at.height_m is not None and at.height_m <= 0.5
        assert is_low or at.phase == "LANDED"
        assert at.after_s <= 3.8  # of a second fault up to 3 s more


def test_the_false_ground_station_changes_parameters_that_there_are() -> None:
    assert {name.decode() for name in PARAMETERS} <= parameters().keys()


def test_a_fault_with_lasting_effects_never_counts_as_over() -> None:
    at = OnsetOptions(time_s=1.0)
    assert FaultOptions(fault="gimbal-slipping", at=at, for_s=0.5).lasts_s is None
    assert FaultOptions(fault="gimbal-offset", at=at, for_s=0.5).lasts_s == 0.5
