"""Days of a study: planned with predictions, executed by simulated truth, planned anew or not.

Four ways through the same day:

- `once`: the morning's plan, whatever happens (the thesis).
- `outcomes`: the rest is planned anew after each outcome.
- `simulated`: besides, a lesson that has been taught is tried in simulation on what is left, as often as the true plan
  may see (`Truth.planning`), before the rest is planned anew.
- `ahead`: as `simulated`, and every plan knows that lessons will be tried before they are used: where one turns out not
  to work, the task is done as without it, and no attempt fails. Exact for lessons that always work or never.

Whether an attempt succeeds is drawn: attempt at task i succeeds if a uniform number of the task's own is below the
skill's executed success rate, so that all ways meet the same numbers. What an attempt costs is its expected cost under
that rate: a draw decides what is learnt, and adds no noise of its own.

Deviation from the thesis: 1. its plans are executed by rates alone; here rates also draw what the robot sees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from p2l.records import Array, IntArray
from p2l.team.day.advance import advance, begin
from p2l.team.day.record import Day, Event, EventOutcome, Step
from p2l.team.day.skills import SkillPrior
from p2l.team.day.steps import next_step
from p2l.team.problem import Decision
from p2l.team.shop.outcome import attempt_cost
from p2l.team.shop.planner import plan_shop
from p2l.team.shop.record import Shop, ShopPlan

Way = Literal["once", "outcomes", "simulated", "ahead"]
WAYS: tuple[Way, ...] = ("once", "outcomes", "simulated", "ahead")


@dataclass(frozen=True)
class Truths:
    """What simulation says of n tasks and the lessons on them.

    Attributes:
        planning: [n, n] success of the lesson on one task (row) on another, that may be looked at once it is taught.
        executing: [n, n] the same, that decides outcomes.
        pretrained: [n] success of the pre-trained skill of each task, that decides outcomes.
        draws: simulated attempts behind each of `planning`.
    """

    planning: Array
    executing: Array
    pretrained: Array
    draws: int


@dataclass(frozen=True)
class Result:
    """What a day has come to: executed cost, and numbers of lessons, tasks of the person and expected failures."""

    cost: float
    lessons: int
    delegated: int
    failures: float


def simulate(
    shop: Shop,
    plan: ShopPlan,
    truths: Truths,
    uniforms: Array,
    way: Way,
    setting: SkillPrior,
    time_limit_s: float = 60.0,
) -> list[Result]:
    """Walk through a day once for each row of draws.

    Args:
        shop: one robot, each task once, a lesson on every task.
        plan: of the morning.
        truths: of the day.
        uniforms: [D, n] in [0, 1), one for each task of each walk.
        way: how the day is planned.
        setting: how fast outcomes change what is believed.
        time_limit_s: wall seconds of each plan.
    """
    if way == "once":
        return [_executed_once(shop, plan, truths)] * len(uniforms)
    if way == "ahead":
        shop = replace(shop, transfer=_ahead(shop))
        plan = plan_shop(shop, time_limit_s=time_limit_s)
    morning = begin(shop, plan, setting=setting, time_limit_s=time_limit_s)
    known: dict[tuple[Event, ...], Day] = {(): morning}  # walks share their beginnings
    return [_walk(morning, truths, row, way, known) for row in uniforms]


def _executed_once(shop: Shop, plan: ShopPlan, truths: Truths) -> Result:
    costs, failures = [], 0.0
    for task in plan.sequence.tolist():
        decision, lesson = Decision(int(plan.decision[task])), int(plan.lesson[task])
        cost, failure = _cost(shop, truths, task, decision, lesson)
        costs.append(cost)
        failures += failure
    lessons, delegated = (int((plan.decision == kind).sum()) for kind in (Decision.LEARN, Decision.DELEGATE))
    return Result(math.fsum(costs), lessons, delegated, failures)


def _walk(day: Day, truths: Truths, uniforms: Array, way: Way, known: dict[tuple[Event, ...], Day]) -> Result:
    costs, failures, decisions = [], 0.0, []
    while (step := next_step(day)) is not None:
        cost, failure = _cost(day.shop, truths, step.task, step.decision, step.lesson)
        costs.append(cost)
        failures += failure
        decisions.append(step.decision)
        outcome = EventOutcome.DONE
        if step.decision == Decision.ACT:
            is_success = uniforms[step.task] < _rate(truths, step.task, step.lesson)
            outcome = EventOutcome.SUCCESS if is_success else EventOutcome.FAILURE
        event = Event(step.task, step.copy, step.decision, step.robot, step.lesson, outcome)
        events = (*day.events, event)
        if events not in known:
            before = _with_trials(day, truths, step) if way != "outcomes" else day
            known[events] = advance(before, event)
        day = known[events]
    return Result(math.fsum(costs), decisions.count(Decision.LEARN), decisions.count(Decision.DELEGATE), failures)


def _ahead(shop: Shop) -> Array:
    """[1, n, n] probabilities at which an attempt costs what is expected if it is made only where the lesson works."""
    task, one = np.arange(shop.n), np.zeros(shop.n, dtype=np.int64)
    without = np.minimum(shop.c_hum, attempt_cost(shop, one, task, shop.pretrained[0]))
    lost = np.divide(without - shop.c_rob[0], shop.c_fail[0], out=np.ones(shop.n), where=shop.c_fail[0] > 0.0)
    return np.asarray(1.0 - np.clip(lost, 0.0, 1.0) * (1.0 - shop.transfer))


def _with_trials(day: Day, truths: Truths, step: Step) -> Day:
    """The day before a lesson, with what simulation says of it in place of what was predicted."""
    if step.decision != Decision.LEARN:
        return day
    transfer, trials = day.shop.transfer.copy(), day.trials.copy()
    transfer[step.robot, step.lesson] = truths.planning[step.lesson]
    trials[step.robot, step.lesson] = truths.draws
    return replace(day, shop=replace(day.shop, transfer=transfer), trials=trials)


def _cost(shop: Shop, truths: Truths, task: int, decision: Decision, lesson: int) -> tuple[float, float]:
    """Executed cost and expected failures of one step."""
    if decision == Decision.LEARN:
        return float(shop.c_demo[0, lesson]), 0.0
    if decision == Decision.DELEGATE:
        return float(shop.c_hum[task]), 0.0
    failure = 1.0 - _rate(truths, task, lesson)
    return float(shop.c_rob[0, task]) + failure * float(shop.c_fail[0, task]), failure


def _rate(truths: Truths, task: int, lesson: int) -> float:
    return float(truths.pretrained[task] if lesson < 0 else truths.executing[lesson, task])


def truths_of(planning: Array, executing: Array, tasks: IntArray, pretrained: IntArray, draws: int) -> Truths:
    """Truths of a set of a block.

    Args:
        planning: [S, M] as in `execute.Truth`.
        executing: [S, M] as in `execute.Truth`.
        tasks: [n] numbers in the block's pool, in order of work.
        pretrained: [n] row of the pre-trained skill that each task would use, -1 for none.
        draws: simulated attempts behind each of `planning`.
    """
    rows = np.ix_(tasks, tasks)
    rate = np.where(pretrained >= 0, executing[np.maximum(pretrained, 0), tasks], 0.0)
    return Truths(planning[rows], executing[rows], rate, draws)
