"""Stage `evaluate_recoveries`: learnt recoveries against heuristic strategies (thesis, section 4.4)."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pandas as pd

from p2l.artifacts import save_table
from p2l.evaluation.metareskill.evaluation import RecoveryEvaluation, evaluation_report, read_curves
from p2l.failures.classifier import load_modes
from p2l.metareskill.episodes import EpisodeLedger, gather
from p2l.metareskill.places import Tour, places
from p2l.metareskill.record import load_recoveries
from p2l.preconditions.record import load_preconditions
from p2l.schema import EvaluateRecoveriesConfig
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._bridge import code_of, fields_of, tell
from stages._child import child
from stages._progress import counter
from stages._stage import stage


@stage("evaluate_recoveries", EvaluateRecoveriesConfig)
def run(cfg: EvaluateRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Run or look up every item; leave episodes.parquet, tables 4.1 and 4.2, figures 4.6 and 4.7, and a summary."""
    world = make_world(cfg.world.key, cfg.world.params)
    preconditions, modes = load_preconditions(cfg.preconditions, world), load_modes(cfg.modes, world)
    files = {seed: cfg.learnt / "recoveries" / f"s{seed}.npz" for seed in cfg.seeds}
    learnt = {seed: load_recoveries(file, world, preconditions, modes) for seed, file in files.items()}
    curves = read_curves(cfg.learnt, cfg.seeds)
    code = code_of("evaluate_recoveries", cfg, cfg.records)
    book = EpisodeLedger(cfg.records or out / "records", code, cfg.seed, cfg.max_options)
    tour = Tour(**fields_of(cfg, Tour) | {"world": cfg.world.key, "params": cfg.world.params})
    tables = []
    with ExitStack() as stack:
        visits = places(tour, preconditions, stack)
        total = sum(place.episodes * len(methods) * len(seeds) for place, methods, seeds in visits)
        with counter(f"evaluate {cfg.item}", " episodes", total) as show:
            for seed in cfg.seeds:
                mine = [(place, methods) for place, methods, seeds in visits if seed in seeds]
                with child(track, cfg, "evaluate_recoveries", "strategies", seed, out / "runs" / f"s{seed}") as tracker:
                    tables.append(gather(book, mine, seed, modes, learnt[seed], partial(_tell, tracker), show))
    episodes = pd.concat(tables, ignore_index=True)
    save_table(out / "episodes.parquet", episodes, schema="recovery_episodes", version=1)
    evaluation = RecoveryEvaluation(cfg.item, episodes, tour.unseen, learnt, *curves)
    tell(track, evaluation_report(out, evaluation, cfg.thesis, cfg.seed))


def _tell(track: Tracker, table: pd.DataFrame) -> None:
    place, method = table["place"].iloc[0], table["method"].iloc[0]
    sound = table[~table["diverged"]]
    track.metrics({f"{place}/{method}/success": float(sound["success"].mean())} if len(sound) else {})


if __name__ == "__main__":
    run()
