"""Stage `evaluate_recoveries`: learnt recoveries against heuristic strategies (thesis, section 4.4)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pandas as pd

from p2l.artifacts import save_table
from p2l.evaluation.metareskill.judged import Evaluated, evaluation_report, read_rounds
from p2l.failures.classifier import load_modes
from p2l.ledger import RECOVERING, code_digest
from p2l.metareskill.episodes import Book, gather
from p2l.metareskill.record import Recoveries, load_recoveries
from p2l.preconditions.record import load_preconditions
from p2l.registry import get_world
from p2l.schema import EvaluateRecoveriesConfig
from p2l.tracking import Tracker
from stages._child import child
from stages._places import places, unseen
from stages._progress import counter
from stages._stage import stage


@stage("evaluate_recoveries", EvaluateRecoveriesConfig)
def run(cfg: EvaluateRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Run or look up every item; leave episodes.parquet, tables 4.1 and 4.2, figures 4.6 and 4.7, and a summary."""
    world = get_world(cfg.world.name, cfg.world.params)
    preconditions, modes = load_preconditions(cfg.preconditions, world), load_modes(cfg.modes, world)
    learnt: Mapping[int, Recoveries] = {
        seed: load_recoveries(cfg.learnt / "recoveries" / f"s{seed}.npz", world, preconditions, modes)
        for seed in cfg.seeds
    }
    rounds = read_rounds(cfg.learnt / "rounds.csv", cfg.seeds)
    # Committed records outlive harmless edits (`recovery_episodes.VERSION` marks the others); a run's own do not.
    code = "" if cfg.records else code_digest(*RECOVERING)
    book = Book(cfg.records or out / "records", code, cfg.seed, cfg.max_options)
    tables = []
    with ExitStack() as stack:
        found = places(cfg, preconditions, stack)
        total = sum(place.episodes * len(methods) * len(seeds) for place, methods, seeds in found)
        with counter(f"evaluate {cfg.item}", " episodes", total) as show:
            for seed in cfg.seeds:
                mine = [(place, methods) for place, methods, seeds in found if seed in seeds]
                with child(track, cfg, "evaluate_recoveries", "strategies", seed, out / "runs" / f"s{seed}") as told:
                    each = partial(_tell, told)
                    tables.append(gather(book, mine, seed, modes, learnt[seed], each, show))
    episodes = pd.concat(tables, ignore_index=True)
    save_table(out / "episodes.parquet", episodes, schema="recovery_episodes", version=1)
    result = evaluation_report(out, Evaluated(cfg.item, episodes, unseen(cfg), learnt, rounds), cfg.thesis, cfg.seed)
    track.metrics(result.metrics)
    for path in result.files:
        track.artifact(path)
    for line in result.notes:
        track.note(line)


def _tell(track: Tracker, table: pd.DataFrame) -> None:
    place, method = table["place"].iloc[0], table["method"].iloc[0]
    sound = table[~table["diverged"]]
    track.metrics({f"{place}/{method}/success": float(sound["success"].mean())} if len(sound) else {})


if __name__ == "__main__":
    run()
