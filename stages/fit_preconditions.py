"""Stage `fit_preconditions`: where may each nominal skill be started? Precondition chaining (thesis, Algorithm 2)."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from p2l.artifacts import atomic, finite, save_arrays, save_json
from p2l.evaluation.metareskill.preconditions import calibration_table, precondition_figure, sample_curve, score_table
from p2l.evaluation.style import png
from p2l.preconditions.backwards import ChainingOptions, chain_preconditions
from p2l.preconditions.record import save_preconditions
from p2l.preconditions.vicinity import Vicinity
from p2l.registry import get_options, get_symbols, get_world
from p2l.schema import FitPreconditionsConfig
from p2l.skills.relative import Timing
from p2l.tracking import Tracker
from stages._progress import counter
from stages._stage import stage

log = logging.getLogger(__name__)


@stage("fit_preconditions", FitPreconditionsConfig)
def run(cfg: FitPreconditionsConfig, out: Path, track: Tracker) -> None:
    """Write the preconditions and their samples, what is known of their quality as CSV and figure, and a summary."""
    world = get_world(cfg.world.name, {**cfg.world.params, "estimator": "fixed"})
    nominal, symbols = get_options(world.name, world), get_symbols(world.name, world)
    options = ChainingOptions(
        **{
            name: getattr(cfg, name) for name in ("trajectories", "samples", "components", "regularisation", "held_out")
        },
        vicinity=Vicinity(**cfg.vicinity.model_dump()),
        timing=Timing(**cfg.timing.model_dump()),
    )
    begun = time.perf_counter()
    with counter(f"preconditions {cfg.item}", "skill", len(nominal)) as show:
        found = chain_preconditions(world, symbols, nominal, options, cfg.seed, show)
    took = time.perf_counter() - begun
    log.info("%s: %d of %d nominal executions succeed", world.name, found.successful, found.trajectories)
    scores, calibration = score_table(found), calibration_table(found)
    curve = sample_curve(found, options, cfg.counts, cfg.seed)
    total = sum(len(samples.labels) for samples in found.samples)
    title = f"{cfg.item}: preconditions from {total} samples"
    picture = png(precondition_figure(scores, calibration, curve, title))

    save_preconditions(out / "preconditions.npz", found.preconditions)
    arrays = {
        f"{name}.{field}": getattr(samples, field)
        for name, samples in zip(found.preconditions.names, found.samples, strict=True)
        for field in samples.__dataclass_fields__
    }
    save_arrays(out / "samples.npz", arrays, schema="precondition_samples", version=1)
    for name, table in (("scores", scores), ("calibration", calibration), ("accuracy", curve)):
        with atomic(out / f"{name}.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.6g")
    with atomic(out / "preconditions.png") as temporary:
        temporary.write_bytes(picture)
    keys = scores["skill"] + "/" + scores["metric"]
    named = {key: finite(value) for key, value in zip(keys.tolist(), scores["value"].tolist(), strict=True)}
    facts: dict[str, Any] = {
        "trajectories": found.trajectories,
        "successful": found.successful,
        "samples": total,
        "nominal": dict(zip(found.preconditions.names, found.preconditions.nominal.tolist(), strict=True)),
        "scores": named,
    }
    save_json(out / "summary.json", facts, schema="preconditions_summary", version=1)
    track.metrics({key: value for key, value in named.items() if value is not None})
    track.metrics({"samples": total, "seconds": took})
    track.artifact(out / "preconditions.png")


if __name__ == "__main__":
    run()
