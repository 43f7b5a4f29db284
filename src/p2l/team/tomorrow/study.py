"""Planning for samples of tomorrow against the mean, today alone and hindsight, in the worlds of chapter 3.

The first half of a set are today's orders, in their order; tomorrow brings as many on average, of any of the block's
tasks. Plans are made with the success rates that `adl_true` sees and with one sample of futures; they are executed with
the other draws of the simulator, in futures that no plan has seen, all methods in the same. What is taught tomorrow is
decided once its orders are known, for every method alike.

Kinds of futures, all with the same expected numbers:
    spread: every type comes a Poisson number of times.
    lots: a type comes with probability 1 / 10, and then ten times as often as its mean.
    one_type: all of tomorrow's orders are of one type, each equally probable.

Methods: `sample` plans for the futures seen, `mean` for their expected numbers, `myopic` for today alone, `hindsight`
knows each future today. `sample_all` plans for a tomorrow without lessons, and gets none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from p2l.records import Array, IntArray
from p2l.seeding import generator
from p2l.team.execute import Truth
from p2l.team.problem import Decision
from p2l.team.shop.record import Ruling, Shop, ShopPlan
from p2l.team.study import Block, Regime, TaskSet
from p2l.team.tomorrow.baselines import plan_for_mean, plan_myopically
from p2l.team.tomorrow.forecast import with_counts
from p2l.team.tomorrow.outcome import tomorrow_outcome
from p2l.team.tomorrow.planner import plan_two_stage, recourse
from p2l.team.tomorrow.record import TwoStage

Kind = Literal["spread", "lots", "one_type"]
KINDS: tuple[Kind, ...] = get_args(Kind)
METHODS = ("sample", "sample_all", "mean", "myopic", "hindsight")
_LOT = 0.1  # probability of a lot of a type
_GAP, _SAMPLE_GAP = 1e-6, 1e-3  # to which single futures are planned, and samples of them


def futures(kind: Kind, types: int, expected: float, samples: int, rng: np.random.Generator) -> Array:
    """[samples, types] numbers of tasks.

    Args:
        kind: see the module.
        types: how many types there are.
        expected: number of tasks of all types together.
        samples: how many futures.
        rng: of the draws.
    """
    mean = expected / types
    if kind == "spread":
        return rng.poisson(mean, (samples, types)).astype(np.float64)
    if kind == "lots":
        return np.where(rng.random((samples, types)) < _LOT, round(mean / _LOT), 0.0)
    counts = np.zeros((samples, types))
    counts[np.arange(samples), rng.integers(0, types, samples)] = round(expected)
    return counts


def two_days(regime: Regime, block: Block, tasks: IntArray, rates: Array, counts: Array) -> TwoStage:
    """Today and tomorrow of a set, without pre-trained skills.

    Args:
        regime: costs.
        block: whose pool tomorrow's tasks are of.
        tasks: [n] pool indices of today's, in order of work.
        rates: [M, M] success of the skill of one pool task (row) on another.
        counts: [S, M] futures.
    """
    size, n = len(block.pool), len(tasks)
    one, shape = np.ones(size), (1, size)
    completes = np.full(size, -1)
    completes[tasks] = np.arange(n)
    c_rob, c_fail = np.full(shape, regime.c_rob), np.full(shape, regime.c_fail)
    today = Shop(
        tasks=tuple(block.pool.names[each] for each in tasks),
        robots=("robot",),
        lessons=block.pool.names,
        completes=completes,
        count=np.ones(n, dtype=np.int64),
        c_hum=np.full(n, regime.c_hum),
        c_rob=c_rob[:, :n],
        c_fail=c_fail[:, :n],
        pretrained=np.zeros((1, n)),
        c_demo=np.full(shape, regime.c_demo),
        transfer=rates[None, :, tasks],
        choice=np.full(n, int(Ruling.FREE)),
    )
    return TwoStage(
        today=today,
        types=block.pool.names,
        lesson=np.arange(size),
        c_hum=regime.c_hum * one,
        c_rob=c_rob,
        c_fail=c_fail,
        pretrained=np.zeros(shape),
        c_demo=np.full(shape, regime.c_demo),
        transfer=rates[None],
        counts=counts,
        probability=np.full(len(counts), 1.0 / len(counts)),
    )


def compare(
    seed: int, block: Block, task_set: TaskSet, regime: Regime, truth: Truth, kind: Kind, samples: int, held_out: int
) -> list[dict[str, Any]]:
    """A row for every method: planned and executed cost, mean over the held-out futures, and lessons of today.

    Args:
        seed: of the study.
        block: of the set.
        task_set: whose first half is today.
        regime: costs.
        truth: of the block.
        kind: of futures.
        samples: futures that plans are made with.
        held_out: futures in which they are executed.
    """
    size, n = len(block.pool), max(1, len(task_set.tasks) // 2)
    tasks = task_set.tasks[:n]
    path = (seed, "tomorrow", kind, block.index, task_set.index)
    seen = futures(kind, size, float(n), samples, generator(*path, "seen"))
    new = futures(kind, size, float(n), held_out, generator(*path, "held_out"))
    planned = two_days(regime, block, tasks, truth.planning[:size], seen)
    judged = replace(planned, counts=new, probability=np.full(held_out, 1.0 / held_out))
    executing = two_days(regime, block, tasks, truth.executing[:size], new)
    sampled = with_counts(planned, planned.counts)
    waiting = {
        "sample": plan_two_stage(sampled, gap=_SAMPLE_GAP).today,
        "mean": plan_for_mean(sampled, gap=_GAP),
        "myopic": plan_myopically(sampled),
    }
    costs = {name: _costs(judged, executing, today) for name, today in waiting.items()}
    rigid = plan_two_stage(replace(sampled, commit="all"), gap=_GAP).today
    costs["sample_all"] = _costs(replace(judged, commit="all"), replace(executing, commit="all"), rigid)
    costs["hindsight"] = _hindsight(judged, executing)
    lessons = {name: float(len(today.taught)) for name, today in {**waiting, "sample_all": rigid}.items()}
    return [
        {
            "block": block.index, "set": task_set.index, "regime": regime.name, "kind": kind, "method": name,
            "planned_cost": costs[name][0], "executed_cost": costs[name][1], "lessons_today": lessons.get(name, np.nan),
        }
        for name in METHODS
    ]  # fmt: skip


def _costs(judged: TwoStage, executing: TwoStage, today: ShopPlan) -> tuple[float, float]:
    """Mean planned and executed cost of today and of the best that can be done tomorrow after it."""
    later, planned = recourse(judged, today.taught)
    executed = tomorrow_outcome(judged, today.taught, later, executing).cost
    return today.objective + float(planned.mean()), executed_today(executing.today, today) + float(executed.mean())


def _hindsight(judged: TwoStage, executing: TwoStage) -> tuple[float, float]:
    totals = []
    for scenario in range(judged.scenarios):
        known, true = (
            replace(each, counts=each.counts[[scenario]], probability=np.ones(1)) for each in (judged, executing)
        )
        plan = plan_two_stage(known, gap=_GAP)
        executed = float(tomorrow_outcome(known, plan.taught, plan.later, true).cost[0])
        totals.append((plan.objective, executed_today(executing.today, plan.today) + executed))
    planned, executed_mean = np.array(totals).mean(axis=0).tolist()
    return planned, executed_mean


def executed_today(true: Shop, plan: ShopPlan) -> float:
    """What a plan of today costs where skills succeed as they do in a shop with other probabilities."""
    task, size = true.groups
    acts = plan.decision == Decision.ACT
    robot, lesson = np.maximum(plan.robot, 0), np.maximum(plan.lesson, 0)
    skill = np.where(plan.lesson >= 0, true.transfer[robot, lesson, task], true.pretrained[robot, task])
    attempt = size * (true.c_rob[robot, task] + (1.0 - skill) * true.c_fail[robot, task])
    apart = plan.taught[true.completes[plan.taught[:, 0]] < 0]
    lessons = float(true.c_demo[apart[:, 1], apart[:, 0]].sum())
    return float(np.where(acts, attempt, plan.expected_cost).sum()) + lessons
