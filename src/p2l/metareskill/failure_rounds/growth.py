"""A setting that grows by further modes: what was trained stays valid, and training goes on.

Where the thesis is silent: new failures are grouped by themselves, and their modes come after the earlier ones.
Failures keep the modes that they have, so their queries stay valid: ledger and history go on, and new recoveries get
the chooser's initial rounds. Which mode a robot is in is then decided among all, weighted by their failures.

Axis letters: N failures, I modes.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from p2l.contracts.rows import Rows
from p2l.failures.classifier import ModeClassifier
from p2l.failures.clustering import Clustering
from p2l.failures.record import Failures
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.members import Members
from p2l.metareskill.setting import Setting
from p2l.metareskill.start import Start, measure_start
from p2l.records import IntArray


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
    modes = join(setting.modes, more.modes)
    start = setting.start.beside(
        measure_start(
            setting.task,
            failures,
            tests,
            range(count, len(modes)),
            setting.options,
            setting.start.choice,
            setting.trials,
        )
    )
    graph = extend_graph(setting.graph, np.bincount(more.mode, minlength=len(more.modes)), start)
    return dataclasses.replace(setting, modes=modes, failures=failures, held_out=tests, graph=graph, start=start)


def extend_graph(graph: SkillGraph, sizes: npt.ArrayLike, start: Start | None = None) -> SkillGraph:
    """The graph before any training with more modes of `sizes`; without a start no recovery succeeds."""
    all_of = np.append(graph.sizes, np.asarray(sizes, dtype=np.float64))
    q = np.zeros((len(all_of), graph.q.shape[1])) if start is None else start.q
    return dataclasses.replace(graph, sizes=all_of, q=q)


def extend_history(history: History, setting: Setting) -> History:
    """The same rounds in the graph with more modes."""
    return History(setting.graph.q, history.rounds, history.generator)


def _with(members: Members, rows: Rows, mode: IntArray) -> Members:
    return Members(Rows.join([members.rows, rows]), np.concatenate([members.mode, mode]))
