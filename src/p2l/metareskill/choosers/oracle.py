"""The best that any chooser could do on recorded learning curves, and how far others stay behind it.

A mode is worth what its best recovery is worth, so an optimal plan trains at most one target per mode. How many rounds
each mode gets is then a knapsack with few items, which dynamic programming over the budget solves exactly.

`curves` [I, M, L] holds the success rate after 1 … L rounds of training; later rounds change nothing.
"""

from __future__ import annotations

import numpy as np

from p2l.errors import ConfigError
from p2l.metareskill.choosers.contract import Choice, Rule, check_number, least_trained
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.value_iteration import recovery_values, value_iteration
from p2l.records import Array, IntArray, freeze


def best_values(graph: SkillGraph, curves: Array, budget: int) -> Array:
    """[budget + 1] the highest value of failures that 0 … budget rounds can reach; `graph.q` is the start."""
    return _solve(graph, curves, budget)[0]


def best_plan(graph: SkillGraph, curves: Array, budget: int) -> IntArray:
    """[I, M] rounds for each recovery that reach `best_values` of the whole budget."""
    _, rounds = _solve(graph, curves, budget)
    target = _gains(graph, curves, budget).argmax(axis=1)  # [I, budget + 1]
    plan = np.zeros(graph.q.shape, dtype=np.int64)
    rest = budget
    for mode in reversed(range(len(plan))):
        count = int(rounds[mode, rest])
        plan[mode, target[mode, count]] = count
        rest -= count
    return plan


def regret(graph: SkillGraph, history: History, curves: Array) -> Array:
    """[T] how much more value of failures the best plan for as many rounds would have reached."""
    start = graph.with_q(history.initial)
    return np.asarray(best_values(start, curves, len(history))[1:] - history.values)


def oracle(curves: Array | None = None, budget: int = 0) -> Rule:
    """Follow the best plan for `budget` rounds, the largest rise per round first.

    Raises:
        ConfigError: no curves, or a budget below 1.
        ShapeError: curves that are no probabilities [I, M, L].
    """
    if curves is None:
        raise ConfigError("oracle: no curves given; it plans on recorded ones [I, M, L], and on the budget in rounds")
    check_number("oracle: budget", budget, low=1, whole=True)
    rates = freeze("curves", curves, ("I", "M", "L"), {}, low=0.0, high=1.0)

    def rule(graph: SkillGraph, history: History, _rng: np.random.Generator) -> Choice:
        start = graph.with_q(history.initial)
        plan = best_plan(start, rates, budget)
        gains = np.take_along_axis(_gains(start, rates, budget), plan[..., None], axis=2)[..., 0]
        rate = np.where(plan > history.counts, gains / np.maximum(plan, 1), -1.0)
        if rate.max() < 0.0:
            return least_trained(history, "nothing left to gain")
        mode, target = np.unravel_index(int(rate.argmax()), rate.shape)
        return Choice(int(mode), int(target), "known curve")

    return rule


def _gains(graph: SkillGraph, curves: Array, budget: int) -> Array:
    """[I, M, budget + 1] rise of the value of failures if recovery (i, j) alone gets 0 … budget rounds."""
    if graph.skills:
        raise ConfigError("oracle: knows the best plan of a chain only, where no mode's gain changes another's value")
    rates = freeze("curves", curves, ("I", "M", "L"), dict(zip("IM", graph.q.shape, strict=True)), low=0.0, high=1.0)
    best = np.maximum.accumulate(np.concatenate([graph.q[..., None], rates], axis=2), axis=2)
    q = best[:, :, np.minimum(np.arange(budget + 1), best.shape[2] - 1)]
    values = value_iteration(graph)
    worth = np.moveaxis(recovery_values(graph, values.targets, np.moveaxis(q, 2, 0)), 0, 2)
    rise = np.maximum(worth - values.modes[:, None, None], 0.0)
    return np.asarray(graph.share[:, None, None] * rise)


def _solve(graph: SkillGraph, curves: Array, budget: int) -> tuple[Array, IntArray]:
    """Best values [budget + 1], and the rounds [I, budget + 1] of each mode where the modes up to it share a budget."""
    gains = _gains(graph, curves, budget).max(axis=1)  # [I, budget + 1]
    total = np.zeros(budget + 1)
    rounds = np.zeros(gains.shape, dtype=np.int64)
    rest = np.arange(budget + 1)[:, None] - np.arange(budget + 1)  # [b, c]: what c of b rounds leave to the others
    for mode, gain in enumerate(gains):
        totals = np.where(rest >= 0, total[np.maximum(rest, 0)] + gain, -np.inf)
        rounds[mode] = totals.argmax(axis=1)
        total = totals.max(axis=1)
    return float(value_iteration(graph).modes @ graph.share) + total, rounds
