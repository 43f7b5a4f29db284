"""Is `tomorrow.csv` what a plan for both days gives? What a lesson saves takes another plan: this asks the planner."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from p2l.errors import ArtifactError, InputError
from p2l.team.shop.files import SUMMARY, read_summary
from p2l.team.tomorrow.files import LESSONS, lesson_rows, lessons_text
from p2l.team.tomorrow.reasons import lesson_times
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan

_AGREES = 1e-8  # relative to the plan's cost: what two sums of the same terms may differ by
_EXACT = ("lesson", "robot", "when", "serves_today")
_NUMBERS = ("c_demo", "uses_tomorrow", "share_taught_tomorrow")


class CheckedLessons(NamedTuple):
    """How many lessons there are, and of how many nobody knows what they save, for want of time now or then."""

    lessons: int
    unknown: int


def check_lessons(folder: Path | str, program: TwoStage, plan: TwoStagePlan, *, time_limit_s: float) -> CheckedLessons:
    """Recompute `tomorrow.csv` and the lessons of `plan.json`: which, when, their costs, uses, shares and savings.

    Args:
        folder: what `files.write_two_stage_plan` has written.
        program: today and tomorrow.
        plan: the plan in the folder, which `check_two_stage_plan` has not refused.
        time_limit_s: wall seconds for what lessons save; where it does not suffice, the rest is checked.

    Raises:
        ArtifactError: a file cannot be read.
        InputError: a lesson or one of its cells is not what these tables and this plan give.
    """
    path = Path(folder) / LESSONS
    try:
        written = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ArtifactError(f"{path}: cannot be read as the lessons of a plan ({error}); plan again") from error
    told = read_summary(Path(folder)).get("lessons")
    try:
        if not isinstance(told, list) or written != lessons_text(told):
            raise InputError.at(path, None, None, f"is not what {SUMMARY} says; plan again")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        problem = f"its lessons are none of ours ({error}); plan again"
        raise InputError.at(path.with_name(SUMMARY), None, None, problem) from error
    truth = {_key(row): row for row in lesson_rows(program, lesson_times(program, plan, time_limit_s=time_limit_s))}
    if absent := [key for key in truth if key not in map(_key, told)]:
        raise InputError.at(path, None, "lesson", f"a row for '{absent[0][0]}' is missing; plan again")
    if len(told) != len(truth):
        raise InputError.at(path, None, "lesson", "has a row for a lesson that this plan does not give; plan again")
    unknown = 0
    for line, row in enumerate(told, start=2):
        found = truth[_key(row)]
        wrong = [name for name in _EXACT if row[name] != found[name]]
        wrong += [name for name in _NUMBERS if not _agree(row[name], found[name])]
        if wrong:
            problem = f"is not what the plan says ({found[wrong[0]]}); plan again"
            raise InputError.at(path, line, wrong[0], problem)
        unknown += _is_unknown(path, line, row, found, plan)
    return CheckedLessons(len(told), unknown)


def _is_unknown(path: Path, line: int, row: Mapping[str, Any], found: Mapping[str, Any], plan: TwoStagePlan) -> bool:
    """Whether a lesson's saving cannot be compared; raises where it can and differs."""
    told, saving = row["saving"], found["saving"]
    if saving is None or math.isnan(saving):
        return saving is not None
    if math.isinf(saving):  # nothing is written of what cannot be done without
        if told is not None:
            raise InputError.at(path, line, "saving", f"is {told}, but nothing can be done without it; plan again")
        return False
    if told is None:
        return True
    slack = _AGREES * max(1.0, abs(plan.objective)) + plan.gap * (abs(plan.objective) + saving)
    if not _agree(told, saving, slack):
        raise InputError.at(path, line, "saving", f"is not what solving again gives ({saving:.12g}); plan again")
    return False


def _key(row: Mapping[str, Any]) -> tuple[str, str, str]:
    return row["lesson"], row["robot"], row["when"]


def _agree(told: object, found: float | None, slack: float = 0.0) -> bool:
    if told is None or found is None:
        return told is found
    allowed = slack + _AGREES * max(1.0, abs(found))
    return isinstance(told, (int, float)) and abs(told - found) <= allowed
