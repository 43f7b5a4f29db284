"""Search a budget of control steps for macros that recover, and learn the policy that chooses among them.

Rounds of trials follow one another (`proposals`); from time to time the network learns one macro for each failure
(`memory.SearchMemory.examples`), and is evaluated on failures set apart.

1. This is none of the thesis's methods: its MDP, its actions and its episodes, but no policy gradient.
2. A control step is a control step: those of trials count like those of PPO's episodes, those of evaluations do not.
3. A run that was killed goes on from its last evaluation and comes to the same policy.

Axis letters: N failures, K decisions, O state columns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from p2l.chaining.checkpoint import Progress, load_checkpoint, save_checkpoint
from p2l.chaining.learner import ChainTask, Learner
from p2l.chaining.policy import Card, Policy
from p2l.chaining.search.macros import MacroSpace, padded
from p2l.chaining.search.memory import SearchMemory
from p2l.chaining.search.mixture import PracticeGrounds, mixture_of
from p2l.chaining.search.model import OutcomeTable, SuccessModel, pair_features
from p2l.chaining.search.network import clone
from p2l.chaining.search.proposals import RoundPlan, Trial, propose
from p2l.chaining.search.trials import MacroTrials
from p2l.chaining.search_settings import SearchSettings
from p2l.chaining.selection import judge_and_keep
from p2l.chaining.train import TrainSettings
from p2l.contracts.rows import Rows
from p2l.records import Array
from p2l.seeding import entropy, generator

SHORT = 50  # trials of the first round
GROWTH = 0.25  # of a later one, as a share of all trials before it: the first ones teach most
LEAST_ROUND = 0.25  # of a round's trials: with fewer, the forest would be fitted for next to nothing
Report = Callable[[str, Mapping[str, float]], None]


@dataclass
class _Run:
    """One training run, see `train`."""

    task: ChainTask
    learner: Learner
    plan: SearchSettings
    mixture: PracticeGrounds
    settings: TrainSettings
    card: Card
    folder: Path
    report: Report
    progress: Progress
    search: SearchMemory
    space: MacroSpace
    features: Array
    first: Array
    since_s: float = field(default_factory=time.perf_counter)
    fitted: int = 0
    forest: SuccessModel | None = None

    def seed(self, purpose: str) -> int:
        """Of a purpose, at this point of the budget."""
        world, steps = self.task.world.name, self.progress.control_steps
        return entropy(self.task.seed, "search", world, purpose, steps) & (2**32 - 1)

    def model(self) -> SuccessModel | None:
        """Of all outcomes so far, fitted once for a round and an evaluation."""
        if self.fitted != len(self.search.table):
            self.fitted = len(self.search.table)
            self.forest = SuccessModel.fit(self.features, self.search.table, self.space, self.seed("forest"))
        return self.forest

    def trials(self) -> int:
        """Of the next round, so that the budget is not exceeded; 0 where it hardly suffices for another one."""
        known, progress = len(self.search.table), self.progress
        whole_round = min(self.plan.trials, max(SHORT, int(known * GROWTH)))
        if not known:
            return whole_round
        fit = int((self.settings.budget - progress.control_steps) * known / progress.control_steps)
        return min(whole_round, fit) if fit >= whole_round * LEAST_ROUND else 0

    def round(self, proposed: list[Trial]) -> None:
        """Carry out proposed trials, learn their outcomes."""
        progress = self.progress
        macros = padded([macro for _, macro in proposed], self.learner.limits.decisions)
        failure = np.array([failure for failure, _ in proposed], dtype=np.int64)
        limits, width = self.learner.limits, self.first.shape[1]
        trials = self.mixture.trials(self.learner.primitives, failure, macros, limits, width)
        self.search.add(proposed, trials)
        progress.control_steps += int(trials.steps.sum())
        self._tell(trials)

    def _tell(self, trials: MacroTrials) -> None:
        progress = self.progress
        counts = np.bincount(trials.actions[trials.actions >= 0], minlength=len(self.card.actions))
        chosen = {f"chosen:{name}": int(count) for name, count in zip(self.card.actions, counts, strict=True)}
        row: dict[str, float] = {
            "round": len(progress.rounds),
            "control_steps": progress.control_steps,
            "spared": 0,
            "ended": len(trials),
            "done": int(trials.success.sum()),
            "revisited": 0,
            "settled": 0,
            "timeouts": trials.timeouts,
            "reward": float(trials.success.sum()),
            **chosen,
        }
        progress.rounds.append(row)
        self.report("round", {**row, "seconds": self.seconds()})

    def policy(self) -> Policy:
        """The network, learnt from the examples so far."""
        plan = self.plan
        examples = self.search.examples(self.model(), self.features, self.first, plan.portfolio, self.mixture.ground)
        hidden, seed = self.settings.ppo.hidden, self.seed("network")
        return clone(self.card, *examples, hidden, updates=plan.updates, batch=plan.batch, seed=seed)

    def evaluate(self) -> None:
        """Learn the network, let it act on failures set apart, keep the best, and what the search remembers."""
        progress, start_s = self.progress, self.seconds()
        row = judge_and_keep(self.policy(), self.learner, self.mixture.apart, progress, self.folder)
        progress.evaluation_seconds += self.seconds() - start_s
        self.search.save_macros(self.folder, self.card.actions, self.plan.portfolio)
        self.remember()
        self.report("evaluation", {**row, "seconds": progress.seconds})

    def remember(self) -> None:
        """Write what a run that is killed goes on from."""
        progress = self.progress
        progress.seconds = self.seconds()
        progress.tensors = self.search.tensors(self.learner.limits.decisions)
        save_checkpoint(self.folder, progress, self.card)

    def seconds(self) -> float:
        """Wall time of the run, those before an interruption included."""
        return time.perf_counter() - self.since_s

    def is_due(self) -> bool:
        """Whether an evaluation is."""
        last = self.progress.evaluations[-1]["control_steps"] if self.progress.evaluations else 0
        return self.progress.control_steps - last >= self.settings.evaluate_every


def search_train(
    task: ChainTask,
    learner: Learner,
    plan: SearchSettings,
    evaluation_starts: Rows,
    settings: TrainSettings,
    card: Card,
    folder: Path,
    report: Report,
) -> Progress:
    """Search up to the budget; writes the best policy to `folder`. See `p2l.chaining.train.train` for the arguments.

    Where nothing that was tried recovers from any failure, the policy does what was tried first: that is a result, too,
    and a comparison over seeds that left it out would be flattered.
    """
    progress = load_checkpoint(folder, card) or Progress()
    torch.set_num_threads(1)  # the network is small, and sums depend on the number of threads
    mixture = mixture_of(task, learner.others, plan.executions, evaluation_starts)
    progress.told = mixture.told()
    state = mixture.states(learner.limits)
    rng = generator(task.seed, "chain_recoveries", task.world.name, "search")
    search = SearchMemory(OutcomeTable(), {}, rng)
    if progress.tensors:
        search.restore(progress.tensors)
        report("resumed", {"control_steps": progress.control_steps, "spared": 0})
    space = MacroSpace(len(learner.primitives), len(card.actions) - len(learner.primitives), plan.longest)
    features = np.concatenate([pair_features(state.values, state.names), mixture.identity()], axis=1)
    run = _Run(
        task,
        learner,
        plan,
        mixture,
        settings,
        card,
        folder,
        report,
        progress,
        search,
        space,
        features,
        state.values,
    )
    run.since_s -= progress.seconds
    while trials := run.trials():
        proposed = propose(RoundPlan(trials, plan.portfolio), space, search.table, run.model(), features, rng)
        if not proposed:
            break
        run.round(proposed)
        if any(search.table.success) and run.is_due():
            run.evaluate()
        elif not progress.evaluations:
            run.remember()
    if not progress.evaluations or progress.evaluations[-1]["control_steps"] < progress.control_steps:
        run.evaluate()
    return progress
