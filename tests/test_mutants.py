"""Every mutant of `make mutants`, which takes half an hour, fits the code and has its test."""

import pytest

from tests.mutants import MUTANTS, ROOT, Mutant


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.rule)
def test_every_mutants_code_and_test_exist(mutant: Mutant) -> None:
    assert (ROOT / mutant.file).read_text(encoding="utf-8").count(mutant.old) == 1
    path, _, name = mutant.test.rpartition("::")
    test = ROOT / "tests" / (path or "test_safety.py")
    assert f"def {name.partition('[')[0]}(" in test.read_text(encoding="utf-8")
