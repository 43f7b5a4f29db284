"""Algorithm 3 for one seed and one chooser: all of its rounds, and what is kept of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from p2l.artifacts import config_hash, finite
from p2l.ledger import Item, find, write
from p2l.metareskill.algorithm import learn
from p2l.metareskill.choosers.contract import Chooser
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import History
from p2l.metareskill.trainer import Trainer
from p2l.seeding import generator


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
