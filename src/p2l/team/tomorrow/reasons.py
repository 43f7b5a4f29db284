"""Which lessons are taken today and why, and which can wait: what a person reads of a plan for both days."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from p2l.errors import ConfigError, SolverError
from p2l.records import IntArray
from p2l.team.plan_files import proof_text
from p2l.team.shop.explain import aligned, limits_of
from p2l.team.shop.record import Shop
from p2l.team.tomorrow.outcome import tomorrow_outcome
from p2l.team.tomorrow.planner import plan_two_stage
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan
from p2l.team.tomorrow.sampling import Estimate
from p2l.text import printable

_NAMES = 4  # tasks that a row names; the rest are counted
_ROWS = 12  # lessons that can wait and are told; the rest are in the file


@dataclass(frozen=True)
class LessonToday:
    """A lesson that is given today.

    Attributes:
        lesson: index.
        robot: index of who is taught.
        c_demo: its cost.
        serves: names of today's tasks that it serves, copies as ×k.
        uses: expected number of tomorrow's copies that it is used for.
        saving: what the best plan without this lesson today costs more, all else decided again; NaN if there was no
            time to find out, infinite if it cannot be done without.
    """

    lesson: int
    robot: int
    c_demo: float
    serves: tuple[str, ...]
    uses: float
    saving: float


@dataclass(frozen=True)
class LessonLater:
    """A lesson that can wait: its cost tomorrow, and the probability of the scenarios in which it is given then."""

    lesson: int
    robot: int
    c_demo: float
    share: float


@dataclass(frozen=True)
class LessonTimes:
    """Lessons of today in order of their saving, and those that can wait, the most probable first."""

    today: tuple[LessonToday, ...]
    later: tuple[LessonLater, ...]


def lesson_times(program: TwoStage, plan: TwoStagePlan, *, time_limit_s: float = 10.0) -> LessonTimes:
    """Why each lesson is given today, by one more plan without it, and which lessons can wait.

    Args:
        program: today and tomorrow.
        plan: of both.
        time_limit_s: wall seconds for all plans; a saving that is not found in time is NaN.
    """
    deadline = time.perf_counter() + time_limit_s
    uses = tomorrow_outcome(program, plan.taught, plan.later).uses
    today = []
    for place, (lesson, robot) in enumerate(plan.taught.tolist()):
        names = _served(program.today, plan, lesson, robot)
        c_demo = float(program.today.c_demo[robot, lesson])
        saving = _saving(program, plan, lesson, robot, deadline)
        today.append(LessonToday(lesson, robot, c_demo, names, float(uses[place]), saving))
    later = [
        LessonLater(lesson, robot, float(program.c_demo[robot, lesson]), share)
        for lesson, robot, share in plan.shares(program)
    ]
    return LessonTimes(tuple(sorted(today, key=lambda each: -np.nan_to_num(each.saving, nan=-1.0))), tuple(later))


def _saving(program: TwoStage, plan: TwoStagePlan, lesson: int, robot: int, deadline: float) -> float:
    left = deadline - time.perf_counter()
    if left <= 0.0:
        return math.nan
    c_demo = program.today.c_demo.copy()
    c_demo[robot, lesson] = np.inf
    without = replace(program, today=replace(program.today, c_demo=c_demo))
    try:
        other = plan_two_stage(without, time_limit_s=left, gap=min(0.5, plan.gap))
    except ConfigError:
        return math.inf
    except SolverError:
        return math.nan
    return max(0.0, other.objective - plan.objective) if other.status != "time_limit" else math.nan


def _served(shop: Shop, plan: TwoStagePlan, lesson: int, robot: int) -> tuple[str, ...]:
    task, size = shop.groups
    uses = (plan.today.lesson == lesson) & (plan.today.robot == robot)
    uses[: shop.n] |= (np.arange(shop.n) == shop.completes[lesson]) & (shop.completes[lesson] >= 0)
    copies: dict[int, int] = {}
    groups: IntArray = np.flatnonzero(uses)
    for group in groups.tolist():
        copies[int(task[group])] = copies.get(int(task[group]), 0) + int(size[group])
    return tuple(shop.tasks[each] + (f" ×{count}" if count > 1 else "") for each, count in copies.items())


def explain_two_stage(
    program: TwoStage, plan: TwoStagePlan, reasons: LessonTimes, estimate: Estimate | None = None, asked: int = 0
) -> str:
    """The headline, what sampling leaves open, and a table of lessons: now, or later and how probably.

    `asked` is how many replications the estimate was to have.
    """
    mean = float(program.probability @ plan.tomorrow)
    many = f"{program.scenarios} scenario{'' if program.scenarios == 1 else 's'}"
    proof = f"{proof_text(plan.status, plan.objective, plan.lower_bound)} for {many}"
    parts = f"today {plan.today.objective:,.1f}, tomorrow {mean:,.1f}"
    lines = [f"Expected cost {plan.objective:,.1f} ({proof}): {parts}."]
    if estimate is not None:
        lines.append(explain_estimate(estimate))
        if 2 <= estimate.gap.replications < asked and estimate.fresh:
            lines.append(f"There was time for {estimate.gap.replications} of {asked} samples (time_limit_s=…).")
    rows = [_now(program, each) for each in reasons.today] + [_then(program, each) for each in reasons.later[:_ROWS]]
    robot = len(program.today.robots) > 1
    header = ("lesson", *(("robot",) if robot else ()), "when", "costs", "today", "tomorrow", "saving")
    if rows:
        names = (0, 1, 3, 4) if not robot else (0, 1, 2, 4, 5)
        lines.append(aligned([header, *rows], names))
    else:
        within = f" within {limits_of(program.today)}" if program.today.is_limited else ""
        lines.append(f"No lesson pays{within}, neither today nor tomorrow.")
    if (rest := len(reasons.later) - _ROWS) > 0:
        lines.append(f"{rest} more that may pay tomorrow in tomorrow.csv.")
    if program.commit == "all":
        lines.append("No lesson is given tomorrow (commit=all).")
    return "\n".join(lines)


def explain_estimate(estimate: Estimate) -> str:
    """What fresh samples, or parts of a file, say of the plan."""
    gap = estimate.gap
    what = f"{gap.replications} fresh samples" if estimate.fresh else f"{gap.replications} parts of the scenarios"
    if math.isnan(gap.upper):
        return f"There was time for {what} only; too few for an interval."
    return (
        f"Over {what} tomorrow costs {estimate.tomorrow:,.1f} ({estimate.low:,.1f} to {estimate.high:,.1f}, 95 %), and "
        f"this plan at most {gap.upper:,.2f} more than the best one (95 %; on average {gap.mean:,.2f})."
    )


def _now(program: TwoStage, each: LessonToday) -> tuple[str, ...]:
    names = [printable(name, lines=False) for name in each.serves]
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    saving = "?" if math.isnan(each.saving) else "needed" if math.isinf(each.saving) else f"{each.saving:,.1f}"
    served = ", ".join(names[:_NAMES]) + more or "-"
    uses = f"{each.uses:,.1f} tasks" if each.uses > 0.0 else "-"
    return (*_head(program, each.lesson, each.robot), "now", f"{each.c_demo:,.1f}", served, uses, saving)


def _then(program: TwoStage, each: LessonLater) -> tuple[str, ...]:
    share = f"taught in {max(each.share, 0.001):.1%} of cases"
    return (*_head(program, each.lesson, each.robot), "can wait", f"{each.c_demo:,.1f}", "-", share, "")


def _head(program: TwoStage, lesson: int, robot: int) -> tuple[str, ...]:
    shop = program.today
    pupil = (printable(shop.robots[robot], lines=False),) if len(shop.robots) > 1 else ()
    return (printable(shop.lessons[lesson], lines=False), *pupil)
