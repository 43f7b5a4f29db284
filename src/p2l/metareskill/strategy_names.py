"""The names of recovery strategies, apart from what they do: configurations and tables need no simulator."""

from __future__ import annotations

RECOVERIES, OPEN_LOOP = "recoveries", "open_loop"
STRATEGIES = (RECOVERIES, "retry", "to_previous", "to_start", "no_recovery", OPEN_LOOP)
