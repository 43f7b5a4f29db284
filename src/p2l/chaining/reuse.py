"""Reuse of nominal options by recoveries, in states that may be new to nominal execution (figure 5.9).

The policy acts from every failure of the evaluation's episodes, up to the moment of its last decision: the state in
which it starts a nominal option. The distance of that state from the states of the option in nominal execution is
measured in the world's own features of failures (`World.mode_fields`), standardised over nominal states.

Readings of the thesis, which defines none of this:
1. Nominal execution: successful runs of the nominal skills. Flagged ones lead to the very states that recoveries start
   from.
2. Two sets of states for every option: `visited`, all in which it is at work, and `begun`, those in which it starts.
3. `novelty` defines what is outside a set.
4. A recovery that hands nothing back has no distance from these sets.

Axis letters: N recoveries, K states, F features.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from p2l.chaining.agent import Agent
from p2l.chaining.episodes import Agents, PolicyLedger, nominal_episodes
from p2l.chaining.execute import BATCH, RecoveryResults, recover
from p2l.chaining.novelty import SETS, NominalStates, StateSet
from p2l.chaining.strategies import strategy
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.failures.classifier import default_fields, features
from p2l.ledger import find, write
from p2l.records import Array, IntArray
from p2l.skills.chain import run
from p2l.skills.runner import Reason

VERSION = 1  # raise it when an edit of the code changes rows: committed records hold no hash of the code
COLUMNS = ("option", "success", "primitives", "strategy", *(f"off_{name}" for name in SETS))


def of_rows(world: World, rows: Rows) -> Array:
    """[K, F] the features of states."""
    truth = world.privileged(rows)
    return features(truth, tuple(world.mode_fields) or default_fields(truth))[1]


def nominal_sets(world: World, nominal: Sequence[Option], starts: Rows) -> NominalStates:
    """The states of the successful nominal runs from `starts`."""
    parts = [(np.arange(len(starts)), np.zeros(len(starts), dtype=np.int64), of_rows(world, starts))]
    execution = run(
        world, nominal, starts, watch=lambda who, step, rows: parts.append((who, step, of_rows(world, rows)))
    )
    episode, step, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.lexsort((step, episode))
    order = order[execution.success[episode[order]]]
    episode, step, values = episode[order], step[order], values[order]
    over = (execution.ends.episode[None] == episode[:, None]) & (execution.ends.step[None] <= step[:, None])
    option = over.sum(axis=1)  # the state in which one option ends is that in which the next begins
    spread = values.std(axis=0) if len(values) else np.ones(values.shape[1])
    centre = values.mean(axis=0) if len(values) else np.zeros(values.shape[1])
    spread = np.where(spread < 1e-9, 1.0, spread)
    begins = np.append(True, (episode[1:] != episode[:-1]) | (option[1:] != option[:-1]))[: len(option)]
    sets = {}
    for number in range(len(nominal)):
        for name, where in (("visited", option == number), ("begun", (option == number) & begins)):
            sets[number, name] = StateSet.of((values[where] - centre) / spread, episode[where])
    return NominalStates(centre, spread, sets)


def last_decisions(world: World, nominal: Sequence[Option], agent: Agent, rows: Rows) -> tuple[RecoveryResults, Rows]:
    """The agent's recoveries from `rows` [N], and the states [N] of their last decisions."""
    parts = [
        _last(world, nominal, agent, rows.take(np.arange(first, min(first + BATCH, len(rows)))))
        for first in range(0, len(rows), BATCH)
    ]
    batches, moments = zip(*parts, strict=True)
    names = RecoveryResults.__dataclass_fields__
    recoveries = RecoveryResults(**{name: np.concatenate([getattr(part, name) for part in batches]) for name in names})
    return recoveries, Rows.join(moments)


def _last(world: World, nominal: Sequence[Option], agent: Agent, rows: Rows) -> tuple[RecoveryResults, Rows]:
    every = np.arange(len(rows))
    moments = [rows.take(every)]  # by the number of actions that have ended
    latest = np.zeros(len(rows), dtype=np.int64)

    def watch(slots: IntArray, now: Rows) -> None:
        count = now.actions - rows.actions[slots]
        for number in np.unique(count[count > latest[slots]]).tolist():
            while len(moments) <= number:
                moments.append(rows.take(every))
            new = (count == number) & (latest[slots] < number)
            moments[number].put(slots[new], now.take(new))
            latest[slots[new]] = number

    recoveries = recover(world, nominal, agent, rows, watch)
    last = (recoveries.actions >= 0).sum(axis=1) - 1
    return recoveries, Rows.join([moments[number].take([row]) for row, number in enumerate(last.tolist())])


@dataclass(frozen=True)
class Novel:
    """A recovery that reused an option in a state in which nominal execution never starts it.

    Attributes:
        learner, seed: whose policy, and of which start states.
        failure: its number among the failures of the seed's episodes.
        option: that was reused.
        off: distance of the start from nominal ones, outside above 1.
    """

    learner: str
    seed: int
    failure: int
    option: str
    off: float


def most_novel(reuse: pd.DataFrame) -> Novel | None:
    """The farthest successful start, of rows of `reuse_of_seed`; None if none was outside.

    Novel is a start outside all states in which the option begins in nominal execution; the most novel is the farthest
    from them, in the world's own features of failures.
    """
    number = reuse.groupby(["learner", "seed"]).cumcount()
    rows = reuse.assign(number=number, off=reuse["off_begun"].astype(float))
    successes = rows[rows["success"].astype(bool) & (rows["option"] != "") & (rows["off"] > 1.0)]
    if successes.empty:
        return None
    one = successes.sort_values("off").iloc[-1]
    return Novel(str(one["learner"]), int(one["seed"]), int(one["number"]), str(one["option"]), float(one["off"]))


def reuse_rows(
    world: World, nominal: Sequence[Option], agent: Agent, failures: Rows, nominal_states: NominalStates
) -> pd.DataFrame:
    """One row per failure.

    Returns:
        `option`: the nominal option that took over, empty without one; `success`; `primitives`; `strategy`;
        `off_visited`, `off_begun`: distance from nominal execution's states of that option, outside above 1.
    """
    if not len(failures):
        return pd.DataFrame({name: [] for name in COLUMNS})
    recoveries, moment = last_decisions(world, nominal, agent, failures)
    count = (recoveries.actions >= 0).sum(axis=1)
    option = recoveries.actions[np.arange(len(count)), count - 1] - len(agent.primitives)
    values = of_rows(world, moment)
    off = {name: np.full(len(count), np.nan) for name in SETS}
    for number in np.unique(option[option >= 0]).tolist():
        mine = option == number
        for name in SETS:
            off[name][mine] = nominal_states.off(number, name, values[mine])
    names = [nominal[number].name if number >= 0 else "" for number in option.tolist()]
    primitives = count - (option >= 0)
    columns = {"option": names, "success": recoveries.success, "primitives": primitives}
    columns["strategy"] = strategy(world, failures, moment, primitives)
    return pd.DataFrame({**columns, **{f"off_{name}": value for name, value in off.items()}})


def reuse_of_seed(
    book: PolicyLedger,
    world: World,
    nominal: Sequence[Option],
    seed: int,
    agents: Agents,
    episodes: int,
    nominal_states: Callable[[], NominalStates],
    key: Sequence[Any],
) -> pd.DataFrame:
    """Rows of every learner, from the failures of `episodes_of_seed`; looked up in the ledger or run and recorded.

    Args:
        book: the ledger.
        world: where.
        nominal: the chain.
        seed: of the start states, and of the policies.
        agents: by learner; those of the whole task hand nothing over, and are left out.
        episodes: from which the failures come.
        nominal_states: makes the nominal states; called only if something has to be run.
        key: determines the nominal states.
    """
    failures: Rows | None = None
    tables = [pd.DataFrame({name: [] for name in ("learner", "seed", *COLUMNS)})]
    for learner, (agent, policy) in agents.items():
        names = [option.name for option in nominal]
        decisive = [VERSION, world.digest, world.estimator.mode, episodes, names, *key]
        item = book.entry(f"{learner}_reuse", seed, agent, policy, *decisive)
        if (record := find(book.records, item)) is None and not agent.whole_task:
            start_s = time.perf_counter()
            if failures is None:
                last = nominal_episodes(book, world, nominal, seed, episodes)[1].last
                failures = last.rows.take(last.reason == Reason.FAILURE)
            record = {"recoveries": _columns(reuse_rows(world, nominal, agent, failures, nominal_states()))}
            write(book.records, item, record, seconds=time.perf_counter() - start_s)
        if record is not None:
            tables.append(pd.DataFrame(record["recoveries"]).assign(learner=learner, seed=seed))
    return pd.concat([one for one in tables if len(one)] or tables, ignore_index=True)


def _columns(rows: pd.DataFrame) -> dict[str, list[Any]]:
    """Plain values; NaN becomes null."""
    plain = rows.astype(object).where(rows.notna(), None)
    return {str(name): [None if one is None else _plain(one) for one in column] for name, column in plain.items()}


def _plain(value: Any) -> Any:
    return round(float(value), 6) if isinstance(value, float) else value.item() if hasattr(value, "item") else value
