"""The team planner at scale, against the plain strong form, in one run on the same instances.

  python -m benchmarks.planner                 n = 20 ... 2,000, and the comparison at n = 1,000
  python -m benchmarks.planner --sizes 5000    certified within a gap, with peak memory
  python -m benchmarks.planner --compare 300   a smaller comparison
  python -m benchmarks.planner --limits        how long planners take when a time limit ends them; nothing else

"wide": a lesson helps on most tasks; "local": on about 2 %. Costs 10/100/100/200, tasks in the unit square.
`seconds` is the planner's own time; loading and compiling its kernels is reported first and apart.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time

import numpy as np

from benchmarks import instances, report
from p2l.records import Array
from p2l.team import Plan, Problem, facility, plan
from p2l.team.certificate import check_certificate

_ORDERS = ("fixed", "any")


def measure(n: int, kind: str, order: str, seed: int, planner: str, time_limit_s: float, gap: float) -> report.Row:
    """Plan one instance and have its certificate checked."""
    problem = instances.geometric(n, kind, np.random.default_rng(seed), order)  # type: ignore[arg-type]
    result = plan(problem, planner, time_limit_s=time_limit_s, gap=gap)
    return _row(problem, result, kind, seed)


def _row(problem: Problem, result: Plan, kind: str, seed: int) -> report.Row:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e9 if sys.platform == "darwin" else 1e6)
    return {
        "n": problem.n,
        "kind": kind,
        "order": problem.order,
        "seed": seed,
        "planner": result.planner,
        "seconds": round(result.seconds, 3),
        "status": result.status,
        "objective": result.objective,
        "gap_percent": round(100.0 * result.gap, 5),
        "certified_gap_percent": round(100.0 * check_certificate(problem, result).gap, 5)
        if result.certificate
        else None,
        "lessons": int((result.decision == 2).sum()),
        "peak_gb": round(peak, 2),
    }


def all_pairs(problem: Problem) -> facility.Pairs:
    """The plain strong form: every lesson in time for a task is a pair, useful or not."""
    cost = facility.lesson_costs(problem)
    row, column = np.nonzero(np.isfinite(cost))
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=problem.n))])
    values: Array = cost[row, column]
    return facility.Pairs(problem.c_demo, problem.outside, start, column.astype(np.int32), values)


def compare(n: int, kind: str, seed: int, time_limit_s: float) -> list[report.Row]:
    """The planner, then the plain strong form given to HiGHS as arrays, on one instance; rows with the ratio."""
    import highspy

    problem = instances.geometric(n, kind, np.random.default_rng(seed))
    result = plan(problem, "facility")
    start = time.perf_counter()
    highs = highspy.Highs()
    for name, value in {"output_flag": False, "threads": 1, "mip_rel_gap": 0.0, "time_limit": time_limit_s}.items():
        highs.setOptionValue(name, value)
    lp, scale = facility.relaxation(all_pairs(problem))
    lp.integrality_ = [highspy.HighsVarType.kInteger] * n + [highspy.HighsVarType.kContinuous] * (lp.num_col_ - n)
    highs.passModel(lp)
    highs.run()
    seconds = time.perf_counter() - start
    complete = highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
    plain: dict[str, object] = {"n": n, "kind": kind, "order": "fixed", "seed": seed, "planner": "plain strong form"}
    plain |= {"seconds": round(seconds, 3), "status": "optimal" if complete else "time_limit"}
    plain |= {"objective": highs.getInfo().objective_function_value / scale}
    plain |= {"times_slower": round(seconds / result.seconds, 1)}
    return [_row(problem, result, kind, seed), plain]


LIMITS = (
    ("max_form", 200, 0.05), ("max_form", 300, 5.0), ("strong", 200, 0.05), ("strong", 200, 5.0), ("highs", 1000, 2.0),
    ("auto", 200, 2.0), ("facility", 1000, 0.2), ("greedy", 1000, 0.05), ("dual_ascent", 1000, 0.05),
    ("exhaustive", 14, 0.05), ("auto", 10_000, 1.0), ("highs", 10_000, 5.0), ("max_form", 10_000, 1.0),
)  # fmt: skip


def limits() -> list[report.Row]:
    """Wall seconds of `plan`, building and checking included, under time limits that end it early.

    `allowed_s` is the limit, a tenth of it and 0.3 s. `first_s` is the first call of a process, which has no solver
    loaded; `wall_s` a later one.
    """
    firsts = [_first_call(*limit) for limit in LIMITS]
    report.load_kernels()
    for planner in ("max_form", "strong", "highs"):
        plan(_limited(14), planner)
    return [_under_limit(*limit) | {"first_s": first} for limit, first in zip(LIMITS, firsts, strict=True)]


def _limited(n: int) -> Problem:
    return instances.geometric(n, "wide", np.random.default_rng(0))


def _under_limit(planner: str, n: int, limit_s: float) -> report.Row:
    problem = _limited(n)
    begin = time.perf_counter()
    result = plan(problem, planner, time_limit_s=limit_s)
    wall = {"limit_s": limit_s, "allowed_s": 1.1 * limit_s + 0.3, "wall_s": round(time.perf_counter() - begin, 3)}
    return {"planner": planner, "n": n, **wall, "status": result.status, "gap": float(f"{result.gap:.3g}")}


def _first_call(planner: str, n: int, limit_s: float) -> float:
    code = f"from benchmarks import planner; print(planner._under_limit({planner!r}, {n}, {limit_s})['wall_s'])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(run.stdout)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--sizes", type=int, nargs="*", default=[20, 200, 300, 1000, 2000])
    parser.add_argument("--kinds", nargs="+", choices=sorted(instances.REACH), default=["wide", "local"])
    parser.add_argument("--orders", nargs="+", choices=_ORDERS, default=list(_ORDERS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--planner", default="facility")
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="seconds per plan")
    parser.add_argument("--gap", type=float, default=0.0, help="relative gap at which to stop")
    parser.add_argument("--compare", type=int, nargs="*", default=[1000], metavar="N", help="sizes of the comparison")
    parser.add_argument("--limits", action="store_true", help="time limits alone")
    args = parser.parse_args(arguments)
    if args.limits:
        report.finish(limits(), args.json)
        return
    report.load_kernels()
    rows = [
        measure(n, kind, order, seed, args.planner, args.time_limit, args.gap)
        for n in args.sizes
        for kind in args.kinds
        for order in args.orders
        for seed in args.seeds
    ]
    for n in args.compare:
        for kind in args.kinds:
            rows += compare(n, kind, args.seeds[0], 10.0 * args.time_limit)
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
