"""Stage `learn_recoveries`: which recovery to train next (thesis, section 4.3.2, Algorithm 3)."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from p2l.artifacts import save_arrays
from p2l.evaluation.metareskill.training import learning_report
from p2l.metareskill.algorithm import check_budget
from p2l.metareskill.chooser_run import train_recoveries
from p2l.metareskill.choosers.table import make_chooser
from p2l.metareskill.history import History
from p2l.metareskill.ledger import Ledger
from p2l.metareskill.record import collect, save_recoveries
from p2l.metareskill.reported import keep_history, reported_split
from p2l.records import Array
from p2l.schema import LearnRecoveriesConfig
from p2l.tracking import Tracker
from stages._bridge import code_of, tell
from stages._child import child
from stages._progress import counter
from stages._recovery import film, inputs_of, round_teller
from stages._stage import stage

log = logging.getLogger(__name__)


@stage("learn_recoveries", LearnRecoveriesConfig)
def run(cfg: LearnRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Train with every chooser and seed; keep the first chooser's skills, all rounds, and figures 4.6 and 4.7."""
    choosers = {name: make_chooser(cfg.choosers[name].key, cfg.choosers[name].params) for name in cfg.compare}
    inputs, records = inputs_of(cfg, out), cfg.records or out / "records"
    setting, compare, budget = inputs.setting, cfg.compare, dict[str, Any](rounds=cfg.rounds, episodes=cfg.episodes)
    for chooser in choosers.values():
        check_budget(setting.graph, chooser, **budget)
    code = code_of("learn_recoveries", cfg, cfg.records)
    split = reported_split(setting, inputs.train, cfg.reported, records, cfg.item)
    histories, values, ledgers = dict[tuple[int, str], History](), dict[tuple[int, str], Array](), dict[int, Ledger]()
    with counter(f"learn {cfg.item}", "round", cfg.rounds * len(choosers) * len(cfg.seeds)) as show:
        for seed in cfg.seeds:
            trainer = setting.trainer(seed, records / f"{cfg.item}-ledger-s{seed}.npz", code)
            for name, chooser in choosers.items():
                with child(track, cfg, "learn_recoveries", name, seed, out / "runs" / f"s{seed}" / name) as tracker:
                    report = round_teller(tracker, show)
                    history = train_recoveries(trainer, setting.graph, chooser, report=report, **budget)
                args = cfg.item, trainer, name, setting.graph, history, split, budget | cfg.choosers[name].model_dump()
                histories[seed, name], values[seed, name] = history, keep_history(records, *args)
            ledgers[seed], first = trainer.ledger, histories[seed, compare[0]]
            learnt = collect(trainer, setting.modes, setting.graph, first, cfg.episodes)
            save_recoveries(out / "recoveries" / f"s{seed}.npz", learnt)
            save_arrays(out / "histories" / f"s{seed}.npz", first.arrays(), schema="recovery_history", version=1)
            if seed == cfg.seeds[0]:
                films = film(cfg, inputs, learnt, out / "videos")
    tell(track, learning_report(out, cfg.item, setting, histories, values, ledgers, compare, cfg.episodes), log, films)


if __name__ == "__main__":
    run()
