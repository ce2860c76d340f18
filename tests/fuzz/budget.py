"""Number of fuzzing examples: always the same ones in the tests, many others by `make fuzz`."""

import os

from hypothesis import HealthCheck, settings

LONGER = int(os.environ.get("LANDERD_FUZZ", "1"))


def examples(count: int) -> settings:
    """Return the settings of a fuzzing test with so many examples in an ordinary run."""
    return settings(
        max_examples=count * LONGER,
        derandomize=LONGER == 1,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    )
