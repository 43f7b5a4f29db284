"""Episodes of the whole robot, one row each (thesis, table 5.1).

A learner's episodes of one seed are an item of the ledger (`p2l.ledger`), so that tables can be built on a machine that
ran none of them. Start states are drawn by seeds of their own, so that none occurs in training. All learners of a seed
have the same start states, the same nominal runs and so the same failures.
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
from p2l.chaining.checkpoint import FILE as CHECKPOINT
from p2l.chaining.execute import Overall, nominal_part, overall
from p2l.chaining.policy import FILE, Card, Policy, policy_hash
from p2l.chaining.states import action_names
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
    """The ledger of policies, and what its items depend on besides the policy.

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
        """The item of a policy, its preconditions included; `rest` is all else that determines the item."""
        handing = {} if agent.preconditions is None else agent.preconditions.arrays()
        plain = {name: values.tolist() for name, values in handing.items()}
        decisive = [VERSION, self.code, seed, policy_hash(policy), plain, *rest]
        return Item(self.item, method, seed, 0, config_hash(decisive))


def policy_place(folder: Path, learner: str, seed: int) -> Path:
    """Folder of a policy in that of `chain_recoveries`, which may hold one run alone."""
    place = folder / "policies" / learner / f"s{seed}"
    return folder if not place.exists() and (folder / FILE).is_file() else place


def check_policies(folder: Path, learners: Sequence[str], seeds: Sequence[int]) -> None:
    """Refuse a folder of `chain_recoveries` in which policies are missing: all of them are named, and those there are.

    Raises:
        ArtifactError: they are.
    """
    if not (folder / "policies").is_dir() and (folder / FILE).is_file():
        if (folder / CHECKPOINT).is_file():
            raise ArtifactError(
                f"{folder}: this run has not finished; `python -m stages.chain_recoveries` with the same settings and "
                f"hydra.run.dir={folder} goes on with it"
            )
        return
    there = sorted(place.parent for place in (folder / "policies").glob(f"*/s*/{FILE}.json"))
    wanted = [folder / "policies" / name / f"s{seed}" for name in learners for seed in seeds]
    if missing := [place for place in wanted if place not in there]:
        names = sorted({place.parent.name for place in missing})
        raise ArtifactError(
            f"{folder}: holds no policy of {_runs(missing)}; it has {_runs(there) or 'none'}. Train them with "
            f"`python -m stages.chain_recoveries … compare=[{','.join(names)}]`, or leave them out (learners=, seeds=)"
        )


def _runs(places: Sequence[Path]) -> str:
    """The learner and the seed of policies, for a message."""
    seeds: dict[str, list[str]] = {}
    for place in places:
        seeds.setdefault(place.parent.name, []).append(place.name)
    return ", ".join(f"{name} {' '.join(each)}" for name, each in seeds.items())


def load_agents(
    folder: Path,
    learners: Sequence[str],
    seed: int,
    world: World,
    nominal: Sequence[Option],
    *,
    transfer: bool = False,
) -> Agents:
    """Agents with the policies of a seed, checked against a world.

    Args:
        folder: of `chain_recoveries`, with policies/<learner>/s<seed>, or one run's own.
        learners: whose policies.
        seed: of their training.
        world: where they are to act.
        nominal: the chain there.
        transfer: accept policies of a world with other parameters.

    Raises:
        ArtifactError: missing, damaged, of another learner or seed, or of another world, other columns or other
            actions.
    """
    some = world.sample(generator(seed, "evaluate_chains", world.name, "columns"), 1)
    agents: dict[str, tuple[Agent, Policy]] = {}
    for name in learners:
        place = policy_place(folder, name, seed)
        agents[name] = load_agent(place, world, nominal, some, transfer=transfer)
        card = agents[name][1].card
        if (card.learner, card.seed) != (name, seed):
            raise ArtifactError(
                f"{place}: the policy of {card.learner}, seed {card.seed}, not of {name}, seed {seed}; say "
                f"learners=[{card.learner}] seeds=[{card.seed}]"
            )
    return agents


def episodes_of_seed(
    book: PolicyLedger,
    world: World,
    nominal: Sequence[Option],
    seed: int,
    agents: Agents,
    episodes: int,
    progress: Callable[[int], None] | None = None,
) -> pd.DataFrame:
    """Every learner's episodes, looked up in the ledger or run and recorded.

    Rows are those of `episode_rows`; `whole_task`: the policy acts from the start of the task, not from a failure.

    Args:
        book: the ledger.
        world: where.
        nominal: the chain.
        seed: of the start states, and of the policies.
        agents: by learner.
        episodes: for each.
        progress: called with 1 after each learner.
    """
    plain: tuple[Rows, Execution] | None = None
    tables = []
    for learner, (agent, policy) in agents.items():
        names = [option.name for option in nominal]
        decisive = [world.digest, world.estimator.mode, episodes, names]
        item = book.entry(f"{learner}_episodes", seed, agent, policy, *decisive)
        if (record := find(book.records, item)) is None:
            if plain is None:
                plain = nominal_episodes(book, world, nominal, seed, episodes)
            start_s = time.perf_counter()
            rows = episode_rows(overall(world, nominal, agent, *plain), policy.card, nominal)
            record = {"episodes": record_of(rows)}
            write(book.records, item, record, seconds=time.perf_counter() - start_s)
        tables.append(table_of(record["episodes"]).assign(learner=learner, seed=seed, whole_task=agent.whole_task))
        if progress is not None:
            progress(1)
    table = pd.concat(tables, ignore_index=True)
    first = ["learner", "seed", "whole_task"]
    return table[[*first, *(name for name in table.columns if name not in first)]]


def nominal_episodes(
    book: PolicyLedger, world: World, nominal: Sequence[Option], seed: int, episodes: int
) -> tuple[Rows, Execution]:
    """Start states of a seed's episodes, and the nominal chain's execution from them; the same for every learner."""
    starts = start_states(world, seed, episodes)
    return starts, nominal_part(world, nominal, starts, slots=book.slots)


def start_states(world: World, seed: int, episodes: int) -> Rows:
    """Start states [episodes] of a seed."""
    return world.sample(generator(seed, "evaluate_chains", world.name, "starts"), episodes)


def record_of(rows: pd.DataFrame) -> dict[str, list[Any]]:
    """`episode_rows` as a record keeps them."""
    table = rows.drop(columns=["learner", "seed", "episode"])
    return {str(name): (column.astype(int) if name in FLAGS else column).tolist() for name, column in table.items()}


def table_of(columns: Mapping[str, list[Any]]) -> pd.DataFrame:
    """Rows from what `record_of` gave."""
    table = pd.DataFrame(columns).astype({**dict.fromkeys(FLAGS, bool), "steps": "int64", "actions": str})
    table.insert(0, "episode", np.arange(len(table)))
    return table


def episode_rows(results: Overall, card: Card, nominal: Sequence[Option]) -> pd.DataFrame:
    """One row per episode.

    Returns:
        learner, seed, episode; `nominal`: the nominal skills did it alone; `flagged`: the policy took over; `success`;
        `diverged`; `steps`: control steps of the recovery; `actions`: its decisions, joined by `;`.
    """
    own = tuple(name for name in card.actions if not name.startswith("from "))
    names = (*own, *action_names((), nominal))
    count = len(results.success)
    steps, actions = np.zeros(count, dtype=np.int64), np.full(count, "", dtype=object)
    steps[results.flagged] = results.recoveries.steps
    actions[results.flagged] = [
        ";".join(names[action] for action in row if action >= 0) for row in results.recoveries.actions.tolist()
    ]
    flags = {name: getattr(results, name) for name in ("nominal", "flagged", "success", "diverged")}
    rows = pd.DataFrame({"episode": np.arange(count), **flags, "steps": steps, "actions": actions.astype(str)})
    return rows.assign(learner=card.learner, seed=card.seed)[["learner", "seed", *rows.columns]]
