"""A plan for today and an uncertain tomorrow as one HTML page; it looks as `p2l.evaluation.team.page` does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from p2l.artifacts import write_text
from p2l.evaluation.team.look import ORDER, UNIT, amount
from p2l.evaluation.team.page_inputs import inputs
from p2l.evaluation.team.page_parts import STYLE, Column, facts, listing, shows, word
from p2l.team.plan_files import proof_text
from p2l.team.shop.files import named_rows
from p2l.team.shop.record import Shop, ShopPlan
from p2l.team.tomorrow.reasons import LessonTimes, explain_estimate
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan
from p2l.team.tomorrow.sampling import Estimate

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_DAY = (
    Column("step", "order"), Column("task", "task"), Column("copies", "count"), Column("done as", "decision"),
    Column("robot", "robot"), Column("with the lesson", "skill"), Column("success", "p_success"),
    Column("expected cost", "expected_cost", True),
)  # fmt: skip
_NOW = (
    Column("lesson", "lesson"), Column("robot", "robot"), Column("costs", "c_demo", True),
    Column("serves today", "serves"), Column("expected tasks tomorrow", "uses", True),
    Column("saves, with the rest planned anew", "saving", True),
)  # fmt: skip
_LATER = (
    Column("lesson", "lesson"), Column("robot", "robot"), Column("costs", "c_demo", True),
    Column("taught tomorrow with probability", "share"),
)  # fmt: skip


def write_tomorrow_page(
    path: Path | str,
    program: TwoStage,
    plan: TwoStagePlan,
    reasons: LessonTimes,
    estimate: Estimate | None,
    remarks: Sequence[str],
    title: str,
) -> None:
    """Write the page, atomically.

    Raises:
        ArtifactError: the file cannot be written.
    """
    write_text(path, tomorrow_page(program, plan, reasons, estimate, remarks, title))


def tomorrow_page(
    program: TwoStage,
    plan: TwoStagePlan,
    reasons: LessonTimes,
    estimate: Estimate | None,
    remarks: Sequence[str],
    title: str,
) -> str:
    """The page as HTML.

    Args:
        program: today and tomorrow.
        plan: of both.
        reasons: which lessons are given now, and which can wait.
        estimate: what sampling leaves open; None if nobody asked.
        remarks: what was assumed, a sentence each.
        title: heading.
    """
    shop, heading = program.today, word(title) or "Plan"
    sections = [
        _headline(program, plan, estimate),
        _section("Lessons of today", facts(_NOW, _today(program, reasons), _costs())) if reasons.today else "",
        _section("Lessons that can wait", _waiting(program, reasons)),
        _section("Today, in order", _day(shop, plan.today)),
        _section("What was assumed", listing(word(remark) for remark in remarks)) if remarks else "",
        _section("Limits and inputs", inputs(shop)),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{heading}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        f'<h1 dir="auto">{heading}</h1>\n' + "\n".join(filter(None, sections)) + "\n</main>\n</body>\n</html>\n"
    )


def check_tomorrow_page(path: Path | str, program: TwoStage, plan: TwoStagePlan) -> bool:
    """Whether there is a page at all; where there is, it has to show the plan's costs, proof and table of today.

    Its lessons, what sampling leaves open, notes and inputs are not looked at.

    Raises:
        ArtifactError: the page cannot be read.
        InputError: it shows another cost or day.
    """
    total, parts = _costs_of(program, plan)
    return shows(path, {"cost": total, "costs of the two days": parts, "day": _day(program.today, plan.today)})


def _costs_of(program: TwoStage, plan: TwoStagePlan) -> tuple[str, str]:
    proof = proof_text(plan.status, plan.objective, plan.lower_bound)
    tomorrow = plan.objective - plan.today.objective
    many = f"{program.scenarios:,} scenario{'' if program.scenarios == 1 else 's'}"
    return (
        f'<p class="total"><b>{amount(plan.objective)}</b> expected cost, {proof} for {many}</p>',
        f"<p>Today {amount(plan.today.objective)}, tomorrow {amount(tomorrow)}. All costs are in the {UNIT}.</p>",
    )


def _day(shop: Shop, plan: ShopPlan) -> str:
    columns = [each for each in _DAY if each.key != "robot" or len(shop.robots) > 1]
    rows = [
        {**row, "order": f"{row['order']}", "count": f"{row['count']}", "p_success": f"{row['p_success']:.0%}"}
        for row in named_rows(shop, plan)
    ]
    return facts(columns, rows, f"Tasks {ORDER[shop.order]}. {_costs()}")


def _headline(program: TwoStage, plan: TwoStagePlan, estimate: Estimate | None) -> str:
    lines = [*_costs_of(program, plan)]
    if estimate is not None:
        lines.append(f"<p>{word(explain_estimate(estimate))}</p>")
    return '<section class="headline">\n' + "\n".join(lines) + "\n</section>"


def _today(program: TwoStage, reasons: LessonTimes) -> list[dict[str, object]]:
    shop = program.today
    return [
        {
            "lesson": shop.lessons[each.lesson],
            "robot": shop.robots[each.robot],
            "c_demo": each.c_demo,
            "serves": each.serves,
            "uses": each.uses,
            "saving": "cannot be done without" if math.isinf(each.saving) else each.saving,
        }
        for each in reasons.today
    ]


def _waiting(program: TwoStage, reasons: LessonTimes) -> str:
    if program.commit == "all":
        return "<p>None is given tomorrow.</p>"
    if not reasons.later:
        return "<p>None would pay tomorrow.</p>"
    shop = program.today
    rows = [
        {
            "lesson": shop.lessons[each.lesson],
            "robot": shop.robots[each.robot],
            "c_demo": each.c_demo,
            "share": f"{max(each.share, 0.001):.1%}",
        }
        for each in reasons.later
    ]
    return facts(_LATER, rows, f"Once tomorrow's orders are known. {_costs()}")


def _costs() -> str:
    return f"Costs are in the {UNIT}."


def _section(title: str, content: str) -> str:
    return f"<section>\n<h2>{title}</h2>\n{content}\n</section>"
