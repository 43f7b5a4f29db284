"""One outcome after another: what it changes, and the plan for what is left.

A plan is kept where a new one would not be cheaper, so that a day does not change hands for nothing:

1. Where a step went as planned and nothing is believed anew of what is left, the rest of an optimal plan is optimal
   (what is left of a shop is a shop), and nothing is solved.
2. Else the rest is planned anew, and replaces the old plan only if it costs less.

Nothing else is remembered: a day is a function of the morning's plan and the events.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array
from p2l.team.certificate import PROVEN
from p2l.team.day.checks import check_event
from p2l.team.day.continuation import continued, is_settled
from p2l.team.day.record import Day, Event, EventOutcome
from p2l.team.day.remaining import Learnt, Standing, remaining_shop
from p2l.team.day.skills import SkillPrior, expected_skill
from p2l.team.problem import Decision, relative_gap
from p2l.team.shop.outcome import shop_outcome
from p2l.team.shop.planner import plan_shop
from p2l.team.shop.record import Ruling, Shop, ShopPlan


def begin(
    shop: Shop,
    plan: ShopPlan,
    *,
    trials: Array | None = None,
    setting: SkillPrior | None = None,
    time_limit_s: float = 60.0,
) -> Day:
    """A day on which nothing has happened yet.

    Args:
        shop: of the morning.
        plan: of it.
        trials: [R, L, n] attempts behind each transfer probability; None: predictions alone.
        setting: how fast outcomes change what is believed.
        time_limit_s: wall seconds of each plan.

    Raises:
        ShapeError: the plan is of another shop.
    """
    shop_outcome(shop, plan.taught, plan.sequence)
    standing = Standing.morning(shop)
    known = np.zeros(shop.transfer.shape) if trials is None else trials
    rest = remaining_shop(shop, standing)
    return Day(shop, known, setting or SkillPrior(), time_limit_s, (), standing, rest, plan)


def advance(day: Day, event: Event) -> Day:
    """The day after one more event, with a plan for the rest.

    Raises:
        EventError: it cannot have happened on this day.
        SolverError: no plan was found in time.
    """
    check_event(day, event)
    standing = standing_after(day, event)
    rest = remaining_shop(day.shop, standing)
    after = replace(day, events=(*day.events, event), standing=standing, rest=rest, plan=None)
    if rest is None:
        return after
    kept = continued(day, event, rest)
    if kept is not None and is_settled(day, event, rest, kept):
        return replace(after, plan=kept)
    best = replan(after)
    assert best.plan is not None
    if kept is None or kept.objective > best.plan.objective * (1.0 + PROVEN):
        return best
    bound = min(kept.objective, best.plan.lower_bound)
    gap = relative_gap(kept.objective, bound)
    status = "optimal" if gap <= PROVEN else best.plan.status
    proof = best.plan.certificate
    return replace(
        after,
        plan=replace(kept, lower_bound=bound, gap=gap, status=status, seconds=best.plan.seconds, certificate=proof),
    )


def replan(day: Day) -> Day:
    """The same day with its rest planned from nothing.

    If decisions and limits of the morning leave no plan, as after lessons that did not teach, tasks need not be taught
    any more, and if that does not help, limits are not kept.
    """
    if day.rest is None:
        return day
    shop = day.rest.shop
    freed = np.where(shop.choice == Ruling.LEARN, Ruling.FREE, shop.choice)
    for attempt in (shop, replace(shop, choice=freed)):
        try:
            return replace(
                day, rest=replace(day.rest, shop=attempt), plan=plan_shop(attempt, time_limit_s=day.time_limit_s)
            )
        except ConfigError:
            continue
    loose = replace(shop, choice=freed, max_lessons=math.inf, max_teaching=math.inf)
    return replace(day, rest=replace(day.rest, shop=loose), plan=plan_shop(loose, time_limit_s=day.time_limit_s))


def standing_after(day: Day, event: Event) -> Standing:
    """What the day comes to with one more event."""
    return standing_of(day, (event,))


def standing_of(day: Day, events: Iterable[Event]) -> Standing:
    """What the day comes to with more events; each skill that was used is believed anew once, after all of them."""
    standing = day.standing
    used: dict[tuple[int, int], None] = {}
    for event in events:
        standing = _counted(day.shop, standing, event)
        if event.decision == Decision.ACT:
            used[event.lesson, event.robot] = None
    for lesson, robot in used:
        standing = _believed(day, standing, lesson, robot)
    return standing


def _counted(shop: Shop, standing: Standing, event: Event) -> Standing:
    """With one more event, and what is believed of skills as before."""
    done = standing.done.copy()
    if event.copy:
        done[event.task] += 1
    if event.decision == Decision.DELEGATE:
        return replace(standing, done=done, shown=-1, spent=standing.spent + float(shop.c_hum[event.task]))
    at = (event.robot, event.task)
    if event.decision == Decision.ACT:
        failed = event.outcome == EventOutcome.FAILURE
        cost = float(shop.c_rob[at]) + (float(shop.c_fail[at]) if failed else 0.0)
        standing = replace(standing, done=done, shown=-1, spent=standing.spent + cost)
        return _with_attempt(standing, event, failed)
    price = float(shop.c_demo[event.robot, event.lesson])
    learnt = standing.learnt
    if event.outcome == EventOutcome.DONE:
        nothing = np.zeros(shop.n)
        new = Learnt(event.lesson, event.robot, nothing, nothing, shop.transfer[event.robot, event.lesson])
        learnt = (*learnt, new)
    return replace(
        standing, done=done, learnt=learnt, spent=standing.spent + price, teaching=standing.teaching + price,
        demonstrations=standing.demonstrations + 1,
        shown=event.lesson if shop.completes[event.lesson] >= 0 and event.outcome == EventOutcome.DONE else -1,
    )  # fmt: skip


def _with_attempt(standing: Standing, event: Event, failed: bool) -> Standing:
    """With one more success or failure of the skill that was used."""
    if event.lesson < 0:
        successes, failures = standing.successes.copy(), standing.failures.copy()
        (failures if failed else successes)[event.robot, event.task] += 1.0
        return replace(standing, successes=successes, failures=failures)
    learnt = list(standing.learnt)
    place = standing.place(event.lesson, event.robot)
    skill = learnt[place]
    won, lost = skill.successes.copy(), skill.failures.copy()
    (lost if failed else won)[event.task] += 1.0
    learnt[place] = replace(skill, successes=won, failures=lost)
    return replace(standing, learnt=tuple(learnt))


def _believed(day: Day, standing: Standing, lesson: int, robot: int) -> Standing:
    """With what is believed of one skill after its successes and failures."""
    shop = day.shop
    if lesson < 0:
        rows = (shop.pretrained[robot], np.zeros(shop.n), standing.successes[robot], standing.failures[robot])
        pretrained = standing.pretrained.copy()
        pretrained[robot] = expected_skill(*rows, day.setting, shared=False)
        return replace(standing, pretrained=pretrained)
    learnt = list(standing.learnt)
    place = standing.place(lesson, robot)
    skill, of = learnt[place], (robot, lesson)
    expected = expected_skill(shop.transfer[of], day.trials[of], skill.successes, skill.failures, day.setting)
    learnt[place] = replace(skill, expected=expected)
    return replace(standing, learnt=tuple(learnt))
