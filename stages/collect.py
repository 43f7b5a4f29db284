"""Stage `collect`: Algorithm 1 in a domain's abstract simulation."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import load_json
from p2l.domains.table import make_domain
from p2l.evaluation.transfer.collected import collection_report
from p2l.schema import CollectConfig
from p2l.tracking import Tracker
from p2l.transfer.collection import collect
from stages._archive import make_or_restore
from stages._progress import bar
from stages._stage import stage

VERSION = 1  # raise it when an edit of the code collects other successes: committed records know no code
FILES = ("transfer_data.npz", "strategy.png", "summary.json")


@stage("collect", CollectConfig)
def run(cfg: CollectConfig, out: Path, track: Tracker) -> None:
    """Learn skills, try every skill on every task, and say whether the skills need the walls."""
    make_or_restore("collect", VERSION, cfg, out, FILES, lambda: _collect(cfg, out))
    track.artifact(out / "strategy.png")
    summary = load_json(out / "summary.json", schema="collect_summary", version=1)
    track.metrics({key: value["mean"] for key, value in summary.items() if isinstance(value, dict)})


def _collect(cfg: CollectConfig, out: Path) -> None:
    domain = make_domain(cfg.domain.key, cfg.domain.params)
    with bar(f"collect {domain.name}") as show:
        collection = collect(
            domain, n_tasks=cfg.n_tasks, n_taught=cfg.n_taught, draws=cfg.draws, seed=cfg.seed, progress=show
        )
    collection_report(out, domain.name, collection)


if __name__ == "__main__":
    run()
