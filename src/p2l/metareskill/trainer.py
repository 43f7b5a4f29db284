"""Train one recovery once more: query REPS at another failure, refit the skill, measure it on held-out failures.

This is the `train` of Algorithm 3 (`metareskill.algorithm.Train`). A parameterised skill is k-nearest-neighbour
regression over the failures of its mode that were solved; its success rate q is measured on held-out failures of the
mode, which have another seed and are never trained from (thesis, sections 4.3.2 and 4.4).

Axis letters: N failures, P parameters.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from p2l.contracts.rows import Rows
from p2l.errors import ArtifactError
from p2l.metareskill.history import Trained
from p2l.metareskill.ledger import Entry, Ledger
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions, query
from p2l.metareskill.regression import ParameterisedSkill, fit_skill
from p2l.metareskill.start import Start
from p2l.metareskill.target import RecoveryTask
from p2l.records import Array, IntArray
from p2l.seeding import generator
from p2l.skills.execute import execute, without_noise
from p2l.skills.relative import SIZE


@dataclass(frozen=True)
class Trainer:
    """Trains recoveries of one world, from one set of failures; remembers in the ledger.

    Attributes:
        task: world and preconditions.
        failures: to train from.
        held_out: to measure on.
        options: of queries.
        seed: of all training.
        ledger: all queries so far.
        trials: largest number of held-out failures that one measurement uses.
        start: of the recoveries before any training; it names the guesses that skills add to.
    """

    task: RecoveryTask
    failures: Members
    held_out: Members
    options: QueryOptions
    seed: int
    ledger: Ledger
    start: Start
    trials: int = 50

    def __call__(self, mode: int, target: int, before: int) -> Trained:
        """Train recovery (mode, target) for the time `before` + 1."""
        key = mode, target, before
        if key not in self.ledger.entries:
            self.ledger.add(key, self._train(mode, target, before))
        entry = self.ledger.entries[key]
        return Trained(q=entry.q, trials=entry.trials, solved=entry.solved)

    def _train(self, mode: int, target: int, before: int) -> Entry:
        start = time.perf_counter()
        index = self._failure(mode, target, before)
        rng = generator(self.seed, "recovery", mode, target, before)
        rows, guess = self.failures.rows.take([index]), self.start.guess[mode][target]
        [answer] = query(self.task, rows, [target], [rng], self.options, [guess])
        past = self.ledger.of(mode, target, before)
        solutions = [(entry.failure, entry.parameters) for entry in past if entry.solved]
        q, trials = (past[-1].q, past[-1].trials) if past else (self.start.q[mode, target], len(self.tests(mode)))
        if answer.solved:
            solutions.append((index, answer.parameters))
            q, trials = self.measure(self._fit(mode, target, solutions), mode, target)
        return Entry(
            failure=index,
            solved=answer.solved,
            parameters=answer.parameters,
            success=np.array(answer.success),
            kl_nats=np.array(answer.kl_nats),
            rollouts=answer.rollouts,
            q=q,
            trials=trials,
            seconds=time.perf_counter() - start,
        )

    def kept(self, mode: int, target: int, trainings: int) -> int | None:
        """After which of the first `trainings` the skill came about that Algorithm 3 keeps; 0: before any of them.

        None: no query was solved, and the guess does not work either.
        """
        past = self.ledger.of(mode, target, trainings)
        rates = {number: entry.q for number, entry in enumerate(past, start=1) if entry.solved}
        if (start := float(self.start.q[mode, target])) > 0.0:
            rates[0] = start
        return max(rates, key=lambda number: (rates[number], number)) if rates else None

    def skill(self, mode: int, target: int, trainings: int) -> ParameterisedSkill | None:
        """The best skill of the first `trainings` of a recovery, as Algorithm 3 keeps it; None: there is none."""
        if (best := self.kept(mode, target, trainings)) is None:
            return None
        past = self.ledger.of(mode, target, best)
        solutions = [(entry.failure, entry.parameters) for entry in past if entry.solved]
        return self._fit(mode, target, solutions)

    def tests(self, mode: int) -> IntArray:
        """Indices of the held-out failures that measure a mode's recoveries."""
        members = self.held_out.of(mode)
        if not len(members):
            raise ArtifactError(
                f"failure mode {mode} has no held-out failure, so its recoveries cannot be measured; "
                "discover with more held-out executions (`executions.held_out`), or cluster into fewer modes"
            )
        order = generator(self.seed, "held_out", mode).permutation(len(members))
        return np.asarray(members[order[: self.trials]])

    def measure(self, skill: ParameterisedSkill, mode: int, target: int) -> tuple[float, int]:
        """Success rate on held-out failures of the mode, all in one batch, and their number."""
        rows = without_noise(self.held_out.rows.take(self.tests(mode)))
        arrivals = execute(
            self.task.world, rows, self.task.recovery(skill, target, self.task.world.observe(rows)), self.options.timing
        )
        _, reached = self.task.judge(arrivals.last, target, verify=self.options.verify)
        return float((reached & ~arrivals.diverged).mean()), len(rows)

    def _failure(self, mode: int, target: int, before: int) -> int:
        """Another failure each time, until all of the mode have been queried."""
        members = self.failures.of(mode)
        order = generator(self.seed, "order", mode, target).permutation(len(members))
        return int(members[order[before % len(members)]])

    def _fit(self, mode: int, target: int, solutions: Sequence[tuple[int, Array]]) -> ParameterisedSkill:
        """The skill of solved failures with their answers; without any, the guess as it is."""
        guess = self.start.guess[mode][target]
        reference = self._context(self.failures.rows.take(self.failures.of(mode)))
        if not solutions:
            return fit_skill(reference[:1], np.zeros((1, SIZE)), reference=reference, guess=guess)
        index, answers = zip(*solutions, strict=True)
        rows, parameters = without_noise(self.failures.rows.take(list(index))), np.stack(answers)
        if guess:
            parameters = parameters - self.task.guessed(guess, self.task.world.observe(rows), target)
        return fit_skill(self._context(rows), parameters, reference=reference, guess=guess)

    def _context(self, rows: Rows) -> Array:
        return self.task.state(rows)[:, list(self.task.symbols.context)]
