"""What `cluster` leaves of a grouping."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from p2l.artifacts import save_arrays, save_json
from p2l.evaluation.failures.figures import mode_figure
from p2l.evaluation.failures.tables import cluster_summary, mode_table
from p2l.evaluation.sheets import save_sheets
from p2l.failures.classifier import save_modes
from p2l.failures.grouping import Grouping


def grouping_report(out: Path, item: str, groups: Grouping) -> None:
    """Write modes.npz, labels.npz, modes.csv, modes.png and summary.json; `item` is the world's name, for the title."""
    clustering, train = groups.clustering, groups.train
    modes = mode_table(clustering, train, groups.held_out_mode, groups.members)
    modes = modes.assign(typical=groups.train_index[groups.members])
    title = f"{item}: {len(train)} failures in {len(modes)} modes ({train.origin.strategy.replace('_', ' ')})"
    figure = mode_figure(clustering, train, modes, title)
    save_modes(out / "modes.npz", clustering.modes)
    save_arrays(out / "labels.npz", groups.labels(), schema="failure_labels", version=1)
    save_sheets(out, {"modes": modes}, {"modes": figure})
    facts = cluster_summary(clustering, train, groups.held_out, modes)
    save_json(out / "summary.json", facts, schema="cluster_summary", version=1)


def grouping_metrics(facts: Mapping[str, Any]) -> dict[str, float]:
    """Headline numbers of `cluster`'s summary, for the tracker."""
    modes = facts["modes"]
    probability = sum(mode["probability"] * mode["size"] for mode in modes) / facts["failures"]
    numbers = {"failures": facts["failures"], "modes": len(modes), "probability": probability}
    return numbers | {f"weight/{mode['mode']}": mode["weight"] for mode in modes}
