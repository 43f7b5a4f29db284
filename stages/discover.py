"""Stage `discover`: run the nominal skills under uncertainty, and keep their failures (thesis, section 4.3.1)."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

from p2l.artifacts import load_json, save_json
from p2l.contracts.world import World
from p2l.evaluation.failures.tables import discovery_line, discovery_metrics, discovery_times, split_summary
from p2l.failures.discovery import find_failures
from p2l.failures.record import SPLITS, STRANDED, Origin, save_failures
from p2l.failures.strategy import ESTIMATORS
from p2l.schema import DiscoverConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from p2l.worlds.table import make_world
from stages._archive import make_or_restore
from stages._bridge import tell_times
from stages._progress import counter
from stages._stage import stage

VERSION = 1  # raise it when an edit of the code finds other failures: committed records know no code
FILES = (*(f"failures_{split}.npz" for split in SPLITS), "summary.json")


@stage("discover", DiscoverConfig)
def run(cfg: DiscoverConfig, out: Path, track: Tracker) -> None:
    """Find training and held-out failures from seeds of their own, and say how often the nominal skills succeed."""
    estimator = cfg.estimator or ESTIMATORS[cfg.strategy]
    params = cfg.world.params | ({"estimator": estimator} if estimator else {})
    world = make_world(cfg.world.key, params)
    make = partial(_discover, cfg, world, params, out, track)
    make_or_restore("discover", VERSION, cfg, out, FILES, make, world.digest)
    summary = load_json(out / "summary.json", schema="discover_summary", version=1)
    track.metrics(discovery_metrics(summary))
    print(f"discover {cfg.item}: {discovery_line(summary)}")


def _discover(cfg: DiscoverConfig, world: World, params: dict[str, Any], out: Path, track: Tracker) -> None:
    options, name, begin = world.nominal_options(), cfg.world.name, time.perf_counter()
    names = tuple(option.name for option in options), (*world.failure_kinds, STRANDED)
    summary: dict[str, Any] = {"strategy": cfg.strategy, "estimator": world.estimator.mode}
    for split in SPLITS:
        count = getattr(cfg.executions, split)
        starts = world.sample(generator(cfg.seed, "discover", name, split), count)
        facts = cfg.world.key, params, world.digest, cfg.strategy, split, cfg.seed, count, cfg.max_options, *names
        with counter(f"discover {cfg.item} {split}", " episodes", count) as show:
            discovery = find_failures(world, options, starts, Origin(*facts), slots=cfg.slots, progress=show)
        save_failures(out / f"failures_{split}.npz", discovery.failures)
        summary[split] = split_summary(discovery)
    save_json(out / "summary.json", summary, schema="discover_summary", version=1)
    tell_times(track, out, discovery_times(summary, time.perf_counter() - begin))


if __name__ == "__main__":
    run()
