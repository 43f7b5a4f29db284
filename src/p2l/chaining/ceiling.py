"""What macros do without a policy: the one that is best everywhere, and whichever recovers (a ceiling for any choice).

Macros are those that a search on training failures has left, in their order there, so that none is chosen by what is
reported. The ceiling of open-loop macros is none of closed loops: a policy may do better than it.

Axis letters: F failures, K macros.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from p2l.chaining.agent import Agent
from p2l.chaining.episodes import PolicyLedger, episode_rows, nominal_episodes, record_of, table_of
from p2l.chaining.execute import Overall, RecoveryResults
from p2l.chaining.policy import Policy
from p2l.chaining.search.macros import Macro, padded
from p2l.chaining.search.trials import run_trials
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.ledger import find, write
from p2l.skills.runner import Reason

CONSTANT, ANY = "constant_macro", "any_macro"
SLOTS = 128  # trials at once; they change no outcome


VERSION = 1  # raise it when an edit of the code changes outcomes: committed records know no code


@dataclass(frozen=True)
class Ceiling:
    """Macros of `learner`'s runs, as many as `macros`; none: the rows are left out."""

    learner: str
    macros: int


def ceiling_of_seed(
    book: PolicyLedger,
    world: World,
    nominal: Sequence[Option],
    seed: int,
    source: tuple[Agent, Policy],
    macros: Sequence[Macro],
    episodes: int,
) -> pd.DataFrame:
    """Rows of `episodes.episodes_of_seed` for `CONSTANT` and `ANY`, looked up in the ledger or run and recorded.

    Args:
        book: the ledger.
        world: where.
        nominal: the chain.
        seed: of the start states, and of the search.
        source: agent and policy of the search, whose actions the macros are of.
        macros: K, the one first that recovered from most failures of its training.
        episodes: as many as for every learner, from the same start states.
    """
    agent, policy = source
    names = [option.name for option in nominal]
    plain_macros = [list(macro) for macro in macros]
    decisive = [VERSION, world.digest, world.estimator.mode, episodes, names, plain_macros]
    item = book.entry(f"{policy.card.learner}_macros", seed, agent, policy, *decisive)
    if (record := find(book.records, item)) is None:
        _, plain = nominal_episodes(book, world, nominal, seed, episodes)
        start_s = time.perf_counter()
        flagged = plain.last.reason == Reason.FAILURE
        record = {}
        for name, recoveries in _recoveries(world, nominal, agent, plain.last.rows.take(flagged), macros).items():
            success = plain.success.copy()
            success[flagged] = recoveries.success
            whole = Overall(plain.success, flagged, recoveries, success, plain.diverged)
            record[name] = record_of(episode_rows(whole, policy.card, nominal))
        write(book.records, item, record, seconds=time.perf_counter() - start_s)
    parts = [table_of(record[name]).assign(learner=name, seed=seed, whole_task=False) for name in (CONSTANT, ANY)]
    return pd.concat(parts, ignore_index=True)


def _recoveries(
    world: World, nominal: Sequence[Option], agent: Agent, failures: Rows, macros: Sequence[Macro]
) -> dict[str, RecoveryResults]:
    """Recoveries from F failures by the first macro, and by the first one that succeeds, or else the first."""
    table, count = padded(macros, agent.limits.decisions), len(macros)
    if not len(failures):
        none = RecoveryResults(np.zeros(0, dtype=np.bool_), table[:0], np.zeros(0, dtype=np.int64))
        return {CONSTANT: none, ANY: none}
    place, column = np.repeat(np.arange(len(failures)), count), np.tile(np.arange(count), len(failures))
    limits = agent.limits
    trials = run_trials(world, nominal, agent.primitives, failures, place, table[column], limits, slots=SLOTS)
    first = np.arange(len(failures)) * count
    best = first + trials.success.reshape(len(failures), count).argmax(axis=1)
    return {
        name: RecoveryResults(trials.success[rows], trials.actions[rows], trials.steps[rows])
        for name, rows in ((CONSTANT, first), (ANY, best))
    }
