"""What a recovery is before its first query: the best guess of how to get there, and how often that works.

In the thesis a recovery succeeds never before it is trained (section 4.3.3). But a motion can be guessed (`target`),
and to run it costs a few rollouts where a query costs hundreds: of the guesses the one that does best from training
failures of the mode is taken for each recovery. It is what REPS begins with, what a skill adds to, and a skill itself
whose success rate is measured on held-out failures like every other one's. So nothing that is learnt is worse than
going straight back, and a chooser knows from the beginning what needs no training.

Axis letters: I modes, M targets, N failures.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from p2l.artifacts import config_hash
from p2l.contracts.rows import Rows
from p2l.errors import ConfigError
from p2l.ledger import Item, find, write
from p2l.metareskill.identity import preconditions_hash
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.target import GUESSES, RecoveryTask
from p2l.records import Array, freeze
from p2l.skills.execute import execute, without_noise

CHOSEN_ON = 20  # training failures of a mode, at most, on which guesses are compared
VERSION = 1  # raise it when an edit of the code changes what is measured: committed records know no code


@dataclass(frozen=True)
class Start:
    """The recoveries of a graph before any training.

    Attributes:
        guess: I rows of M names of `target.GUESSES`; empty where a skill predicts the motion itself.
        q: [I, M] success rates on held-out failures.
        choice: the names that there were to choose from.
        rollouts: how many were run for it.
    """

    guess: tuple[tuple[str, ...], ...]
    q: Array
    choice: tuple[str, ...] = ()
    rollouts: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", freeze("q", self.q, ("I", "M"), {"I": len(self.guess)}, low=0.0, high=1.0))

    @classmethod
    def nothing(cls, modes: int, targets: int) -> Start:
        """No guess, and no success before any training."""
        return cls((("",) * targets,) * modes, np.zeros((modes, targets)))

    def beside(self, more: Start) -> Start:
        """With the recoveries of further modes."""
        return Start(
            (*self.guess, *more.guess), np.concatenate([self.q, more.q]), self.choice, self.rollouts + more.rollouts
        )


def check_guesses(guesses: Sequence[str]) -> None:
    """Refuse names that are none of `GUESSES`, or twice there.

    Raises:
        ConfigError: names them.
    """
    if unknown := sorted(set(guesses) - set(GUESSES)):
        raise ConfigError(f"guesses: unknown {', '.join(unknown)}; known: {', '.join(GUESSES)}")
    if len(set(guesses)) < len(guesses):
        raise ConfigError(f"guesses: {', '.join(guesses)} names something twice")


def measure_start(
    task: RecoveryTask,
    failures: Members,
    held_out: Members,
    modes: Sequence[int],
    options: QueryOptions,
    guesses: Sequence[str],
    trials: int,
) -> Start:
    """Choose and measure the guesses of all recoveries from `modes`.

    Args:
        task: world and preconditions.
        failures: to choose on, the first of each mode.
        held_out: to measure on, the first of each mode.
        modes: which ones.
        options: of queries; of them the timing counts, and whether a target is verified.
        guesses: names that may be chosen; of equals the first.
        trials: largest number of held-out failures of a mode.
    """
    check_guesses(guesses)
    targets = range(len(task.targets))
    if not guesses:
        return Start.nothing(len(modes), len(targets))
    names: list[tuple[str, ...]] = []
    rates: list[list[float]] = []
    rollouts = 0
    for mode in modes:
        chosen_on, measured_on = failures.of(mode)[:CHOSEN_ON], held_out.of(mode)[:trials]
        rows, tests = failures.rows.take(chosen_on), held_out.rows.take(measured_on)
        best: list[str] = []
        for target in targets:
            scores = [_outcome(task, rows, guess, target, options) for guess in guesses]
            best.append(guesses[max(range(len(guesses)), key=lambda number: scores[number])])
        names.append(tuple(best))
        rates.append([_outcome(task, tests, best[target], target, options)[0] for target in targets])
        rollouts += len(targets) * (len(guesses) * len(rows) + len(tests))
    return Start(tuple(names), np.array(rates), tuple(guesses), rollouts)


def recorded_start(
    records: Path,
    item: str,
    task: RecoveryTask,
    failures: Members,
    held_out: Members,
    options: QueryOptions,
    guesses: Sequence[str],
    trials: int,
) -> Start:
    """`measure_start` of all modes, from its record or by running it, which leaves a record."""
    check_guesses(guesses)
    modes = range(int(failures.mode.max(initial=-1)) + 1)
    if not guesses:
        return Start.nothing(len(modes), len(task.targets))
    parts = [failures.rows.states, failures.mode, held_out.rows.states, held_out.mode]
    decisive = [
        VERSION,
        preconditions_hash(task.preconditions),
        asdict(options.timing),
        options.verify,
        list(guesses),
        trials,
    ]
    record = Item(item, "start", 0, 0, config_hash([*decisive, *(part.tolist() for part in parts)]))
    if (content := find(records, record)) is None:
        begin = time.perf_counter()
        start = measure_start(task, failures, held_out, modes, options, guesses, trials)
        content = {"guess": [list(row) for row in start.guess], "q": start.q.tolist(), "rollouts": start.rollouts}
        write(records, record, content, seconds=time.perf_counter() - begin)
    names = tuple(tuple(row) for row in content["guess"])
    return Start(names, np.array(content["q"]), tuple(guesses), content["rollouts"])


def _outcome(task: RecoveryTask, rows: Rows, guess: str, target: int, options: QueryOptions) -> tuple[float, float]:
    """Share of `rows` from which the guess reaches the target, and the mean reward where it ends."""
    known = without_noise(rows)
    arrivals = execute(task.world, known, task.guessed(guess, task.world.observe(known), target), options.timing)
    reward, holds = task.judge(arrivals.last, target, verify=options.verify)
    sound = ~arrivals.diverged
    return float((holds & sound).mean()), float(reward[sound].mean()) if sound.any() else -np.inf
