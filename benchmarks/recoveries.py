"""What learning recoveries costs: a REPS query, a round of training, and the values behind MetaReSkill's choice.

  python -m benchmarks.recoveries                          the door, 1, 2 and 4 queries at once; 6 to 200 modes
  python -m benchmarks.recoveries --queries 1 --json out.json

Queries: 10 updates of 40 rollouts each, from start states to the goal, which none reaches, so that all 400 are run.
`engine_s` replays the very commands of the queries with plain engine calls; `engine_share` = engine_s / query_s says
how much of the engine's throughput a query uses. `per_query` is the time of one query beside that in the first row.
`rounds_per_hour` counts a query and a measurement on 50 held-out failures.

Modes: `predicted_value` looks at every (mode, target) at once; `exact` solves a linear system for each pair,
`one_by_one` iterates values for each pair. `times_exact` and `times_one_by_one` are how much longer they take,
`difference` is the largest one between the vectorised and the exact values.

The machine is shared: seconds are medians over `--rounds`, and only ratios of one run mean much.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

from benchmarks import report
from benchmarks.simulation import Recorder
from p2l.contracts.rows import Rows
from p2l.contracts.world import symbols_of
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions, query
from p2l.metareskill.regression import fit_skill
from p2l.metareskill.start import Start
from p2l.metareskill.target import RecoveryTask
from p2l.metareskill.trainer import Trainer
from p2l.metareskill.value_iteration import (
    predicted_value,
    recovery_values,
    value_iteration,
    value_of_failures,
)
from p2l.preconditions.backwards import ChainingOptions, chain_preconditions
from p2l.records import Array
from p2l.skills.relative import SIZE
from p2l.worlds.table import make_world

TRIALS = 50
OPTIONS = QueryOptions(hopeless=10)  # none is given up before it has cost all there is to it


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def recovery_task(name: str, threads: int) -> RecoveryTask:
    """A world with preconditions from few samples: how good they are takes no part in what a query costs."""
    world = make_world(name, {"nthread": threads})
    symbols = symbols_of(world)
    few = ChainingOptions(trajectories=24, samples=24)
    return RecoveryTask(
        world, symbols, chain_preconditions(world, symbols, world.nominal_options(), few, 0).preconditions
    )


def ask(task: RecoveryTask, rows: Rows) -> int:
    """Ask one query from each of `rows` to the goal, always the same; the number of rollouts."""
    rngs = [np.random.default_rng(q) for q in range(len(rows))]
    answers = query(task, rows, [len(task.targets) - 1] * len(rows), rngs, OPTIONS)
    return sum(answer.rollouts for answer in answers)


def queries(task: RecoveryTask, counts: list[int], rounds: int) -> list[report.Row]:
    """A row for each number of queries that share their batches."""
    table: list[report.Row] = []
    first, measure_s = 0.0, measurement(task, rounds)
    for count in counts:
        rows = task.world.sample(np.random.default_rng(1), count)
        with Recorder(task.world) as recorder:
            rollouts = ask(task, rows)

        def replay(calls: list[tuple[Array, Array, Array, Array, Any]] = recorder.calls) -> None:
            for call in calls:
                task.world.engine.step(*call)

        def again(rows: Rows = rows) -> None:
            ask(task, rows)

        times = [(seconds(again), seconds(replay)) for _ in range(rounds)]
        whole = median(one for one, _ in times)
        first = first or whole / count
        table.append(
            {
                "queries": count,
                "rollouts": rollouts,
                "query_s": round(whole, 3),
                "engine_s": round(median(other for _, other in times), 3),
                "engine_share": round(median(other / one for one, other in times), 3),
                "per_query": round(whole / count / first, 3),
                "measure_s": round(measure_s, 3),
                "rounds_per_hour": round(3600.0 / (whole / count + measure_s)),
            }
        )
    return table


def measurement(task: RecoveryTask, rounds: int) -> float:
    """Time to measure a skill on `TRIALS` held-out failures."""
    rows = task.world.sample(np.random.default_rng(2), TRIALS)
    members = Members(rows, np.zeros(TRIALS, dtype=np.int64))
    start = Start.nothing(1, len(task.targets))
    trainer = Trainer(task, members, members, OPTIONS, 0, Ledger(""), start, TRIALS)
    skill = fit_skill(np.zeros((1, len(task.symbols.context))), np.zeros((1, SIZE)), guess="straight")
    return median(seconds(lambda: trainer.measure(skill, 0, 0)) for _ in range(rounds))


def exact_values(graph: SkillGraph, upper: Array) -> Array:
    """[I, M] value of failures where q of one recovery alone is `upper`, by a linear solve for each."""
    targets = value_iteration(graph).targets
    count, modes = len(targets), len(graph.sizes)
    value = np.empty(graph.q.shape)
    for pair in np.ndindex(*graph.q.shape):
        q = graph.q.copy()
        q[pair] = upper[pair]
        scores = recovery_values(graph, targets, q)
        best, mode = scores.argmax(axis=1), np.arange(modes)
        worth = scores[mode, best] > -graph.c_fail  # else the robot gives up
        success = np.where(worth, q[mode, best], 0.0)
        system, reward = np.eye(count + modes), np.zeros(count + modes)
        system[np.arange(count - 1), np.arange(1, count)] = -graph.nominal
        reward[: count - 1] = graph.skill_reward - (1.0 - graph.nominal) * graph.c_fail
        system[count + mode, best] = -success
        reward[count:] = np.where(worth, graph.recovery_reward, 0.0) - (1.0 - success) * graph.c_fail
        value[pair] = np.linalg.solve(system, reward)[count:] @ graph.share
    return value


def one_by_one(graph: SkillGraph, upper: Array) -> Array:
    """The same by value iteration on each replaced graph."""
    value = np.empty(graph.q.shape)
    for pair in np.ndindex(*graph.q.shape):
        q = graph.q.copy()
        q[pair] = upper[pair]
        value[pair] = value_of_failures(graph, q)
    return value


def values(modes: int, rounds: int) -> report.Row:
    """A random graph of three nominal skills and so many modes."""
    rng = np.random.default_rng(modes)
    graph = SkillGraph(np.full(3, 0.95), rng.uniform(1.0, 500.0, modes), rng.random((modes, 4)))
    upper = np.minimum(graph.q + 0.3 * rng.random(graph.q.shape), 1.0)
    difference = np.abs(predicted_value(graph, upper) - exact_values(graph, upper)).max()
    ways = (predicted_value, exact_values, one_by_one)
    times = [[seconds(lambda way=way: way(graph, upper)) for way in ways] for _ in range(rounds)]  # type: ignore[misc]
    fast, exact, single = (median(column) for column in zip(*times, strict=True))
    return {
        "modes": modes,
        "recoveries": graph.q.size,
        "vectorised_s": round(fast, 6),
        "exact_s": round(exact, 4),
        "one_by_one_s": round(single, 4),
        "times_exact": round(median(row[1] / row[0] for row in times)),
        "times_one_by_one": round(median(row[2] / row[0] for row in times)),
        "difference": float(difference),
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--world", type=report.known_world, default="door")
    parser.add_argument("--queries", type=int, nargs="*", default=[1, 2, 4], help="queries that share batches")
    parser.add_argument("--modes", type=int, nargs="*", default=[6, 20, 50, 100, 200])
    parser.add_argument("--threads", type=report.positive, default=2)
    parser.add_argument("--rounds", type=report.positive, default=3)
    args = parser.parse_args(arguments)
    rows = [values(modes, args.rounds) for modes in args.modes]
    if args.queries:
        rows = queries(recovery_task(args.world, args.threads), args.queries, args.rounds) + rows
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
