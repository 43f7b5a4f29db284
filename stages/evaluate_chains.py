"""Stage `evaluate_chains`: nominal where it works, recovery where the detector fires (thesis, equation 5.1)."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from p2l.artifacts import save_json, save_table
from p2l.evaluation.chain_episodes import episode_rows, totals
from p2l.recoveries.chaining.agent import load_agent
from p2l.recoveries.chaining.execute import nominal_part, overall
from p2l.registry import get_options, get_world
from p2l.schema import EvaluateChainsConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from stages._progress import counter
from stages._stage import stage


@stage("evaluate_chains", EvaluateChainsConfig)
def run(cfg: EvaluateChainsConfig, out: Path, track: Tracker) -> None:
    """Leave episodes.parquet and summary.json; every learner meets the same start states, and the same failures."""
    world = get_world(cfg.world.name, cfg.world.params)
    nominal = get_options(world.name, world)
    runs = [(learner, seed) for seed in cfg.seeds for learner in cfg.learners]
    some = world.sample(generator(cfg.seed, "evaluate_chains", world.name), 1)
    agents = {run: load_agent(cfg.policies / run[0] / f"s{run[1]}", world, nominal, some) for run in runs}
    tables: list[pd.DataFrame] = []
    with counter(f"evaluate {cfg.item}", " policies", len(runs)) as show:
        for seed in cfg.seeds:
            starts = world.sample(generator(seed, "evaluate_chains", world.name, "starts"), cfg.episodes)
            plain = nominal_part(world, nominal, starts, slots=cfg.slots)
            for learner in cfg.learners:
                agent, policy = agents[learner, seed]
                found = overall(world, nominal, agent, starts, plain)
                tables.append(episode_rows(found, policy.card, nominal))
                show(1)
    episodes = pd.concat(tables, ignore_index=True)
    save_table(out / "episodes.parquet", episodes, schema="chain_episodes", version=1)
    facts = {learner: totals(episodes[episodes["learner"] == learner]) for learner in cfg.learners}
    save_json(out / "summary.json", {"learners": facts}, schema="chain_evaluation", version=1)
    track.metrics({f"{learner}/{name}": told["mean"] for learner, part in facts.items() for name, told in part.items()})


if __name__ == "__main__":
    run()
