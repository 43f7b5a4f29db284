"""Chapters 4 and 5: how often the nominal skills succeed on their own, and how they fail."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import pandas as pd

from p2l.evaluation.failures.tables import rate
from p2l.evaluation.page.page import Agreement, Films, Part, Picture, Reading, Section, Sheet
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, stage_commands
from p2l.evaluation.rows import table_of
from p2l.evaluation.thesis import Thesis

CHAPTERS = (4, 5)
NEAR = 0.05  # a success rate this near the thesis's counts as reproduced
ITEM = "nominal"
JUDGED = (
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
    found = {world: sources.discovered(world) for world in sources.worlds}
    theses = [sources.chapter(number) for number in CHAPTERS]
    table = _beside(pd.DataFrame([row for world in found for row in _rows(world, found[world])]), theses)
    success = {row["setting"]: row for row in table.to_dict("records") if row["metric"] == "success"}
    parts: list[Part] = [JUDGED]
    for world, told in found.items():
        for thesis in theses:
            parts += _readings(world, success[f"world={world}"], told, thesis)
    rows = [_shown(world, found[world], success[f"world={world}"]) for world in found]
    head = ["", "discovery", "success", "thesis", "executions", "failures", "diverged", "kinds of failure"]
    parts.append(Sheet("nominal", table, head, rows, "Success with 95 % Wilson interval."))
    numbers = {f"nominal/{world}/success": float(success[f"world={world}"]["mean"]) for world in found}
    return Section(title, parts, stage_commands("discover", sources.worlds), numbers)


def modes(sources: Sources) -> Section:
    """The failure modes of every world: figure, table, and a typical member of each on video."""
    title = "Failure modes (section 4.3.1)"
    if not sources.worlds:
        return _missing(title)
    found = {world: sources.clustered(world) for world in sources.worlds}
    theses = [sources.chapter(number) for number in CHAPTERS]
    table = _beside(pd.DataFrame([row for world in found for row in _mode_rows(world, found[world])]), theses, "modes")
    parts: list[Part] = []
    for world, told in found.items():
        caption = f"{world}: {told['failures']} training failures; features by how well they tell the modes apart."
        parts += [_of_modes(thesis, world, told) for thesis in theses if ("modes", world) in thesis.claims]
        parts.append(Picture(f"modes_{world}", sources.image("cluster", world, "modes.png"), caption))
        parts.append(_films(sources, world))
    rows = [
        [world, str(mode["mode"]), str(mode["size"]), f"{mode['weight']:.2f}", str(mode["held_out"]), *_mostly(mode)]
        for world, told in found.items()
        for mode in told["modes"]
    ]
    head = ["", "mode", "size", "weight", "held out", "kinds", "skills that failed"]
    parts.append(Sheet("failure_modes", table, head, rows, "Size: training failures; weight: their share."))
    numbers = {f"failure_modes/{world}": float(len(told["modes"])) for world, told in found.items()}
    return Section(title, parts, stage_commands("cluster", sources.worlds), numbers)


def _of_modes(thesis: Thesis, world: str, told: dict[str, Any]) -> Reading:
    executions, failures, number = told["executions"], told["failures"], len(told["modes"])
    ours = f"{world}: {executions} executions leave {failures} failure states, grouped into {number} modes."
    return Reading(thesis.claims["modes", world], ours)


def _films(sources: Sources, world: str) -> Part:
    """A typical member of each mode, or why there is no video."""
    films, skipped = sources.videos(world)
    if skipped:
        return f"{world}: {skipped}"
    shown = []
    for number, (one, mp4) in enumerate(films):
        what = f"{one['kind']} in {one['option']}, {one['time_s']:.1f} s".replace("_", " ")
        shown.append((f"{world} mode {number}", mp4, f"Mode {number}, a typical member: {what}"))
    return Films(shown)


def _missing(title: str) -> Section:
    return Section(title, ["Left out: conf/pipeline.yaml runs no worlds. Add them there."])


def _total(told: dict[str, Any], key: str) -> int:
    return int(sum(told[split][key] for split in ("train", "held_out")))


def _rows(world: str, told: dict[str, Any]) -> list[dict[str, Any]]:
    """Long rows of a world: both splits together."""
    trials = sum(told[split]["success"]["trials"] for split in ("train", "held_out"))
    sound = [told[split]["success"] for split in ("train", "held_out") if told[split]["success"]["trials"]]
    success = rate(sum(round(part["mean"] * part["trials"]) for part in sound), trials)
    failures, kinds = _total(told, "failures"), _kinds(told)
    first = {"method": told["strategy"], "setting": f"world={world}", "low": math.nan, "high": math.nan}
    measured = {key: math.nan if success[key] is None else success[key] for key in ("mean", "low", "high")}
    rows = [{**first, "metric": "success", "n": trials, **measured}]
    rows.append({**first, "metric": "failures_per_execution", "mean": failures / max(trials, 1), "n": trials})
    return rows + [
        {**first, "metric": f"first_failure/{kind}", "mean": count / kinds.total(), "n": kinds.total()}
        for kind, count in kinds.most_common()
    ]


def _kinds(told: dict[str, Any]) -> Counter[str]:
    """Failing episodes of both splits by the kind of their first failure."""
    return Counter(told["train"]["first_kind"]) + Counter(told["held_out"]["first_kind"])


def _mode_rows(world: str, told: dict[str, Any]) -> list[dict[str, Any]]:
    first = {"method": told["strategy"], "low": math.nan, "high": math.nan, "n": told["failures"]}
    rows = [{**first, "setting": f"world={world}", "metric": "modes", "mean": float(len(told["modes"]))}]
    for mode in told["modes"]:
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
    known = [thesis.beside(columns, item)["thesis"] for thesis in theses]
    return columns.assign(thesis=known[0].combine_first(known[1]))


def _readings(world: str, success: Mapping[Any, Any], told: dict[str, Any], thesis: Thesis) -> list[Reading]:
    """What the thesis says of a world's nominal skills beside what ours do."""
    made = []
    if (claim := thesis.claims.get((ITEM, world))) is not None:
        mean, low, high, known = (float(success[name]) for name in ("mean", "low", "high", "thesis"))
        ours = f"{world}: {100 * mean:.1f} % [{100 * low:.1f}, {100 * high:.1f}]."
        made.append(Reading(claim, ours, _near(mean, low, high, known)))
    if (claim := thesis.claims.get((ITEM, f"{world}_kinds"))) is not None:
        kinds = _kinds(told)
        made.append(Reading(claim, f"{world}: {_spoken_shares(kinds)} of {kinds.total()} failing executions."))
    return made


def _near(mean: float, low: float, high: float, known: float) -> Agreement:
    """Whether a rate is that of the thesis, give or take `NEAR`; in part if only its interval reaches so far."""
    if math.isnan(known) or math.isnan(mean):
        return "unsaid"
    return "yes" if abs(mean - known) <= NEAR else "partly" if low - NEAR <= known <= high + NEAR else "no"


def _spoken_shares(kinds: Counter[str]) -> str:
    total = max(kinds.total(), 1)
    return ", ".join(f"{kind.replace('_', ' ')} {count / total:.0%}" for kind, count in kinds.most_common()) or "none"


def _shown(world: str, told: dict[str, Any], success: Mapping[Any, Any]) -> list[str]:
    mean, low, high = (100 * float(success[name]) for name in ("mean", "low", "high"))
    known = float(success["thesis"])
    counts = [str(_total(told, key)) for key in ("executions", "failures", "diverged")]
    beside = "–" if math.isnan(known) else f"{100 * known:.1f} %"
    ours, shares = f"{estimate(mean, low, high, digits=1)} %", _spoken_shares(_kinds(told))
    return [world, told["strategy"].replace("_", " "), ours, beside, *counts, shares]


def _mostly(mode: dict[str, Any]) -> list[str]:
    """Kinds and options of a mode, the largest share first."""
    told = []
    for start in ("kind:", "option:"):
        shares = {name.removeprefix(start): value for name, value in mode.items() if name.startswith(start) and value}
        ranked = sorted(shares.items(), key=lambda share: -share[1])
        told.append(", ".join(f"{name.replace('_', ' ')} {share:.0%}" for name, share in ranked))
    return told
