"""Success rates of episodes of the whole robot (thesis, table 5.1)."""

from __future__ import annotations

from typing import Any

import pandas as pd

from p2l.evaluation.statistics import wilson_interval


def totals(episodes: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Rates of one learner with 95 % Wilson intervals: overall success, that of the nominal skills, and of recoveries.

    A learner of the whole task has the first alone.

    Args:
        episodes: rows of `p2l.chaining.episodes.episodes_of_seed`.
    """
    sound = episodes[~episodes["diverged"]]
    flagged = sound[sound["flagged"]]
    parts = {
        "success": (sound["success"], len(sound)),
        "nominal": (sound["nominal"], len(sound)),
        "recovery": (flagged["success"], len(flagged)),
    }
    if episodes["whole_task"].all():
        del parts["nominal"], parts["recovery"]
    return {name: _rate(int(good.sum()), count) for name, (good, count) in parts.items()}


def _rate(successes: int, trials: int) -> dict[str, Any]:
    low, high = wilson_interval(successes, trials)
    return {"mean": successes / max(trials, 1), "low": float(low), "high": float(high), "n": trials}
