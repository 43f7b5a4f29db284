"""What all seeds and choosers of a training share: failures with their modes, the graph before it, how it is measured.

Axis letters: N failures, I modes, M targets.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import config_hash
from p2l.errors import ArtifactError
from p2l.failures.classifier import ModeClassifier
from p2l.failures.lost import lost
from p2l.failures.record import Failures
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.identity import modes_hash, preconditions_hash
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.start import Start
from p2l.metareskill.target import RecoveryTask
from p2l.metareskill.trainer import Trainer


@dataclass(frozen=True)
class Rewards:
    """Of the skill graph, see `metareskill.graph`."""

    skill_reward: float = -1.0
    recovery_reward: float = -1.0
    c_fail: float = 10.0


def members(task: RecoveryTask, failures: Failures, modes: ModeClassifier) -> tuple[Members, int]:
    """Failures with their modes, and how many were left out because a precondition, as learnt, holds there.

    Raises:
        ArtifactError: none is left.
    """
    index = lost(task.world, task.symbols, task.preconditions, failures)
    selection = failures.take(index)
    return Members(selection.rows, modes.classify(selection.truth)[0]), len(failures) - len(index)


def start_graph(
    task: RecoveryTask, failures: Members, modes: ModeClassifier, rewards: Rewards, start: Start | None = None
) -> SkillGraph:
    """The graph before any training: nominal skills and recoveries as measured, modes with their sizes.

    Raises:
        ArtifactError: a mode has no failure to train from.
    """
    sizes = np.bincount(failures.mode, minlength=len(modes)).astype(np.float64)
    if empty := np.flatnonzero(sizes == 0).tolist():
        raise ArtifactError(f"failure modes {empty} have no failure to train from; cluster into fewer modes")
    q = np.zeros((len(modes), len(task.targets))) if start is None else start.q
    return SkillGraph(task.preconditions.nominal, sizes, q, **asdict(rewards))


def check_measurable(held_out: Members, modes: int) -> None:
    """Refuse modes whose recoveries could not be measured.

    Raises:
        ArtifactError: a mode has no held-out failure.
    """
    sizes = np.bincount(held_out.mode, minlength=modes)
    if empty := np.flatnonzero(sizes == 0).tolist():
        raise ArtifactError(
            f"failure modes {empty} have no held-out failure, so their recoveries cannot be measured; "
            "discover with more held-out executions (`executions.held_out`), or cluster into fewer modes"
        )


@dataclass(frozen=True)
class Setting:
    """What all seeds and choosers share.

    Attributes:
        task: world and preconditions.
        modes: the failure classifier.
        failures: to train from.
        held_out: to measure on.
        graph: before any training.
        options: of queries.
        trials: largest number of held-out failures behind a success rate.
        start: of the recoveries before any training.

    Raises:
        ArtifactError: a mode has no held-out failure to measure its recoveries on.
    """

    task: RecoveryTask
    modes: ModeClassifier
    failures: Members
    held_out: Members
    graph: SkillGraph
    options: QueryOptions
    trials: int
    start: Start

    def __post_init__(self) -> None:
        check_measurable(self.held_out, len(self.graph.sizes))

    def trainer(self, seed: int, path: Path | None = None, code: str = "") -> Trainer:
        """The trainer of one seed; its ledger, kept at `path`, goes on where the same training left off.

        Args:
            seed: of all training.
            path: of the ledger.
            code: hash of code whose change makes a ledger's entries invalid; empty: no change does.
        """
        parts = [self.failures.rows.states, self.failures.mode, self.held_out.rows.states, self.held_out.mode]
        settings = [
            preconditions_hash(self.task.preconditions),
            modes_hash(self.modes),
            asdict(self.options),
            self.start.guess,
        ]
        identity = config_hash(
            [*settings, *([code] if code else []), self.trials, seed, *(part.tolist() for part in parts)]
        )
        ledger = Ledger(identity) if path is None else Ledger.open(path, identity)
        return Trainer(self.task, self.failures, self.held_out, self.options, seed, ledger, self.start, self.trials)
