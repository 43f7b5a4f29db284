"""Stage `fit_transfer`: fit, correct and judge the precondition predictor of a domain (thesis, section 3.3.2)."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import load_arrays, load_json
from p2l.contracts.domain import Domain
from p2l.domains.table import make_domain
from p2l.errors import ArtifactError
from p2l.evaluation.transfer.fit import fit_report
from p2l.records import TransferData
from p2l.schema import FitTransferConfig
from p2l.seeding import generator, torch_seed
from p2l.tracking import Tracker
from p2l.transfer.encodings import name_in_records
from p2l.transfer.fitting import FitOptions, Report, fit_best, split_tasks
from stages._archive import make_or_restore
from stages._bridge import fields_of
from stages._stage import stage

VERSION = 1  # raise it when an edit of the code fits another model: committed records know no code
MODEL = "transfer_model.safetensors"
FILES = (MODEL, f"{MODEL}.json", "metrics.json", "calibration.csv", "calibration.png")


@stage("fit_transfer", FitTransferConfig)
def run(cfg: FitTransferConfig, out: Path, track: Tracker) -> None:
    """Write transfer_model.safetensors with its card, metrics.json, calibration.csv and calibration.png."""
    domain = make_domain(cfg.domain.key, cfg.domain.params)
    seen_as = name_in_records(domain.encoding, chosen="encoding" in cfg.domain.params)
    make_or_restore("fit_transfer", VERSION, cfg, out, FILES, lambda: _fit(cfg, domain, out, track), seen_as)
    scores = load_json(out / "metrics.json", schema="fit_transfer_metrics", version=1)["scores"]
    mine = [row for row in scores if row["method"] == "model"]
    track.metrics({f"{row['pairs']}/{row['metric']}": row["mean"] for row in mine if row["mean"] is not None})
    track.artifact(out / "calibration.png")


def _fit(cfg: FitTransferConfig, domain: Domain, out: Path, track: Tracker) -> None:
    data = TransferData.from_arrays(load_arrays(cfg.transfer_data, schema="transfer_data", version=1))
    if data.feature_names != domain.feature_names:
        raise ArtifactError(f"{cfg.transfer_data}: its features are not those of domain '{domain.name}'; collect again")
    options = FitOptions(**fields_of(cfg, FitOptions) | {"weight_decay": cfg.weight_decay[0]})
    split = split_tasks(data, cfg.holdout, cfg.members, generator(cfg.seed, "fit_transfer", domain.name, "split"))
    seed = torch_seed(cfg.seed, "fit_transfer", domain.name, "weights")

    def report(decay: float) -> Report:
        def tell(epoch: int, training: float, validation: float) -> None:
            losses = {"training": training, "validation": validation}
            track.metrics({f"loss_decay_{decay:g}/{name}": loss for name, loss in losses.items()}, step=epoch)

        return tell

    fitting, losses = fit_best(data, domain.encoding, split, options, cfg.weight_decay, seed, report)
    fitting.model.save(out / MODEL, domain=domain.name, config_hash=cfg.hash)
    fit_report(out, domain.name, data, fitting, losses, split, cfg.seed)


if __name__ == "__main__":
    run()
