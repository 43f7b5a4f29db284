"""Stage `learn_recoveries`: which recovery to train next (thesis, section 4.3.2, Algorithm 3)."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from p2l.artifacts import save_arrays
from p2l.evaluation.metareskill.learnt import learning_report
from p2l.ledger import RECOVERING, code_digest
from p2l.metareskill.choosers.choose import Chooser, get_chooser
from p2l.metareskill.history import History
from p2l.metareskill.learn import Setting, record_history, train_recoveries
from p2l.metareskill.loop import check_budget
from p2l.metareskill.record import collect, save_recoveries
from p2l.metareskill.train import Trainer
from p2l.schema import LearnRecoveriesConfig
from p2l.tracking import Tracker
from stages._child import child
from stages._progress import counter
from stages._recovery import film, open_setting
from stages._stage import stage

log = logging.getLogger(__name__)


@stage("learn_recoveries", LearnRecoveriesConfig)
def run(cfg: LearnRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Train with every chooser and seed; keep the first chooser's skills, all rounds, and figures 4.6 and 4.7."""
    choosers = {name: get_chooser(cfg.choosers[name].name, cfg.choosers[name].params) for name in cfg.compare}
    setting, records = open_setting(cfg), cfg.records or out / "records"
    for chooser in choosers.values():
        check_budget(setting.graph, chooser, cfg.rounds, cfg.episodes)
    # Committed ledgers outlive harmless edits; a run's own do not.
    code = "" if cfg.records else code_digest(*RECOVERING)
    histories: dict[tuple[int, str], History] = {}
    with counter(f"learn {cfg.item}", "round", cfg.rounds * len(choosers) * len(cfg.seeds)) as show:
        for seed in cfg.seeds:
            trainer = setting.trainer(seed, records / f"{cfg.item}-ledger-s{seed}.npz", code)
            for name, chooser in choosers.items():
                with child(track, cfg, "learn_recoveries", name, seed, out / "runs" / f"s{seed}" / name) as told:
                    histories[seed, name] = _learn(cfg, setting, trainer, chooser, told, show)
                settings = {"rounds": cfg.rounds, "episodes": cfg.episodes, **cfg.choosers[name].model_dump()}
                record_history(records, cfg.item, trainer, name, histories[seed, name], settings)
            kept = histories[seed, cfg.compare[0]]
            learnt = collect(trainer, setting.modes, setting.graph, kept, cfg.episodes)
            save_recoveries(out / "recoveries" / f"s{seed}.npz", learnt)
            save_arrays(out / "histories" / f"s{seed}.npz", kept.arrays(), schema="recovery_history", version=1)
            if seed == cfg.seeds[0]:
                films = film(cfg, setting, learnt, out / "videos")
    report = learning_report(out, cfg.item, setting, histories, cfg.compare)
    track.metrics(report.metrics)
    for path in (*report.files, *films):
        track.artifact(path)
    for line in report.notes:
        log.warning(line)
        track.note(line)


def _learn(
    cfg: LearnRecoveriesConfig,
    setting: Setting,
    trainer: Trainer,
    chooser: Chooser,
    track: Tracker,
    show: Callable[[int], None],
) -> History:
    def report(history: History) -> None:
        last = history.rounds[-1]
        numbers = {"value": last.value, "predicted": last.predicted, "q_upper": last.q_upper, "q": last.q}
        track.metrics({**numbers, "mode": last.mode, "target": last.target, "solved": last.solved}, step=len(history))
        show(1)

    return train_recoveries(trainer, setting.graph, chooser, rounds=cfg.rounds, episodes=cfg.episodes, report=report)


if __name__ == "__main__":
    run()
