"""What planning for samples of tomorrow is held against: the mean, today alone, and hindsight."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from p2l.records import Array, IntArray
from p2l.team.shop.planner import plan_shop
from p2l.team.shop.record import ShopPlan
from p2l.team.tomorrow.planner import plan_two_stage, recourse
from p2l.team.tomorrow.record import TwoStage


def mean_tomorrow(program: TwoStage) -> TwoStage:
    """The program whose only scenario has the expected number of every type, which need not be whole."""
    return replace(program, counts=(program.probability @ program.counts)[None], probability=np.ones(1))


def plan_for_mean(program: TwoStage, *, time_limit_s: float = 60.0, gap: float = 0.0) -> ShopPlan:
    """Today's part of the best plan for the expected numbers.

    Without lessons tomorrow (`commit="all"`) that is the best plan for the scenarios, too, since costs are linear in
    the numbers. With them it is not: a mean has a little of every type, and a lesson that waits seems to pay for many.
    """
    return plan_two_stage(mean_tomorrow(program), time_limit_s=time_limit_s, gap=gap).today


def plan_myopically(program: TwoStage, *, time_limit_s: float = 60.0, gap: float = 0.0) -> ShopPlan:
    """The best plan for today, as if nothing came tomorrow."""
    return plan_shop(program.today, time_limit_s=time_limit_s, gap=gap)


def hindsight(program: TwoStage, *, time_limit_s: float = 60.0, gap: float = 0.0) -> Array:
    """[S] what no plan costs less than that knows its scenario today; its mean is a bound on every plan."""
    deadline = time.perf_counter() + time_limit_s
    bounds = []
    for scenario in range(program.scenarios):
        known = replace(program, counts=program.counts[[scenario]], probability=np.ones(1))
        left = max(1e-2, deadline - time.perf_counter())
        bounds.append(plan_two_stage(known, time_limit_s=left, gap=gap).lower_bound)
    return np.array(bounds)


def realised(program: TwoStage, today: ShopPlan, *, time_limit_s: float = 60.0) -> Array:
    """[S] what today's plan and the best that can be done tomorrow after it cost in each scenario."""
    taught: IntArray = today.taught
    _, cost = recourse(program, taught, deadline=time.perf_counter() + time_limit_s)
    total: Array = today.objective + cost
    return total
