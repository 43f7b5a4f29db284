"""Settings that all tests share."""

from hypothesis import settings

# Tests share their machine with other work, so the clock decides nothing, and the same commit draws the same examples.
settings.register_profile("p2l", deadline=None, derandomize=True)
settings.load_profile("p2l")
