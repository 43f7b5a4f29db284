"""Stage `cluster`: group failures into modes, draw them, and film a typical member of each (thesis, section 4.3.1)."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from p2l.artifacts import atomic, save_arrays, save_json
from p2l.contracts.world import World
from p2l.evaluation.failures.figures import mode_figure
from p2l.evaluation.failures.tables import cluster_summary, mode_table
from p2l.evaluation.style import png
from p2l.evaluation.video.failures import film, skip
from p2l.evaluation.video.player import VideoOptions
from p2l.failures.classifier import save_modes
from p2l.failures.clustering import ClusterOptions, cluster, typical
from p2l.failures.lost import lost
from p2l.failures.record import Failures, check_pair, check_params, load_failures, open_world
from p2l.preconditions.record import load_preconditions
from p2l.records import IntArray
from p2l.registry import get_symbols
from p2l.schema import ClusterConfig
from p2l.seeding import entropy
from p2l.tracking import Tracker
from stages._stage import stage

log = logging.getLogger(__name__)


@stage("cluster", ClusterConfig)
def run(cfg: ClusterConfig, out: Path, track: Tracker) -> None:
    """Write modes.npz, labels.npz, modes.csv, modes.png, summary.json and videos/."""
    every = load_failures(cfg.failures, "train"), load_failures(cfg.held_out, "held_out")
    check_params(every[0], cfg.world.name, cfg.world.params, cfg.failures)
    check_pair(*every, cfg.held_out)
    world, options = open_world(every[0], cfg.failures)
    where = [_grouped(cfg, world, failures) for failures in every]
    train, held_out = (failures.take(index) for failures, index in zip(every, where, strict=True))
    shared = {name: getattr(cfg, name) for name in ("max_modes", "covariance", "regularisation", "restarts")}
    wanted = ClusterOptions(modes=getattr(cfg.modes, train.origin.strategy), **shared)
    found = cluster(world, train, wanted, entropy(cfg.seed, "cluster", world.name) % 2**32)
    members = typical(found, train)
    mode, probability = found.modes.classify(held_out.truth)
    table = mode_table(found, train, mode, members).assign(typical=where[0][members])
    title = f"{cfg.item}: {len(train)} failures in {len(table)} modes ({train.origin.strategy.replace('_', ' ')})"
    picture = png(mode_figure(found, train, table, title))

    save_modes(out / "modes.npz", found.modes)
    labels = {"train": found.mode, "train_probability": found.probability, "train_index": where[0]}
    labels |= {"held_out": mode, "held_out_probability": probability, "held_out_index": where[1]}
    save_arrays(out / "labels.npz", labels, schema="failure_labels", version=1)
    with atomic(out / "modes.csv") as temporary:
        table.to_csv(temporary, index=False, float_format="%.6g")
    with atomic(out / "modes.png") as temporary:
        temporary.write_bytes(picture)
    facts = cluster_summary(found, train, held_out, table)
    save_json(out / "summary.json", facts, schema="cluster_summary", version=1)
    track.metrics({"failures": len(train), "modes": len(table), "probability": float(found.probability.mean())})
    track.metrics({f"weight/{number}": weight for number, weight in enumerate(table["weight"])})
    if cfg.videos:
        names = [f"mode_{number}" for number in range(len(table))]
        film(out / "videos", names, world, options, train.take(members), VideoOptions(**cfg.video.model_dump()))
    else:
        skip(out / "videos", "videos=false")
    for path in [out / "modes.png", out / "modes.csv", *sorted((out / "videos").glob("*.mp4"))]:
        track.artifact(path)


def _grouped(cfg: ClusterConfig, world: World, failures: Failures) -> IntArray:
    """Index of the failures to group."""
    if cfg.preconditions is None:
        return np.arange(len(failures))
    learnt = load_preconditions(cfg.preconditions, world)
    where = lost(world, get_symbols(world.name, world), learnt, failures)
    log.info("%s: in %d of %d failures no learnt precondition holds", failures.origin.split, len(where), len(failures))
    return where


if __name__ == "__main__":
    run()
