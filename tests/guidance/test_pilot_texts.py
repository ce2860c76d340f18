"""Texts to the pilot must fit a STATUSTEXT: what is cut off would be missing."""

import pytest

from landerd.guidance import pilot_texts
from landerd.guidance.states import HAND_BACKS, Event
from landerd.messages import Phase

WIDEST = {
    "mode": "AUTOROTATE",
    "channel": 18,
    "speed": 9.99,
    "distance": 99.94,
    "height": 99.94,
    "lean": 59.9,
    "error": 179.9,
    "ordered": 15.0,
    "flown": 99.0,
    "id": 999,
    "known": 99.9,
    "radius": 99.9,
    "off": 99.9,
    "what": pilot_texts.SEARCHING,
}
BLIND_REASONS = (
    *pilot_texts.STALE.values(),
    pilot_texts.NO_PICTURES,
    pilot_texts.OLD_PICTURES,
    pilot_texts.NOT_IN_SIGHT,
    pilot_texts.NOT_BELIEVED,
    pilot_texts.UNPLACED,
    pilot_texts.OTHER_PAD.format(id=999),
)
TEXTS = [
    value
    for name, value in vars(pilot_texts).items()
    if name.isupper()
    and isinstance(value, str)
    and "{why}" not in value
    and "{reason}" not in value
]


def line(text: str) -> str:
    return pilot_texts.PREFIX + text


@pytest.mark.parametrize("text", [*TEXTS, *pilot_texts.REASONS.values()])
def test_every_line_is_short_plain_text(text: str) -> None:
    said = line(text.format(**WIDEST))
    assert said.isascii()
    assert len(said) <= pilot_texts.MAX_CHARACTERS


@pytest.mark.parametrize("what", [pilot_texts.SEARCHING, pilot_texts.CLIMBING_AWAY])
@pytest.mark.parametrize("why", BLIND_REASONS)
def test_a_text_on_a_lost_pad_fits_with_both_its_parts(why: str, what: str) -> None:
    said = line(pilot_texts.BLIND.format(why=why, what=what))
    assert len(said) <= pilot_texts.MAX_CHARACTERS


@pytest.mark.parametrize("source", ["attitude", "position"])
def test_a_text_on_data_that_come_too_seldom_fits(source: str) -> None:
    said = line(pilot_texts.NOW_AND_THEN.format(why=pilot_texts.STALE[source]))
    assert len(said) <= pilot_texts.MAX_CHARACTERS


@pytest.mark.parametrize("event", HAND_BACKS)
def test_a_hand_back_fits_with_its_reason(event: Event) -> None:
    said = line(pilot_texts.HANDED_BACK.format(reason=pilot_texts.REASONS[event]))
    assert len(said) <= pilot_texts.MAX_CHARACTERS


@pytest.mark.parametrize("phase", [p for p in Phase if p is not Phase.NOT_LANDING])
def test_a_phase_and_where_the_pad_is_fit(phase: Phase) -> None:
    name = phase.value.replace("_", " ").lower()
    for text in (pilot_texts.UNDER_WAY, pilot_texts.TURNING):
        assert len(line(f"{name}: {text.format(**WIDEST)}")) <= pilot_texts.MAX_CHARACTERS
