"""Shops at scale, and how long `python -m stages.plan` takes for a person's few tasks.

  python -m benchmarks.shop             limits, copies and two robots at 1,000 tasks; partial orders at 200
  python -m benchmarks.shop --stage     the stage on the README's four tasks, with tracking and without

`cpu_s` is processor time, which other work on the machine changes less than wall seconds.
"""

from __future__ import annotations

import math
import re
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import report
from p2l.team.shop import Shop, check_shop_plan, plan_shop

_README = Path(__file__).resolve().parents[1] / "README.md"


def made_up(n: int, robots: int, arcs: int, limit: str, seed: int) -> Shop:
    """Tasks in a square of four features; a lesson carries over to what is near, a bit less with each robot."""
    rng = np.random.default_rng(seed)
    place = rng.random((n, 4))
    distance = np.linalg.norm(place[:, None] - place[None], axis=-1)
    pairs: set[tuple[int, int]] = set()
    rank = rng.permutation(n)
    while len(pairs) < arcs:
        one, other = sorted(rng.choice(n, 2, replace=False).tolist())
        pairs.add((int(rank[one]), int(rank[other])))
    names = tuple(f"task {i}" for i in range(n))
    return Shop(
        tasks=names,
        robots=tuple(f"robot {i}" for i in range(robots)),
        lessons=names,
        completes=np.arange(n),
        count=np.where(rng.random(n) < 0.3, rng.integers(2, 6, n), 1) if robots > 1 else np.ones(n, dtype=np.int64),
        c_hum=rng.uniform(80, 120, n).round(1),
        c_rob=rng.uniform(8, 15, (robots, n)).round(1),
        c_fail=rng.uniform(80, 120, (robots, n)).round(1),
        pretrained=np.zeros((robots, n)),
        c_demo=rng.uniform(150, 250, (robots, n)).round(1),
        transfer=np.exp(-3.0 * distance)[None] * rng.uniform(0.8, 1.0, (robots, 1, 1)),
        choice=np.full(n, -1),
        order="partial" if arcs else "fixed",
        before=np.array(sorted(pairs)) if arcs else None,
        max_lessons=float(n // 60) if limit == "lessons" else math.inf,
        max_teaching=1.5 * n if limit == "teaching" else math.inf,
    )


def measure(n: int, robots: int, arcs: int, limit: str, seed: int, time_limit_s: float) -> report.Row:
    """Plan one shop, and check the plan."""
    shop = made_up(n, robots, arcs, limit, seed)
    start, cpu = time.perf_counter(), time.process_time()
    day = plan_shop(shop, time_limit_s=time_limit_s)
    seconds, cpu_s = time.perf_counter() - start, time.process_time() - cpu
    return {
        "tasks": n,
        "robots": robots,
        "arcs": arcs,
        "limit": limit or "none",
        "seed": seed,
        "lessons": len(day.taught),
        "cases": len(day.certificate.leaf) if day.certificate else 0,
        "status": day.status,
        "seconds": round(seconds, 2),
        "cpu_s": round(cpu_s, 2),
        "gap_checked": check_shop_plan(shop, day).gap,
    }


def stage(tracking: str, repeats: int) -> report.Row:
    """The fastest of some runs of `stages.plan` on the README's tasks, in processes of their own."""
    orders, transfer = re.findall(r"```csv\n(.*?)```", _README.read_text(encoding="utf-8"), re.DOTALL)[:2]
    with TemporaryDirectory() as folder:
        (Path(folder) / "orders.csv").write_text(orders, encoding="utf-8")
        (Path(folder) / "transfer.csv").write_text(transfer, encoding="utf-8")
        files = [f"tasks={folder}/orders.csv", f"transfer={folder}/transfer.csv", f"tracking={tracking}"]
        walls, cpus = [], []
        for run in range(repeats):
            start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
            command = [sys.executable, "-m", "stages.plan", *files, f"hydra.run.dir={folder}/{run}"]
            subprocess.run(command, check=True, capture_output=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            walls.append(time.perf_counter() - start)
            cpus.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return {"tracking": tracking, "runs": repeats, "seconds": round(min(walls), 2), "cpu_s": round(min(cpus), 2)}


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--stage", action="store_true", help="time the stage instead")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S")
    args = parser.parse_args(arguments)
    if args.stage:
        report.finish([stage(tracking, 3) for tracking in ("disabled", "local")], args.json)
        return
    plan_shop(made_up(50, 2, 0, "lessons", 0))  # loads what is compiled
    cases = [(1000, 2, 0, "lessons"), (1000, 2, 0, "teaching"), (200, 1, 200, "")]
    rows = [measure(*case, seed, args.time_limit) for case in cases for seed in range(args.seeds)]
    report.finish(rows, args.json)


if __name__ == "__main__":
    main()
