"""Which macro to try next on which failure.

Failures that nothing has recovered from come first: what recovered from others and is thought to fit, a neighbour of
that, or something random. The more of them are recovered from, the more trials teach the model where the good macros
hold: on any failure, the macro that a few trees, drawn anew for each round, believe in most (Thompson sampling), so
that what is uncertain and may be best is tried first.

Axis letters: N failures, K macros.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.chaining.search.macros import Macro, MacroSpace
from p2l.chaining.search.model import OutcomeTable, SuccessModel
from p2l.records import Array, BoolArray, IntArray

OPINION = 10  # trees that a draw asks
KNOWN, NEIGHBOUR = 0.6, 0.85  # cumulative chances of a known macro and of a neighbour; the rest is random
SPREAD = 4.0  # mean rank of the macro whose neighbour is tried
UNCERTAIN = 0.6  # share of a round that teaches the model once everything is recovered from
DEPTH = 16  # trials of each failure that macros are looked for at, before they are at further ones
FEWEST = 40  # failures that they are looked for at first
GIVE_UP = 40  # trials after which nothing more is looked for at a failure
VARIED = 0.2  # share of a round for neighbours of good macros on whatever failure, which may be better everywhere
DRAWS = 20  # of random macros for a failure, where nothing else is new


@dataclass(frozen=True)
class RoundPlan:
    """What a round may choose from.

    Attributes:
        trials: of a round, at most.
        portfolio: most macros that the model is asked about.
    """

    trials: int
    portfolio: int


Trial = tuple[int, Macro]


def propose(
    plan: RoundPlan,
    space: MacroSpace,
    table: OutcomeTable,
    model: SuccessModel | None,
    features: Array,
    rng: np.random.Generator,
) -> list[Trial]:
    """Trials of a round, none of them known or named twice; none where nothing new comes up.

    Args:
        plan: what a round may choose from.
        space: of the macros.
        table: outcomes so far.
        model: fitted to them, if they suffice.
        features: [N, F] of the failures.
        rng: draws them.
    """
    solved = table.solved(min(len(features), max(FEWEST, len(table) // DEPTH)))
    winners = table.winners(plan.portfolio)
    teaching = int(plan.trials * UNCERTAIN * solved.mean()) if winners and model is not None else 0
    tries = np.bincount(table.failure, minlength=len(features))[: len(solved)]
    hard = rng.permutation(np.flatnonzero(~solved & (tries < GIVE_UP)))[: plan.trials - teaching]
    any_ones = rng.permutation(len(features))[: plan.trials - len(hard)]
    trials: dict[Trial, None] = {}
    beliefs = model.probability(features[hard], winners) if model is not None and winners and len(hard) else None
    for row, failure in enumerate(hard.tolist()):
        macro = _hard(failure, space, table, winners, None if beliefs is None else beliefs[row], rng)
        if not table.tried(failure, macro):
            trials[failure, macro] = None
    varied = rng.permutation(len(features))[: int(plan.trials * VARIED) if winners else 0]
    for failure in varied.tolist():
        macro = space.neighbour(winners[min(int(rng.exponential(SPREAD)), len(winners) - 1)], rng)
        if not table.tried(failure, macro):
            trials[failure, macro] = None
    for failure, macro in _uncertain(any_ones[len(varied) :], table, winners, model, features, rng):
        trials[failure, macro] = None
    if not trials:  # everything that is known has been tried everywhere
        for failure in rng.permutation(len(features))[: plan.trials].tolist():
            drawn = [space.random(rng) for _ in range(DRAWS)]
            trials |= {(failure, macro): None for macro in drawn if not table.tried(failure, macro)}
    return list(trials)[: plan.trials]


def _hard(
    failure: int,
    space: MacroSpace,
    table: OutcomeTable,
    winners: list[Macro],
    scores: Array | None,
    rng: np.random.Generator,
) -> Macro:
    """A macro for a failure that nothing has recovered from."""
    chance = rng.random()
    if winners and chance < KNOWN:
        order = range(len(winners)) if scores is None else np.argsort(-scores, kind="stable").tolist()
        new = [winners[place] for place in order if not table.tried(failure, winners[place])]
        if new:
            return new[0]
    if winners and chance < NEIGHBOUR:
        return space.neighbour(winners[min(int(rng.exponential(SPREAD)), len(winners) - 1)], rng)
    return space.random(rng)


def _uncertain(
    failures: IntArray,
    table: OutcomeTable,
    winners: list[Macro],
    model: SuccessModel | None,
    features: Array,
    rng: np.random.Generator,
) -> list[Trial]:
    """For each failure the macro that a few trees believe in most, where that is not known already."""
    if model is None or not winners or not len(failures):
        return []
    trees = rng.integers(len(model.forest.estimators_), size=OPINION)
    belief = model.probability(features[failures], winners, trees)
    belief += 1e-9 * rng.random(belief.shape)
    known: BoolArray = np.array([[table.tried(int(failure), macro) for macro in winners] for failure in failures])
    best = np.where(known, -1.0, belief).argmax(axis=1)
    return [
        (int(failure), winners[place])
        for row, (failure, place) in enumerate(zip(failures, best, strict=True))
        if not known[row, place]
    ]
