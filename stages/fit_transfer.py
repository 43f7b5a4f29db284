"""Stage `fit_transfer`: fit, correct and judge the precondition predictor of a domain (thesis, section 3.3.2)."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from p2l.artifacts import atomic, load_arrays, load_json, save_json
from p2l.domains.table import make_domain
from p2l.errors import ArtifactError
from p2l.evaluation.transfer.fit import held_out_predictions
from p2l.evaluation.transfer.reliability import reliability_diagram
from p2l.evaluation.transfer.scores import calibration_table, records, score_table
from p2l.records import TransferData
from p2l.schema import FitTransferConfig
from p2l.seeding import generator, torch_seed
from p2l.tracking import Tracker
from p2l.transfer.fitting import FitOptions, Report, fit_best, split_tasks
from stages._archive import archive_of
from stages._bridge import fields_of
from stages._stage import stage

VERSION = 1  # raise it when an edit of the code fits another model: committed records know no code
MODEL = "transfer_model.safetensors"
FILES = (MODEL, f"{MODEL}.json", "metrics.json", "calibration.csv", "calibration.png")


@stage("fit_transfer", FitTransferConfig)
def run(cfg: FitTransferConfig, out: Path, track: Tracker) -> None:
    """Write transfer_model.safetensors with its card, metrics.json, calibration.csv and calibration.png."""
    archive = archive_of("fit_transfer", VERSION, cfg, FILES)
    if not archive.restore(out):
        begin = time.perf_counter()
        _fit(cfg, out, track)
        archive.keep(out, seconds=time.perf_counter() - begin)
    scores = load_json(out / "metrics.json", schema="fit_transfer_metrics", version=1)["scores"]
    mine = [row for row in scores if row["method"] == "model"]
    track.metrics({f"{row['pairs']}/{row['metric']}": row["mean"] for row in mine if row["mean"] is not None})
    track.artifact(out / "calibration.png")


def _fit(cfg: FitTransferConfig, out: Path, track: Tracker) -> None:
    """Fit with every weight decay, keep the best, and write the files."""
    domain = make_domain(cfg.domain.key, cfg.domain.params)
    data = TransferData.from_arrays(load_arrays(cfg.transfer_data, schema="transfer_data", version=1))
    if data.feature_names != domain.feature_names:
        raise ArtifactError(f"{cfg.transfer_data}: its features are not those of domain '{domain.name}'; collect again")
    options = FitOptions(**{**fields_of(cfg, FitOptions), "weight_decay": 0.0})  # which is chosen among those given
    split = split_tasks(data, cfg.holdout, cfg.members, generator(cfg.seed, "fit_transfer", domain.name, "split"))
    seed = torch_seed(cfg.seed, "fit_transfer", domain.name, "weights")

    def report(decay: float) -> Report:
        def tell(epoch: int, training: float, validation: float) -> None:
            name = f"loss_decay_{decay:g}"
            track.metrics({f"{name}/training": training, f"{name}/validation": validation}, step=epoch)

        return tell

    fitting, losses = fit_best(data, domain.encoding, split, options, cfg.weight_decay, seed, report)
    fitting.model.save(out / MODEL, domain=domain.name, config_hash=cfg.hash)

    predictions = held_out_predictions(data, fitting.model, split)
    scores = score_table(predictions, generator(cfg.seed, "fit_transfer", domain.name, "intervals"))
    table = calibration_table(predictions)
    with atomic(out / "calibration.csv") as temporary:
        table.to_csv(temporary, index=False)
    reliability_diagram(table, ("model", "nearest_neighbour"), domain.name, out / "calibration.png")
    facts: dict[str, Any] = {
        "tasks_fitted": int((~split.held_out).sum()),
        "tasks_held_out": int(split.held_out.sum()),
        "weight_decay": min(losses, key=losses.__getitem__),
        "loss_by_weight_decay": {str(decay): loss for decay, loss in losses.items()},
        "platt": {"slope": fitting.model.platt.slope, "shift": fitting.model.platt.shift},
        "best_epoch": fitting.best_epoch.tolist(),
        "scores": records(scores),
    }
    save_json(out / "metrics.json", facts, schema="fit_transfer_metrics", version=1)


if __name__ == "__main__":
    run()
