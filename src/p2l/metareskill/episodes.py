"""Episodes of chapter 4's strategies, item by item: a strategy, in one world, from the start states of one seed.

An item leaves a record in the ledger (`p2l.ledger`), so that tables can be built on a machine that ran none of them.
The seeds of start states have a path of their own (`p2l.seeding`): training, choosing and measuring a recovery never
met them. Items of the same world and seed start from the same rows, with the same draws of the estimator's error.

Axis letters: N episodes, K nominal skills.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from p2l.artifacts import config_hash
from p2l.contracts.option import Option
from p2l.contracts.world import World
from p2l.failures.classifier import ModeClassifier
from p2l.ledger import Item, find, write
from p2l.metareskill.identity import preconditions_hash
from p2l.metareskill.record import Recoveries, recoveries_hash
from p2l.metareskill.strategies import playbook
from p2l.metareskill.strategy_names import LEARNT, OPEN_LOOP
from p2l.metareskill.target import RecoveryTask
from p2l.seeding import generator
from p2l.skills.chain import Execution, run

VERSION = 1  # raise it when an edit of the code changes episodes: committed records know no code
POLICY = 2  # the same for what recoveries alone depend on


@dataclass(frozen=True)
class Place:
    """Where strategies are compared.

    Attributes:
        name: of the items' records.
        setting: for the tables, see `p2l.evaluation.metareskill.tables`.
        world: with its estimator; its rows are where episodes start.
        task: its symbols and preconditions; its world is another one where robosuite simulates.
        nominal: K options.
        episodes: N for each seed.
        slots: episodes at once.
    """

    name: str
    setting: str
    world: World
    task: RecoveryTask
    nominal: tuple[Option, ...]
    episodes: int
    slots: int


@dataclass(frozen=True)
class EpisodeLedger:
    """Where items are looked up, and what they are functions of besides place, strategy and seed.

    Attributes:
        records: folder of the ledger.
        identity: of the code, or empty for committed records.
        seed: of the evaluation.
        max_options: of an episode.
    """

    records: Path
    identity: str
    seed: int
    max_options: int


def episodes(
    book: EpisodeLedger,
    place: Place,
    strategy: str,
    seed: int,
    modes: ModeClassifier,
    recoveries: Recoveries,
    progress: Callable[[int], None] | None = None,
) -> pd.DataFrame:
    """An item's episodes, from its record or by running them, which leaves a record.

    Args:
        book: the ledger.
        place: where.
        strategy: one of `strategies.STRATEGIES`.
        seed: of the start states and of the recoveries.
        modes: the failure classifier.
        recoveries: of that seed.
        progress: called with the number of episodes finished since its last call.

    Returns:
        `place, setting, method, seed, episode, success, path_m, options, recoveries, diverged`, a row per episode;
        `options` were executed in it, `recoveries` of them were none of the nominal ones.
    """
    item = Item(place.name, strategy, seed, 0, _identity(book, place, strategy, seed, recoveries))
    if (record := find(book.records, item)) is None:
        start = time.perf_counter()
        record = _content(_execute(book, place, strategy, seed, modes, recoveries, progress), len(place.nominal))
        write(book.records, item, record, seconds=time.perf_counter() - start)
    elif progress is not None:
        progress(place.episodes)
    table = pd.DataFrame(record["episodes"]).astype({"success": bool, "diverged": bool, "path_m": float})
    columns = ["place", "setting", "method", "seed", "episode", *table.columns]
    table = table.assign(place=place.name, setting=place.setting, method=strategy)
    return table.assign(seed=seed, episode=np.arange(len(table)))[columns]


def gather(
    book: EpisodeLedger,
    places: Sequence[tuple[Place, Sequence[str]]],
    seed: int,
    modes: ModeClassifier,
    recoveries: Recoveries,
    report: Callable[[pd.DataFrame], None],
    progress: Callable[[int], None] | None = None,
) -> pd.DataFrame:
    """All items of one seed, for places with their strategies; `report` gets each one's episodes."""
    tables = []
    for place, strategies in places:
        for strategy in strategies:
            tables.append(episodes(book, place, strategy, seed, modes, recoveries, progress))
            report(tables[-1])
    return pd.concat(tables, ignore_index=True)


def _execute(
    book: EpisodeLedger,
    place: Place,
    strategy: str,
    seed: int,
    modes: ModeClassifier,
    recoveries: Recoveries,
    progress: Callable[[int], None] | None,
) -> Execution:
    path = "evaluate_recoveries", place.world.name
    starts = place.world.sample(generator(book.seed, *path, "starts", seed), place.episodes)
    policy = playbook(
        strategy,
        place.task,
        place.nominal,
        recoveries.graph,
        recoveries.timing,
        generator(book.seed, *path, "ties", seed),
        modes=modes,
        skills=recoveries.skills,
        max_options=book.max_options,
    )
    adopt = getattr(place.task.world, "adopt", lambda rows: rows)  # robosuite's rows have one more column of memory
    return run(
        place.task.world,
        policy.options,
        adopt(starts),
        choose=policy.choose,
        stop_on_failure=False,  # chapter 4 knows no detectors, only preconditions
        slots=place.slots,
        progress=progress,
    )


def _content(execution: Execution, nominal: int) -> dict[str, Any]:
    other = np.bincount(execution.ends.episode, weights=execution.ends.option >= nominal, minlength=len(execution))
    return {
        "episodes": {
            "success": execution.success.astype(int).tolist(),
            "path_m": np.round(execution.last.path_m, 4).tolist(),
            "options": execution.last.rows.actions.tolist(),
            "recoveries": other.astype(int).tolist(),
            "diverged": execution.diverged.astype(int).tolist(),
        }
    }


def _identity(book: EpisodeLedger, place: Place, strategy: str, seed: int, recoveries: Recoveries) -> str:
    """Hash of all that decides an item; heuristics are no function of the recoveries."""
    graph = recoveries.graph
    decisive: list[Any] = [
        VERSION,
        book.identity,
        book.seed,
        seed,
        place.name,
        place.world.digest,
        place.world.estimator.mode,
        place.episodes,
        [option.name for option in place.nominal],
    ]
    if strategy != OPEN_LOOP:
        rewards = [graph.skill_reward, graph.recovery_reward, graph.c_fail]
        decisive += [book.max_options, preconditions_hash(place.task.preconditions), str(recoveries.timing), *rewards]
    if strategy in LEARNT:
        decisive += [recoveries.modes, recoveries_hash(recoveries), POLICY]
    return config_hash(decisive)
