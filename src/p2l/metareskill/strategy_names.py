"""The names of recovery strategies, apart from what they do: configurations and tables need no simulator."""

from __future__ import annotations

RECOVERIES, REPEATING, OPEN_LOOP = "recoveries", "recoveries_repeating", "open_loop"
LEARNT = (RECOVERIES, REPEATING)  # depend on a training
STRATEGIES = (RECOVERIES, "retry", "to_previous", "to_start", "no_recovery", REPEATING, OPEN_LOOP)
