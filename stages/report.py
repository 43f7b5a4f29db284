"""Stage `report`: every table and figure of the thesis beside ours, in one self-contained page."""

from __future__ import annotations

from pathlib import Path

from p2l.evaluation.page.files import headline, save_report
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.report import SECTIONS
from p2l.schema import ReportConfig
from p2l.tracking import Tracker
from stages._progress import bar
from stages._stage import stage

TITLE = "Plan to Learn: the thesis's tables and figures, and ours"

ABOUT = (
    (
        "Everything here, the sentences too, is computed from the pipeline's outputs: dvc repro makes it anew. Below "
        "each section stand the commands of its numbers, to be run in order from the repository's root."
    ),
    (
        "Costs are in the thesis's units of effort. Executed costs come from running the plans in simulation, "
        "predicted ones are what the planner expected."
    ),
)


@stage("report", ReportConfig)
def run(cfg: ReportConfig, out: Path, track: Tracker) -> None:
    """Make every section, then write the page, its tables and figures, and the headline numbers."""
    worlds = (cfg.worlds, cfg.recovery_worlds, cfg.chain_worlds)
    sources = Sources(cfg.data, cfg.thesis, cfg.domains, *worlds, cfg.results)
    sections = []
    with bar("report") as show:
        for done, make in enumerate(SECTIONS, start=1):
            sections.append(make(sources))
            show(done, len(SECTIONS))
    items = f"domains: {', '.join(cfg.domains)}; worlds: {', '.join(cfg.worlds) or 'none'}"
    save_report(out, TITLE, [f"Preset {cfg.preset}, seed {cfg.seed}; {items}.", *ABOUT], sections)
    track.metrics(headline(sections))
    track.artifact(out / "index.html")
    for folder in ("tables", "figures"):
        for path in sorted((out / folder).iterdir()):
            track.artifact(path, folder)


if __name__ == "__main__":
    run()
