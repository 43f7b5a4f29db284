"""What a person reads at the end: the cost, why each lesson pays, and which others nearly do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from p2l.team.problem import Decision
from p2l.team.shop.reasons import SAME, BreakEven, LessonReason, Reasons, tells_costs
from p2l.team.shop.record import Shop, ShopPlan
from p2l.text import printable

_NAMES = 4  # tasks that a row names; the rest are counted
_NEAR = 3  # lessons that are told, of those that would pay if they cost less


def explain_shop(shop: Shop, plan: ShopPlan, reasons: Reasons) -> str:
    """The headline, a table of the lessons, and the lessons that are nearest to being given.

    "saving" is what the best plan without a lesson costs more, with all decisions made again; "others kept fixed" is
    what this plan without it costs more.
    """
    _, size = shop.groups
    counts = ", ".join(f"{int(size[plan.decision == kind].sum())} {kind.name.lower()}" for kind in Decision)
    alone = "not possible" if math.isinf(reasons.alone) else "not known" if math.isnan(reasons.alone) else None
    without = f"without any lesson {alone or f'{reasons.alone:,.1f}'}"
    lines = [f"Expected cost {plan.objective:,.1f} ({proof_of(plan)}); {without}. {counts}."]
    if reasons.lessons:
        robot = ("robot",) if len(shop.robots) > 1 else ()
        up_to = ("given up to",) if tells_costs(shop) else ()
        header = ("lesson", *robot, "costs", "pays for", "saving", "others kept fixed", *up_to)
        lines.append(aligned([header, *(_row(shop, each) for each in reasons.lessons)], names=(0, 2 + len(robot))))
    if reasons.not_given:
        near = ", ".join(_near(shop, each) for each in reasons.not_given[:_NEAR])
        rest = len(reasons.not_given) - _NEAR
        lines.append(
            f"{'No other lesson pays' if reasons.lessons else 'No lesson pays'}; {near}"
            + (f", and {rest} more in reasons.csv." if rest > 0 else ".")
        )
    elif not reasons.lessons:
        lines.append(_none_given(shop, plan, reasons))
    if reasons.unknown:
        lines.append(f"There was no time to solve again for {reasons.unknown} lessons; give more with reasons_s=….")
    return "\n".join(lines)


def reason_rows(shop: Shop, reasons: Reasons) -> list[dict[str, Any]]:
    """Lessons that are given, as `evaluation.team.page` takes them."""
    return [
        {
            "lesson": shop.lessons[each.lesson],
            "robot": shop.robots[each.robot],
            "c_demo": each.c_demo,
            "serves": served(shop, each, most=len(each.serves)),
            "saving_resolved": each.saving,
            "saving_others_fixed": each.saving_others_fixed,
            "stays_up_to": None if math.isnan(each.stays_up_to) else each.stays_up_to,
        }
        for each in reasons.lessons
    ]


def break_even_rows(shop: Shop, reasons: Reasons) -> list[dict[str, Any]]:
    """Lessons that are not given, as `evaluation.team.page` takes them."""
    return [
        {
            "lesson": shop.lessons[each.lesson],
            "robot": shop.robots[each.robot],
            "c_demo": each.c_demo,
            "pays_below": each.below,
        }
        for each in reasons.not_given
    ]


def proof_of(plan: ShopPlan) -> str:
    """How far the plan can be from the best one."""
    if plan.status == "optimal":
        return "proven optimal"
    if plan.lower_bound > 0.0:
        excess = (plan.objective - plan.lower_bound) / plan.lower_bound
        return f"{plan.status}, at most {excess:.2%} above the optimum"
    return f"{plan.status}, the optimum is at least {max(0.0, plan.lower_bound):,.1f}"  # no cost is negative


def served(shop: Shop, reason: LessonReason, most: int = _NAMES) -> str:
    """Names of the tasks that a lesson serves, copies as ×k."""
    names = [printable(name, lines=False) for name in tasks_of(shop, reason)]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more or "itself only"


def tasks_of(shop: Shop, reason: LessonReason) -> list[str]:
    """Tasks that a lesson serves, each once, with ×k for k copies."""
    task, size = shop.groups
    copies: dict[int, int] = {}
    for group in reason.serves.tolist():
        each = int(task[group])
        copies[each] = copies.get(each, 0) + int(size[group])
    return [shop.tasks[each] + (f" ×{count}" if count > 1 else "") for each, count in copies.items()]


def _row(shop: Shop, reason: LessonReason) -> tuple[str, ...]:
    robot = (printable(shop.robots[reason.robot], lines=False),) if len(shop.robots) > 1 else ()
    name = printable(shop.lessons[reason.lesson], lines=False)
    up_to = (reason.stays_up_to,) if tells_costs(shop) else ()
    numbers = (reason.saving, reason.saving_others_fixed, *up_to)
    return (name, *robot, f"{reason.c_demo:,.1f}", served(shop, reason), *map(_amount, numbers))


def _none_given(shop: Shop, plan: ShopPlan, reasons: Reasons) -> str:
    if not shop.is_limited:
        return "No lesson pays for itself."
    limits = limits_of(shop)
    if math.isnan(reasons.without_limits):
        return f"No lesson pays within {limits}; there was no time to find out whether one does without."
    if plan.objective - reasons.without_limits <= SAME * plan.objective:
        return f"No lesson pays for itself, without {limits} neither."
    return (
        f"No lesson is given because of {limits}: without, some pay, and the day costs {reasons.without_limits:,.1f}."
    )


def limits_of(shop: Shop) -> str:
    """The limits on lessons as they were given."""
    given = (("max_lessons", shop.max_lessons), ("max_teaching", shop.max_teaching))
    return " and ".join(f"{name}={value:g}" for name, value in given if math.isfinite(value))


def _near(shop: Shop, other: BreakEven) -> str:
    name = printable(shop.lessons[other.lesson], lines=False)
    robot = f" to {printable(shop.robots[other.robot], lines=False)}" if len(shop.robots) > 1 else ""
    return f"{name}{robot} would below {other.below:,.1f}"


def _amount(value: float) -> str:
    return "?" if math.isnan(value) else "needed" if math.isinf(value) else f"{value:,.1f}"


def aligned(rows: Sequence[Sequence[str]], names: tuple[int, ...]) -> str:
    """Rows under a header, columns of `names` read from the left and others from the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column in names else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])
