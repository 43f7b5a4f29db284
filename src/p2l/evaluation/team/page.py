"""A plan of a shop as one HTML page: the day in order, why each lesson pays, and what the plan was made from.

Nothing is fetched, no script runs, and the page says so to the browser. Names are a person's input: each is escaped,
and isolated, so that one that is written from the right leaves the rest of its line alone. No matplotlib is imported.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import write_text
from p2l.evaluation.team.look import ORDER, UNIT, amount, limits
from p2l.evaluation.team.page_inputs import inputs
from p2l.evaluation.team.page_parts import (
    NONE,
    STYLE,
    Column,
    cell,
    facts,
    header,
    listing,
    name,
    names,
    shows,
    table,
    word,
)
from p2l.team.plan_files import proof_text
from p2l.team.problem import Decision
from p2l.team.shop.outcome import shop_outcome
from p2l.team.shop.record import Ruling, Shop, ShopPlan
from p2l.team.shop.rows import PlanRow, plan_rows

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_DID = {Decision.ACT: "attempt", Decision.DELEGATE: "handed over", Decision.LEARN: "lesson"}
_ROBOT = Column("robot", "robot")
_UP_TO = Column("stays in the plan up to a cost of", "stays_up_to", True)
_REASONS = (
    Column("lesson", "lesson"), _ROBOT, Column("costs", "c_demo", True), Column("serves", "serves"),
    Column("saves, with the rest planned anew", "saving_resolved", True),
    Column("saves, with the other lessons as they are", "saving_others_fixed", True),
    _UP_TO,
)  # fmt: skip
_BREAK_EVEN = (
    Column("lesson", "lesson"), _ROBOT, Column("costs", "c_demo", True), Column("would pay below", "pays_below", True),
)  # fmt: skip


@dataclass(frozen=True)
class PageContent:
    """What the page of a plan shows.

    Attributes:
        shop: the day.
        plan: its plan.
        title: heading.
        reasons: why each lesson pays, a row for each lesson and robot: `lesson` and `robot` (names), `c_demo`,
            `serves` (names of tasks, or a text), `saving_resolved`, `saving_others_fixed`, `stays_up_to`. What is
            missing or None is shown as a dash; without any `stays_up_to` there is no such column.
        break_even: lessons that are not given, the best first: `lesson`, `robot`, `c_demo`, and `pays_below`, the
            cost below which the lesson would pay.
        without_lessons: optimum without any lesson, infinite if there is none; if it is not known, the cost of this
            plan without its lessons, those that are demanded included.
        remarks: what was assumed, a sentence each.
        figure_png: the figure; None for none, since the table has bars of its own.
    """

    shop: Shop
    plan: ShopPlan
    title: str
    reasons: Sequence[Mapping[str, Any]] = ()
    break_even: Sequence[Mapping[str, Any]] = ()
    without_lessons: float | None = None
    remarks: Sequence[str] = ()
    figure_png: bytes | None = None


def write_page(path: Path | str, content: PageContent) -> None:
    """Write the page of a plan, atomically.

    Raises:
        ArtifactError: the file cannot be written.
    """
    write_text(path, plan_page(content))


def plan_page(content: PageContent) -> str:
    """The page of a plan, as HTML."""
    shop, plan = content.shop, content.plan
    rows = plan_rows(shop, plan)
    heading = word(content.title) or "Plan"
    figure = ""
    if content.figure_png is not None:
        data = base64.b64encode(content.figure_png).decode("ascii")
        figure = (
            f'<figure><img src="data:image/png;base64,{data}" alt="The plan as a picture: arcs lead from each lesson '
            'to the tasks that it serves; bars are expected costs. The table below has the same."></figure>'
        )
    alone = cost_without_lessons(shop, plan) if content.without_lessons is None else content.without_lessons
    sections = [
        _headline(shop, plan, rows, alone),
        figure,
        _section("The day, in order", _day(shop, rows)),
        _section("Lessons, and why they pay", _lessons(shop, plan, content.reasons, content.break_even)),
        _section("What was assumed", listing(word(each) for each in content.remarks)) if content.remarks else "",
        _section("Limits and inputs", inputs(shop)),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{heading}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        f'<h1 dir="auto">{heading}</h1>\n' + "\n".join(filter(None, sections)) + "\n</main>\n</body>\n</html>\n"
    )


def check_page(path: Path | str, shop: Shop, plan: ShopPlan) -> bool:
    """Whether there is a page at all; where there is, it has to show the plan's cost, proof and table of the day.

    Its reasons, notes and inputs are not looked at.

    Raises:
        ArtifactError: the page cannot be read.
        InputError: it shows another cost or day.
    """
    return shows(path, {"cost": _total(plan), "day": _day(shop, plan_rows(shop, plan))})


def cost_without_lessons(shop: Shop, plan: ShopPlan) -> float:
    """Expected cost of the day if no lesson is given, though some may be demanded; infinite if that cannot be done."""
    choice = np.where(shop.choice == Ruling.LEARN, Ruling.NOT_LEARN, shop.choice)
    return shop_outcome(replace(shop, choice=choice), np.zeros((0, 2), dtype=np.int64), plan.sequence).total


def _headline(shop: Shop, plan: ShopPlan, rows: Sequence[PlanRow], alone: float) -> str:
    if not len(plan.taught):
        lessons = "No lesson is given."
    elif math.isfinite(alone):
        saving = alone - plan.objective
        balance = f"the lessons save {amount(saving)}" if saving >= 0.0 else f"the lessons cost {amount(-saving)} more"
        lessons = f"Without any lesson it would be {amount(alone)}: {balance}."
    else:
        lessons = "Without any lesson the day could not be done."
    number = {kind: sum(row.copies for row in rows if row.decision == kind) for kind in Decision}
    number[Decision.LEARN] = len(plan.taught)
    text = {
        Decision.ACT: f"attempt{_s(number[Decision.ACT])} by {'robots' if len(shop.robots) > 1 else 'the robot'}",
        Decision.DELEGATE: "done by the person",
        Decision.LEARN: f"lesson{_s(number[Decision.LEARN])}",
    }
    items = "".join(f'<li class="{kind.name.lower()}"><b>{number[kind]:,}</b> {text[kind]}</li>' for kind in Decision)
    given = limits(shop)
    return (
        f'<section class="headline">\n{_total(plan)}\n'
        f"<p>{lessons} All costs are in the {UNIT}.{' Limits: ' + ', '.join(given) + '.' if given else ''}</p>\n"
        f'<ul class="counts">{items}</ul>\n</section>'
    )


def _total(plan: ShopPlan) -> str:
    proof = proof_text(plan.status, plan.objective, plan.lower_bound)
    return f'<p class="total"><b>{amount(plan.objective)}</b> expected cost, {proof}</p>'


def _day(shop: Shop, rows: Sequence[PlanRow]) -> str:
    largest = max((row.expected_cost for row in rows), default=0.0) or 1.0
    lines = []
    for step, row in enumerate(rows, start=1):
        copies = f" <b>×{row.copies:,}</b>" if row.copies > 1 else ""
        task = name(shop.tasks[row.task]) + copies if row.task >= 0 else '<span class="faint">no task of today</span>'
        who = names(shop.robots[robot] for robot in row.robots) or "person"
        certain, risk = (100.0 * part / largest for part in (row.certain_cost, row.expected_cost - row.certain_cost))
        bar = f'<i style="width:{certain:.1f}%"></i>' + (
            f'<i class="risk" style="width:{risk:.1f}%"></i>' if risk else ""
        )
        kind = row.decision.name.lower()
        lines.append(
            f'<tr><td class="number">{step}</td><th scope="row">{task}</th>'
            f'<td><span class="badge {kind}">{_DID[row.decision]}</span></td><td>{who}</td><td>{_with(shop, row)}</td>'
            f'<td class="number">{_chance(row.p_success)}</td><td class="number">{amount(row.expected_cost)}</td>'
            f'<td class="bar {kind}" aria-hidden="true"><span>{bar}</span></td></tr>'
        )
    costs = "Success is of each copy, cost of all copies together," if shop.count.max() > 1 else "Costs are"
    heads = (header("step", True), header("task"), header("done as"), header("by"), header("with"))
    numbers = (header("success", True), header("expected cost", True))
    key = '<td class="key" aria-hidden="true">bar: cost, <i class="risk"></i> expected failure</td>'
    note = f"Tasks {ORDER[shop.order]}. {costs} in the {UNIT}."
    return table(note, "".join([*heads, *numbers, key]), lines, kind="day")


def _with(shop: Shop, row: PlanRow) -> str:
    """What an attempt uses, or which lesson is given."""
    if row.decision == Decision.DELEGATE:
        return NONE
    if row.lesson < 0:
        return '<span class="faint">skills it has</span>'
    lesson = shop.lessons[row.lesson]
    if row.decision == Decision.ACT:
        return f"lesson {name(lesson)}"
    own = row.task >= 0 and lesson == shop.tasks[row.task]
    return "is taught here" if own else f"is taught {name(lesson)}"


def _lessons(
    shop: Shop, plan: ShopPlan, reasons: Sequence[Mapping[str, Any]], break_even: Sequence[Mapping[str, Any]]
) -> str:
    one = len(shop.robots) == 1
    reason, other = ([each for each in columns if not (one and each is _ROBOT)] for columns in (_REASONS, _BREAK_EVEN))
    if all(each.get(_UP_TO.key) is None for each in reasons):
        reason.remove(_UP_TO)
    parts = []
    if reasons:
        parts.append(facts(reason, reasons, f"Costs and savings are in the {UNIT}."))
    elif not len(plan.taught):
        first = break_even[0] if break_even else {}
        near = cell(first.get("pays_below"))
        parts.append(
            f"<p>No lesson pays{' within the limits' if shop.is_limited else ''}"
            + (f"; {cell(first.get('lesson'))} would below {near}." if first else ".")
            + "</p>"
        )
    if break_even:
        parts.append("<h3>Lessons that are not given</h3>")
        parts.append(facts(other, break_even, f"Costs are in the {UNIT}; all else as it is."))
    return "\n".join(parts) or "<p>No reasons are given.</p>"


def _section(title: str, content: str) -> str:
    return f"<section>\n<h2>{title}</h2>\n{content}\n</section>"


def _chance(probability: float) -> str:
    """A probability in per cent, which is 100 or 0 only if it is certain."""
    if 0.0 < probability < 1.0:
        return f"{min(max(100.0 * probability, 0.1), 99.9):.1f} %"
    return f"{100.0 * probability:.0f} %"


def _s(number: int) -> str:
    return "" if number == 1 else "s"
