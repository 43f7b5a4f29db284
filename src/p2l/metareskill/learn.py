"""Recoveries from failures to skills: the pieces put together for one seed, whatever the chooser (Algorithm 3).

Axis letters: N failures, I modes, M targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import config_hash, finite
from p2l.errors import ArtifactError
from p2l.failures.classifier import ModeClassifier
from p2l.failures.lost import lost
from p2l.failures.record import Failures
from p2l.ledger import Item, find, write
from p2l.metareskill.choosers.contract import Chooser
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.loop import learn
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.record import modes_hash, preconditions_hash
from p2l.metareskill.target import RecoveryTask
from p2l.metareskill.train import Members, Trainer
from p2l.seeding import generator


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


def start_graph(task: RecoveryTask, failures: Members, modes: ModeClassifier, rewards: Rewards) -> SkillGraph:
    """The graph before any training: nominal skills as measured, modes with their sizes, no recovery succeeds.

    Raises:
        ArtifactError: a mode has no failure to train from.
    """
    sizes = np.bincount(failures.mode, minlength=len(modes)).astype(np.float64)
    if empty := np.flatnonzero(sizes == 0).tolist():
        raise ArtifactError(f"failure modes {empty} have no failure to train from; cluster into fewer modes")
    q = np.zeros((len(modes), len(task.targets)))
    return SkillGraph(task.preconditions.nominal, sizes, q, **asdict(rewards))


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
        residual: whether skills add to the straight motion, see `regression`.

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
    residual: bool = True

    def __post_init__(self) -> None:
        sizes = np.bincount(self.held_out.mode, minlength=len(self.graph.sizes))
        if empty := np.flatnonzero(sizes == 0).tolist():
            raise ArtifactError(
                f"failure modes {empty} have no held-out failure, so their recoveries cannot be measured; "
                "discover with more held-out executions (`executions.held_out`), or cluster into fewer modes"
            )

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
            self.residual,
        ]
        identity = config_hash(
            [*settings, *([code] if code else []), self.trials, seed, *(part.tolist() for part in parts)]
        )
        ledger = Ledger(identity) if path is None else Ledger.open(path, identity)
        return Trainer(self.task, self.failures, self.held_out, self.options, seed, ledger, self.trials, self.residual)


def train_recoveries(
    trainer: Trainer,
    graph: SkillGraph,
    chooser: Chooser,
    *,
    rounds: int,
    episodes: int = 1,
    history: History | None = None,
    report: Callable[[History], None] | None = None,
) -> History:
    """All rounds of one chooser, those of an earlier `history` included; `report` gets the history after each.

    What the ledger already holds is not trained again, so an interrupted training repeats its choices at once and goes
    on, to the bit.
    """
    latest = History(graph.q) if history is None else history
    rng = generator(trainer.seed, "choose", chooser.name)
    for latest in learn(graph, chooser, trainer, rounds=rounds, rng=rng, history=history, episodes=episodes):
        if report is not None:
            report(latest)
    return latest


def record_history(
    records: Path, item: str, trainer: Trainer, chooser: str, history: History, settings: Mapping[str, Any]
) -> None:
    """Leave a chooser's rounds among the records of finished items, by column, with the wall time of its queries.

    Args:
        records: folder.
        item: what was trained, for the name of the record.
        trainer: of one seed; its ledger holds the queries, and from them this record is made again in no time.
        chooser: whose rounds.
        history: the rounds.
        settings: of the chooser and of the loop; `episodes`, the trainings of a round, among them.
    """
    record = Item(item, chooser, trainer.seed, 0, config_hash([trainer.ledger.identity, dict(settings)]))
    if find(records, record) is not None:  # on another processor the last digits differ
        return
    counts = history.counts * int(settings["episodes"])
    entries = [entry for (*pair, number), entry in trainer.ledger.entries.items() if number < counts[tuple(pair)]]
    plain = {name: [getattr(each, name) for each in history.rounds] for name in ("mode", "target", "trials", "solved")}
    numbers = {
        name: [finite(float(f"{getattr(each, name):.6g}")) for each in history.rounds]
        for name in ("q", "q_upper", "predicted", "value")
    }
    write(records, record, {"rounds": plain | numbers}, seconds=sum(entry.seconds for entry in entries))
