"""Stage `cluster`: group failures into modes, draw them, and film a typical member of each (thesis, section 4.3.1)."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import load_json
from p2l.contracts.world import World
from p2l.evaluation.failures.report import grouping_metrics, grouping_report
from p2l.evaluation.video.failures import film, skip
from p2l.evaluation.video.player import VideoOptions
from p2l.failures.clustering import ClusterOptions
from p2l.failures.discovery import replay
from p2l.failures.grouping import group_failures
from p2l.failures.record import Failures, check_pair, check_params, load_failures, open_world
from p2l.schema import ClusterConfig
from p2l.seeding import entropy
from p2l.tracking import Tracker
from stages._archive import make_or_restore
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
    make_or_restore("cluster", VERSION, cfg, out, FILES, lambda: _group(cfg, world, train, out))
    facts = load_json(out / "summary.json", schema="cluster_summary", version=1)
    track.metrics(grouping_metrics(facts))
    if cfg.videos:
        members = train.take([mode["typical"] for mode in facts["modes"]])
        names, ways = [f"mode_{number}" for number in range(len(members))], replay(world, nominal, members)
        film(out / "videos", names, world, members, ways, VideoOptions(**cfg.video.model_dump()))
    else:
        skip(out / "videos", "videos=false")
    for path in [out / "modes.png", out / "modes.csv", *sorted((out / "videos").glob("*.mp4"))]:
        track.artifact(path)


def _group(cfg: ClusterConfig, world: World, train: Failures, out: Path) -> None:
    held_out = load_failures(cfg.held_out, "held_out")
    check_pair(train, held_out, cfg.held_out)
    options = ClusterOptions(**fields_of(cfg, ClusterOptions) | {"modes": getattr(cfg.modes, train.origin.strategy)})
    seed = entropy(cfg.seed, "cluster", world.name) % 2**32
    grouping_report(out, cfg.item, group_failures(world, train, held_out, options, seed, cfg.preconditions))


if __name__ == "__main__":
    run()
