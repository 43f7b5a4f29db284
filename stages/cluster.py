"""Stage `cluster`: group failures into modes, draw them, and film a typical member of each (thesis, section 4.3.1)."""

from __future__ import annotations

import time
from pathlib import Path

from p2l.artifacts import load_json, save_arrays, save_json
from p2l.evaluation.failures.figures import mode_figure
from p2l.evaluation.failures.tables import cluster_summary, mode_table
from p2l.evaluation.sheets import save_sheets
from p2l.evaluation.video.failures import film, skip
from p2l.evaluation.video.player import VideoOptions
from p2l.failures.classifier import save_modes
from p2l.failures.clustering import ClusterOptions
from p2l.failures.discovery import replay
from p2l.failures.grouping import group_failures
from p2l.failures.record import check_pair, check_params, load_failures, open_world
from p2l.schema import ClusterConfig
from p2l.seeding import entropy
from p2l.tracking import Tracker
from stages._archive import archive_of
from stages._bridge import fields_of
from stages._stage import stage

VERSION = 1  # raise it when an edit of the code groups otherwise: committed records know no code
FILES = ("modes.npz", "labels.npz", "modes.csv", "modes.png", "summary.json")


@stage("cluster", ClusterConfig)
def run(cfg: ClusterConfig, out: Path, track: Tracker) -> None:
    """Write modes.npz, labels.npz, modes.csv, modes.png, summary.json and videos/."""
    train = load_failures(cfg.failures, "train")
    check_params(train, cfg.world.key, cfg.world.params, cfg.failures)
    world, nominal = open_world(train, cfg.failures)
    archive = archive_of("cluster", VERSION, cfg, FILES)
    if not archive.restore(out):
        begin = time.perf_counter()
        _group(cfg, out)
        archive.keep(out, seconds=time.perf_counter() - begin)
    facts = load_json(out / "summary.json", schema="cluster_summary", version=1)
    modes = facts["modes"]
    probability = sum(mode["probability"] * mode["size"] for mode in modes) / facts["failures"]
    track.metrics({"failures": facts["failures"], "modes": len(modes), "probability": probability})
    track.metrics({f"weight/{mode['mode']}": mode["weight"] for mode in modes})
    if cfg.videos:
        members = train.take([mode["typical"] for mode in modes])
        names, ways = [f"mode_{number}" for number in range(len(modes))], replay(world, nominal, members)
        film(out / "videos", names, world, members, ways, VideoOptions(**cfg.video.model_dump()))
    else:
        skip(out / "videos", "videos=false")
    for path in [out / "modes.png", out / "modes.csv", *sorted((out / "videos").glob("*.mp4"))]:
        track.artifact(path)


def _group(cfg: ClusterConfig, out: Path) -> None:
    """Fit the modes and write the files."""
    train, held_out = load_failures(cfg.failures, "train"), load_failures(cfg.held_out, "held_out")
    check_pair(train, held_out, cfg.held_out)
    world, _ = open_world(train, cfg.failures)
    options = ClusterOptions(**fields_of(cfg, ClusterOptions) | {"modes": getattr(cfg.modes, train.origin.strategy)})
    seed = entropy(cfg.seed, "cluster", world.name) % 2**32
    groups = group_failures(world, train, held_out, options, seed, cfg.preconditions)
    clustering, train = groups.clustering, groups.train
    modes = mode_table(clustering, train, groups.held_out_mode, groups.members)
    modes = modes.assign(typical=groups.train_index[groups.members])
    title = f"{cfg.item}: {len(train)} failures in {len(modes)} modes ({train.origin.strategy.replace('_', ' ')})"
    figure = mode_figure(clustering, train, modes, title)
    save_modes(out / "modes.npz", clustering.modes)
    save_arrays(out / "labels.npz", groups.labels(), schema="failure_labels", version=1)
    save_sheets(out, {"modes": modes}, {"modes": figure})
    facts = cluster_summary(clustering, train, groups.held_out, modes)
    save_json(out / "summary.json", facts, schema="cluster_summary", version=1)


if __name__ == "__main__":
    run()
