"""Episodes of the whole robot, one row each, (thesis, table 5.1).

A learner's episodes of one seed are an item of the ledger (`p2l.ledger`), so that tables can be built on a machine that
ran none of them. Seeds of start states have a path of their own: learning never met them. All learners of a seed meet
the same start states, the same nominal runs and so the same failures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from p2l.artifacts import config_hash
from p2l.chaining.agent import Agent, load_agent
from p2l.chaining.execute import Overall, nominal_part, overall
from p2l.chaining.policy import FILE, Card, Policy, policy_hash
from p2l.chaining.pool import action_names
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ArtifactError
from p2l.ledger import Item, find, write
from p2l.seeding import generator
from p2l.skills.chain import Execution

VERSION = 1  # raise it when an edit of the code changes episodes: committed records know no code
FLAGS = ("nominal", "flagged", "success", "diverged")
Agents = Mapping[str, tuple[Agent, Policy]]


@dataclass(frozen=True)
class PolicyLedger:
    """Where items are looked up, and what they are functions of besides the policy.

    Attributes:
        records: folder of the ledger.
        code: hash of the code, or empty for committed records.
        item: name of the world, or of a variant of it.
        slots: episodes at once.
    """

    records: Path
    code: str
    item: str
    slots: int

    def entry(self, method: str, seed: int, agent: Agent, policy: Policy, *rest: Any) -> Item:
        """The item of a policy, what it hands over by included; `rest` is all else that decides it."""
        handing = {} if agent.preconditions is None else agent.preconditions.arrays()
        plain = {name: values.tolist() for name, values in handing.items()}
        decisive = [VERSION, self.code, seed, policy_hash(policy), plain, *rest]
        return Item(self.item, method, seed, 0, config_hash(decisive))


def load_agents(
    folder: Path,
    learners: Sequence[str],
    seed: int,
    world: World,
    nominal: Sequence[Option],
    *,
    transfer: bool = False,
) -> Agents:
    """The policies of a seed, let into a world.

    Args:
        folder: of `chain_recoveries`, with policies/<learner>/s<seed>, or one run's own.
        learners: whose.
        seed: that they were learnt with.
        world: where they are to act.
        nominal: the chain there.
        transfer: the world may have other parameters than the one they were learnt in.

    Raises:
        ArtifactError: missing, damaged, of another learner or seed, or learnt for another world, other columns or other
            actions.
    """
    some = world.sample(generator(seed, "evaluate_chains", world.name, "columns"), 1)
    found: dict[str, tuple[Agent, Policy]] = {}
    for name in learners:
        place = folder / "policies" / name / f"s{seed}"
        if not place.exists() and (folder / FILE).is_file():
            place = folder
        found[name] = load_agent(place, world, nominal, some, transfer=transfer)
        card = found[name][1].card
        if (card.learner, card.seed) != (name, seed):
            raise ArtifactError(
                f"{place}: the policy of {card.learner}, seed {card.seed}, not of {name}, seed {seed}; say "
                f"learners=[{card.learner}] seeds=[{card.seed}]"
            )
    return found


def episodes_of_seed(
    book: PolicyLedger,
    world: World,
    nominal: Sequence[Option],
    seed: int,
    agents: Agents,
    episodes: int,
    progress: Callable[[int], None] | None = None,
) -> pd.DataFrame:
    """Every learner's episodes, from records or by running them, which leaves records.

    Rows are those of `episode_rows`; `whole_task` tells of those that start where the task does, and take nothing over.

    Args:
        book: the ledger.
        world: where.
        nominal: the chain.
        seed: of the start states, and of the policies.
        agents: by learner.
        episodes: for each.
        progress: told 1 after each learner.
    """
    plain: tuple[Rows, Execution] | None = None
    tables = []
    for learner, (agent, policy) in agents.items():
        names = [option.name for option in nominal]
        decisive = [world.digest, world.estimator.mode, episodes, names]
        item = book.entry(f"{learner}_episodes", seed, agent, policy, *decisive)
        if (known := find(book.records, item)) is None:
            if plain is None:
                plain = nominal_episodes(book, world, nominal, seed, episodes)
            begun = time.perf_counter()
            rows = episode_rows(overall(world, nominal, agent, *plain), policy.card, nominal)
            known = {"episodes": _columns(rows)}
            write(book.records, item, known, seconds=time.perf_counter() - begun)
        tables.append(_table(known["episodes"]).assign(learner=learner, seed=seed, whole_task=agent.whole_task))
        if progress is not None:
            progress(1)
    table = pd.concat(tables, ignore_index=True)
    first = ["learner", "seed", "whole_task"]
    return table[[*first, *(name for name in table.columns if name not in first)]]


def nominal_episodes(
    book: PolicyLedger, world: World, nominal: Sequence[Option], seed: int, episodes: int
) -> tuple[Rows, Execution]:
    """The start states of a seed's episodes, and what the nominal chain does from them; the same for every learner."""
    starts = start_states(world, seed, episodes)
    return starts, nominal_part(world, nominal, starts, slots=book.slots)


def start_states(world: World, seed: int, episodes: int) -> Rows:
    """[episodes] where a seed's episodes start."""
    return world.sample(generator(seed, "evaluate_chains", world.name, "starts"), episodes)


def _columns(rows: pd.DataFrame) -> dict[str, list[Any]]:
    kept = rows.drop(columns=["learner", "seed", "episode"])
    return {str(name): (column.astype(int) if name in FLAGS else column).tolist() for name, column in kept.items()}


def _table(columns: Mapping[str, list[Any]]) -> pd.DataFrame:
    table = pd.DataFrame(columns).astype({**dict.fromkeys(FLAGS, bool), "steps": "int64", "actions": str})
    table.insert(0, "episode", np.arange(len(table)))
    return table


def episode_rows(found: Overall, card: Card, nominal: Sequence[Option]) -> pd.DataFrame:
    """One row per episode.

    Returns:
        learner, seed, episode; `nominal`: the nominal skills did it alone; `flagged`: the policy took over; `success`;
        `diverged`; `steps`: control steps of the recovery; `actions`: its decisions, joined by `;`.
    """
    own = tuple(name for name in card.actions if not name.startswith("from "))
    names = (*own, *action_names((), nominal))
    count = len(found.success)
    steps, actions = np.zeros(count, dtype=np.int64), np.full(count, "", dtype=object)
    steps[found.flagged] = found.recovered.steps
    actions[found.flagged] = [
        ";".join(names[action] for action in row if action >= 0) for row in found.recovered.actions.tolist()
    ]
    told = {name: getattr(found, name) for name in ("nominal", "flagged", "success", "diverged")}
    rows = pd.DataFrame({"episode": np.arange(count), **told, "steps": steps, "actions": actions.astype(str)})
    return rows.assign(learner=card.learner, seed=card.seed)[["learner", "seed", *rows.columns]]
