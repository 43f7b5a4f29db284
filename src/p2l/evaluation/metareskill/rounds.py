"""Tables of the rounds of training and of how choosers compare: the numbers behind figures 4.6 and 4.7.

Axis letters: I modes, M targets, T rounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from p2l.metareskill.history import History, table
from p2l.metareskill.ledger import Ledger
from p2l.records import Array

Histories = Mapping[tuple[int, str], History]
Values = Mapping[tuple[int, str], Array]  # [T + 1] to be reported, before any training first, by (seed, chooser)


def rounds_table(histories: Histories, reported: Values, targets: Sequence[str]) -> pd.DataFrame:
    """Every round of every seed and chooser: `seed, chooser, round, mode, target, reason, q_before, q_upper, …`.

    `value` is what the chooser saw; `value_reported` that on failures nobody chose by (`metareskill.reported`).
    """
    rows = [
        {"seed": seed, "chooser": chooser, **row, "value_reported": float(value)}
        for (seed, chooser), history in histories.items()
        for row, value in zip(table(history, targets), reported[seed, chooser][1:], strict=True)
    ]
    return pd.DataFrame(rows)


def queries_table(
    histories: Histories, ledgers: Mapping[int, Ledger], targets: Sequence[str], episodes: int
) -> pd.DataFrame:
    """A row per query that a chooser has asked, `episodes` in each of its rounds; a ledger may hold more.

    Columns `seed, mode, target, number, failure, solved, updates, rollouts, success, kl_nats, q`.
    `number` counts the queries of a recovery from 0, `success` is of its last update's rollouts; `kl_nats` is the
    median over the updates of how far the search distribution moved, KL(new ‖ old), NaN where none did.
    """
    asked = {
        seed: np.max([each.counts for (own, _), each in histories.items() if own == seed], axis=0) * episodes
        for seed in ledgers
    }
    rows = [
        {
            "seed": seed,
            "mode": mode,
            "target": targets[target],
            "number": number,
            "failure": entry.failure,
            "solved": entry.solved,
            "updates": len(entry.success),
            "rollouts": entry.rollouts,
            "success": float(entry.success[-1]),
            "kl_nats": float(np.median(entry.kl_nats)) if len(entry.kl_nats) else float("nan"),
            "q": entry.q,
        }
        for seed, ledger in ledgers.items()
        for (mode, target, number), entry in sorted(ledger.entries.items())
        if number < asked[seed][mode, target]
    ]
    return pd.DataFrame(rows)


def value_table(reported: Values) -> pd.DataFrame:
    """Figure 4.7: `seed, chooser, queries, value`; 0 queries are the graph before any training."""
    rows = []
    for (seed, chooser), after in reported.items():
        rows += [(seed, chooser, queries, value) for queries, value in enumerate(after.tolist())]
    return pd.DataFrame(rows, columns=["seed", "chooser", "queries", "value"])


def allocation_table(histories: Histories, targets: Sequence[str]) -> pd.DataFrame:
    """Figure 4.6, right: `seed, chooser, mode, target, trained, q`, one row per recovery."""
    rows = [
        (seed, chooser, mode, targets[target], int(count), float(history.best[mode, target]))
        for (seed, chooser), history in histories.items()
        for (mode, target), count in np.ndenumerate(history.counts)
    ]
    return pd.DataFrame(rows, columns=["seed", "chooser", "mode", "target", "trained", "q"])


def comparison_table(values: pd.DataFrame, chooser: str) -> pd.DataFrame:
    """`chooser` against every other by seed: `other, seed, final, final_other, better, share`.

    `share` is the part of the budget after which `chooser` is at least as good as the other ever becomes; NaN if never.
    """
    columns = ["other", "seed", "final", "final_other", "better", "share"]
    rows = []
    curves = {
        key: group.sort_values("queries")["value"].to_numpy() for key, group in values.groupby(["chooser", "seed"])
    }
    for (other, seed), theirs in curves.items():
        if other == chooser or (chooser, seed) not in curves:
            continue
        mine = curves[chooser, seed]
        parity = np.flatnonzero(mine >= theirs.max() - 1e-9)
        share = parity[0] / (len(mine) - 1) if len(parity) else np.nan
        rows.append((other, seed, mine[-1], theirs[-1], bool(mine[-1] > theirs[-1]), share))
    return pd.DataFrame(rows, columns=columns).sort_values(["other", "seed"], ignore_index=True)
