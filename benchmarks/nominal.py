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
    began = time.perf_counter()
    done = chain.run(world, world.nominal_options(), rows, stop_on_failure=stop, slots=128)
    seconds = time.perf_counter() - began
    valid = ~done.diverged
    low, high = wilson_interval(done.success[valid].sum(), valid.sum())
    failed = first_flags(done)[valid & ~done.success]
    names = dict(enumerate(world.failure_kinds)) | {NO_FAILURE: "no flag"}
    shares = {name: (failed == index).mean() for index, name in names.items() if (failed == index).any()}
    return {
        "world": name,
        "estimator": world.estimator.mode,
        "timestep_s": world.engine.timestep_s,
        "episodes": len(rows),
        "diverged": int(done.diverged.sum()),
        "success_percent": round(100.0 * done.success[valid].mean(), 1),
        "low": round(100.0 * float(low), 1),
        "high": round(100.0 * float(high), 1),
        "control_steps": round(float(done.last.step.mean()), 1),
        "path_m": round(float(done.last.path_m.mean()), 2),
        "episodes_per_s": round(len(rows) / seconds, 1),
        "of_failures": ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares.items()),
    }, done.success


def first_flags(done: chain.Execution) -> IntArray:
    """[N] kind of the first flag of each episode, whichever option it was raised in."""
    kinds = np.full(len(done), NO_FAILURE, dtype=np.int64)
    flagged = done.ends.take(done.ends.kind != NO_FAILURE)
    kinds[flagged.episode[::-1]] = flagged.kind[::-1]
    return kinds


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS.names(), default=list(WORLDS.names()))
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timestep", type=float, metavar="S", help="second time step to compare with, row by row")
    given = parser.parse_args(arguments)
    table: list[report.Row] = []
    for name in given.worlds:
        exact = {"estimator": "exact", **EXACT.get(name, {})}
        for label, params in (("exact", exact), ("uncertain", {})):
            stop = label == "uncertain" and name not in OPEN_LOOP
            row, success = run(name, params, given.episodes, given.seed, stop=stop)
            table.append({"case": label, **row})
            if given.timestep is not None:
                other = {**params, "timestep_s": given.timestep}
                row, again = run(name, other, given.episodes, given.seed, stop=stop)
                agreement = {"same_outcome_percent": round(100.0 * (again == success).mean(), 1)}
                table.append({"case": label, **row, **agreement})
    report.finish(table, given.json)


if __name__ == "__main__":
    main()
