"""Settings that all tests share."""

import signal

from hypothesis import settings

# A shell that puts `make test &` into the background lets it, and all that it starts, ignore Ctrl-C; tests send one.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests share their machine with other work, so the clock decides nothing, and the same commit draws the same examples.
settings.register_profile("p2l", deadline=None, derandomize=True)
settings.load_profile("p2l")
