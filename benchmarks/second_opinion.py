"""The nominal skills in robosuite's own environments with its own controller, beside ours, on the same start states.

  python -m benchmarks.second_opinion                            door and pick_place, 200 episodes each, seed 0
  python -m benchmarks.second_opinion --worlds door --episodes 50 --json out.json

`ours` and `robosuite` are the percentages of successful episodes with Wilson's 95 % interval; `difference` is robosuite
minus ours in points. robosuite judges by its own test. `tuning` is that of its controller: `matched` to the impedance
of our skills, or robosuite's `own`. Where the thesis stops at the first failure flag (chapter 5), an
episode that is flagged has failed on both sides.
"""

from __future__ import annotations

import functools
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from typing import get_args

import numpy as np
from tqdm import tqdm

from benchmarks import report
from benchmarks.nominal import OPEN_LOOP
from p2l.contracts.world import World
from p2l.evaluation.statistics import wilson_interval
from p2l.records import BoolArray
from p2l.skills import chain
from p2l.worlds import robosuite as robosuite_sim
from p2l.worlds.table import make_world

CHUNK = 10  # episodes of one piece of work; every piece samples all start states again, which is quick


@functools.cache
def world_of(name: str) -> World:
    """The world, made once in a process."""
    return make_world(name, {"nthread": 1})


@functools.cache
def transfer_of(name: str, tuning: robosuite_sim.Tuning) -> robosuite_sim.TransferWorld:
    """The side of robosuite, made once in a process."""
    return robosuite_sim.make(world_of(name), tuning=tuning)


def robosuite_chunk(
    name: str, tuning: robosuite_sim.Tuning, seed: int, episodes: int, first: int
) -> tuple[BoolArray, int]:
    """Outcomes of `CHUNK` episodes from `first` on in robosuite, and how many control steps they took."""
    rows = world_of(name).sample(np.random.default_rng(seed), episodes)
    part = rows.take(np.arange(first, min(first + CHUNK, episodes)))
    options = world_of(name).nominal_options()
    execution = robosuite_sim.execute(transfer_of(name, tuning), options, part, stop_on_failure=name not in OPEN_LOOP)
    return execution.success, int(execution.last.step.sum())


def robosuite_success(
    name: str, tuning: robosuite_sim.Tuning, episodes: int, seed: int, processes: int
) -> tuple[BoolArray, int]:
    """Outcome of every episode in robosuite, and the control steps of all."""
    spawn = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(processes, mp_context=spawn) as pool,
        tqdm(desc=f"{name} in robosuite", unit="episode", total=episodes, disable=None, leave=False) as bar,
    ):
        parts = []
        for part in pool.map(
            functools.partial(robosuite_chunk, name, tuning, seed, episodes), range(0, episodes, CHUNK)
        ):
            parts.append(part)
            bar.update(len(part[0]))
    return np.concatenate([success for success, _ in parts]), sum(steps for _, steps in parts)


def interval(success: BoolArray) -> str:
    """Wilson's limits in percent."""
    low, high = wilson_interval(success.sum(), len(success))
    return f"{100.0 * float(low):.1f}–{100.0 * float(high):.1f}"


def compare(name: str, tuning: robosuite_sim.Tuning, episodes: int, seed: int, processes: int) -> report.Row:
    """One row of the table."""
    world = world_of(name)
    rows = world.sample(np.random.default_rng(seed), episodes)
    ours = chain.run(world, world.nominal_options(), rows, stop_on_failure=name not in OPEN_LOOP).success
    start = time.perf_counter()
    theirs, steps = robosuite_success(name, tuning, episodes, seed, processes)
    seconds = time.perf_counter() - start
    return {
        "world": name,
        "environment": robosuite_sim.known_tasks()[name],
        "tuning": tuning,
        "estimator": world.estimator.mode,
        "episodes": episodes,
        "ours": round(100.0 * ours.mean(), 1),
        "ours_interval": interval(ours),
        "robosuite": round(100.0 * theirs.mean(), 1),
        "robosuite_interval": interval(theirs),
        "difference": round(100.0 * (theirs.mean() - ours.mean()), 1),
        "same_outcome_percent": round(100.0 * (theirs == ours).mean(), 1),
        "control_steps_per_s": round(steps / seconds, 1),
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    tasks = list(robosuite_sim.known_tasks())
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", choices=tasks, default=tasks)
    parser.add_argument("--episodes", type=report.positive, default=200)
    parser.add_argument("--seed", type=report.seed, default=0)
    parser.add_argument("--processes", type=report.positive, default=2)
    parser.add_argument("--tuning", nargs="+", choices=get_args(robosuite_sim.Tuning), default=["matched"])
    args = parser.parse_args(arguments)
    table = [
        compare(name, tuning, args.episodes, args.seed, args.processes)
        for name in args.worlds
        for tuning in args.tuning
    ]
    report.finish(table, args.json)


if __name__ == "__main__":
    report.command(main)
