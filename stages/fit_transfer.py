"""Stage `fit_transfer`: fit, correct and judge the precondition predictor of a domain (thesis, section 3.3.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from p2l.artifacts import atomic, load_arrays, save_json
from p2l.domains.table import make_domain
from p2l.errors import ArtifactError
from p2l.evaluation.transfer.fit import calibration_table, held_out_predictions, records, score_table
from p2l.evaluation.transfer.reliability import reliability_diagram
from p2l.records import TransferData
from p2l.schema import FitTransferConfig
from p2l.seeding import generator, torch_seed
from p2l.tracking import Tracker
from p2l.transfer.fitting import FitOptions, fit, split_tasks
from stages._stage import stage


@stage("fit_transfer", FitTransferConfig)
def run(cfg: FitTransferConfig, out: Path, track: Tracker) -> None:
    """Write transfer_model.safetensors with its card, metrics.json, calibration.csv and calibration.png."""
    domain = make_domain(cfg.domain.key, cfg.domain.params)
    data = TransferData.from_arrays(load_arrays(cfg.transfer_data, schema="transfer_data", version=1))
    if data.feature_names != domain.feature_names:
        raise ArtifactError(f"{cfg.transfer_data}: its features are not those of domain '{domain.name}'; collect again")
    options = FitOptions(**{name: getattr(cfg, name) for name in FitOptions.__dataclass_fields__})
    split = split_tasks(data, cfg.holdout, cfg.members, generator(cfg.seed, "fit_transfer", domain.name, "split"))
    weights = torch.Generator().manual_seed(torch_seed(cfg.seed, "fit_transfer", domain.name, "weights"))

    def report(epoch: int, training: float, validation: float) -> None:
        track.metrics({"loss/training": training, "loss/validation": validation}, step=epoch)

    fitting = fit(data, domain.encoding, split, options, weights, report)
    fitting.model.save(out / "transfer_model.safetensors", domain=domain.name, config_hash=cfg.hash)

    predictions = held_out_predictions(data, fitting.model, split)
    scores = score_table(predictions, generator(cfg.seed, "fit_transfer", domain.name, "intervals"))
    table = calibration_table(predictions)
    with atomic(out / "calibration.csv") as temporary:
        table.to_csv(temporary, index=False)
    reliability_diagram(table, ("model", "nearest_neighbour"), domain.name, out / "calibration.png")
    facts: dict[str, Any] = {
        "tasks_fitted": int((~split.held_out).sum()),
        "tasks_held_out": int(split.held_out.sum()),
        "platt": {"slope": fitting.model.platt.slope, "shift": fitting.model.platt.shift},
        "best_epoch": fitting.best_epoch.tolist(),
        "scores": records(scores),
    }
    save_json(out / "metrics.json", facts, schema="fit_transfer_metrics", version=1)
    mine = [row for row in facts["scores"] if row["method"] == "model"]
    track.metrics({f"{row['pairs']}/{row['metric']}": row["mean"] for row in mine if row["mean"] is not None})
    track.artifact(out / "calibration.png")


if __name__ == "__main__":
    run()
