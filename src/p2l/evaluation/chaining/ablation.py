"""Recoveries under other state uncertainty, or from other observations (thesis, section 5.4.2).

"In our ablation studies with different amounts of state uncertainty, we found that the policy tends to be more
conservative and learns relatively open-loop policies under high uncertainty"; and the number of past actions "was
crucial". The thesis gives no numbers. Each variant's policies are trained and evaluated in the variant itself.

Readings of the thesis:
1. Conservative: more primitives before control is handed back, `primitives`.
2. Open loop: the action depends on the number of the decision alone. `open_loop` is the share of decisions
   that are the commonest one at their number; 1 = the same sequence after every failure.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from p2l.evaluation.chaining.rates import totals
from p2l.evaluation.rows import Row, interval_row, table_of
from p2l.evaluation.statistics import t_interval
from p2l.evaluation.thesis import Thesis

TABLE = "ablation_5"
OWN = "as_given"  # the world as it is configured


def ablation_5(world: str, episodes: Mapping[str, pd.DataFrame], thesis: Thesis) -> pd.DataFrame:
    """Success of every variant over its trainings, and how its policies act.

    Intervals are `statistics.rate_interval`'s, and t limits over the trainings.

    Args:
        world: configured.
        episodes: rows of `p2l.chaining.episodes`, by variant; without another variant than `OWN` the table is empty.
        thesis: for the column of its numbers.
    """
    rows: list[Row] = []
    for variant, table in episodes.items() if set(episodes) - {OWN} else ():
        setting = f"world={world};variant={variant}"
        for learner, part in table.groupby("learner", sort=False):
            rates = totals(part)
            for name in ("nominal", "success", "recovery"):
                rate = rates[name]
                mean = rate["mean"] if rate["n"] else np.nan
                rows.append((str(learner), setting, name, mean, rate["low"], rate["high"], int(rate["n"])))
            by_seed = [one for _, one in part[part["flagged"]].groupby("seed")]
            for name, measure in (("primitives", primitives), ("open_loop", open_loop)):
                if by_seed:
                    interval = t_interval([measure(one["actions"]) for one in by_seed])
                    rows.append(interval_row(str(learner), setting, name, interval))
    return thesis.beside(table_of(rows), TABLE)


def primitives(actions: pd.Series) -> float:
    """Mean number of primitives of a recovery, from sequences joined by `;`."""
    return float(np.mean([sum(not name.startswith("from ") for name in text.split(";")) for text in actions]))


def open_loop(actions: pd.Series) -> float:
    """Share of decisions that are the commonest at their number, from sequences joined by `;`."""
    sequences = [text.split(";") for text in actions]
    at = [[one[k] for one in sequences if len(one) > k] for k in range(max(len(one) for one in sequences))]
    return sum(max(names.count(name) for name in set(names)) for names in at) / sum(len(names) for names in at)
