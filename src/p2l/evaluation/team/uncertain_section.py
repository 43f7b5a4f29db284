"""Sections of thesis 6.2.1 and 6.2.2: an uncertain tomorrow, planning anew, and asking a person about their costs.

Their numbers are those of committed tables (`Sources.results`), which scripts make from the records of the thesis
preset; the pipeline does not make them again, whatever its preset.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from p2l.evaluation.page.page import Link, PageTable, Part, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, plain_setting, setting_label
from p2l.evaluation.rows import COLUMNS

Number = Mapping[str, Any]  # a row's `mean`, `low` and `high`
_RECORDED = (
    "From the records of the thesis preset, whatever the preset of this page. Units of effort, 95 % intervals over "
    "task sets; differences are paired by set, and the text counts those whose interval excludes zero."
)
_POOLED = ";regime=all;pretrained=all"
_FUTURES = {"mean": "the mean", "myopic": "today alone", "hindsight": "hindsight"}
_WAYS = {
    "once": "the morning's plan",
    "outcomes": "after outcomes",
    "simulated": "lessons tried, too",
    "ahead": "and planned for",
    "adl_true": "true transfer",
}
_ASKING = {"nothing": "nothing", "everything": "everything", "uncertain": "the most uncertain"}
_KINDS = {"all": "everybody", "specialist": "specialised", "hurried": "hurried", "indifferent": "indifferent"}
_PREFERENCE_COLUMNS = ("domain", "regime", "c_ask", "kind", "policy", "sets", "questions", "total", "minus")


def tomorrow(sources: Sources) -> Section:
    """Planning for samples of tomorrow beside planning for its mean, for today alone, and with hindsight."""
    title, name = "An uncertain tomorrow (section 6.2.1)", "tomorrow_3"
    command = "python scripts/tomorrow_table.py results/thesis"
    table = sources.committed(name, COLUMNS)
    if table is None:
        return _left_out(title, name, command)
    cases = _cases(table)
    over = {method: [case[method, "executed_cost_over_sample"] for case in cases.values()] for method in _FUTURES}
    rows = [
        [
            setting_label(setting),
            _text(case["sample", "executed_cost"], 0),
            *(_text(case[method, "executed_cost_over_sample"]) for method in _FUTURES),
        ]
        for setting, case in cases.items()
    ]
    head = ["", "planned for samples", *(f"{label}, more" for label in _FUTURES.values())]
    said = (
        f"Executed in futures that no plan has seen, planning for the mean of tomorrow costs more than planning for "
        f"samples in {_above(over['mean'])}, planning for today alone in {_above(over['myopic'])}. Knowing the future "
        f"would save in {_below(over['hindsight'])}; no forecast could save more."
    )
    caption = (
        f"Executed cost, and how much more other plans cost. {_RECORDED} Futures: spread, every type a Poisson number "
        "of times; lots, a type seldom and then several; one type, all orders of one."
    )
    numbers = {f"{name}/over_{method}/cases": float(_count(over[method])[0]) for method in ("mean", "myopic")}
    parts: list[Part] = [said, PageTable(name, table, head, rows, caption)]
    return Section(title, [*parts, Link("docs/your-tasks.md", "Does it pay?")], [command], numbers)


def replanning(sources: Sources) -> Section:
    """Planning anew as the day goes beside the morning's plan, by what is known of the transfer."""
    title, name = "The day as it happens (section 6.2.1)", "replanning_3"
    command = "python scripts/replanning.py results/thesis"
    table = sources.committed(name, COLUMNS)
    if table is None:
        return _left_out(title, name, command)
    cases = _summarised(_cases(table))
    saved = {way: [case[way, "executed_saving"] for case in cases.values()] for way in ("outcomes", "ahead")}
    rows = [
        [
            setting_label(setting),
            *(f"{case[way, 'executed_cost']['mean']:.0f}" for way in _WAYS),
            _text(case["ahead", "executed_saving"]),
            _share(case.get(("ahead", "price_regained"))),
        ]
        for setting, case in cases.items()
    ]
    said = (
        f"What outcomes alone say of lessons saves in {_above(saved['outcomes'])}. Trying a lesson in simulation "
        f"before anything relies on it, and planning with that in mind, saves in {_above(saved['ahead'])}; the last "
        "column is how much of the price of imperfect prediction (the morning's plan less the true transfer's) that is."
    )
    caption = (
        f"Executed cost of a day. {_RECORDED} Each row is over all costs and numbers of pre-trained skills of its "
        "study; predicted or measured is what the morning knows of pre-trained skills."
    )
    head = ["", *_WAYS.values(), "planned for, saved", "of the price"]
    numbers = {f"{name}/{plain_setting(setting)}": float(_mean(case)) for setting, case in cases.items()}
    parts: list[Part] = [said, PageTable(name, table, head, rows, caption)]
    return Section(title, [*parts, Link("docs/planning.md", "Planning anew as the day goes")], [command], numbers)


def preferences(sources: Sources) -> Section:
    """Asking a person what is worth most beside other ways of asking, questions included."""
    title, name = "A person whose costs are not known (section 6.2.2)", "preferences_3"
    command = "python scripts/preferences_tables.py results/thesis"
    table = sources.committed(name, _PREFERENCE_COLUMNS)
    if table is None:
        return _left_out(title, name, command)
    price = float(table["c_ask"].iloc[0])
    groups = table[table["c_ask"] == price].groupby(["domain", "regime", "kind"], sort=False)
    named = {tuple(map(str, key)): group.set_index("policy").to_dict("index") for key, group in groups}
    cases = dict(sorted(named.items(), key=lambda case: list(_KINDS).index(case[0][2])))  # everybody first
    rows, saved = [], {kind: {policy: list[Number]() for policy in _ASKING} for kind in _KINDS}
    for (domain, regime, kind), case in cases.items():
        ours, setting = case["worth"], f"domain={domain};regime={regime}"
        savings = {policy: _saving(case[policy]) for policy in _ASKING}
        for policy, one in savings.items():
            saved[kind][policy].append(one)
        total = estimate(ours["total"], ours["total_low"], ours["total_high"])
        told = (_text(one) for one in savings.values())
        rows.append([f"{_KINDS[kind]}, {setting_label(setting)}", f"{ours['questions']:.1f}", total, *told])
    everybody, lost = saved["all"], {kind: _count(saved[kind]["nothing"])[1] for kind in _KINDS if kind != "all"}
    said = (
        f"Over all people, asking the question that is worth most saves against asking nothing in "
        f"{_above(everybody['nothing'])}, and against asking everything in {_above(everybody['everything'])}. Kind by "
        f"kind it costs more than asking nothing in {sum(lost.values())} cases ("
        f"{', '.join(f'{number} with {_KINDS[kind]} people' for kind, number in lost.items())})."
    )
    caption = (
        f"Total cost; a question costs {price:g}. What asking by worth saves against asking nothing, everything, and "
        f"as many of the most uncertain families. {_RECORDED} People are made up: hurried, "
        "specialised (dear in few families) and indifferent ones; all three kinds are known beforehand."
    )
    head = ["", "questions", "by worth", *(f"against {label}" for label in _ASKING.values())]
    numbers = {f"{name}/saves_against_{policy}/cases": float(_count(everybody[policy])[0]) for policy in _ASKING}
    parts: list[Part] = [said, PageTable(name, table, head, rows, caption)]
    return Section(title, [*parts, Link("docs/your-tasks.md", "What asking by worth is worth")], [command], numbers)


SECTIONS = (tomorrow, replanning, preferences)


def _left_out(title: str, name: str, command: str) -> Section:
    return Section(
        title, [f"Left out: there is no {name}.csv. The command below makes it, from records alone."], [command]
    )


def _cases(table: pd.DataFrame) -> dict[str, dict[tuple[str, str], Number]]:
    """Setting → (method, metric) → row."""
    cases: dict[str, dict[tuple[str, str], Number]] = {}
    for row in table.to_dict("records"):
        cases.setdefault(row["setting"], {})[row["method"], row["metric"]] = {str(key): row[key] for key in row}
    return cases


def _summarised(cases: Mapping[str, Any]) -> dict[str, Any]:
    """The rows over all cases of a study; of a study with a single case, that one."""
    whole = {setting.removesuffix(_POOLED): case for setting, case in cases.items() if setting.endswith(_POOLED)}
    single = {setting.partition(";regime=")[0]: case for setting, case in cases.items()}
    return {name: whole.get(name, case) for name, case in single.items()}


def _saving(row: Mapping[Any, Any]) -> Number:
    """Of asking by worth against a row's policy; the table has ours minus that."""
    return {"mean": -row["minus"], "low": -row["minus_high"], "high": -row["minus_low"]}


def _mean(case: Mapping[tuple[str, str], Number]) -> float:
    return float(case["ahead", "executed_saving"]["mean"])


def _text(row: Number, digits: int = 1) -> str:
    return estimate(row["mean"], row["low"], row["high"], digits)


def _share(row: Number | None) -> str:
    if row is None:
        return "there is none"
    return f"{row['mean']:.0%} [{row['low']:.0%}, {row['high']:.0%}]"


def _count(rows: Sequence[Number]) -> tuple[int, int, int]:
    """How many intervals lie above zero, how many below, and how many there are."""
    return sum(row["low"] > 0.0 for row in rows), sum(row["high"] < 0.0 for row in rows), len(rows)


def _above(rows: Iterable[Number]) -> str:
    above, below, number = _count([*rows])
    return f"{above} of {number} cases" + (f" (the other way round in {below})" if below else "")


def _below(rows: Iterable[Number]) -> str:
    _, below, number = _count([*rows])
    return f"{below} of {number} cases"
