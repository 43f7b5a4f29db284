"""Readings: the claims of chapter 4 beside what our results give for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from p2l.evaluation.page.page import Agreement, Reading

PROMISING = 5  # "a small number of promising recoveries"
Claims = Mapping[tuple[str, str], str]


def read_preconditions(claim: str, cell: Mapping[Any, Mapping[Any, Any]], samples: int) -> Reading:
    """How many samples, and the accuracy of each skill's precondition."""
    accuracies = [
        f"{skill.replace('_', ' ')} {row['value']:.2f} [{row['low']:.2f}, {row['high']:.2f}]"
        for (skill, metric), row in cell.items()
        if metric == "accuracy"
    ]
    return Reading(claim, f"{samples} samples; accuracy on those held out: {', '.join(accuracies)}.")


def read_saturation(claims: Claims, values: pd.DataFrame) -> list[Reading]:
    """Whether the value of failures hardly rises any more under round-robin, from `seed, chooser, queries, value`."""
    mine = values[values["chooser"] == "round_robin"].groupby("queries")["value"].mean().to_numpy()
    if len(mine) < 2:
        return []
    gains = mine - mine[0]
    if gains[-1] <= 0.0:
        text, agrees = "Round-robin improves nothing within the budget.", _grade(False, False)
    else:
        share = float(np.argmax(gains >= 0.9 * gains[-1])) / (len(mine) - 1)
        text, agrees = f"Round-robin has 90 % of what it gains after {share:.0%} of the budget.", _grade(*_early(share))
    return [Reading(claims["figure_4_6", "saturates"], text, agrees)]


def _early(share: float) -> tuple[bool, bool]:
    return share <= 0.5, share <= 0.75


def read_allocation(claims: Claims, allocation: pd.DataFrame) -> list[Reading]:
    """Whether MetaReSkill concentrates on few recoveries, from `seed, chooser, mode, target, trained, q`."""
    shares: dict[str, list[float]] = {}
    for (chooser, _), part in allocation.groupby(["chooser", "seed"], sort=False):
        counts = np.sort(part["trained"].to_numpy())[::-1]
        shares.setdefault(str(chooser), []).append(counts[:PROMISING].sum() / counts.sum())
    if not {"metareskill", "round_robin"} <= set(shares):
        return []
    ours, theirs = (float(np.mean(shares[name])) for name in ("metareskill", "round_robin"))
    text = (
        f"MetaReSkill spends {ours:.0%} of its rounds, the initial ones included, on its {PROMISING} most trained "
        f"recoveries of {len(allocation[['mode', 'target']].drop_duplicates())}, round-robin {theirs:.0%}."
    )
    return [Reading(claims["figure_4_6", "allocation"], text, _grade(ours > 1.25 * theirs, ours > theirs))]


def read_predictions(rounds: pd.DataFrame) -> Reading:
    """The gain in value that the chooser's upper limits predict per round beside the gain that was measured."""
    values = rounds.assign(before=rounds.groupby("seed")["value"].shift())
    choices = values[values["predicted"].notna() & values["before"].notna()]
    if choices.empty:
        return Reading("", "No round was decided by an upper limit: the budget is that of the initial rounds.")
    prediction, gain = ((choices[name] - choices["before"]).mean() for name in ("predicted", "value"))
    text = (
        f"In {len(choices)} rounds after the initial ones the upper limits promise {prediction:+.3f} each on average "
        f"and bring {gain:+.3f}; {choices['solved'].mean():.0%} of their queries are solved."
    )
    return Reading("", text)


def _grade(full: bool, partly: bool) -> Agreement:
    return "yes" if full else "partly" if partly else "no"
