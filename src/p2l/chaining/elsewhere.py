"""Zero-shot transfer of policies to another arm, another object, another simulator (thesis, table 5.2).

Failures are induced as in section 5.4.5: the nominal skills run until a detector has fired often enough; from each of
those moments the policy acts, and the rate of successful recoveries counts.

Axis letters: F failures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pandas as pd

from p2l.chaining.agent import Agent
from p2l.chaining.episodes import Agents, PolicyLedger
from p2l.chaining.execute import nominal_part, recover
from p2l.contracts.option import Option
from p2l.contracts.world import World
from p2l.errors import ConfigError, P2LError
from p2l.ledger import find, write
from p2l.seeding import generator
from p2l.skills.runner import Reason
from p2l.worlds.table import make_world

VERSION = 2  # raise it when an edit of the code changes episodes: committed records know no code
MIRROR_VERSION = 3  # the same for robosuite's environments alone
AT_ONCE = 64
ROBOSUITE = "robosuite"
MOST = 20  # executions for each failure to induce: where nominal skills hardly ever fail the search ends


@dataclass(frozen=True)
class Variant:
    """A world to transfer policies to.

    Attributes:
        name: for tables and records.
        world: with the columns and actions of the one in which they were trained.
        failures: F to induce.
        at_once: rows that the world can simulate.
    """

    name: str
    world: World
    failures: int
    at_once: int = AT_ONCE

    @property
    def nominal(self) -> tuple[Option, ...]:
        """Its chain."""
        return self.world.nominal_options()


def variants(
    name: str, params: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]], failures: int
) -> list[Variant]:
    """The worlds `others`, by name: parameters that differ from `params`.

    Raises:
        ConfigError: one of them is refused.
    """
    made = []
    for other, differs in others.items():
        try:
            made.append(Variant(other, make_world(name, {**params, **differs}), failures))
        except P2LError as error:
            raise ConfigError(f"transfer.variants.{other}: {error}") from error
    return made


def robosuite_variant(world: World, failures: int, stack: ExitStack) -> Variant:
    """The environment and controller of robosuite in place of `world`, one row at a time; `stack` closes it."""
    from p2l.worlds.robosuite import make

    there = make(world)
    stack.callback(there.engine.close)
    return Variant(ROBOSUITE, there, failures, at_once=1)


def transfer_of_seed(
    book: PolicyLedger,
    variant_agents: Sequence[tuple[Variant, Agents]],
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> pd.DataFrame:
    """Recovery counts of every variant and learner, looked up in the ledger or run and recorded.

    Args:
        book: the ledger.
        variant_agents: the variants, each with the agents that act there, by learner.
        seed: of the start states, and of the policies.
        progress: called with 1 after each policy.

    Returns:
        `variant, learner, seed, failures, recovered, executions`, a row per variant and learner.
    """
    columns = ["variant", "learner", "seed", "failures", "recovered", "executions"]
    rows = []
    for variant, agents in variant_agents:
        for learner, (agent, policy) in agents.items():
            world, names = variant.world, [option.name for option in variant.nominal]
            decisive = [VERSION, variant.name, world.digest, world.estimator.mode, variant.failures, names]
            decisive += [MIRROR_VERSION] if variant.name == ROBOSUITE else []
            item = book.entry(f"{learner}_to_{variant.name}", seed, agent, policy, *decisive)
            if (record := find(book.records, item)) is None:
                start_s = time.perf_counter()
                record = recovery_counts(variant, agent, seed)
                write(book.records, item, record, seconds=time.perf_counter() - start_s)
            counts = {name: int(record[name]) for name in ("failures", "recovered", "executions")}
            rows.append({"variant": variant.name, "learner": learner, "seed": seed, **counts})
            if progress is not None:
                progress(1)
    return pd.DataFrame(rows, columns=columns)


def recovery_counts(variant: Variant, agent: Agent, seed: int) -> dict[str, Any]:
    """Run the nominal skills until they have failed often enough, and count the failures that the agent recovers from.

    Args:
        variant: where.
        agent: recovers from the failures.
        seed: of the start states; the failures are the same for every agent.
    """
    world, target = variant.world, variant.failures
    rng = generator(seed, "evaluate_chains", world.name, "transfer", variant.name)
    outcomes: list[bool] = []
    executions = 0
    while len(outcomes) < target and executions < MOST * target:
        starts = world.sample(rng, variant.at_once)
        plain = nominal_part(world, variant.nominal, starts, slots=variant.at_once)
        executions += len(starts)
        flagged = plain.last.reason == Reason.FAILURE
        if flagged.any():
            recoveries = recover(world, variant.nominal, agent, plain.last.rows.take(flagged))
            outcomes += recoveries.success.tolist()
    attempts = outcomes[:target]
    return {"failures": len(attempts), "recovered": sum(attempts), "executions": executions}
