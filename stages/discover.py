"""Stage `discover`: run the nominal skills under uncertainty, and keep their failures (thesis, section 4.3.1)."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from p2l.artifacts import save_json
from p2l.evaluation.failures.tables import found_metrics, found_summary
from p2l.failures.discovery import discover
from p2l.failures.record import SPLITS, STRANDED, Origin, save_failures
from p2l.failures.strategy import ESTIMATORS
from p2l.registry import get_options, get_world
from p2l.schema import DiscoverConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from stages._progress import counter
from stages._stage import stage

log = logging.getLogger(__name__)


@stage("discover", DiscoverConfig)
def run(cfg: DiscoverConfig, out: Path, track: Tracker) -> None:
    """Find training and held-out failures from seeds of their own, and say how often the nominal skills succeed."""
    name, params = cfg.world.name, dict(cfg.world.params)
    if estimator := cfg.estimator or ESTIMATORS[cfg.strategy]:
        params["estimator"] = estimator
    world = get_world(name, params)
    options = get_options(name, world)
    known = (tuple(option.name for option in options), (*world.failure_kinds, STRANDED))
    summary: dict[str, Any] = {"strategy": cfg.strategy, "estimator": world.estimator.mode}
    took, steps = 0.0, 0
    for split in SPLITS:
        count = getattr(cfg.executions, split)
        starts = world.sample(generator(cfg.seed, "discover", name, split), count)
        origin = Origin(name, params, world.digest, cfg.strategy, split, cfg.seed, count, cfg.max_options, *known)
        with counter(f"discover {cfg.item} {split}", " episodes", count) as show:
            begun = time.perf_counter()
            found = discover(world, options, starts, origin, slots=cfg.slots, progress=show)
            took += time.perf_counter() - begun
        save_failures(out / f"failures_{split}.npz", found.failures)
        summary[split] = found_summary(found)
        steps += summary[split]["control_steps"]
        if diverged := summary[split]["diverged"]:
            log.warning("%s %s: the simulation of %d of %d episodes broke down; left out", name, split, diverged, count)
    total = sum(summary[split]["executions"] for split in SPLITS)
    summary |= {"episodes_per_s": total / took, "control_steps_per_s": steps / took}
    save_json(out / "summary.json", summary, schema="discover_summary", version=1)
    track.metrics(found_metrics(summary))


if __name__ == "__main__":
    run()
