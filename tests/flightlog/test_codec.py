import json
import math
import typing
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from landerd.flightlog import codec
from landerd.flightlog.contents import COMMANDS, INPUTS, State
from landerd.messages import Attitude, Landed, LandedState, Tick


@pytest.mark.long
@given(st.data())
def test_every_message_comes_back_to_the_bit(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from([*INPUTS.values(), *COMMANDS.values(), State]))
    message = data.draw(st.from_type(kind))
    encoded = codec.encode(message)
    again = codec.decode(kind, encoded)
    assert repr(again) == repr(message)  # equality would take -0.0 for 0.0, and never nan for nan
    assert codec.encode(again) == encoded


def test_numbers_that_json_lacks_are_still_json() -> None:
    message = Attitude(math.nan, math.inf, -math.inf, -0.0, (0.1, 5e-324, 1e308))
    encoded = codec.encode(message)
    assert json.loads(encoded, parse_constant=pytest.fail)["t"] == "nan"
    again = codec.decode(Attitude, encoded)
    assert repr(again) == repr(message)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (b"{", "not JSON"),
        (b"[]", "Tick: expected an object"),
        (b"{}", "Tick: t is missing"),
        (b'{"t":1.0,"u":2}', "Tick: u is not known"),
        (b'{"t":"soon"}', "Tick.t: found 'soon', expected float"),
        (b'{"t":true}', "Tick.t: found True"),
    ],
)
def test_a_damaged_message_is_refused_with_the_wrong_field(text: bytes, names: str) -> None:
    with pytest.raises(codec.CodecError) as e:
        codec.decode(Tick, text)
    assert names in str(e.value)


def test_an_unknown_member_of_an_enumeration_is_refused() -> None:
    encoded = codec.encode(LandedState(1.0, Landed.IN_AIR)).replace(b"2", b"77")
    with pytest.raises(codec.CodecError, match=r"LandedState.state: 77 is not a Landed"):
        codec.decode(LandedState, encoded)


def test_schemas_have_the_fields_of_their_messages() -> None:
    for kind in (*INPUTS.values(), *COMMANDS.values(), State):
        schema = codec.schema(kind)
        assert set(schema["properties"]) == set(typing.get_type_hints(kind))
    position = codec.schema(INPUTS["LocalPosition"])["properties"]["position"]
    assert position == {"type": "array", "items": {"type": "number"}}


def test_a_message_with_a_value_that_is_no_message_is_refused() -> None:
    with pytest.raises(TypeError, match="complex cannot be logged"):
        codec.encode(replace(Tick(1.0), t=1j))  # type: ignore[arg-type]
