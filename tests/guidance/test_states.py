"""The table of states, read as a pilot would: nothing leads where it must not."""

import pytest

from landerd.guidance.pilot_texts import REASONS
from landerd.guidance.states import HAND_BACKS, OUTCOMES, TRANSITIONS, Event, State

FLYING = (
    State.TRACKING,
    State.SEARCHING,
    State.COMMITTED,
    State.WAVING_OFF,
    State.ON_PAD,
)


def test_every_state_has_its_row_and_every_event_its_use() -> None:
    assert set(TRANSITIONS) == set(State)
    used = {event for row in TRANSITIONS.values() for event in row}
    assert used == set(Event)
    assert {state for row in TRANSITIONS.values() for state in row.values()} == set(State)


@pytest.mark.parametrize("state", FLYING)
def test_a_closed_gate_ends_every_state_with_a_stop_where_one_is_possible(state: State) -> None:
    stops = State.STANDING if state is State.ON_PAD else State.RELEASING
    assert TRANSITIONS[state][Event.RELEASED] is stops
    assert TRANSITIONS[state][Event.RELEASED_LOW] is State.LEAVING
    assert TRANSITIONS[state][Event.SILENCED] is State.SILENT


def test_released_as_it_seems_to_touch_it_stops_as_on_the_pad() -> None:
    assert TRANSITIONS[State.COMMITTED][Event.RELEASED_TOUCHING] is State.STANDING


def test_a_vehicle_that_leaves_the_pad_is_stopped_before_landerd_is_silent() -> None:
    assert TRANSITIONS[State.LEAVING][Event.CLEAR_OF_PAD] is State.RELEASING
    assert TRANSITIONS[State.LEAVING][Event.STANDS] is State.STANDING


def test_it_begins_to_fly_only_by_seeing_the_pad() -> None:
    for state in (State.SILENT, State.RELEASING):
        for event, to in TRANSITIONS[state].items():
            assert to not in FLYING or event is Event.PAD_IN_SIGHT


def test_it_gets_onto_the_pad_only_by_commit_and_contact_or_by_turning_over() -> None:
    ways = [(state, event, to) for state, row in TRANSITIONS.items() for event, to in row.items()]
    onto = [way for way in ways if way[2] in (State.COMMITTED, State.ON_PAD)]
    onto = [way for way in onto if way[1] is not Event.TURNS_OVER]
    assert onto == [
        (State.TRACKING, Event.COMMITS, State.COMMITTED),
        (State.COMMITTED, Event.CONTACT, State.ON_PAD),
        (State.WAVING_OFF, Event.STANDS, State.ON_PAD),  # of a commit, and contact not noticed
        (State.ON_PAD, Event.NO_CONTACT, State.COMMITTED),  # of a commit, and there was none
        (State.STANDING, Event.GRANTED, State.ON_PAD),
    ]


def test_sight_plays_no_part_on_the_pad() -> None:
    assert Event.SIGHT_LOST not in TRANSITIONS[State.ON_PAD]
    assert TRANSITIONS[State.COMMITTED][Event.SIGHT_LOST] is State.WAVING_OFF


@pytest.mark.parametrize("event", HAND_BACKS)
def test_a_hand_back_stops_the_vehicle_and_says_why(event: Event) -> None:
    leads_to = {row[event] for row in TRANSITIONS.values() if event in row}
    assert leads_to == {State.RELEASING}
    assert OUTCOMES[event] == "handed_back"
    assert REASONS[event]


def test_only_disarming_on_the_pad_is_called_landed() -> None:
    assert [event for event, outcome in OUTCOMES.items() if outcome == "landed"] == [Event.DISARMED]
    assert [s for s, row in TRANSITIONS.items() if Event.DISARMED in row] == [State.ON_PAD]
