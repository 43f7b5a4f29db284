"""The failures that are left with the recoveries in place, and their modes.

Where the thesis is silent:
1. A new failure is the first state of an episode after a recovery in which no precondition, as learnt, holds on the
   truth. The estimator halves its error after every skill, as where recoveries are evaluated.
2. BIC chooses the number of new modes, and there are fewer where one would have no held-out failure.

Axis letters: N failures.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from p2l.contracts.rows import Rows
from p2l.contracts.world import NO_FAILURE
from p2l.failures.clustering import Clustering, ClusterOptions, cluster
from p2l.failures.record import STRANDED, Failures, Origin
from p2l.metareskill.failure_rounds.field import Field
from p2l.metareskill.target import RecoveryTask
from p2l.skills.chain import Execution


def lost(field: Field, starts: Rows, execution: Execution, first: Origin, split: str, seed: int) -> Failures:
    """New failures of episodes from `starts` [N], at most one each; `first` is the origin of those before learning."""
    ends, world = execution.ends, field.task.world
    moments = ends.take((ends.option >= len(field.nominal)) & ~execution.diverged[ends.episode])
    if len(moments):
        moments = moments.take(~field.task.holds(moments.rows).any(axis=1))
        moments = moments.take(np.unique(moments.episode, return_index=True)[1])
    origin = dataclasses.replace(
        first,
        params={**first.params, "estimator": world.estimator.mode},
        strategy="early_termination",
        split=split,
        seed=seed,
        executions=len(starts),
        max_options=field.max_options,
        options=(*(option.name for option in field.nominal), "recovery"),  # recoveries are not told apart
        kinds=(*world.failure_kinds, STRANDED),
    )
    return Failures(
        origin=origin,
        start=starts.take(moments.episode),
        rows=moments.rows,
        truth=world.privileged(moments.rows),
        seen=world.observe(moments.rows),
        option=np.full(len(moments), len(field.nominal)),
        kind=np.where(moments.kind == NO_FAILURE, origin.kinds.index(STRANDED), moments.kind),
        step=moments.step,
        time_s=np.round(moments.step * world.control_period_s, 6),
        episode=moments.episode,
    )


def group(task: RecoveryTask, train: Failures, held_out: Failures, max_modes: int, seed: int) -> Clustering | None:
    """Modes of new failures, each with a held-out one; None where there is nothing to learn from or to measure on."""
    limit = min(max_modes, len(train))
    if not len(held_out):
        return None
    while limit:
        clustering = cluster(task.world, train, ClusterOptions(None, limit), seed % 2**32)
        if len(np.unique(clustering.modes.classify(held_out.truth)[0])) == len(clustering.modes):
            return clustering
        limit = len(clustering.modes) - 1
    return None
