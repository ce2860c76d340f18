"""Settings for all tests."""

import gc

import pytest
from hypothesis import settings

# The same examples in every run, and no limit on a slow machine's time for one.
settings.register_profile("landerd", derandomize=True, deadline=None)
settings.load_profile("landerd")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest tests, of a page's commands, first, so that they do not start last."""
    items.sort(key=lambda item: "run_as_printed" not in item.name)


def pytest_collection_finish() -> None:
    """Exempt the collected tests, which are kept to the end, from later garbage collections."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)  # flights make many small objects: a tenth of their time went into it
