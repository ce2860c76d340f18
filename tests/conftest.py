"""Settings for all tests."""

from hypothesis import settings

# The same examples in every run, and no limit on a slow machine's time for one.
settings.register_profile("landerd", derandomize=True, deadline=None)
settings.load_profile("landerd")
