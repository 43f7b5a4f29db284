"""Sections of chapter 4: preconditions of the nominal skills, and the training of recoveries round by round."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from p2l.evaluation.metareskill import readings
from p2l.evaluation.page.page import Films, PageTable, Part, Picture, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, stage_commands
from p2l.evaluation.rows import table_of

CHAPTER = 4
ROUNDS_ON_PAGE = 40
SCORES = ("accuracy", "precision", "recall", "solved_where_it_holds")
ROUND_METRICS = ("q_before", "q_upper", "q", "predicted", "value")
CURVE = (
    "Above: how often the next precondition is reached from samples to which a probability p was given. Below: "
    "accuracy against the number of training samples; good starts of nominal executions are added to each."
)
GRAPH = (
    "the skill graph after training, first seed. Modes stand with their share of the failures; a blue edge is a "
    "recovery that succeeds, with its rate on held-out failures, and as thick as it was trained often."
)
ROUNDS = (
    "Limit: upper confidence limit of the success rate after the round. Predicted: value of failures if the limit were "
    "reached; realised: the value measured after the round, which keeps the best skill so far."
)


def preconditions(sources: Sources) -> Section:
    """Held-out accuracy and calibration of learnt preconditions."""
    title = "Preconditions of the nominal skills (section 4.2.1, algorithm 2)"
    if not sources.recovery_worlds:
        return _missing(title)
    thesis = sources.chapter(CHAPTER)
    parts: list[Part] = []
    numbers: dict[str, float] = {}
    for world in sources.recovery_worlds:
        scores = sources.sheet("fit_preconditions", world, "scores.csv")
        setting = "world=" + world + ";skill=" + scores["skill"]
        table = thesis.beside(table_of(scores.assign(method="chaining", setting=setting, mean=scores["value"])), "")
        cell = {(row["skill"], row["metric"]): row for row in scores.to_dict("records")}
        skills = list(dict.fromkeys(scores["skill"]))
        rows = [[_plain(skill), *(_rate(cell[skill, metric]) for metric in SCORES)] for skill in skills]
        samples = sources.sheet("fit_preconditions", world, "accuracy.csv").groupby("skill")["samples"].max()
        held_out = sum(int(cell[skill, "accuracy"]["n"]) for skill in skills)
        parts += [
            readings.read_preconditions(thesis.claims["preconditions", "samples"], cell, int(samples.sum()) + held_out),
            Picture(
                _report_name("preconditions", sources, world),
                sources.image("fit_preconditions", world, "preconditions.png"),
                CURVE,
            ),
            PageTable(
                _report_name("preconditions", sources, world),
                table,
                ["skill", "accuracy", "precision", "recall", "chain solves where it holds"],
                rows,
                f"{world}: held-out samples, 95 % Wilson intervals.",
            ),
        ]
        numbers |= {
            f"preconditions/{world}/{skill}/accuracy": float(cell[skill, "accuracy"]["value"]) for skill in skills
        }
    return Section(title, parts, stage_commands("fit_preconditions", sources.recovery_worlds), numbers)


def learning(sources: Sources) -> Section:
    """The rounds of the first chooser, whose skills are used, with the reason for each; its skill graph and videos."""
    title = "What was trained, round by round, and why (section 4.3.2, algorithm 3)"
    if not sources.recovery_worlds:
        return _missing(title)
    claims = sources.chapter(CHAPTER).claims
    parts: list[Part] = []
    numbers: dict[str, float] = {}
    for world in sources.recovery_worlds:
        rounds = sources.sheet("learn_recoveries", world, "rounds.csv")
        values, counts = (sources.sheet("learn_recoveries", world, f"figure_4_{name}.csv") for name in (7, 6))
        first, seed = str(rounds["chooser"].iloc[0]), int(rounds["seed"].iloc[0])
        mine = rounds[rounds["chooser"] == first]
        graph = sources.image("learn_recoveries", world, f"graphs/s{seed}.png")
        parts += [
            *readings.read_saturation(claims, values),
            *readings.read_allocation(claims, counts),
            readings.read_predictions(mine),
            Picture(_report_name("skill_graph", sources, world), graph, f"{world}: {GRAPH}"),
            _films(sources, world),
            _rounds(sources, world, mine),
        ]
        final = values[values["queries"] == values["queries"].max()].groupby("chooser", sort=False)["value"].mean()
        numbers |= {f"recoveries/{world}/value/{chooser}": float(value) for chooser, value in final.items()}
        numbers[f"recoveries/{world}/queries_solved"] = float(mine["solved"].mean())
    return Section(title, parts, stage_commands("learn_recoveries", sources.recovery_worlds), numbers)


def _rounds(sources: Sources, world: str, mine: pd.DataFrame) -> PageTable:
    """All rounds of one chooser as a table; on the page those after the initial ones, of the first seed."""
    where = [f"seed={r.seed};round={r.round};mode={r.mode};target={r.target_name}" for r in mine.itertuples()]
    long = pd.concat(
        [
            mine.assign(method=mine["chooser"], setting=where, metric=metric, mean=mine[metric])
            for metric in ROUND_METRICS
        ]
    ).assign(low=math.nan, high=math.nan, n=1)
    excerpt = mine[(mine["seed"] == mine["seed"].iloc[0]) & (mine["reason"] != "initial round")].head(ROUNDS_ON_PAGE)
    rows = [
        [
            str(row["round"]),
            f"{row['mode']} → {_plain(str(row['target_name']))}",
            str(row["reason"]),
            *(_number(row[metric]) for metric in ROUND_METRICS),
            "yes" if row["solved"] else "no",
        ]
        for row in excerpt.to_dict("records")
    ]
    head = ["round", "recovery", "why", "q before", "limit", "q", "predicted", "realised", "query solved"]
    caption = (
        f"{world}, {_plain(mine['chooser'].iloc[0])}, first seed: {len(rows)} rounds after the initial ones. {ROUNDS}"
    )
    name = _report_name("recovery_rounds", sources, world)
    return PageTable(name, table_of(long).assign(thesis=math.nan), head, rows, caption)


def _films(sources: Sources, world: str) -> Part:
    """Each mode before and after learning, or the reason why there is no video."""
    videos, reason = sources.videos(world, "learn_recoveries")
    if reason:
        return f"{world}: {reason}"
    films = []
    for one, mp4 in videos:
        name, content = f"Mode {one['mode']}, {one['moment']} learning", _plain(one["told"])
        end = "" if one["moment"] == "before" else "; solved" if one["solved"] else "; not solved"
        films.append((f"{world} mode {one['mode']} {one['moment']}", mp4, f"{name}: {content}{end}"))
    return Films(films)


def _report_name(name: str, sources: Sources, world: str) -> str:
    """The name of a world's table or figure: the thesis's own for the first world, with the world's for others."""
    return name if world == sources.recovery_worlds[0] else f"{name}_{world}"


def _missing(title: str) -> Section:
    return Section(title, ["Left out: conf/pipeline.yaml names no recovery_worlds. Add them there."])


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"


def _rate(row: Mapping[Any, Any]) -> str:
    return estimate(row["value"], row["low"], row["high"], digits=2)
