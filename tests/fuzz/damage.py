"""Damages bytes, for fuzzing the readers of files."""

from collections.abc import Callable

from hypothesis import strategies as st

_Edit = tuple[str, float, bytes]
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["set", "cut", "insert", "double"]),
        st.floats(0.0, 1.0, exclude_max=True),
        st.binary(min_size=1, max_size=24),
    ),
    min_size=1,
    max_size=6,
)


def damaged(data: bytes, edits: list[_Edit]) -> bytes:
    """Return data after edits, each at a share of its length."""
    ways: dict[str, Callable[[bytes, int, bytes], bytes]] = {
        "set": lambda d, at, new: d[:at] + new + d[at + len(new) :],
        "cut": lambda d, at, new: d[:at] + d[at + len(new) ** 2 :],
        "insert": lambda d, at, new: d[:at] + new + d[at:],
        "double": lambda d, at, new: d[: at + len(new)] + d[at:],
    }
    for way, share, new in edits:
        data = ways[way](data, int(share * len(data)), new)
    return data
