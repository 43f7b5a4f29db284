"""Stage `fit_preconditions`: where may each nominal skill be started? Precondition chaining (thesis, Algorithm 2)."""

from __future__ import annotations

import logging
import time
from functools import partial
from pathlib import Path

from p2l.artifacts import load_json
from p2l.contracts.world import World, symbols_of
from p2l.evaluation.metareskill.preconditions import precondition_report
from p2l.preconditions.backwards import ChainingOptions, chain_preconditions
from p2l.preconditions.vicinity import Vicinity
from p2l.schema import FitPreconditionsConfig
from p2l.skills.relative import Timing
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._archive import make_or_restore
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
    make_or_restore("fit_preconditions", VERSION, cfg, out, FILES, partial(_fit, cfg, world, out, track), world.digest)
    facts = load_json(out / "summary.json", schema="preconditions_summary", version=1)
    track.metrics({name: value for name, value in facts["scores"].items() if value is not None})
    track.metrics({"samples": facts["samples"]})
    track.artifact(out / "preconditions.png")


def _fit(cfg: FitPreconditionsConfig, world: World, out: Path, track: Tracker) -> None:
    nominal, symbols = world.nominal_options(), symbols_of(world)
    parts = {"vicinity": Vicinity(**cfg.vicinity.model_dump()), "timing": Timing(**cfg.timing.model_dump())}
    options = ChainingOptions(**fields_of(cfg, ChainingOptions) | parts)
    begin = time.perf_counter()
    with counter(f"preconditions {cfg.item}", "skill", len(nominal)) as show:
        chaining = chain_preconditions(world, symbols, nominal, options, cfg.seed, show)
    tell_times(track, out, {"seconds": time.perf_counter() - begin})
    log.info("%s: %d of %d nominal executions succeed", world.name, chaining.successful, chaining.trajectories)
    precondition_report(out, cfg.item, chaining, options, cfg.counts, cfg.seed)


if __name__ == "__main__":
    run()
