"""The names of recovery strategies, apart from what they do: a configuration is checked without a simulator."""

from __future__ import annotations

STRATEGIES = ("recoveries", "retry", "to_previous", "to_start", "no_recovery", "open_loop")
