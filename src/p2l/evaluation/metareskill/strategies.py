"""Sections of chapter 4: learnt recoveries beside heuristic strategies, how soon, on other doors, choosers compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from p2l.evaluation.metareskill.tables import UNSEEN
from p2l.evaluation.metareskill.within import SKILLS
from p2l.evaluation.metareskill.within import TABLE as WITHIN
from p2l.evaluation.page.page import Agreement, PageTable, Part, Picture, Reading, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, setting_label, stage_commands
from p2l.evaluation.statistics import TRAININGS
from p2l.metareskill.strategy_names import LEARNT, OPEN_LOOP, RECOVERIES

CHAPTER, STAGE = 4, "evaluate_recoveries"
NEAR = 0.05  # a success rate this far below the thesis's still counts as reproduced
IN_PERCENT = ("success", SKILLS, "gain", "recovered", "diverged")
TABLE_METRICS = ("success", "path_m_success", "options", "gain")
CURVE_METRICS = ("final_gain", "budget_share", "better", "trained")
PROTOCOL_4_1 = (
    "Every strategy meets the same start states, none of which training or measuring has seen; the estimate's standard "
    "deviation halves after every skill, and an episode has at most 10. Gains are paired; their 95 % intervals "
    f"resample trainings and, within them, episodes. Else, {TRAININGS}"
)
PROTOCOL_4_2 = (
    "The estimate is exact once the first skill has ended. Recoveries, preconditions and failure modes are those "
    "learnt on the nominal handle; in the rows of robosuite its own Door, controller and test of success are used. "
    "The thesis's rows are 10 to 20 attempts on a real robot."
)
PROTOCOL_WITHIN = (
    "The episodes of table 4.1. A strategy that starts all over needs five skills where a recovery needs four, and a "
    "longer way; success at ten skills does not tell."
)
CAPTION_WITHIN = (
    "share of episodes that have succeeded within so many skills (left), and within so long a way of the hand (right); "
    "bands are 95 % intervals."
)
CURVES = {
    "figure_4_6": "Left: value of failures while recoveries are trained in turn. Right: rounds that each recovery got.",
    "figure_4_7": (
        "Value of failures against queries, on failures that neither training nor choosing has met: mean over seeds, "
        "and a band from the worst to the best."
    ),
}


def table_4_1(sources: Sources) -> Section:
    """Six strategies in simulation."""
    return _section(sources, "Table 4.1: recovery strategies in simulation", PROTOCOL_4_1, "table_4_1", _strategies)


def within(sources: Sources) -> Section:
    """Success against the number of skills, and against the way of the hand."""
    title = "Success within so many skills"
    if not sources.recovery_worlds:
        return _missing(title)
    parts: list[Part] = [PROTOCOL_WITHIN]
    for place, world in enumerate(sources.recovery_worlds):
        table, name = _read(sources, world, WITHIN), _report_name(WITHIN, world, place)
        if not len(table):
            parts.append(f"{world}: left out by its configuration.")
            continue
        parts.append(Picture(name, sources.image(STAGE, world, f"{WITHIN}.png"), f"{world}: {CAPTION_WITHIN}"))
        parts.append(_sheet(name, table, (SKILLS,)))
    return Section(title, parts, stage_commands(STAGE, sources.recovery_worlds))


def table_4_2(sources: Sources) -> Section:
    """Doors that recoveries were not trained on, and robosuite's own."""
    return _section(sources, "Table 4.2: other doors", PROTOCOL_4_2, "table_4_2", _doors)


def curves(sources: Sources) -> Section:
    """Figures 4.6 and 4.7: choosers compared on the same budget."""
    title = "Figures 4.6 and 4.7: which recovery is trained next"
    if not sources.recovery_worlds:
        return _missing(title)
    parts: list[Part] = []
    numbers: dict[str, float] = {}
    for place, world in enumerate(sources.recovery_worlds):
        for item, caption in CURVES.items():
            table, name = _read(sources, world, item), _report_name(item, world, place)
            if item == "figure_4_7":
                parts.append(_comparison(sources, world, table))
                numbers |= {f"{item}/{world}/{key}": value for key, value in _final(table).items()}
            parts.append(Picture(name, sources.image(STAGE, world, f"{item}.png"), f"{world}: {caption}"))
            parts.append(_sheet(name, table, CURVE_METRICS))
    return Section(title, parts, stage_commands(STAGE, sources.recovery_worlds), numbers)


def _section(
    sources: Sources, title: str, protocol: str, name: str, read: Callable[[Sources, str, pd.DataFrame], Reading]
) -> Section:
    if not sources.recovery_worlds:
        return _missing(title)
    parts: list[Part] = [protocol]
    numbers: dict[str, float] = {}
    for place, world in enumerate(sources.recovery_worlds):
        table = _read(sources, world, name)
        if not len(table):
            parts.append(f"{world}: left out by its configuration.")
            continue
        parts += [read(sources, world, table), _sheet(_report_name(name, world, place), table, TABLE_METRICS)]
        for row in _aggregates(table, ("success", "gain")):
            key = "/".join([name, world, str(row["method"]), *str(row["setting"]).replace("=", "_").split(";")])
            numbers[f"{key.rstrip('/')}/{row['metric']}"] = float(row["mean"])
    return Section(title, parts, stage_commands(STAGE, sources.recovery_worlds), numbers)


def _strategies(sources: Sources, world: str, table: pd.DataFrame) -> Reading:
    cells = {(row["method"], row["setting"], row["metric"]): row for row in _aggregates(table, ("success", "gain"))}
    ours = cells.get((RECOVERIES, "", "success"))
    others = {key[1].removeprefix("over="): row for key, row in cells.items() if key[2] == "gain"}
    gains = {name: row for name, row in others.items() if name not in LEARNT}
    claim = sources.chapter(CHAPTER).claims["table_4_1", "success"]
    if ours is None or not gains:
        return Reading(claim, f"{world}: recoveries were not compared.")
    margins = [f"{_percent(row, sign=True)} over {name.replace('_', ' ')}" for name, row in gains.items()]
    agrees: Agreement = "no"
    if ours["mean"] >= ours["thesis"] - NEAR and OPEN_LOOP in gains and gains[OPEN_LOOP]["low"] > 0.0:
        agrees = "yes" if all(row["low"] > 0.0 for row in gains.values()) else "partly"
    return Reading(claim, f"{world}: {_percent(ours)}; {', '.join(margins)}.", agrees)


def _doors(sources: Sources, world: str, table: pd.DataFrame) -> Reading:
    claim = sources.chapter(CHAPTER).claims["table_4_2", "unseen"]
    setting = f"over={OPEN_LOOP};handle={UNSEEN}"
    rows = [row for row in _aggregates(table, ("gain",)) if row["setting"] == setting]
    if not rows:
        return Reading(claim, f"{world}: no unseen handle was evaluated.")
    agrees: Agreement = "yes" if rows[0]["low"] > 0.0 else "partly" if rows[0]["mean"] > 0.0 else "no"
    return Reading(claim, f"{world}: {_percent(rows[0], sign=True)} over open loop on unseen handles.", agrees)


def _comparison(sources: Sources, world: str, table: pd.DataFrame) -> Reading:
    claim = sources.chapter(CHAPTER).claims["figure_4_7", "better"]
    rows = {str(row["setting"]).removeprefix("over="): row for row in _aggregates(table, ("better",))}
    wins = [
        f"better than {name.replace('_', ' ')} in {round(row['mean'] * row['n'])} of {row['n']}"
        for name, row in rows.items()
    ]
    share = rows["round_robin"]["mean"] if "round_robin" in rows else math.nan
    agrees: Agreement = "unsaid" if math.isnan(share) else "yes" if share == 1.0 else "partly" if share > 0.5 else "no"
    return Reading(claim, f"{world}: {'; '.join(wins) or 'one chooser alone'}.", agrees)


def _final(table: pd.DataFrame) -> dict[str, float]:
    rows = _aggregates(table, ("final_gain", "better"))
    return {f"{str(row['setting']).replace('=', '_')}/{row['metric']}": float(row["mean"]) for row in rows}


def _sheet(name: str, table: pd.DataFrame, metrics: Sequence[str]) -> PageTable:
    rows = []
    for row in _aggregates(table, metrics):
        percent = str(row["metric"]).startswith(IN_PERCENT)
        scale, digits = (100.0, 1) if percent else (1.0, 2)
        mean, low, high, reference = (scale * float(row[key]) for key in ("mean", "low", "high", "thesis"))
        method, metric = (str(row[key]).replace("_", " ") for key in ("method", "metric"))
        ours = f"{estimate(mean, low, high, digits=digits)}{' %' if percent else ''}"
        thesis = "–" if math.isnan(reference) else f"{reference:.3g}"
        rows.append([method, setting_label(str(row["setting"])), metric, ours, thesis, str(row["n"])])
    return PageTable(
        name, table, ["", "", "", "ours", "thesis", "n"], rows, f"{TRAININGS} Single trainings are in the file."
    )


def _aggregates(table: pd.DataFrame, metrics: Sequence[str]) -> list[dict[Any, Any]]:
    """Rows of the metrics over all seeds, not those of single seeds."""
    single = table["setting"].str.startswith("seed=") | table["setting"].str.contains("queries=")
    return table[table["metric"].isin(metrics) & ~single].to_dict("records")


def _read(sources: Sources, world: str, name: str) -> pd.DataFrame:
    return sources.sheet(STAGE, world, f"{name}.csv").fillna({"setting": ""})


def _report_name(name: str, world: str, place: int) -> str:
    """The name of a world's table or figure: the thesis's own for the first world, with the world's for others."""
    return name if place == 0 else f"{name}_{world}"


def _percent(row: dict[Any, Any], *, sign: bool = False) -> str:
    mean, low, high = (100.0 * float(row[key]) for key in ("mean", "low", "high"))
    plus = "+" if sign and mean >= 0.0 else ""
    return f"{plus}{mean:.1f} [{low:.1f}, {high:.1f}] %"


def _missing(title: str) -> Section:
    return Section(title, ["Left out: conf/pipeline.yaml names no recovery_worlds. Add them there."])
