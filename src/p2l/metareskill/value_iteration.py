"""Values of the skill graph by value iteration, and the greedy policy on them (thesis, sections 4.2.1 and 4.3.3).

`q` may carry leading axes [..., I, M], so that many graphs that differ in their recoveries are solved at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p2l.metareskill.graph import SkillGraph
from p2l.records import Array, BoolArray, IntArray

TIE = 1e-3  # values this close to the best are as good as it, in the units of the rewards
NONE = -1  # no recovery that ever succeeds, or no precondition that holds
_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Values:
    """Expected return from each symbolic state.

    Attributes:
        targets: [M] of the preconditions; the goal, last, is worth 0.
        modes: [..., I] of the failure modes.
    """

    targets: Array
    modes: Array


def recovery_values(graph: SkillGraph, targets: Array, q: Array | None = None) -> Array:
    """[..., I, M] value of executing each recovery and acting greedily from where it leads."""
    success = graph.q if q is None else np.asarray(q)
    return np.asarray(graph.recovery_reward + success * targets - (1.0 - success) * graph.c_fail)


def backup(graph: SkillGraph, values: Values, q: Array | None = None) -> Values:
    """One Bellman backup of every state at once."""
    if graph.skills:
        return _general_backup(graph, values, graph.q if q is None else np.asarray(q))
    nominal = graph.skill_reward + graph.nominal * values.targets[1:] - (1.0 - graph.nominal) * graph.c_fail
    best = recovery_values(graph, values.targets, q).max(axis=-1)
    return Values(np.append(nominal, 0.0), np.maximum(best, -graph.c_fail))


def value_iteration(graph: SkillGraph, q: Array | None = None) -> Values:
    """The fixed point of `backup`.

    A chain has no cycle, so K + 2 sweeps from any start reach it exactly; the change is checked all the same. In a
    graph with cycles every skill costs something, so there is one fixed point, and sweeps come as close as asked.
    """
    shape = graph.q.shape if q is None else np.shape(q)
    targets = np.zeros((*shape[:-2], len(graph.nominal) + 1) if graph.skills else len(graph.nominal) + 1)
    values = Values(targets, np.zeros(shape[:-1]))
    while True:
        new = backup(graph, values, q)
        change = max(np.abs(new.targets - values.targets).max(), np.abs(new.modes - values.modes).max())
        values = new
        if change <= _TOLERANCE * graph.c_fail:
            return values


def _general_backup(graph: SkillGraph, values: Values, q: Array) -> Values:
    """One backup of a graph that is no chain; `values.targets` [..., M] may have the leading axes of `q`."""
    worth = skill_values(graph, values)
    source, _, _ = graph.edges
    targets = np.full((*worth.shape[:-1], len(graph.nominal) + 1), -np.inf)
    for place in range(len(source)):
        targets[..., source[place]] = np.maximum(targets[..., source[place]], worth[..., place])
    targets[np.isneginf(targets)] = -graph.c_fail  # no skill starts there: the robot is stranded
    targets[..., -1] = 0.0
    best = recovery_values(graph, values.targets[..., None, :], q).max(axis=-1)
    return Values(targets, np.maximum(best, -graph.c_fail))


def skill_values(graph: SkillGraph, values: Values) -> Array:
    """[..., S] value of executing each nominal skill and acting greedily from where it leads."""
    _, reach, fall = graph.edges
    lost = 1.0 - reach.sum(axis=1) - fall.sum(axis=1)
    return np.asarray(graph.skill_reward + values.targets @ reach.T + values.modes @ fall.T - lost * graph.c_fail)


def best_skills(graph: SkillGraph) -> tuple[str | None, ...]:
    """[K] the skill to execute at each precondition: the most valuable, of equals the first; None where none starts."""
    worth, (source, _, _) = skill_values(graph, value_iteration(graph)), graph.edges
    names = [skill.name for skill in graph.skills] or [f"skill {place}" for place in range(len(source))]
    chosen: list[str | None] = []
    for vertex in range(len(graph.nominal)):
        mine = np.flatnonzero(source == vertex)
        chosen.append(names[int(mine[worth[mine].argmax()])] if len(mine) else None)
    return tuple(chosen)


def value_of_failures(graph: SkillGraph, q: Array | None = None) -> Array:
    """[...] mean value of the failure modes, weighted by their sizes (equation 4.2); `graph.q` if `q` is not given."""
    return np.asarray(value_iteration(graph, q).modes @ graph.share)


def predicted_value(graph: SkillGraph, q_upper: Array) -> Array:
    """[..., I, M] J^U: the value of failures if q_ij alone were replaced by `q_upper`_ij, for every (i, j) at once.

    In a chain no skill ends in a failure mode, so that replacing q_ij moves the value of mode i and no other: one
    backup of the replaced entries on the solved graph is the fixed point of every replaced graph. Other graphs are
    solved anew.
    """
    if graph.skills:
        places = np.eye(graph.q.size, dtype=bool).reshape(-1, *graph.q.shape)
        replaced = np.where(places, np.asarray(q_upper)[..., None, :, :], graph.q)
        return np.asarray(value_of_failures(graph, replaced)).reshape(np.shape(q_upper))
    values = value_iteration(graph)
    count = len(values.targets)
    current = recovery_values(graph, values.targets)[:, None, :]
    others = np.where(np.eye(count, dtype=bool), -graph.c_fail, current).max(axis=-1)  # [I, M] best without target j
    best = np.maximum(others, recovery_values(graph, values.targets, q_upper))
    best = np.maximum(best, -graph.c_fail)  # [..., I, M] value of mode i with the upper limit of target j
    return np.asarray(values.modes @ graph.share + graph.share[:, None] * (best - values.modes[:, None]))


def greedy(scores: Array, rng: np.random.Generator, tie: float = TIE) -> IntArray:
    """[N] column of the best score in each row of [N, A]; those within `tie` of the best are broken at random."""
    candidate = scores >= scores.max(axis=-1, keepdims=True) - tie
    return np.where(candidate, rng.random(scores.shape), -1.0).argmax(axis=-1).astype(np.int64)


def best_recovery(graph: SkillGraph, mode: IntArray, executions: IntArray, order: Array) -> IntArray:
    """[N] the target of the most valuable recovery, `NONE` where none ever succeeds.

    Args:
        graph: the skill graph.
        mode: [N] modes to recover from.
        executions: [N, M] earlier executions of each recovery from the same failure; its rate q was measured on
            failures met for the first time, and counts as q / (1 + n) after n of them.
        order: [I, M] in [0, 1), decides among values closer than `TIE`.
    """
    targets, q = value_iteration(graph).targets, graph.q[mode]
    scores = recovery_values(graph, targets, q / (1.0 + executions)) + TIE * order[mode]
    best = np.where(q > 0.0, scores, -np.inf).argmax(axis=1)
    return np.where((q > 0.0).any(axis=1), best, NONE).astype(np.int64)


def nominal_policy(graph: SkillGraph, holds: BoolArray, rng: np.random.Generator, tie: float = TIE) -> IntArray:
    """[N] the most valuable precondition that holds, hence the nominal skill to execute.

    Args:
        graph: the skill graph.
        holds: [N, M] which preconditions are satisfied, the goal last.
        rng: breaks ties.
        tie: values this close are equal.

    Returns:
        K where the goal is reached, `NONE` where nothing holds and a recovery is due.
    """
    scores = np.where(holds, value_iteration(graph).targets, -np.inf)
    return np.where(holds.any(axis=1), greedy(scores, rng, tie), NONE)
