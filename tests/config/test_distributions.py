"""Values drawn by the simulator's seed: what is drawn, reported and refused."""

import statistics
from collections.abc import Sequence
from pathlib import Path

import pytest

from hw.sim.options import SimOptions
from landerd.config.files import ConfigError, Loaded, config_dir
from landerd.drivers import read_configuration


def world(path: Path, *overrides: str, seed: int = 1) -> Loaded:
    return read_configuration(path, overrides=overrides, seed=seed)


def wind(loaded: Loaded) -> float:
    sim = loaded.options["sim"]
    assert isinstance(sim, SimOptions)
    return sim.wind.speed_mps


DEFAULT = config_dir() / "default.yaml"


def drawn(override: str, seeds: Sequence[int] = range(200)) -> list[float]:
    return [wind(world(DEFAULT, f"sim.wind.speed_mps={override}", seed=seed)) for seed in seeds]


def test_each_seed_draws_its_own_value_and_the_same_one_again() -> None:
    values = drawn("{uniform: [2, 8]}", range(40))
    assert all(2.0 <= value <= 8.0 for value in values)
    assert min(values) < 3.0
    assert max(values) > 7.0
    assert len(set(values)) == 40
    assert drawn("{uniform: [2, 8]}", range(40)) == values


def test_normal_is_cut_off_at_three_sigma_so_that_bounds_hold() -> None:
    values = drawn("{normal: [6, 2]}")
    assert statistics.mean(values) == pytest.approx(6.0, abs=0.5)
    assert statistics.stdev(values) == pytest.approx(2.0, rel=0.2)
    assert all(0.0 <= value <= 12.0 for value in values)


def test_log_uniform_spreads_evenly_over_the_decades() -> None:
    values = drawn("{log_uniform: [0.1, 10]}")
    assert sum(value < 1.0 for value in values) == pytest.approx(100, abs=25)


def test_a_choice_may_be_of_words_and_a_sign_goes_either_way() -> None:
    sims = [
        world(
            DEFAULT,
            "sim.vehicle={choice: [reference, fast]}",
            "sim.camera.clock_offset_s={sign: 0.02}",
            seed=seed,
        )
        for seed in range(20)
    ]
    assert {loaded.world["sim.vehicle"] for loaded in sims} == {"reference", "fast"}
    assert {loaded.world["sim.camera.clock_offset_s"] for loaded in sims} == {0.02, -0.02}


def test_one_more_distribution_does_not_change_what_is_drawn_for_other_keys() -> None:
    one = world(DEFAULT, "sim.wind.speed_mps={uniform: [2, 8]}").world
    two = world(
        DEFAULT,
        "sim.wind.speed_mps={uniform: [2, 8]}",
        "sim.start.position_m=[{uniform: [-30, -20]}, 0]",
    ).world
    assert two["sim.wind.speed_mps"] == one["sim.wind.speed_mps"]
    assert -30.0 <= two["sim.start.position_m.0"] <= -20.0


def test_a_file_laid_over_replaces_a_distribution_and_does_not_mix_with_it(tmp_path: Path) -> None:
    below, above = tmp_path / "below.yaml", tmp_path / "above.yaml"
    below.write_text(f"include: [{DEFAULT}]\nsim: {{wind: {{speed_mps: {{uniform: [2, 8]}}}}}}\n")
    above.write_text("include: [below.yaml]\nsim: {wind: {speed_mps: {choice: [5]}}}\n")
    assert wind(world(above)) == 5.0
    assert wind(world(above, "sim.wind.speed_mps=1")) == 1.0


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("{uniform: [8, 2]}", "uniform: found a list of 2, expected [least, most]"),
        ("{uniform: 3}", "uniform: found 3, expected [least, most]"),
        ("{normal: [1]}", "normal: found a list of 1, expected [mean, sigma]"),
        ("{log_uniform: [0, 1]}", "expected [least, most], above 0"),
        ("{choice: []}", "choice: found a list of 0, expected a list of values"),
        ("{uniform: [50, 60]}", "expected a number at least 0 and at most 40"),
        ("{choice: [calm]}", "expected a number at least 0 and at most 40"),
        ("{gauss: [1, 2]}", "found a block of keys, expected a number"),
    ],
)
def test_a_distribution_that_cannot_be_drawn_from_is_a_fault_with_its_line(
    tmp_path: Path, value: str, said: str
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"include: [{DEFAULT}]\nsim:\n  wind:\n    speed_mps: {value}\n")
    with pytest.raises(ConfigError) as error:
        world(path)
    assert "mine.yaml:4: sim.wind.speed_mps" in str(error.value)
    assert said in str(error.value)


def test_only_keys_of_the_simulated_world_may_be_distributions(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"include: [{DEFAULT}]\nguidance: {{release_s: {{uniform: [0, 1]}}}}\n")
    with pytest.raises(ConfigError, match=r"guidance\.release_s: found a block of keys"):
        world(path)
