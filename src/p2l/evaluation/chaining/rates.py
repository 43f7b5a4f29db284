"""Success rates of episodes of the whole robot (thesis, table 5.1)."""

from __future__ import annotations

from typing import Any

import pandas as pd

from p2l.evaluation.rows import Row, rate_row, trained_row


def totals(episodes: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Rates of one learner with 95 % intervals: overall success, that of the nominal skills, and of recoveries.

    The first and the last depend on trainings (`statistics.rate_interval`), the nominal skills on none (Wilson's). A
    learner of the whole task has the first alone.

    Args:
        episodes: rows of `p2l.chaining.episodes.episodes_of_seed`.
    """
    sound = episodes[~episodes["diverged"]]
    flagged = sound[sound["flagged"]]
    rows = [trained_row("", "", "success", sound["success"], sound["seed"])]
    if not episodes["whole_task"].all():
        rows.append(rate_row("", "", "nominal", int(sound["nominal"].sum()), len(sound)))
        rows.append(trained_row("", "", "recovery", flagged["success"], flagged["seed"]))
    return {row[2]: _plain(row) for row in rows}


def _plain(row: Row) -> dict[str, Any]:
    *_, mean, low, high, n = row
    return {"mean": mean, "low": low, "high": high, "n": n} if n else {"mean": 0.0, "low": 0.0, "high": 1.0, "n": 0}
