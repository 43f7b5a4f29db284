"""Train a recovery policy: rounds of PPO, evaluations on held-out failures, the best policy, runs that resume.

1. Evaluation during training uses failures that training never starts from, so that the best policy is selected on
   held-out data; it costs no budget and is reported on its own. At thesis scale it has 40 episodes, where the
   author's has 20: these hardly tell a policy of 65 % from one of 75 %.
2. A run that was killed, however often, comes to the same policy as one that was not, to the bit: a checkpoint is taken
   after the update that follows an evaluation, and holds everything that decides the future.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from p2l.chaining.checkpoint import Progress, load_checkpoint, save_checkpoint
from p2l.chaining.ground import Ground
from p2l.chaining.learner import ChainTask, Learner, no_failures
from p2l.chaining.policy import NARROWEST, Card, Normalisation
from p2l.chaining.ppo import PoolPPO, PPOSettings
from p2l.chaining.selection import judge_and_keep
from p2l.chaining.states import action_names, first_state
from p2l.chaining.weights import export_policy, restore, tensors
from p2l.contracts.rows import Rows
from p2l.errors import ConfigError
from p2l.seeding import entropy, generator
from p2l.skills.primitives import STEPS


@dataclass(frozen=True)
class TrainSettings:
    """Budget and rhythm.

    Attributes:
        budget: control steps to simulate, options included, also those of options that a shortcut spares.
        slots: episodes at once.
        evaluate_every: control steps of the budget between evaluations.
        episodes: of an evaluation.
        ppo: of the algorithm.
        revisit: largest share of the episodes that start at earlier successes, in [0, 1], see `revisit`.
    """

    budget: int
    slots: int = 64
    evaluate_every: int = 20_000
    episodes: int = 20
    ppo: PPOSettings = field(default_factory=PPOSettings)
    revisit: float = 0.0

    def check_rounds(self) -> None:
        """Refuse a budget of less than a round of PPO, which a search has none of.

        Raises:
            ConfigError: it is.
        """
        round_steps = self.ppo.n_steps * STEPS
        if self.budget < round_steps:
            raise ConfigError(
                f"a budget of {self.budget} control steps is less than one round of {self.ppo.n_steps} decisions of "
                f"{STEPS} control steps; give at least {round_steps}"
            )


@dataclass(frozen=True)
class FailureSplit:
    """Failures for training, and failures for evaluations during training.

    Attributes:
        training: start states of training episodes.
        evaluation: start states of evaluations.
        overlap: the failures are too few to set some apart: evaluations start at failures of training.
    """

    training: Rows
    evaluation: Rows
    overlap: bool = False

    @property
    def set_apart(self) -> int:
        """Number of failures for evaluations alone."""
        return 0 if self.overlap else len(self.evaluation)


Report = Callable[[str, Mapping[str, float]], None]


def split(rows: Rows, episodes: int, seed: int, world: str) -> FailureSplit:
    """Set `episodes` failures apart; where that would be more than a fifth, none, and evaluations use them all.

    Raises:
        ConfigError: there is no failure.
    """
    if not len(rows):
        raise no_failures(world)
    order = generator(seed, "chain_recoveries", world, "split").permutation(len(rows))
    if len(rows) < 5 * episodes:
        return FailureSplit(rows, rows.take(order[np.arange(episodes) % len(rows)]), overlap=True)
    return FailureSplit(rows.take(np.sort(order[episodes:])), rows.take(order[:episodes]))


def evaluation_starts_of(task: ChainTask, learner: Learner, parts: FailureSplit, episodes: int) -> Rows:
    """Start states of evaluations during training: failures set apart, or new start states for a whole task."""
    if not learner.whole_task:
        return parts.evaluation
    return task.world.sample(generator(task.seed, "chain_recoveries", task.world.name, "apart"), episodes)


def success_everywhere(evaluation: Mapping[str, float]) -> float:
    """By what policies are chosen: the success of an evaluation in all the worlds that were practised in."""
    return evaluation.get("success_everywhere", evaluation["success"])


def summary(progress: Progress) -> dict[str, Any]:
    """Summary numbers of a completed run, the same on every machine; for wall times see `times`."""
    return {
        "control_steps": progress.control_steps,
        "spared": progress.spared,
        "evaluation_steps": sum(row["evaluation_steps"] for row in progress.evaluations),
        "decisions": int(sum(value for row in progress.rounds for name, value in row.items() if "chosen:" in name)),
        "timeouts": sum(row["timeouts"] for row in progress.rounds),
        "settled": sum(row["settled"] for row in progress.rounds),
        "best_evaluation": progress.best,
        "last_evaluation": success_everywhere(progress.evaluations[-1]),
    }


def times(progress: Progress) -> dict[str, float]:
    """Wall time of a run, s; `control_steps_per_s` is the speed without evaluations."""
    learning_s = max(progress.seconds - progress.evaluation_seconds, 1e-9)
    return {"seconds": progress.seconds, "control_steps_per_s": progress.control_steps / learning_s}


def card_of(task: ChainTask, learner: Learner, name: str, config_hash: str, narrowest: float = NARROWEST) -> Card:
    """The card of the policy to train; observations are standardised over the starts of the episodes, at first."""
    state = first_state(task.world, learner.starts, learner.limits)
    return Card(
        world=task.world.name,
        digest=task.world.digest,
        learner=name,
        seed=task.seed,
        config_hash=config_hash,
        columns=state.names,
        actions=action_names(learner.primitives, task.nominal if learner.options else ()),
        limits=learner.limits,
        normalisation=Normalisation.of(state.values, narrowest),
        whole_task=learner.whole_task,
        preconditions=learner.preconditions is not None,
    )


def train(
    task: ChainTask,
    learner: Learner,
    evaluation_starts: Rows,
    settings: TrainSettings,
    card: Card,
    folder: Path,
    report: Report,
) -> Progress:
    """Train up to the budget; writes the best policy to `folder`.

    Args:
        task: of the policy.
        learner: its MDP.
        evaluation_starts: start states of evaluations.
        settings: budget and rhythm.
        card: of the policy, its `told` still empty.
        folder: for the policy and the checkpoint.
        report: called with each `round` and each `evaluation` row, with the wall time `seconds`; before them, where a
            checkpoint is resumed, with `resumed` and its control steps.
    """
    progress = load_checkpoint(folder, card) or Progress()
    steps_before = progress.control_steps
    if steps_before:
        report("resumed", {"control_steps": steps_before, "spared": progress.spared})
    torch.set_num_threads(1)  # the networks are small, and their first weights depend on the number of threads
    rng = generator(task.seed, "chain_recoveries", task.world.name, "starts", 0)
    pool = learner.pool(task, rng, settings.slots, settings.revisit)
    seed = entropy(task.seed, "chain_recoveries", task.world.name, "ppo", 0) & (2**32 - 1)
    running = learner.running_normalisation
    model = PoolPPO(pool, settings.ppo, card.normalisation, seed, learner.shortcut, running=running)
    if progress.tensors:
        restore(model, progress, rng)
    watcher = _Watcher(task, learner, evaluation_starts, settings, card, folder, report, progress, rng)
    model.learn(settings.budget - model.num_timesteps, callback=watcher, log_interval=10**9, reset_num_timesteps=False)
    watcher.finish()
    return progress


class _Watcher(BaseCallback):
    """After each round: its counts; from time to time an evaluation, the best policy, a checkpoint."""

    model: PoolPPO

    def __init__(
        self,
        task: ChainTask,
        learner: Learner,
        evaluation_starts: Rows,
        settings: TrainSettings,
        card: Card,
        folder: Path,
        report: Report,
        progress: Progress,
        rng: np.random.Generator,
    ) -> None:
        super().__init__()
        self._task, self._learner, self._evaluation_starts = task, learner, evaluation_starts
        self._settings, self._card, self._folder = settings, card, folder
        self._report, self._progress = report, progress
        self._since = time.perf_counter() - progress.seconds
        self._rng = rng
        self._timeouts = 0  # of the pool, before the round
        self._is_due = False  # a checkpoint, once the policy is updated

    def _on_training_start(self) -> None:
        self._timeouts = self.model.pool.timeouts
        if not self._progress.evaluations:
            self._evaluate()

    def _on_rollout_start(self) -> None:
        if self._is_due:
            self._progress.tensors = tensors(self.model, self._rng)
            self._progress.seconds = self._seconds()
            save_checkpoint(self._folder, self._progress, self._card)
            self._is_due = False

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        one, progress = self.model.round, self._progress
        progress.control_steps, progress.spared = self.model.pool.control_steps, self.model.spared
        counts = {f"chosen:{name}": int(k) for name, k in zip(self.model.pool.actions, one.action_counts, strict=True)}
        row: dict[str, float] = {
            "round": len(progress.rounds),
            "control_steps": progress.control_steps,
            "spared": progress.spared,
            "ended": one.ended,
        }
        row |= {
            "done": one.done,
            "revisited": one.revisited,
            "settled": one.settled,
            "timeouts": self.model.pool.timeouts - self._timeouts,
        }
        row |= {"reward": one.reward, **counts}
        self._timeouts = self.model.pool.timeouts
        progress.rounds.append(row)
        self._report("round", {**row, "seconds": self._seconds()})
        last = progress.evaluations[-1]
        if self.model.num_timesteps - last["control_steps"] - last["spared"] >= self._settings.evaluate_every:
            self._evaluate()

    def finish(self) -> None:
        """The last evaluation: after the last update, unless the last rollout has just had one."""
        last = self._progress.evaluations[-1]
        if last["control_steps"] + last["spared"] < self.model.num_timesteps:
            self._evaluate()

    def _evaluate(self) -> None:
        progress, start_s = self._progress, self._seconds()
        progress.control_steps, progress.spared = self.model.pool.control_steps, self.model.spared
        policy = export_policy(self.model, self._card)
        task = self._task
        apart = [Ground(task.world, task.nominal, self._evaluation_starts)]
        row = judge_and_keep(policy, self._learner, apart, progress, self._folder)
        progress.evaluation_seconds += self._seconds() - start_s
        self._is_due = True
        progress.seconds = self._seconds()
        self._report("evaluation", {**row, "seconds": progress.seconds})

    def _seconds(self) -> float:
        return time.perf_counter() - self._since
