"""Episodes of the whole robot, one row each, and what they add up to (thesis, table 5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from p2l.evaluation.statistics import wilson_interval
from p2l.recoveries.chaining.execute import Overall
from p2l.recoveries.chaining.policy import Card
from p2l.recoveries.chaining.pool import action_names
from p2l.skills.option import Option


def episode_rows(found: Overall, card: Card, nominal: Sequence[Option]) -> pd.DataFrame:
    """One row per episode.

    Returns:
        learner, seed, episode; `nominal`: the nominal skills did it alone; `flagged`: the policy took over; `success`;
        `diverged`; `steps`: control steps of the recovery; `actions`: its decisions, joined by `;`.
    """
    own = tuple(name for name in card.actions if not name.startswith("from "))
    names = (*own, *action_names((), nominal))
    count = len(found.success)
    steps, actions = np.zeros(count, dtype=np.int64), np.full(count, "", dtype=object)
    steps[found.flagged] = found.recovered.steps
    actions[found.flagged] = [
        ";".join(names[action] for action in row if action >= 0) for row in found.recovered.actions.tolist()
    ]
    told = {name: getattr(found, name) for name in ("nominal", "flagged", "success", "diverged")}
    rows = pd.DataFrame({"episode": np.arange(count), **told, "steps": steps, "actions": actions.astype(str)})
    return rows.assign(learner=card.learner, seed=card.seed)[["learner", "seed", *rows.columns]]


def totals(episodes: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Rates with 95 % Wilson intervals: overall success, that of the nominal skills, and of recoveries."""
    sound = episodes[~episodes["diverged"]]
    flagged = sound[sound["flagged"]]
    parts = {
        "success": (sound["success"], len(sound)),
        "nominal": (sound["nominal"], len(sound)),
        "recovery": (flagged["success"], len(flagged)),
    }
    return {name: _rate(int(good.sum()), count) for name, (good, count) in parts.items()}


def _rate(successes: int, trials: int) -> dict[str, Any]:
    low, high = wilson_interval(successes, trials)
    return {"mean": successes / max(trials, 1), "low": float(low), "high": float(high), "n": trials}
