"""Sections of chapters 4 and 5: success rates of the nominal skills, their kinds of failure, and failure modes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import pandas as pd

from p2l.evaluation.failures.tables import rate
from p2l.evaluation.page.page import Agreement, Films, PageTable, Part, Picture, Reading, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, stage_commands
from p2l.evaluation.rows import table_of
from p2l.evaluation.thesis import Thesis

CHAPTERS = (4, 5)
NEAR = 0.05  # a success rate this near the thesis's counts as reproduced
ITEM = "nominal"
PROTOCOL = (
    "Every execution counts, those of training and those held out. Pessimistic discovery runs the chain open loop to "
    "its end; where failures are flagged, the first flag ends an execution, and it has failed. A state counts as "
    "stranded if no detector spoke, no nominal skill's precondition holds and the task is not done. An execution's "
    "kind of failure is that of its first one."
)


def nominal_skills(sources: Sources) -> Section:
    """Success of the nominal chains beside the thesis's, and the kinds of their failures."""
    title = "Nominal skills: how often they succeed, and how they fail (chapters 4 and 5)"
    if not sources.worlds:
        return _missing(title)
    summaries = {world: sources.discovery(world) for world in sources.worlds}
    theses = [sources.chapter(number) for number in CHAPTERS]
    long = [row for world in summaries for row in _rows(world, summaries[world])]
    table = _beside(pd.DataFrame(long), theses)
    success = {row["setting"]: row for row in table.to_dict("records") if row["metric"] == "success"}
    parts: list[Part] = [PROTOCOL]
    for world, summary in summaries.items():
        for thesis in theses:
            parts += _readings(world, success[f"world={world}"], summary, thesis)
    rows = [_page_row(world, summaries[world], success[f"world={world}"]) for world in summaries]
    head = ["", "discovery", "success", "thesis", "executions", "failures", "diverged", "kinds of failure"]
    parts.append(PageTable("nominal", table, head, rows, "Success with 95 % Wilson interval."))
    numbers = {f"nominal/{world}/success": float(success[f"world={world}"]["mean"]) for world in summaries}
    return Section(title, parts, stage_commands("discover", sources.worlds), numbers)


def modes(sources: Sources) -> Section:
    """The failure modes of every world: figure, table, and a typical member of each on video."""
    title = "Failure modes (section 4.3.1)"
    if not sources.worlds:
        return _missing(title)
    summaries = {world: sources.clustering(world) for world in sources.worlds}
    theses = [sources.chapter(number) for number in CHAPTERS]
    long = [row for world in summaries for row in _mode_rows(world, summaries[world])]
    table = _beside(pd.DataFrame(long), theses, "modes")
    parts: list[Part] = []
    for world, summary in summaries.items():
        caption = f"{world}: {summary['failures']} training failures; features by how well they tell the modes apart."
        parts += [_of_modes(thesis, world, summary) for thesis in theses if ("modes", world) in thesis.claims]
        parts.append(Picture(f"modes_{world}", sources.image("cluster", world, "modes.png"), caption))
        parts.append(_films(sources, world))
    rows = [
        [world, str(mode["mode"]), str(mode["size"]), f"{mode['weight']:.2f}", str(mode["held_out"]), *_shares(mode)]
        for world, summary in summaries.items()
        for mode in summary["modes"]
    ]
    head = ["", "mode", "size", "weight", "held out", "kinds", "skills that failed"]
    parts.append(PageTable("failure_modes", table, head, rows, "Size: training failures; weight: their share."))
    numbers = {f"failure_modes/{world}": float(len(summary["modes"])) for world, summary in summaries.items()}
    return Section(title, parts, stage_commands("cluster", sources.worlds), numbers)


def _of_modes(thesis: Thesis, world: str, summary: dict[str, Any]) -> Reading:
    executions, failures, number = summary["executions"], summary["failures"], len(summary["modes"])
    ours = f"{world}: {executions} executions leave {failures} failure states, grouped into {number} modes."
    return Reading(thesis.claims["modes", world], ours)


def _films(sources: Sources, world: str) -> Part:
    """A typical member of each mode, or the reason why there is no video."""
    videos, reason = sources.videos(world)
    if reason:
        return f"{world}: {reason}"
    films = []
    for number, (one, mp4) in enumerate(videos):
        what = f"{one['kind']} in {one['option']}, {one['time_s']:.1f} s".replace("_", " ")
        films.append((f"{world} mode {number}", mp4, f"Mode {number}, a typical member: {what}"))
    return Films(films)


def _missing(title: str) -> Section:
    return Section(title, ["Left out: conf/pipeline.yaml runs no worlds. Add them there."])


def _total(summary: dict[str, Any], key: str) -> int:
    return int(sum(summary[split][key] for split in ("train", "held_out")))


def _rows(world: str, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Long rows of a world: both splits together."""
    trials = sum(summary[split]["success"]["trials"] for split in ("train", "held_out"))
    sound = [summary[split]["success"] for split in ("train", "held_out") if summary[split]["success"]["trials"]]
    success = rate(sum(round(part["mean"] * part["trials"]) for part in sound), trials)
    failures, kinds = _total(summary, "failures"), _kinds(summary)
    first = {"method": summary["strategy"], "setting": f"world={world}", "low": math.nan, "high": math.nan}
    interval = {key: math.nan if success[key] is None else success[key] for key in ("mean", "low", "high")}
    rows = [{**first, "metric": "success", "n": trials, **interval}]
    rows.append({**first, "metric": "failures_per_execution", "mean": failures / max(trials, 1), "n": trials})
    return rows + [
        {**first, "metric": f"first_failure/{kind}", "mean": count / kinds.total(), "n": kinds.total()}
        for kind, count in kinds.most_common()
    ]


def _kinds(summary: dict[str, Any]) -> Counter[str]:
    """Failing episodes of both splits by the kind of their first failure."""
    return Counter(summary["train"]["first_kind"]) + Counter(summary["held_out"]["first_kind"])


def _mode_rows(world: str, summary: dict[str, Any]) -> list[dict[str, Any]]:
    first = {"method": summary["strategy"], "low": math.nan, "high": math.nan, "n": summary["failures"]}
    rows = [{**first, "setting": f"world={world}", "metric": "modes", "mean": float(len(summary["modes"]))}]
    for mode in summary["modes"]:
        setting = f"world={world};mode={mode['mode']}"
        rows += [
            {**first, "setting": setting, "metric": name.replace(":", "/"), "mean": float(value)}
            for name, value in mode.items()
            if name in ("size", "weight", "held_out", "probability") or name.startswith(("kind:", "option:"))
        ]
    return rows


def _beside(table: pd.DataFrame, theses: list[Thesis], item: str = ITEM) -> pd.DataFrame:
    """The table with the thesis's numbers, whichever chapter has them."""
    columns = table_of(table)
    references = [thesis.beside(columns, item)["thesis"] for thesis in theses]
    return columns.assign(thesis=references[0].combine_first(references[1]))


def _readings(world: str, success: Mapping[Any, Any], summary: dict[str, Any], thesis: Thesis) -> list[Reading]:
    """The thesis's claims about a world's nominal skills beside our results."""
    readings = []
    if (claim := thesis.claims.get((ITEM, world))) is not None:
        mean, low, high, reference = (float(success[name]) for name in ("mean", "low", "high", "thesis"))
        ours = f"{world}: {100 * mean:.1f} % [{100 * low:.1f}, {100 * high:.1f}]."
        readings.append(Reading(claim, ours, _near(mean, low, high, reference)))
    if (claim := thesis.claims.get((ITEM, f"{world}_kinds"))) is not None:
        kinds = _kinds(summary)
        readings.append(Reading(claim, f"{world}: {_share_label(kinds)} of {kinds.total()} failing executions."))
    return readings


def _near(mean: float, low: float, high: float, reference: float) -> Agreement:
    """Whether a rate lies within `NEAR` of the thesis's; in part if only its interval does."""
    if math.isnan(reference) or math.isnan(mean):
        return "unsaid"
    if abs(mean - reference) <= NEAR:
        return "yes"
    return "partly" if low - NEAR <= reference <= high + NEAR else "no"


def _share_label(kinds: Counter[str]) -> str:
    total = max(kinds.total(), 1)
    return ", ".join(f"{kind.replace('_', ' ')} {count / total:.0%}" for kind, count in kinds.most_common()) or "none"


def _page_row(world: str, summary: dict[str, Any], success: Mapping[Any, Any]) -> list[str]:
    mean, low, high = (100 * float(success[name]) for name in ("mean", "low", "high"))
    reference = float(success["thesis"])
    counts = [str(_total(summary, key)) for key in ("executions", "failures", "diverged")]
    thesis = "–" if math.isnan(reference) else f"{100 * reference:.1f} %"
    ours, shares = f"{estimate(mean, low, high, digits=1)} %", _share_label(_kinds(summary))
    return [world, summary["strategy"].replace("_", " "), ours, thesis, *counts, shares]


def _shares(mode: dict[str, Any]) -> list[str]:
    """Kinds and options of a mode, the largest share first."""
    labels = []
    for start in ("kind:", "option:"):
        shares = {name.removeprefix(start): value for name, value in mode.items() if name.startswith(start) and value}
        ranking = sorted(shares.items(), key=lambda share: -share[1])
        labels.append(", ".join(f"{name.replace('_', ' ')} {share:.0%}" for name, share in ranking))
    return labels
