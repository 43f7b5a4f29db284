"""Plans for an uncertain tomorrow at scale: scenarios of Poisson numbers of the same tasks, lessons that can wait.

  python -m benchmarks.tomorrow             20 scenarios of 20 tasks to the optimum, 200 of 50 to 0.1 %
  python -m benchmarks.tomorrow --random    the same where a lesson's transfer has no structure at all

`near` is a square in which a lesson carries over to what is near, as in the other benchmarks; `random` draws every pair
on its own. `seconds` is what planning takes with its own check of the bound, `check_s` a second, independent one.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks import report
from p2l.records import Array
from p2l.team.shop import Shop
from p2l.team.tomorrow import TwoStage, check_two_stage_plan, plan_two_stage


def made_up(tasks: int, scenarios: int, reach: float, c_demo: float, seed: int) -> TwoStage:
    """Each task once today, in any order, and one such task on average in each scenario; a reach of 0 is random."""
    rng = np.random.default_rng(seed)
    place = rng.random((tasks, 2))
    distance = np.linalg.norm(place[:, None] - place[None], axis=-1)
    transfer: Array = np.exp(-distance / reach) if reach else rng.random((tasks, tasks))
    names = tuple(f"task {i}" for i in range(tasks))
    c_hum = rng.uniform(80, 120, tasks).round(1)
    one = np.ones((1, tasks))
    shop = Shop(
        tasks=names,
        robots=("arm",),
        lessons=names,
        completes=np.arange(tasks),
        count=np.ones(tasks, dtype=np.int64),
        c_hum=c_hum,
        c_rob=10 * one,
        c_fail=100 * one,
        pretrained=0 * one,
        c_demo=c_demo * one,
        transfer=transfer[None],
        choice=np.full(tasks, -1),
        order="any",
    )
    return TwoStage(
        today=shop,
        types=names,
        lesson=np.arange(tasks),
        c_hum=c_hum,
        c_rob=shop.c_rob,
        c_fail=shop.c_fail,
        pretrained=shop.pretrained,
        c_demo=shop.c_demo,
        transfer=shop.transfer,
        counts=rng.poisson(1.0, (scenarios, tasks)),
        probability=np.full(scenarios, 1.0 / scenarios),
    )


def measure(
    tasks: int, scenarios: int, reach: float, c_demo: float, seed: int, gap: float, limit_s: float
) -> report.Row:
    """Plan, and check the plan."""
    program = made_up(tasks, scenarios, reach, c_demo, seed)
    start = time.perf_counter()
    plan = plan_two_stage(program, gap=gap, time_limit_s=limit_s)
    seconds = time.perf_counter() - start
    start = time.perf_counter()
    verdict = check_two_stage_plan(program, plan)
    return {
        "scenarios": scenarios,
        "tasks": tasks,
        "transfer": f"near {reach:g}" if reach else "random",
        "c_demo": c_demo,
        "seed": seed,
        "demands": len(program.groups.kind) + tasks,
        "today": len(plan.taught),
        "later": round(len(plan.later) / scenarios, 2),
        "status": plan.status,
        "gap_checked": verdict.gap,
        "seconds": round(seconds, 2),
        "check_s": round(time.perf_counter() - start, 2),
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--random", action="store_true", help="transfer without structure")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--time-limit", type=float, default=30.0, metavar="S")
    args = parser.parse_args(arguments)
    plan_two_stage(made_up(12, 12, 0.3, 150.0, 0))  # loads what is compiled
    reaches = (0.0,) if args.random else (0.1, 0.3)
    rows = [
        measure(tasks, scenarios, reach, c_demo, seed, gap, args.time_limit)
        for tasks, scenarios, gap in ((20, 20, 0.0), (50, 200, 1e-3))
        for reach in reaches
        for c_demo in (150.0, 400.0)
        for seed in range(args.seeds)
    ]
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
