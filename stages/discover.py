"""Stage `discover`: run the nominal skills under uncertainty, and keep their failures (thesis, section 4.3.1)."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from p2l.artifacts import load_json, save_json
from p2l.contracts.world import World
from p2l.evaluation.failures.tables import discovery_metrics, split_summary
from p2l.failures.discovery import discover
from p2l.failures.record import SPLITS, STRANDED, Origin, save_failures
from p2l.failures.strategy import ESTIMATORS
from p2l.schema import DiscoverConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._archive import archive_of
from stages._bridge import tell_times
from stages._progress import counter
from stages._stage import stage

log = logging.getLogger(__name__)
VERSION = 1  # raise it when an edit of the code finds other failures: committed records know no code
FILES = (*(f"failures_{split}.npz" for split in SPLITS), "summary.json")


@stage("discover", DiscoverConfig)
def run(cfg: DiscoverConfig, out: Path, track: Tracker) -> None:
    """Find training and held-out failures from seeds of their own, and say how often the nominal skills succeed."""
    params = dict(cfg.world.params)
    if estimator := cfg.estimator or ESTIMATORS[cfg.strategy]:
        params["estimator"] = estimator
    world = make_world(cfg.world.key, params)
    archive = archive_of("discover", VERSION, cfg, FILES, world.digest)
    if not archive.restore(out):
        archive.keep(out, seconds=_discover(cfg, world, params, out, track))
    track.metrics(discovery_metrics(load_json(out / "summary.json", schema="discover_summary", version=1)))


def _discover(cfg: DiscoverConfig, world: World, params: dict[str, Any], out: Path, track: Tracker) -> float:
    """Run all episodes and write the files; wall seconds."""
    name = cfg.world.name
    options = world.nominal_options()
    names = (tuple(option.name for option in options), (*world.failure_kinds, STRANDED))
    summary: dict[str, Any] = {"strategy": cfg.strategy, "estimator": world.estimator.mode}
    spent_s = 0.0
    for split in SPLITS:
        count = getattr(cfg.executions, split)
        starts = world.sample(generator(cfg.seed, "discover", name, split), count)
        key = cfg.world.key
        origin = Origin(key, params, world.digest, cfg.strategy, split, cfg.seed, count, cfg.max_options, *names)
        with counter(f"discover {cfg.item} {split}", " episodes", count) as show:
            begin = time.perf_counter()
            discovery = discover(world, options, starts, origin, slots=cfg.slots, progress=show)
            spent_s += time.perf_counter() - begin
        save_failures(out / f"failures_{split}.npz", discovery.failures)
        summary[split] = split_summary(discovery)
        if diverged := summary[split]["diverged"]:
            log.warning("%s %s: the simulation of %d of %d episodes broke down; left out", name, split, diverged, count)
    save_json(out / "summary.json", summary, schema="discover_summary", version=1)
    totals = {key: sum(summary[split][key] for split in SPLITS) for key in ("executions", "control_steps")}
    rates = {"episodes_per_s": totals["executions"] / spent_s, "control_steps_per_s": totals["control_steps"] / spent_s}
    tell_times(track, out, {"seconds": spent_s, **rates})
    return spent_s


if __name__ == "__main__":
    run()
