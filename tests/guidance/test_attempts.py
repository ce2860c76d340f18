from landerd.config.models import LostSection
from landerd.guidance.attempts import Attempts


def test_only_descents_broken_off_count_until_they_are_reset() -> None:
    attempts = Attempts(LostSection(retries=1))
    for is_descent in (True, False, False):
        attempts.break_off(is_descent=is_descent)
    assert not attempts.tried_enough
    attempts.break_off(is_descent=True)
    assert attempts.tried_enough
    assert attempts.aborts == 4
    attempts.forgive()
    assert not attempts.tried_enough
    assert attempts.aborts == 4


def test_a_landings_time_runs_from_its_first_beginning_until_commit() -> None:
    attempts = Attempts(LostSection(total_s=60.0))
    assert not attempts.takes_too_long(1e6)
    attempts.begin(10.0)
    attempts.begin(50.0)  # sight was lost meanwhile
    assert not attempts.takes_too_long(69.0)
    assert attempts.takes_too_long(71.0)
    attempts.end()
    assert not attempts.takes_too_long(71.0)


def test_the_first_outcome_stays() -> None:
    attempts = Attempts(LostSection())
    attempts.finish("touchdown_unconfirmed")
    attempts.finish("handed_back")
    assert attempts.outcome == "touchdown_unconfirmed"
