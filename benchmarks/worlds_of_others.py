"""The table of the tasks that others have made: nominal skills, RecoveryChaining, and what needs no learning.

  python -m benchmarks.worlds_of_others build/worlds_of_others results/thesis/tables/worlds_of_others.csv

`scripts/worlds_of_others.sh` calls it at its end. `retry` hands control back to the first controller at every failure;
`untrained` is each policy before its first update, on the failures of its evaluations. Intervals: Student's t
over the trainings; Wilson's over the episodes of `nominal` and `retry`, which no training changes.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from benchmarks import report
from p2l.chaining.agent import Agent
from p2l.chaining.episodes import start_states
from p2l.chaining.execute import nominal_part, overall
from p2l.chaining.mdp import Limits
from p2l.evaluation.statistics import rate_interval
from p2l.worlds.table import make_world

CONF = Path(__file__).resolve().parents[1] / "examples/conf/world"
EPISODES = 200  # of each seed, as evaluate_chains has them


def retry(name: str, seeds: list[int]) -> tuple[int, int]:
    """Episodes done, of how many, if every failure is answered by the first controller."""
    plain = yaml.safe_load((CONF / f"{name}.yaml").read_text(encoding="utf-8"))
    world = make_world(plain["target"], plain["params"])
    nominal, own = world.nominal_options(), world.primitives()
    agent = Agent(Limits(), own, lambda seen: np.full(len(seen), len(own)))
    success = []
    for seed in seeds:
        starts = start_states(world, seed, EPISODES)
        results = overall(world, nominal, agent, starts, nominal_part(world, nominal, starts))
        success += results.success[~results.diverged].tolist()
    return sum(success), len(success)


def rows_of(name: str, place: Path) -> list[report.Row]:
    """One world."""
    found = json.loads((place / "discover/summary.json").read_text(encoding="utf-8"))["train"]
    facts = {"world": name, "failures": found["failures"], "of_episodes": found["executions"]}
    facts["modes"] = len(pd.read_csv(place / "cluster/modes.csv"))
    table = pd.read_csv(place / "judged/table_5_1.csv")
    columns = ["method", "metric", "mean", "low", "high", "n"]
    rows = [facts | row.to_dict() for _, row in table.loc[table["setting"] == f"world={name}", columns].iterrows()]
    curves = pd.read_csv(place / "chains/evaluations.csv")
    first = curves[curves["control_steps"] == 0]
    done, of = retry(name, sorted(first["seed"].tolist()))
    untrained = rate_interval((first["success"] * first["episodes"]).round(), first["episodes"])
    for method, metric, interval, n in (
        ("untrained", "recovery", untrained, len(first)),
        ("retry", "success", rate_interval([done], [of]), of),
    ):
        numbers = {"mean": float(interval.mean), "low": float(interval.low), "high": float(interval.high), "n": n}
        rows.append(facts | {"method": method, "metric": metric, **numbers})
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("build", type=Path, help="folder of the runs, one for each world")
    parser.add_argument("target", type=Path, help="CSV file to write")
    args = parser.parse_args(arguments)
    build, target = args.build, args.target
    rows = [row for name in sorted(each.name for each in build.iterdir()) for row in rows_of(name, build / name)]
    pd.DataFrame(rows).to_csv(target, index=False, float_format="%.4g")
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
