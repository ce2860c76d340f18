"""The pilot is warned of sightings that are refused or late, before the pad is lost."""

from dataclasses import replace

import pytest

from landerd.config.models import Config
from landerd.geometry import add
from landerd.guidance import pilot_texts
from landerd.messages import Phase, PoseSolution, RcChannels
from tests.scripted_flight import HIGH, LOW, Flight

pytestmark = pytest.mark.long

WORDS = (pilot_texts.MANY_REFUSED, pilot_texts.LATE_PICTURES)


def told(flight: Flight, words: str) -> int:
    return sum(text == pilot_texts.PREFIX + words for text in flight.texts)


def test_a_normal_landing_gives_the_pilot_no_warning() -> None:
    flight = Flight().engaged().until_contact()
    assert [told(flight, words) for words in WORDS] == [0, 0]


def test_the_pilot_is_warned_if_every_third_sighting_is_refused() -> None:
    flight = Flight().engaged()
    count = 0

    def now_and_again_aside(true: PoseSolution) -> PoseSolution:
        nonlocal count
        count += 1
        aside = (2.0, 0.0, 0.0) if count % 3 == 0 else (0.0, 0.0, 0.0)
        return replace(true, position=add(true.position, aside))

    flight.distort = now_and_again_aside
    flight.run(2.0)
    assert told(flight, pilot_texts.MANY_REFUSED) == 1  # and not again for a while
    assert flight.lander.phase is not Phase.NOT_LANDING
    assert flight.lander.aborts == 0


def test_the_pilot_is_warned_of_late_pictures_while_it_still_flies_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tests.scripted_flight.LATE_TICKS", 14)  # 0.35 s
    flight = Flight().engaged()
    flight.run(2.0)
    assert told(flight, pilot_texts.LATE_PICTURES) == 1
    assert flight.lander.aborts == 0


def test_pictures_too_late_to_be_used_are_not_reported_as_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = Flight().engaged()
    flight.run(1.0)
    monkeypatch.setattr("tests.scripted_flight.LATE_TICKS", 40)  # 1 s
    flight.run(2.5)
    assert flight.lander.phase is Phase.NOT_LANDING
    assert pilot_texts.OLD_PICTURES in flight.lander.reason


def test_the_pilot_is_told_if_the_autopilot_does_not_fly_as_ordered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ArduCopter with GUID_OPTIONS 32 reports that it obeys, and drifts."""
    ignored = "off its orders: autopilot?"
    flight = Flight().engaged().until_contact()
    assert not any(text.endswith(ignored) for text in flight.texts)
    flight = Flight().engaged()
    monkeypatch.setattr("tests.scripted_flight.VELOCITY_LAG_S", 1e6)
    flight.run(8.0)
    told = [text for text in flight.texts if text.endswith(ignored)]
    assert len(told) == 1
    assert float(told[0].split()[2]) > 1.0  # m/s


def test_why_it_does_not_begin_although_it_may_is_told_again_and_again() -> None:
    """Over a slow link the pilot read "attitude is stale" once, and then nothing for 74 s."""
    flight = Flight()
    flight.visible = False
    flight.run(1.1)
    flight.pulse_us = HIGH
    flight.run(25.0)
    told = [text for text in flight.texts if text == "landerd: pad not in sight"]
    assert 3 <= len(told) <= 4
    flight.pulse_us = LOW
    flight.run(25.0)
    assert flight.texts.count("landerd: RC 11 is low") <= 2  # before and after


def test_a_climb_rate_that_the_height_contradicts_is_not_flown_down_on() -> None:
    """ArduCopter with accelerometers off by 1 m/s^2 believed to hover, and fell at 6 m/s."""
    flight = Flight().engaged().until(Phase.DESCENT)
    flight.told_to_sink = 1.5
    flight.run(3.0)
    assert pilot_texts.WRONG_CLIMB_RATE in flight.lander.reason
    height = flight.height
    assert all(order.velocity[2] <= 0.0 for order in flight.run(2.0))
    assert flight.height > height
    flight.told_to_sink = 0.0
    flight.until_contact()


def test_a_climb_rate_that_is_a_little_off_is_landed_with() -> None:
    flight = Flight().engaged()
    flight.told_to_sink = 0.2
    flight.until_contact()
    assert flight.lander.aborts == 0


def test_a_vehicle_that_sinks_by_a_wrong_climb_rate_is_held_at_its_height_by_sight() -> None:
    """ArduCopter with accelerometers off the other way touched at 0.9 m/s, ordered to climb.

    The order that holds its height by telemetry does not hold it; the pad in sight shows what does.
    """
    flight = Flight().engaged().until(Phase.DESCENT)
    while flight.height > 6.0:
        flight.run(0.1)
    flight.told_to_sink = -0.9
    while pilot_texts.WRONG_CLIMB_RATE not in flight.lander.reason:
        flight.tick()
    flight.run(1.0)  # it sank with what it was ordered before
    height = flight.height
    assert height > 2.0
    flight.run(8.0)
    assert flight.height > height - 0.2
    assert flight.contact_t is None
    flight.silent.add(RcChannels)  # for a moment: then zero velocity was ordered until it struck
    flight.run(0.7)
    flight.silent.clear()
    flight.run(5.0)
    assert flight.height > height - 1.5
    assert flight.contact_t is None
    flight.told_to_sink = 0.0
    flight.until_contact()
    assert flight.lander.aborts == 1


def test_a_vehicle_on_the_pad_with_a_wrong_climb_rate_stays_there() -> None:
    flight = Flight().engaged().until(Phase.DESCENT)
    flight.told_to_sink = -2.5
    while flight.contact_t is None:
        flight.run(0.1)
    assert pilot_texts.WRONG_CLIMB_RATE in flight.lander.reason
    flight.run(1.5)
    assert flight.lander.phase is Phase.LANDED


@pytest.mark.parametrize(
    ("offset_s", "words"), [(0.5, "pictures come too late"), (-0.3, "but no telemetry")]
)
def test_a_pad_in_pictures_of_another_time_is_not_said_to_be_out_of_sight(
    offset_s: float, words: str
) -> None:
    flight = Flight(config=Config.model_validate({"camera": {"clock_offset_s": offset_s}}))
    flight.run(1.1)
    flight.pulse_us = HIGH
    flight.run(2.0)
    assert words in flight.lander.reason
    assert not any("not in sight" in text for text in flight.texts), flight.texts
