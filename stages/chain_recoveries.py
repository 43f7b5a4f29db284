"""Stage `chain_recoveries`: learn a recovery policy from recorded failures (thesis, chapter 5)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from p2l.artifacts import atomic, save_json
from p2l.failures.record import check_params, load_failures, open_world
from p2l.recoveries.chaining.checkpoint import drop_checkpoint
from p2l.recoveries.chaining.learner import Task
from p2l.recoveries.chaining.learners import make_learner
from p2l.recoveries.chaining.mdp import Limits
from p2l.recoveries.chaining.ppo import PPOSettings
from p2l.recoveries.chaining.train import TrainSettings, apart_of, card_of, split, summary, train
from p2l.schema import ChainRecoveriesConfig
from p2l.tracking import Tracker
from stages._progress import training
from stages._stage import stage


@stage("chain_recoveries", ChainRecoveriesConfig)
def run(cfg: ChainRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Leave policy.safetensors with its card, rounds.csv, evaluations.csv and summary.json."""
    budget = round(cfg.budget * cfg.learner.budget_share)
    every, episodes = cfg.evaluation.every, cfg.evaluation.episodes
    settings = TrainSettings(budget, cfg.slots, every, episodes, PPOSettings(**cfg.ppo.model_dump()))
    failures = load_failures(cfg.failures, "train")
    check_params(failures, cfg.world.name, cfg.world.params, cfg.failures)
    world, nominal = open_world(failures, cfg.failures)
    parts = split(failures.rows, episodes, cfg.seed, world.name)
    task = Task(world, nominal, parts.learnt, cfg.seed)
    learner = make_learner(cfg.learner.name, task, Limits(**cfg.limits.model_dump()), cfg.learner.params)
    card = card_of(task, learner, cfg.learner.name, cfg.hash)
    with training(f"{cfg.item} {cfg.learner.name} s{cfg.seed}", budget) as show:

        def report(kind: str, row: Mapping[str, float]) -> None:
            told = {name.replace("+", "plus "): value for name, value in row.items() if name != "control_steps"}
            track.metrics({f"{kind}/{name}": value for name, value in told.items()}, step=int(row["control_steps"]))
            if kind == "round":
                show(int(row["control_steps"]), row["done"] / max(row["ended"], 1))

        progress = train(task, learner, apart_of(task, learner, parts, episodes), settings, card, out, report)
    for name in ("rounds", "evaluations"):
        with atomic(out / f"{name}.csv") as temporary:
            pd.DataFrame(getattr(progress, name)).to_csv(temporary, index=False, float_format="%.6g")
        track.artifact(out / f"{name}.csv")
    facts = {"failures": len(failures), "set_apart": len(parts.apart), **summary(progress)}
    save_json(out / "summary.json", facts, schema="chain_summary", version=1)
    track.metrics({name: value for name, value in facts.items() if value is not None})
    drop_checkpoint(out)


if __name__ == "__main__":
    run()
