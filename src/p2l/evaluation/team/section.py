"""Chapter 3 (Act, Delegate or Learn): its tables and figures beside ours, one section each."""

from __future__ import annotations

import pandas as pd

from p2l.evaluation.page.page import PageTable, Part, Picture, Section
from p2l.evaluation.page.sources import Sources, Team
from p2l.evaluation.page.views import averages, estimate, missing, pivot, plain_setting, setting_label, stage_commands
from p2l.evaluation.style import METHODS, THESIS_METHODS, png
from p2l.evaluation.team import readings, tables
from p2l.evaluation.team.figures import cost_by_method, cost_by_pretraining
from p2l.evaluation.team.layouts import board_plans
from p2l.evaluation.team.overview import overview
from p2l.evaluation.team.tables import HIGH, LOW

CHAPTER = 3
TABLE_METRICS = ("executed_cost", "demos", "delegated", "failures")


def in_one_picture(sources: Sources) -> Section:
    """A planned day, the board, and the costs of the planners."""
    day, board = sources.team("insertion"), sources.team("board")
    title = "In one picture"
    if day is None or board is None:
        return missing(title, ("insertion", "board"), sources)
    level = min(day.results["level"])
    rows = _plan(day, HIGH, level)
    first = rows[rows["set"] == rows["set"].min()]
    costs = day.summary[day.summary["regime"] == HIGH]
    on_board = board.plans[(board.plans["method"] == "adl") & (board.plans["set"] == min(2, board.plans["set"].max()))]
    picture = Picture(
        "overview",
        png(overview(first, on_board, costs)),
        f"Top: ADL's plan for the first insertion set with {level} pre-trained skills. Left: ADL's plan for one order "
        f"of table 3.1. Right: mean executed cost over {day.sets}.",
    )
    return Section(title, [picture], stage_commands("evaluate_team", ("insertion", "board")))


def figure_3_7(sources: Sources) -> Section:
    """Cost against the number of pre-trained skills in the insertion domain."""
    team, title = sources.team("insertion"), "Figure 3.7: insertion, cost against pre-training"
    if team is None:
        return missing(title, ("insertion",), sources)
    thesis, summary = sources.chapter(CHAPTER), team.summary
    table = tables.figure_3_7(summary, team.thetas, thesis)
    claims = {name: thesis.claims["figure_3_7", name] for name in ("cheapest", "gap", "converge", "crossing", "theta")}
    counts = readings.cheapest(summary, HIGH)
    parts: list[Part] = [
        _conditions(team, HIGH),
        Picture(
            "figure_3_7",
            png(cost_by_pretraining(summary, {HIGH: "Insertion, teaching costs more than delegating"}, team.sets)),
            "Above: mean cost; its 95 % intervals are in the table. Below: the same sets compared pair by pair.",
        ),
        readings.read_cheapest(claims["cheapest"], summary, HIGH),
        readings.read_gap(claims["gap"], summary, HIGH),
        readings.read_convergence(claims["converge"], summary, HIGH, team.results["n_tasks"].iloc[0]),
        readings.read_crossing(claims["crossing"], summary, HIGH),
        readings.read_theta(claims["theta"], table),
        _cost_sheet("figure_3_7", table),
    ]
    numbers = {
        "figure_3_7/levels": float(counts.levels),
        "figure_3_7/levels_adl_cheapest": float(counts.strict),
        "figure_3_7/levels_adl_tied": float(counts.ties),
        "figure_3_7/theta": team.thetas[HIGH],
    }
    return Section(title, parts, stage_commands("evaluate_team", ("insertion",)), numbers)


def table_3_1(sources: Sources) -> Section:
    """Five orders of holes on the peg board."""
    team, title = sources.team("board"), "Table 3.1: the peg board"
    if team is None:
        return missing(title, ("board",), sources)
    thesis = sources.chapter(CHAPTER)
    table = tables.table_3_1(team.results, thesis)
    plans = team.plans[team.plans["method"] == "adl"].sort_values(["set", "step"])
    orders = [", ".join(plans.loc[plans["set"] == index, "name"]) for index in sorted(set(plans["set"]))]
    value = {(row["method"], row["setting"], row["metric"]): row for row in table.to_dict("records")}
    rows, titles = [], []
    for number, names in enumerate(orders, start=1):
        mine = {metric: value["adl", f"order={number}", metric] for metric in tables.BOARD_METRICS}
        demos, delegations = (f"{mine[name]['mean']:g}" for name in ("demos", "delegated"))
        titles.append(f"order {number}: {names}\n{demos} taught, {delegations} delegated")
        references = [estimate(mine[name]["thesis"]) for name in ("demos", "delegated")]
        costs = [f"{mine[name]['mean']:.0f}" for name in ("executed_cost", "predicted_cost")]
        true = f"{value['adl_true', f'order={number}', 'executed_cost']['mean']:.0f}"
        counts = [f"{demos} ({references[0]})", f"{delegations} ({references[1]})", f"{mine['failures']['mean']:.2f}"]
        rows.append([str(number), names, *counts, *costs, true])
    head = ["", "order of tasks", "#demo (thesis)", "#hum (thesis)", "failures", "executed", "predicted", "true matrix"]
    caption = (
        "One plan per order; costs in units of effort; failures and executed costs are means over execution draws. "
        "Last column: executed cost of the plan made from the true transfer matrix."
    )
    arrows = "ADL's plans; arrows lead from a lesson to the attempts it serves."
    parts: list[Part] = [
        _conditions(team, next(iter(team.study["regimes"]))),
        PageTable("table_3_1", table, head, rows, caption),
        readings.read_orders(thesis.claims["table_3_1", "rows"], table),
        Picture("table_3_1", png(board_plans(plans, titles)), arrows),
    ]
    same = len(orders) - len(readings.orders_that_differ(table))
    return Section(
        title, parts, stage_commands("evaluate_team", ("board",)), {"table_3_1/orders_reproduced": float(same)}
    )


def table_3_2(sources: Sources) -> Section:
    """Lego without pre-training: costs, counts, and figure 3.9."""
    team, title = sources.team("lego"), "Table 3.2 and figure 3.9: Lego stacking, no pre-training"
    if team is None:
        return missing(title, ("lego",), sources)
    thesis = sources.chapter(CHAPTER)
    table = tables.table_3_2(team.results, thesis)
    methods = [method for method in METHODS if (table["method"] == method).any()]
    rows = [row for method in methods for row in averages(table, method, TABLE_METRICS)]
    cases = team.results[(team.results["regime"] == HIGH) & (team.results["level"] == 0)]
    costs = table[(table["metric"] == "executed_cost") & table["thesis"].notna()]
    totals = dict(zip(costs["method"], costs["thesis"], strict=True))
    summary = team.summary[team.summary["level"] == 0]
    parts: list[Part] = [
        _conditions(team, HIGH),
        PageTable(
            "table_3_2",
            table,
            ["", "total cost", "# demo", "# hum", "# fail"],
            rows,
            "Ours: mean ± standard deviation [95 % t interval of the mean]; thesis: mean ± standard deviation.",
        ),
        readings.read_cheapest(thesis.claims["table_3_2", "cheapest"], summary, HIGH),
        readings.read_percent(thesis.claims["table_3_2", "percent"], table),
        Picture(
            "figure_3_9",
            png(cost_by_method(cases, team.costs(HIGH), totals, "Lego stacking, no pre-training")),
            "What the total is made of; numbers in the bars are mean counts per set, whiskers 95 % t intervals.",
        ),
    ]
    numbers = {
        f"table_3_2/{row['method']}": row["mean"]
        for row in table[(table["metric"] == "executed_cost")].to_dict("records")
    }
    return Section(title, parts, stage_commands("evaluate_team", ("lego",)), numbers)


def figure_3_10(sources: Sources) -> Section:
    """Both cost regimes against pre-training: Lego, and the same for insertion."""
    title = "Figure 3.10: effect of costs on plans"
    thesis = sources.chapter(CHAPTER)
    parts: list[Part] = []
    domains: list[str] = []
    for domain, name in (("lego", "figure_3_10"), ("insertion", "figure_3_10_insertion")):
        team = sources.team(domain)
        if team is None:
            parts.append(f"Domain '{domain}' is not part of this pipeline.")
            continue
        domains.append(domain)
        panels = {LOW: "(a) low cost of teaching", HIGH: "(b) high cost of teaching"}
        panels = {regime: f"{text}, c_demo = {team.costs(regime)['c_demo']:g}" for regime, text in panels.items()}
        table = tables.figure_3_10(team.summary, thesis)
        parts += [
            f"{domain.capitalize()}: {_conditions(team, LOW, HIGH)}",
            Picture(name, png(cost_by_pretraining(team.summary, panels, team.sets)), f"{domain}, both regimes."),
            readings.read_low(thesis.claims["figure_3_10", "low"], team.summary, LOW),
            readings.read_high(thesis.claims["figure_3_10", "high"], team.summary, HIGH),
            _cost_sheet(name, table),
        ]
    return Section(title, parts, stage_commands("evaluate_team", domains))


def order_any(sources: Sources) -> Section:
    """The saving of ADL with any order of work."""
    return _comparison(
        sources,
        "Any order of work (section 6.2.1)",
        "order_any",
        "If tasks may be done in any order, each lesson can come first. Cost of ADL in the given order minus its cost "
        "with the order free, on the same sets.",
        {"executed_saving": "The free order saves executed cost", "predicted_saving": "It saves predicted cost"},
    )


def prediction_price(sources: Sources) -> Section:
    """The cost of ADL's plans minus that of plans made from the true transfer matrix."""
    return _comparison(
        sources,
        "The price of imperfect prediction",
        "prediction_price",
        "Executed cost of ADL's plan minus that of the plan made from the true (simulated) transfer matrix, on the "
        "same sets; the draws that make the true matrix are not those that execute.",
        {"executed_price": "The learnt predictor costs more than the truth"},
    )


def _comparison(sources: Sources, title: str, name: str, lead: str, lines: dict[str, str]) -> Section:
    thesis = sources.chapter(CHAPTER)
    make = {"order_any": tables.order_any, "prediction_price": tables.prediction_price}[name]
    teams = [team for domain in sources.domains if (team := sources.team(domain)) is not None]
    table = pd.concat([make(team.results, team.domain, thesis) for team in teams], ignore_index=True)
    metrics = list(lines)
    first = table[table["metric"] == metrics[0]]
    rows = [
        [setting_label(row["setting"]), *(_of(table, row["setting"], metric) for metric in metrics)]
        for row in first.to_dict("records")
    ]
    sheet = PageTable(
        name,
        table,
        ["", *(metric.replace("_", " ") for metric in metrics)],
        rows,
        "Mean paired difference [95 % t interval over sets], units of effort.",
    )
    savings = [readings.read_saving(table, metric, text) for metric, text in lines.items()]
    headline = {f"{name}/{plain_setting(row['setting'])}": row["mean"] for row in first.to_dict("records")}
    return Section(title, [lead, *savings, sheet], stage_commands("evaluate_team", sources.domains), headline)


def _cost_sheet(name: str, table: pd.DataFrame) -> PageTable:
    return PageTable(
        name, table, *pivot(table, "executed_cost", THESIS_METHODS), "Mean executed cost [95 % t interval]."
    )


def _of(table: pd.DataFrame, setting: str, metric: str) -> str:
    row = table[(table["setting"] == setting) & (table["metric"] == metric)].iloc[0]
    return estimate(row["mean"], row["low"], row["high"])


def _plan(team: Team, regime: str, level: int) -> pd.DataFrame:
    plans = team.plans
    return plans[(plans["method"] == "adl") & (plans["regime"] == regime) & (plans["level"] == level)]


def _conditions(team: Team, *regimes: str) -> str:
    costs = [team.costs(regime) for regime in regimes]
    each = {name: " or ".join(dict.fromkeys(f"{cost[name]:g}" for cost in costs)) for name in costs[0]}
    prices = ", ".join(f"{name} = {value}" for name, value in each.items())
    return f"{team.sets}; {prices}; {team.study['draws']} executions behind each success rate."
