"""How often the nominal skills succeed, and how they fail.

  python -m benchmarks.nominal                          every registered world, 1000 episodes each, seed 0
  python -m benchmarks.nominal --worlds door --episodes 200
  python -m benchmarks.nominal --timestep 0.002         also run the same rows with another time step and compare

`exact`: the state is known exactly (pick_place: the object away from the walls) and only the goal counts.
`uncertain`: the thesis's noise and distributions; where the thesis stops at the first failure flag (chapter 5), so does
this. Intervals are Wilson's, 95 %.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks import report
from p2l.contracts.world import NO_FAILURE
from p2l.evaluation.statistics import wilson_interval
from p2l.records import BoolArray, IntArray
from p2l.skills import chain
from p2l.worlds.table import WORLDS, make_world

EXACT: dict[str, dict[str, Any]] = {"pick_place": {"wall_clearance_m": 0.1}}
OPEN_LOOP = ("door",)  # chapter 4 has no stop at a flag: the chain goes on to its end


def run(name: str, params: dict[str, Any], episodes: int, seed: int, *, stop: bool) -> tuple[report.Row, BoolArray]:
    """One row of the table, and the outcome of each episode."""
    world = make_world(name, params)
    rows = world.sample(np.random.default_rng(seed), episodes)
    start = time.perf_counter()
    execution = chain.run(world, world.nominal_options(), rows, stop_on_failure=stop, slots=128)
    seconds = time.perf_counter() - start
    valid = ~execution.diverged
    low, high = wilson_interval(execution.success[valid].sum(), valid.sum())
    kinds = first_flags(execution)[valid & ~execution.success]
    names = dict(enumerate(world.failure_kinds)) | {NO_FAILURE: "no flag"}
    shares = {name: (kinds == index).mean() for index, name in names.items() if (kinds == index).any()}
    return {
        "world": name,
        "estimator": world.estimator.mode,
        "timestep_s": world.engine.timestep_s,
        "episodes": len(rows),
        "diverged": int(execution.diverged.sum()),
        "success_percent": round(100.0 * execution.success[valid].mean(), 1),
        "low": round(100.0 * float(low), 1),
        "high": round(100.0 * float(high), 1),
        "control_steps": round(float(execution.last.step.mean()), 1),
        "path_m": round(float(execution.last.path_m.mean()), 2),
        "episodes_per_s": round(len(rows) / seconds, 1),
        "of_failures": ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares.items()),
    }, execution.success


def first_flags(execution: chain.Execution) -> IntArray:
    """[N] kind of the first flag of each episode, whichever option it was raised in."""
    kinds = np.full(len(execution), NO_FAILURE, dtype=np.int64)
    flags = execution.ends.take(execution.ends.kind != NO_FAILURE)
    kinds[flags.episode[::-1]] = flags.kind[::-1]
    return kinds


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", type=report.known_world, default=list(WORLDS.names()))
    parser.add_argument("--episodes", type=report.positive, default=1000)
    parser.add_argument("--seed", type=report.seed, default=0)
    parser.add_argument("--timestep", type=float, metavar="S", help="second time step to compare with, row by row")
    args = parser.parse_args(arguments)
    table: list[report.Row] = []
    for name in args.worlds:
        exact = {"estimator": "exact", **EXACT.get(name, {})}
        for label, params in (("exact", exact), ("uncertain", {})):
            stop = label == "uncertain" and name not in OPEN_LOOP
            row, success = run(name, params, args.episodes, args.seed, stop=stop)
            table.append({"case": label, **row})
            if args.timestep is not None:
                other = {**params, "timestep_s": args.timestep}
                row, again = run(name, other, args.episodes, args.seed, stop=stop)
                agreement = {"same_outcome_percent": round(100.0 * (again == success).mean(), 1)}
                table.append({"case": label, **row, **agreement})
    report.finish(table, args.json)


if __name__ == "__main__":
    report.command(main)
