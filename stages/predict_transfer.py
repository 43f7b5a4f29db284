"""Stage `predict_transfer`: a transfer table from a few trials, and the trials to run next (thesis, section 3.3.2)."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import save_json, write_text
from p2l.errors import InputError
from p2l.schema import PredictTransferConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from stages._bridge import fields_of
from stages._progress import bar
from stages._stage import stage


@stage("predict_transfer", PredictTransferConfig)
def run(cfg: PredictTransferConfig, out: Path, track: Tracker) -> None:
    """Write transfer.csv, transfer.png, summary.json and, where there are orders, next_trials.csv."""
    from p2l.evaluation.transfer.predicted import save_prediction_figure
    from p2l.team import transfer_files as files
    from p2l.team.information import Stake, outlook
    from p2l.team.sheets import check_standard_input
    from p2l.team.trial_files import read_features, read_orders, read_trials
    from p2l.transfer.few_trials import Prior, Trials
    from p2l.transfer.pair_models import FitSetting
    from p2l.transfer.prediction import predict, summary_of

    table = out / "transfer.csv"
    for path in (table, *([cfg.out] if cfg.out else [])):
        files.check_output(path, (cfg.features, cfg.trials, cfg.orders))
    check_standard_input(cfg.features, cfg.trials, cfg.orders)
    tasks = read_features(cfg.features)
    trials = read_trials(cfg.trials, tasks.names, cfg.features) if cfg.trials else Trials.none()
    orders = read_orders(cfg.orders, tasks.names, cfg.features, cfg.order) if cfg.orders else None
    if cfg.trials is None and tasks.family is None:
        raise InputError.at(cfg.features, 1, "family", "column is missing; without trials it is all there is to go by")
    setting = FitSetting(tasks, Prior(**fields_of(cfg.prior, Prior)), cfg.members)
    with bar("comparing models", " fits") as show:
        rng = generator(cfg.seed, "predict_transfer")
        sizes = (cfg.folds, cfg.fewest_pairs, cfg.level)
        prediction = predict(setting, trials, cfg.models, *sizes, rng=rng, report=show)
    view = None
    if orders is not None:
        with bar("valuing trials", " pairs") as show:
            view = outlook(Stake(*orders, prediction.belief, len(tasks.names)), cfg.next_trials, show)
    save_prediction_figure(out / "transfer.png", prediction, cfg.level)  # whatever can fail comes before the first file
    for path in (table, *([cfg.out] if cfg.out else [])):
        write_text(path, files.transfer_text(prediction, cfg.format))
    facts = summary_of(prediction, cfg.level)
    save_json(out / "summary.json", facts, schema="predict_transfer_summary", version=1)
    if view is not None:
        write_text(out / "next_trials.csv", files.next_trials_text(view.values, tasks.names, cfg.attempts_each))
    track.metrics({name: facts[name] for name in ("trials", "mean_p", "mean_width")})
    track.artifact(out / "transfer.png")
    print(files.report(prediction, view, cfg.attempts_each))


if __name__ == "__main__":
    run()
