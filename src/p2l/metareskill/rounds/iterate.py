"""Learning on from the failures that are left: discovery with the recoveries in place, further modes, more training.

Where the thesis is silent:
1. A new failure is the first state of an episode after a recovery in which no precondition, as learnt, holds on the
   truth. The estimator halves its error after every skill, as where recoveries are evaluated.
2. New failures are grouped by themselves, and their modes come after the earlier ones. Failures keep the modes that
   they have, so their queries stay valid: ledger and history go on, and new recoveries get the chooser's
   initial rounds. Which mode a robot is in is then decided among all of them, weighted by their failures.
3. BIC chooses the number of new modes, and there are fewer where one would have no held-out failure.

Axis letters: N episodes or failures, I modes.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import NO_FAILURE
from p2l.failures.classifier import ModeClassifier
from p2l.failures.clustering import Clustering, ClusterOptions, cluster
from p2l.failures.record import STRANDED, Failures, Origin
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.learn import Setting
from p2l.metareskill.record import Recoveries
from p2l.metareskill.strategies import playbook
from p2l.metareskill.target import RecoveryTask
from p2l.metareskill.train import Members
from p2l.records import IntArray
from p2l.skills.chain import Execution, run


@dataclass(frozen=True)
class Field:
    """Where episodes are run.

    Attributes:
        task: its world's estimator halves its error.
        nominal: K options.
        max_options: of an episode.
        slots: episodes at once.
    """

    task: RecoveryTask
    nominal: tuple[Option, ...]
    max_options: int
    slots: int


def execute(
    field: Field, strategy: str, starts: Rows, setting: Setting, recoveries: Recoveries | None, rng: np.random.Generator
) -> Execution:
    """Run one episode from each of `starts` [N]; strategy `recoveries` needs its skills."""
    policy = playbook(
        strategy,
        field.task,
        field.nominal,
        setting.graph if recoveries is None else recoveries.graph,
        setting.options.timing,
        rng,
        modes=setting.modes,
        skills=None if recoveries is None else recoveries.skills,
        max_options=field.max_options,
    )
    return run(field.task.world, policy.options, starts, choose=policy.choose, stop_on_failure=False, slots=field.slots)


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


def join(first: ModeClassifier, more: ModeClassifier) -> ModeClassifier:
    """One classifier of the modes of both, `more`'s after those of `first`; features are scaled as in `first`."""
    share = np.array([first.sizes.sum(), more.sizes.sum()]) / (first.sizes.sum() + more.sizes.sum())
    scale = more.spread / first.spread
    means = (more.means * more.spread + more.centre - first.centre) / first.spread
    return dataclasses.replace(
        first,
        weights=np.concatenate([share[0] * first.weights, share[1] * more.weights]),
        means=np.concatenate([first.means, means]),
        covariances=np.concatenate([first.covariances, more.covariances * np.outer(scale, scale)]),
        sizes=np.concatenate([first.sizes, more.sizes]),
    )


def extend(setting: Setting, train: Failures, held_out: Failures, more: Clustering) -> Setting:
    """The setting with new failures and their modes; the graph is that before any training."""
    count = len(setting.modes)
    failures = _with(setting.failures, train.rows, more.mode + count)
    tests = _with(setting.held_out, held_out.rows, more.modes.classify(held_out.truth)[0] + count)
    graph = extend_graph(setting.graph, np.bincount(more.mode, minlength=len(more.modes)))
    modes = join(setting.modes, more.modes)
    return dataclasses.replace(setting, modes=modes, failures=failures, held_out=tests, graph=graph)


def extend_graph(graph: SkillGraph, sizes: npt.ArrayLike) -> SkillGraph:
    """The graph before any training with more modes of `sizes`."""
    all_of = np.append(graph.sizes, np.asarray(sizes, dtype=np.float64))
    return dataclasses.replace(graph, sizes=all_of, q=np.zeros((len(all_of), graph.q.shape[1])))


def extend_history(history: History, setting: Setting) -> History:
    """The same rounds in the graph with more modes."""
    return History(setting.graph.q, history.rounds, history.generator)


def _with(members: Members, rows: Rows, mode: IntArray) -> Members:
    return Members(Rows.join([members.rows, rows]), np.concatenate([members.mode, mode]))
