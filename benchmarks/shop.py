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

from benchmarks import report
from benchmarks.instances import large_shop
from p2l.team.shop import check_shop_plan, plan_shop

_README = Path(__file__).resolve().parents[1] / "README.md"


def measure(n: int, robots: int, arcs: int, limit: str, seed: int, time_limit_s: float) -> report.Row:
    """Plan one shop, and check the plan."""
    shop = large_shop(
        n, robots, seed=seed, counts=robots > 1, arcs=arcs,
        max_lessons=float(n // 60) if limit == "lessons" else math.inf,
        max_teaching=1.5 * n if limit == "teaching" else math.inf,
    )  # fmt: skip
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
    plan_shop(large_shop(50, 2, max_lessons=1.0))  # loads what is compiled
    cases = [(1000, 2, 0, "lessons"), (1000, 2, 0, "teaching"), (200, 1, 200, "")]
    rows = [measure(*case, seed, args.time_limit) for case in cases for seed in range(args.seeds)]
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
