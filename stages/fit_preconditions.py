"""Stage `fit_preconditions`: where may each nominal skill be started? Precondition chaining (thesis, Algorithm 2)."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from p2l.artifacts import load_json, save_arrays, save_json
from p2l.contracts.world import World, symbols_of
from p2l.evaluation.metareskill import preconditions as quality
from p2l.evaluation.sheets import save_sheets
from p2l.preconditions.backwards import ChainingOptions, chain_preconditions
from p2l.preconditions.record import save_preconditions
from p2l.preconditions.vicinity import Vicinity
from p2l.schema import FitPreconditionsConfig
from p2l.skills.relative import Timing
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._archive import archive_of
from stages._bridge import fields_of, tell_times
from stages._progress import counter
from stages._stage import stage

log = logging.getLogger(__name__)
VERSION = 1  # raise it when an edit of the code fits other preconditions: committed records know no code
TABLES = ("scores", "calibration", "accuracy")
FILES = ("preconditions.npz", "samples.npz", *(f"{name}.csv" for name in TABLES), "preconditions.png", "summary.json")


@stage("fit_preconditions", FitPreconditionsConfig)
def run(cfg: FitPreconditionsConfig, out: Path, track: Tracker) -> None:
    """Write the preconditions and their samples, what is known of their quality as CSV and figure, and a summary."""
    world = make_world(cfg.world.key, {**cfg.world.params, "estimator": "fixed"})
    archive = archive_of("fit_preconditions", VERSION, cfg, FILES, world.digest)
    if not archive.restore(out):
        archive.keep(out, seconds=_fit(cfg, world, out, track))
    facts = load_json(out / "summary.json", schema="preconditions_summary", version=1)
    track.metrics({name: value for name, value in facts["scores"].items() if value is not None})
    track.metrics({"samples": facts["samples"]})
    track.artifact(out / "preconditions.png")


def _fit(cfg: FitPreconditionsConfig, world: World, out: Path, track: Tracker) -> float:
    """Execute, fit and write the files; wall seconds of executing and fitting."""
    nominal, symbols = world.nominal_options(), symbols_of(world)
    parts = {"vicinity": Vicinity(**cfg.vicinity.model_dump()), "timing": Timing(**cfg.timing.model_dump())}
    options = ChainingOptions(**fields_of(cfg, ChainingOptions) | parts)
    begin = time.perf_counter()
    with counter(f"preconditions {cfg.item}", "skill", len(nominal)) as show:
        chaining = chain_preconditions(world, symbols, nominal, options, cfg.seed, show)
    seconds = time.perf_counter() - begin
    tell_times(track, out, {"seconds": seconds})
    log.info("%s: %d of %d nominal executions succeed", world.name, chaining.successful, chaining.trajectories)
    tables = {
        "scores": quality.score_table(chaining),
        "calibration": quality.calibration_table(chaining),
        "accuracy": quality.sample_curve(chaining, options, cfg.counts, cfg.seed),
    }
    facts = quality.summary(chaining, tables["scores"])
    title = f"{cfg.item}: preconditions from {facts['samples']} samples"
    figure = quality.precondition_figure(tables["scores"], tables["calibration"], tables["accuracy"], title)
    save_preconditions(out / "preconditions.npz", chaining.preconditions)
    save_arrays(out / "samples.npz", chaining.sample_arrays(), schema="precondition_samples", version=1)
    save_sheets(out, tables, {"preconditions": figure})
    save_json(out / "summary.json", facts, schema="preconditions_summary", version=1)
    return seconds


if __name__ == "__main__":
    run()
