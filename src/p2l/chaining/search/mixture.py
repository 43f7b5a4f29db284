"""Failures of several worlds as those of one: the task's own world, and others that differ from it in a few parameters.

A policy that is to work with another thing, other gains or another friction learns from failures met there. Every
failure has one index; with one world it is that of its row.

Axis letters: N failures of all worlds, T trials, D decisions, O state columns, G worlds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from p2l.chaining.execute import nominal_part
from p2l.chaining.ground import Ground
from p2l.chaining.learner import ChainTask
from p2l.chaining.mdp import Limits
from p2l.chaining.search.trials import MacroTrials, run_trials
from p2l.chaining.states import first_state
from p2l.chaining.train import split
from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import NO_FAILURE, World
from p2l.errors import ConfigError
from p2l.records import Array, IntArray
from p2l.seeding import generator

SLOTS = 128  # trials at once; a wider batch is faster and changes nothing


@dataclass(frozen=True)
class PracticeGrounds:
    """Failures to practise on, and those set apart.

    Attributes:
        training: G of them.
        apart: G of them, for evaluations.
        ground: [N] which of them each failure belongs to.
        row: [N] its row there.
    """

    training: tuple[Ground, ...]
    apart: tuple[Ground, ...]
    ground: IntArray
    row: IntArray

    def __len__(self) -> int:
        return len(self.ground)

    def states(self, limits: Limits) -> Observation:
        """[N, O] first states."""
        each = [first_state(one.world, one.failures, limits) for one in self.training]
        start = np.cumsum([0, *(len(one.failures) for one in self.training)])[self.ground]
        return Observation(each[0].columns, np.concatenate([one.values for one in each])[start + self.row])

    def identity(self) -> Array:
        """[N, G] the world of each failure, as 0 or 1; [N, 0] of one world.

        The model of success knows it, the policy never: what recovers in which world is learnt from all outcomes, and
        the network then tells the worlds apart by what is seen.
        """
        worlds = len(self.training)
        return np.eye(worlds)[self.ground] if worlds > 1 else np.zeros((len(self), 0))

    def told(self) -> dict[str, float]:
        """How many failures each further world has to practise on, and how many are set apart there."""
        kinds = {"failures": self.training, "set_apart": self.apart}
        return {
            f"{kind}:{one.name}": len(one.failures) for kind, grounds in kinds.items() for one in grounds if one.name
        }

    def trials(
        self, primitives: Sequence[Option], failure: IntArray, macros: IntArray, limits: Limits, width: int
    ) -> MacroTrials:
        """Carry out one macro from each of the failures named, in its world; see `trials.run_trials`.

        Args:
            primitives: the agent's own actions.
            failure: [T] where each trial starts.
            macros: [T, D] actions, −1 after the last.
            limits: bounds of an episode.
            width: O.
        """
        count = len(failure)
        actions, states = np.full(macros.shape, -1, dtype=np.int64), np.zeros((*macros.shape, width))
        success, steps, timeouts = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.int64), 0
        for index, one in enumerate(self.training):
            mine = np.flatnonzero(self.ground[failure] == index)
            if not len(mine):
                continue
            rows = self.row[failure[mine]]
            done = run_trials(one.world, one.nominal, primitives, one.failures, rows, macros[mine], limits, slots=SLOTS)
            actions[mine], states[mine], success[mine], steps[mine] = (
                done.actions,
                done.states,
                done.success,
                done.steps,
            )
            timeouts += done.timeouts
        return MacroTrials(np.asarray(failure), actions, states, success, steps, timeouts)


def mixture_of(task: ChainTask, others: Mapping[str, World], executions: int, evaluation: Rows) -> PracticeGrounds:
    """The failures of a task and of other worlds, where the nominal skills run `executions` times each.

    Of the others' failures as many are set apart, all together, as of the task's own.

    Args:
        task: of the policy.
        others: further worlds, by name.
        executions: in each of them.
        evaluation: failures of the task that are set apart already.

    Raises:
        ConfigError: the nominal skills did not fail in some of them.
    """
    training, apart = [Ground(task.world, task.nominal, task.failures)], [Ground(task.world, task.nominal, evaluation)]
    harmless = []
    for index, (name, world) in enumerate(others.items()):
        nominal = world.nominal_options()
        rng = generator(task.seed, "chain_recoveries", task.world.name, "mixture", str(index))
        last = nominal_part(world, nominal, world.sample(rng, executions), slots=SLOTS).last
        flagged = last.kind != NO_FAILURE
        if not flagged.any():
            harmless.append(name)
            continue
        parts = split(last.rows.take(flagged), max(len(evaluation) // len(others), 1), task.seed, world.name)
        training.append(Ground(world, nominal, parts.training, name))
        apart.append(Ground(world, nominal, parts.evaluation, name))
    if harmless:
        raise ConfigError(
            f"search: the nominal skills did not fail in {executions} executions of the mixture's "
            f"{', '.join(harmless)}; leave that out, or give more (learner.params.executions)"
        )
    ground = np.repeat(np.arange(len(training)), [len(one.failures) for one in training])
    row = np.concatenate([np.arange(len(one.failures)) for one in training])
    if others:  # the first failures are tried first, see `proposals`
        order = generator(task.seed, "chain_recoveries", task.world.name, "mixture").permutation(len(ground))
        ground, row = ground[order], row[order]
    return PracticeGrounds(tuple(training), tuple(apart), ground, row)
