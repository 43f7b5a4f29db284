"""How long it takes to plan anew in the middle of a day: `python -m benchmarks.day`.

Half of a made-up day goes as planned in the morning, its attempts drawn by what was predicted of them. Then `steps`
outcomes are entered one by one. `replan_s` is the whole answer to one of them (belief, what is left, plan), `restart_s`
what is left planned from nothing. `cpu_s` is processor time of the slowest answer, which other work changes less.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from benchmarks import report
from benchmarks.instances import large_shop
from p2l.team.day import Day, Event, EventOutcome, Step, advance, begin, next_step, remaining_shop, replan
from p2l.team.day.advance import standing_after
from p2l.team.problem import Decision
from p2l.team.shop import plan_shop
from p2l.team.shop.record import ShopOrder


def event_of(step: Step, rng: np.random.Generator) -> Event:
    """What happens at a step, by chance as predicted."""
    outcome = EventOutcome.DONE
    if step.decision == Decision.ACT:
        outcome = EventOutcome.SUCCESS if rng.random() < step.p_success else EventOutcome.FAILURE
    return Event(step.task, step.copy, step.decision, step.robot, step.lesson, outcome)


def at_noon(day: Day, rng: np.random.Generator) -> Day:
    """The day after half of its tasks, done as planned in the morning, planned anew once."""
    assert day.plan is not None
    plan = day.plan
    for group in plan.sequence[: day.shop.n // 2].tolist():
        decision = Decision(int(plan.decision[group]))
        step = Step(
            group, 1, decision, int(plan.robot[group]), int(plan.lesson[group]), float(plan.p_success[group]), 0.0
        )
        event = event_of(step, rng)
        day = replace(day, standing=standing_after(day, event), events=(*day.events, event))
    return replace(day, rest=remaining_shop(day.shop, day.standing))


def measure(n: int, order: ShopOrder, steps: int, seed: int) -> report.Row:
    """Plan a day, go to its middle, and enter outcomes."""
    rng = np.random.default_rng(seed)
    shop = replace(large_shop(n, seed=seed, counts=False), order=order)
    plan = plan_shop(shop)
    noon = at_noon(begin(shop, plan), rng)
    start = time.perf_counter()
    day = replan(noon)
    restart_s = time.perf_counter() - start
    walls, cpus = [], []
    for _ in range(steps):
        step = next_step(day)
        assert step is not None
        event = event_of(step, rng)
        start, cpu = time.perf_counter(), time.process_time()
        day = advance(day, event)
        walls.append(time.perf_counter() - start)
        cpus.append(time.process_time() - cpu)
    assert day.plan is not None
    return {
        "tasks": n,
        "order": order,
        "seed": seed,
        "left": n - len(day.events),
        "morning_s": round(plan.seconds, 2),
        "restart_s": round(restart_s, 2),
        "replan_s": round(float(np.mean(walls)), 2),
        "slowest_s": round(max(walls), 2),
        "cpu_s": round(max(cpus), 2),
        "status": day.plan.status,
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--tasks", type=report.positive, default=1000)
    parser.add_argument("--steps", type=report.positive, default=10)
    parser.add_argument("--seeds", type=report.positive, default=3)
    args = parser.parse_args(arguments)
    plan_shop(large_shop(50, counts=False))  # loads what is compiled
    orders: tuple[ShopOrder, ...] = ("fixed", "any")
    cases = [(order, seed) for order in orders for seed in range(args.seeds)]
    report.finish([measure(args.tasks, order, args.steps, seed) for order, seed in cases], args.json)


if __name__ == "__main__":
    report.command(main)
