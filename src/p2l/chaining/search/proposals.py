"""Which macro to try next on which failure.

Failures that nothing has recovered from come first: what recovered from others and is thought to fit, a neighbour of
that, or something random. The more of them are recovered from, the more trials teach the model where the good macros
hold: on any failure, the macro that a few trees, drawn anew for each round, believe in most (Thompson sampling), so
that what is uncertain and may be best is tried first. Of every round, shares go to what may be better everywhere:
macros that were never tried, neighbours, and a race of those that have recovered from something and of all short ones;
without them a search stays with the first macros that happened to help, or forgets a short one that helps on a third of
the failures because it did not on the first. Of several new macros that are drawn, the trees pick one.

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
UNCERTAIN = 0.6  # share of a round that teaches the model once everything is recovered from
DEPTH = 16  # trials of each failure that macros are looked for at, before they are at further ones
FEWEST = 40  # failures that they are looked for at first
GIVE_UP = 40  # trials after which nothing more is looked for at a failure
VARIED, RACED, RANDOM = 0.2, 0.2, 0.15  # shares of a round, on whatever failure: neighbours, known ones, random ones
YOUNG, RACED_AT_FIRST = 600, 0.5  # trials of a search until which more are of the race
CHOICE = 8  # new macros of which the model picks one
FARTHER = 0.3  # chance of one change more in a neighbour
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
    others = _for_whatever_failure(plan, space, table, winners, len(features) if winners else len(solved), rng)
    left = plan.trials - max(len(others), teaching)
    hard = rng.permutation(np.flatnonzero(~solved & (tries < GIVE_UP)))[:left]
    any_ones = rng.permutation(len(features))[: plan.trials - len(hard) - len(others)]
    trials: dict[Trial, None] = {}
    beliefs = model.probability(features[hard], winners) if model is not None and winners and len(hard) else None
    drawn = [
        (failure, _hard(failure, space, table, winners, None if beliefs is None else beliefs[row], rng))
        for row, failure in enumerate(hard.tolist())
    ]
    for failure, macro in _picked([*drawn, *others], model, features, rng):
        if not table.tried(failure, macro):
            trials[failure, macro] = None
    for failure, macro in _uncertain(any_ones, table, winners, model, features, rng):
        trials[failure, macro] = None
    if not trials:  # everything that is known has been tried everywhere
        for failure in rng.permutation(len(features))[: plan.trials].tolist():
            some = [space.random(rng) for _ in range(DRAWS)]
            trials |= {(failure, macro): None for macro in some if not table.tried(failure, macro)}
    return list(trials)[: plan.trials]


def _hard(
    failure: int,
    space: MacroSpace,
    table: OutcomeTable,
    winners: list[Macro],
    scores: Array | None,
    rng: np.random.Generator,
) -> list[Macro]:
    """Macros of which to try one on a failure that nothing has recovered from."""
    chance = rng.random()
    if winners and chance < KNOWN:
        order = range(len(winners)) if scores is None else np.argsort(-scores, kind="stable").tolist()
        new = [winners[place] for place in order if not table.tried(failure, winners[place])]
        if new:
            return new[:1]
    if winners and chance < NEIGHBOUR:
        return _neighbours(space, table, winners, rng)
    return [space.random(rng) for _ in range(CHOICE)]


def _for_whatever_failure(
    plan: RoundPlan,
    space: MacroSpace,
    table: OutcomeTable,
    winners: list[Macro],
    failures: int,
    rng: np.random.Generator,
) -> list[tuple[int, list[Macro]]]:
    """In search of a macro that is better everywhere: random ones, neighbours, and a race of known and short ones.

    Each is of any failure, so that few of them leave every kind its share. A short macro races though it has never
    recovered from anything: one failure tells little of it, and what recovers from many is most often short.
    """
    racing = list(dict.fromkeys([*winners, *space.short()]))
    shares = {"known": RACED_AT_FIRST if len(table) < YOUNG else RACED}
    if winners:
        shares |= {"neighbour": VARIED, "random": RANDOM}
    trials: list[tuple[int, list[Macro]]] = []
    for kind, share in shares.items():
        for failure in rng.integers(failures, size=int(plan.trials * share)).tolist():
            if kind == "known":
                new = [macro for macro in racing if not table.tried(failure, macro)]
                macros = [promising(table, new or racing, rng)]
            elif kind == "neighbour":
                macros = _neighbours(space, table, winners, rng)
            else:
                macros = [space.random(rng) for _ in range(CHOICE)]
            trials.append((failure, macros))
    return trials


def _picked(
    drawn: list[tuple[int, list[Macro]]], model: SuccessModel | None, features: Array, rng: np.random.Generator
) -> list[Trial]:
    """Of the macros that were drawn for a trial, the one that a few trees believe in most; without them the first."""
    if model is None or not drawn:
        return [(failure, macros[0]) for failure, macros in drawn]
    trees = rng.integers(len(model.forest.estimators_), size=OPINION)
    failures = np.repeat([failure for failure, _ in drawn], [len(macros) for _, macros in drawn])
    belief = model.of_pairs(features[failures], [macro for _, macros in drawn for macro in macros], trees)
    belief += 1e-9 * rng.random(len(belief))
    parts = np.split(belief, np.cumsum([len(macros) for _, macros in drawn])[:-1])
    return [(failure, macros[int(part.argmax())]) for (failure, macros), part in zip(drawn, parts, strict=True)]


def promising(table: OutcomeTable, winners: list[Macro], rng: np.random.Generator) -> Macro:
    """The one of the best rate, each drawn from what its outcomes leave open (Thompson sampling)."""
    tried, recovered = np.array([table.counts(macro) for macro in winners]).T
    return winners[int(rng.beta(recovered + 0.3, tried - recovered + 1.7).argmax())]


def _neighbours(space: MacroSpace, table: OutcomeTable, winners: list[Macro], rng: np.random.Generator) -> list[Macro]:
    """Of promising macros, a few changes away."""
    return [_neighbour(space, promising(table, winners, rng), rng) for _ in range(CHOICE)]


def _neighbour(space: MacroSpace, macro: Macro, rng: np.random.Generator) -> Macro:
    changed = space.neighbour(macro, rng)
    while rng.random() < FARTHER:
        changed = space.neighbour(changed, rng)
    return changed


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
