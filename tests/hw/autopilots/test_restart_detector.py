from hw.autopilots.boot_clock import WRAP_S
from hw.autopilots.restart_detector import Boot, RestartDetector


def test_boot_times_that_go_on_or_come_late_are_of_the_same_boot() -> None:
    detector = RestartDetector()
    assert [detector.hear(100.0 + s, s) for s in (0.0, 1.0, 0.5, 2.0)] == [Boot.SAME] * 4


def test_boot_times_that_went_back_twice_are_a_restart_and_an_answer_at_once() -> None:
    detector = RestartDetector()
    detector.hear(100.0, 0.0)
    assert detector.hear(3.0, 1.0) is Boot.UNKNOWN
    assert detector.hear(3.1, 1.1) is Boot.NEW
    assert detector.hear(3.2, 1.2) is Boot.SAME
    assert detector.hear(0.5, 2.0, is_answer=True) is Boot.NEW


def test_a_wrapped_boot_time_is_recognised_by_an_answer() -> None:
    detector = RestartDetector()
    detector.hear(100.0, 0.0)
    assert detector.hear(WRAP_S + 101.0, 1.0, is_answer=True) is Boot.WRAPPED
    assert detector.hear(WRAP_S + 102.0, 2.0) is Boot.SAME
