"""What a trial is worth to the plan, before it is run: preposterior analysis (Raiffa and Schlaifer, 1961).

A trial of a pair (the skill taught on one task, tried on another) ends in a number of successes. Each would change what
is believed of that pair, and of those that resemble it, and with it perhaps the best plan. The value of a trial is what
the new plan then saves, in expectation over its outcomes:

    EVI = Σ_s P(s) · (cost of today's plan, expected after s - cost of the best plan after s)

in units of the plan's costs; what the trial itself costs is not taken off. No term is negative, and the value is 0
where no outcome changes the plan. Today's plan keeps its lessons and the lesson behind each attempt.

Candidates are found cheaply (`screened`), ranked by a plan that differs by one lesson, and only the best are planned
anew to the optimum. Axis letters: n rows of the orders, M tasks with features.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from p2l.records import Array, BoolArray, IntArray
from p2l.team.outcome import best_skills, work_order
from p2l.team.planners import plan
from p2l.team.problem import Decision, Plan, Problem
from p2l.transfer.beliefs import Belief

MOST = 5  # attempts of one trial that are looked at
_SCREENED = 150  # pairs that are ranked by a plan that differs by one lesson
_SLACK = 3.0  # multipliers are of a relaxation, and ends of intervals not the last word
_NOTHING = 1e-9  # relative to the plan's cost: a value below it is rounding


@dataclass(frozen=True)
class TrialValue:
    """What trying one pair is worth.

    Attributes:
        taught, tested: task indices.
        p: success probability that is expected today.
        values: expected saving of 1, 2, … attempts, units of cost.
    """

    taught: int
    tested: int
    p: float
    values: tuple[float, ...]

    def value(self, attempts: int) -> float:
        """Expected saving of so many attempts."""
        return self.values[attempts - 1]

    @property
    def best(self) -> int:
        """How many attempts save most each."""
        shares = [value / count for count, value in enumerate(self.values, start=1)]
        return 1 + int(np.argmax(shares))


@dataclass(frozen=True)
class Stake:
    """A day's orders and what is believed of the pairs of tasks.

    Attributes:
        problem: the orders; its transfer table is a factor of every probability: how surely a lesson has taught.
        place: [n] the task behind each row of the orders; several rows may be the same task.
        belief: of all M · M pairs, the tested task fastest.
        tasks: M.
    """

    problem: Problem
    place: IntArray
    belief: Belief
    tasks: int

    @property
    def index(self) -> IntArray:
        """[n, n] pair that each cell of the problem's transfer table holds."""
        return self.place[:, None] * self.tasks + self.place

    def expected(self, means: Array) -> Problem:
        """The problem with these means [n · n] for a transfer table."""
        believed = np.clip(means, 0.0, 1.0).reshape(self.problem.n, -1)
        return replace(self.problem, transfer=believed * self.problem.transfer)

    @property
    def today(self) -> Problem:
        """The problem as it is believed now."""
        return self.expected(self.belief.mean[self.index])


@dataclass(frozen=True)
class Outlook:
    """Today's plan, and the trials that are most worth running."""

    plan: Plan
    values: tuple[TrialValue, ...]


Progress = Callable[[int, int], None]


def outlook(stake: Stake, largest: int, progress: Progress | None = None) -> Outlook:
    """Today's plan and `trial_values` of it."""
    today = plan(stake.today)
    return Outlook(today, tuple(trial_values(stake, today, largest=largest, progress=progress)))


def trial_values(
    stake: Stake, today: Plan, *, largest: int, attempts: Sequence[int] = tuple(range(1, MOST + 1)),
    progress: Progress | None = None,
) -> list[TrialValue]:  # fmt: skip
    """The pairs that are most worth trying, best first (by value per attempt); those of no value are left out.

    Args:
        stake: orders and beliefs.
        today: the plan of `stake.today`.
        largest: pairs whose value is computed exactly.
        attempts: numbers of attempts to value, 1, 2, … without gaps.
        progress: is told how many pairs are done.
    """
    pairs = screened(stake, today)
    rough = np.array([_rough_value(stake, today, pair, max(attempts)) for pair in pairs.tolist()])
    pairs = pairs[np.argsort(-rough, kind="stable")[:largest]]
    values = []
    for done, pair in enumerate(pairs.tolist(), start=1):
        saved = tuple(value_of_trial(stake, today, pair, count) for count in attempts)
        if max(saved) > 0.0:
            taught, tested = divmod(pair, stake.tasks)
            values.append(TrialValue(taught, tested, float(stake.belief.mean[pair]), saved))
        if progress is not None:
            progress(done, len(pairs))
    return sorted(values, key=lambda each: -each.value(each.best) / each.best)


def value_of_trial(stake: Stake, today: Plan, pair: int, attempts: int) -> float:
    """EVI of so many attempts of one pair, by the best plan after each outcome."""
    cells = stake.index.ravel()
    at, back = np.unique(cells, return_inverse=True)
    probability, means = stake.belief.outcomes(pair, attempts, at)
    value = 0.0
    for share, mean in zip(probability.tolist(), means, strict=True):
        problem = stake.expected(mean[back])
        kept = cost_of(problem, today)
        value += share * max(0.0, kept - plan(problem).objective)
    return value if value > _NOTHING * max(1.0, today.objective) else 0.0


def cost_of(problem: Problem, kept: Plan) -> float:
    """What the decisions of a plan, with the lesson behind each attempt, cost in another problem of the same tasks."""
    own = np.arange(problem.n)
    acts = (kept.decision == Decision.ACT) & (kept.skill >= 0)
    p = np.where(acts, problem.transfer[np.maximum(kept.skill, 0), own], problem.pretrained)
    attempt = problem.attempt_cost(p)
    by_decision = [attempt, problem.c_hum, problem.c_demo]
    return math.fsum(np.choose(kept.decision, by_decision).tolist())


def screened(stake: Stake, today: Plan, most: int = _SCREENED, level: float = 0.98) -> IntArray:
    """Pairs whose outcome could change the plan, the most promising first.

    If a pair is at the high end of its interval, it and those that resemble it may make a lesson pay: what they save
    has to exceed its reduced cost (what it lacks today to pay for itself, under the multipliers of the plan's
    certificate). At the low end, pairs that the plan uses may cost more than other ways. A pair counts by both.
    """
    n, own = stake.problem.n, np.arange(stake.problem.n)
    at, back = np.unique(stake.index.ravel(), return_inverse=True)
    problem = stake.today
    in_time = own[:, None] < own if problem.order == "fixed" else ~np.eye(n, dtype=bool)
    possible = in_time & np.isfinite(problem.c_demo)[:, None]
    price = problem.outside if today.certificate is None else today.certificate.multipliers[0]
    price = np.minimum(np.where(np.isfinite(price), price, problem.c_demo), problem.outside)
    acts = np.flatnonzero((today.decision == Decision.ACT) & (today.skill >= 0))

    def served(p: Array) -> Array:
        """[n] what each lesson saves on other tasks."""
        gain = np.where(possible, np.maximum(price - problem.attempt_cost(p), 0.0), 0.0)
        return np.asarray(gain.sum(axis=1))

    def in_use(p: Array) -> float:
        return float(problem.attempt_cost(p[today.skill[acts], acts], acts.tolist()).sum())

    now, cost = served(problem.transfer), in_use(problem.transfer)
    surplus = now + price - problem.c_demo  # beyond its own cost, below 0 where it does not pay
    scores = np.zeros(len(at))
    for number, pair in enumerate(at.tolist()):
        low, high = (stake.expected(end[back]).transfer for end in stake.belief.extremes(pair, level, at))
        more = served(high) - now
        saved = np.maximum(surplus + _SLACK * more, 0.0) - np.maximum(surplus, 0.0)
        scores[number] = max(0.0, float(saved.max())) + max(0.0, in_use(low) - cost)
    order = np.argsort(-scores, kind="stable")[:most]
    return np.asarray(at[order[scores[order] > _NOTHING * max(1.0, today.objective)]])


def _rough_value(stake: Stake, today: Plan, pair: int, attempts: int) -> float:
    """A lower bound of the value: after each outcome, the best plan whose lessons are today's but for one."""
    at, back = np.unique(stake.index.ravel(), return_inverse=True)
    probability, means = stake.belief.outcomes(pair, attempts, at)
    lessons = today.decision == Decision.LEARN
    value = 0.0
    for share, mean in zip(probability.tolist(), means, strict=True):
        problem = stake.expected(mean[back])
        value += share * max(0.0, cost_of(problem, today) - _nearby_cost(problem, lessons))
    return value


def _nearby_cost(problem: Problem, lessons: BoolArray) -> float:
    """Cost of the best plan whose lessons are these, one more, or one fewer."""
    n, own = problem.n, np.arange(problem.n)
    service = problem.service_cost(slice(None))
    usable = own[:, None] < own if problem.order == "fixed" else ~np.eye(n, dtype=bool)
    service = np.where(usable, service, np.inf)
    given = np.vstack([service[lessons], problem.outside[None]])
    ranked = np.sort(given, axis=0)
    now = np.where(lessons, problem.c_demo, ranked[0])
    costs = [now.sum()]
    candidates = np.flatnonzero(~lessons & np.isfinite(problem.c_demo))
    if candidates.size:
        with_one = np.where(lessons, problem.c_demo, np.minimum(ranked[0], service[candidates]))
        with_one[np.arange(len(candidates)), candidates] = problem.c_demo[candidates]
        costs.append(with_one.sum(axis=1).min())
    for lesson in np.flatnonzero(lessons).tolist():
        rest = lessons.copy()
        rest[lesson] = False
        best, _ = best_skills(problem, rest, work_order(problem, rest))
        cost = np.minimum(problem.c_hum, problem.attempt_cost(best))
        costs.append(np.where(rest, problem.c_demo, cost).sum())
    return float(min(costs))
