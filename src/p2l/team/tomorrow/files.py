"""A plan for today and tomorrow as files: `plan.csv`, `tomorrow.csv`, `plan.json` with all of it, `certificate.npz`."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from p2l.artifacts import finite
from p2l.errors import ArtifactError, InputError, ShapeError
from p2l.team.problem import Status
from p2l.team.shop.files import (
    SUMMARY,
    TABLE,
    check_table,
    named_rows,
    read_summary,
    table_text,
    write_files,
)
from p2l.team.shop.proof_file import PROOF, read_proof
from p2l.team.shop.record import ShopPlan
from p2l.team.tomorrow.reading import TwoStageReading
from p2l.team.tomorrow.reasons import LessonLater, LessonTimes, LessonToday
from p2l.team.tomorrow.record import COMMITS, Commit, TwoStage, TwoStagePlan
from p2l.team.tomorrow.sampling import Estimate
from p2l.text import guarded_cell

LESSONS = "tomorrow.csv"
FILES = (TABLE, LESSONS, SUMMARY, PROOF, "plan.html")
PLANNER = "two_stage"
_GROUPS = {"taught": np.int64, "sequence": np.int64, "decision": np.int64, "robot": np.int64, "lesson": np.int64,
           "p_success": np.float64, "expected_cost": np.float64}  # fmt: skip


@dataclass(frozen=True)
class TwoStageSetting:
    """What a plan for both days was asked for beside its tables."""

    commit: Commit
    samples: int
    seed: int


def write_two_stage_plan(
    folder: Path | str,
    reading: TwoStageReading,
    plan: TwoStagePlan,
    reasons: LessonTimes,
    setting: TwoStageSetting,
    estimate: Estimate | None = None,
) -> None:
    """Write `plan.csv` (today), `tomorrow.csv` (lessons now and later), `plan.json` and `certificate.npz`."""
    program = reading.program
    lessons = lesson_rows(program, reasons)
    for row in lessons:
        row["saving"] = None if row["saving"] is None else finite(row["saving"])
    summary = {
        "planner": PLANNER,
        "status": plan.status,
        "objective": finite(plan.objective),
        "lower_bound": finite(plan.lower_bound),
        "gap": finite(plan.gap),
        "seconds": finite(plan.seconds),
        "remarks": list(reading.day.remarks),
        "setting": {"commit": setting.commit, "samples": setting.samples, "seed": setting.seed},
        "estimate": None if estimate is None else _estimate(estimate),
        **_summed_up(program, plan),
        "lessons": lessons,
        "groups": {name: getattr(plan.today, name).tolist() for name in _GROUPS},
        "later": plan.later.tolist(),
        "scenarios": _scenarios(reading, plan),
    }
    texts = {LESSONS: lessons_text(lessons), TABLE: table_text(program.today, plan.today, reading.day.extra)}
    write_files(Path(folder), summary, plan.certificate, texts)


def lessons_text(lessons: Sequence[Mapping[str, Any]]) -> str:
    """`tomorrow.csv`: a row per lesson that is given today, or in some scenario tomorrow (see `lesson_rows`)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = ["lesson", "robot", "when", "c_demo", "serves_today", "uses_tomorrow", "share_taught_tomorrow", "saving"]
    writer.writerow(names)
    for lesson in lessons:
        row = {**lesson, "serves_today": "; ".join(lesson["serves_today"])}
        cells = ["" if row[name] is None else row[name] for name in names]
        writer.writerow([guarded_cell(each) if isinstance(each, str) else f"{each:.12g}" for each in cells])
    return text.getvalue()


def read_two_stage_plan(folder: Path | str, reading: TwoStageReading) -> TwoStagePlan:
    """Read what `write_two_stage_plan` has written; `check_two_stage_plan` says whether it is true.

    Raises:
        ArtifactError: a file is missing, damaged, or not what `write_two_stage_plan` writes.
        InputError: the plan is not of these tables, or `plan.csv` is not the table of `plan.json`.
    """
    out, program = Path(folder), reading.program
    summary = read_summary(out)
    try:
        groups: dict[str, Any] = {name: np.array(summary["groups"][name], dtype=kind) for name, kind in _GROUPS.items()}
        today = ShopPlan(
            planner=PLANNER, status="heuristic", objective=_float(summary["cost_today"]), lower_bound=0.0,
            gap=1.0, seconds=0.0, **groups,
        )  # fmt: skip
        plan = TwoStagePlan(
            today=today, later=np.array(summary["later"], dtype=np.int64),
            tomorrow=np.array([_float(each["cost"]) for each in summary["scenarios"]]),
            objective=_float(summary["objective"]), lower_bound=_float(summary["lower_bound"]),
            gap=_float(summary["gap"]), status=cast(Status, summary["status"]), seconds=_float(summary["seconds"]),
            certificate=read_proof(out / PROOF),
        )  # fmt: skip
        if len(today.sequence) != len(program.today.groups[0]) or len(plan.tomorrow) != program.scenarios:
            raise ValueError("its tasks or its scenarios are others")
        for name, truth in _summed_up(program, plan).items():
            if summary[name] != truth:
                raise ValueError(f"its '{name}' is not what these tables and its decisions give")
        if summary["scenarios"] != _scenarios(reading, plan):
            raise ValueError("its scenarios are others")
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, ShapeError, OverflowError) as error:
        raise InputError.at(out / SUMMARY, None, None, f"is no plan of these tables ({error}); plan again") from error
    check_table(out, table_text(program.today, today, reading.day.extra))
    return plan


def is_two_stage(folder: Path | str) -> bool:
    """Whether a folder holds a plan for today and tomorrow.

    Raises:
        ArtifactError: as `read_summary`.
    """
    return read_summary(Path(folder))["planner"] == PLANNER


def setting_of(folder: Path | str) -> TwoStageSetting:
    """What a written plan was asked for.

    Raises:
        ArtifactError: as `read_summary`, or a setting that there is not.
    """
    summary = read_summary(Path(folder))
    given = summary.get("setting")
    setting: dict[str, Any] = given if isinstance(given, dict) else {}
    numbers = [setting.get(name) for name in ("samples", "seed")]
    if not all(type(each) is int for each in numbers) or setting.get("commit") not in COMMITS:
        raise ArtifactError(f"{Path(folder) / SUMMARY}: what was planned for is unknown; plan again")
    return TwoStageSetting(setting["commit"], setting["samples"], setting["seed"])


def _summed_up(program: TwoStage, plan: TwoStagePlan) -> dict[str, Any]:
    """What of `plan.json` follows from the tables and the decisions."""
    shop = program.today
    return {
        "order": shop.order,
        "max_lessons": finite(shop.max_lessons),
        "max_teaching": finite(shop.max_teaching),
        "commit": program.commit,
        "n_scenarios": program.scenarios,
        "cost_today": finite(plan.today.objective),
        "cost_tomorrow": finite(math.fsum((program.probability * plan.tomorrow).tolist())),
        "plan": named_rows(shop, plan.today),
    }


def _scenarios(reading: TwoStageReading, plan: TwoStagePlan) -> list[dict[str, Any]]:
    program = reading.program
    names = reading.names or tuple(str(each) for each in range(1, program.scenarios + 1))
    return [
        {
            "scenario": name,
            "probability": p,
            "cost": cost,
            "counts": {program.types[j]: counts[j] for j in np.flatnonzero(counts).tolist()},
        }
        for name, p, cost, counts in zip(
            names, program.probability.tolist(), plan.tomorrow.tolist(), program.counts, strict=True
        )
    ]


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {
        "samples": "fresh" if estimate.fresh else "parts of the scenarios",
        "replications": estimate.gap.replications,
        "tomorrow": finite(estimate.tomorrow),
        "tomorrow_low": finite(estimate.low),
        "tomorrow_high": finite(estimate.high),
        "gap_mean": finite(estimate.gap.mean),
        "gap_upper": finite(estimate.gap.upper),
        "level": estimate.gap.level,
    }


def lesson_rows(program: TwoStage, reasons: LessonTimes) -> list[dict[str, Any]]:
    """Keys as the columns of `tomorrow.csv`; what does not apply is None, a saving as in `LessonToday`."""
    now: list[dict[str, Any]] = [
        {
            **_named(program, each), "when": "now", "c_demo": each.c_demo, "serves_today": list(each.serves),
            "uses_tomorrow": each.uses, "share_taught_tomorrow": None, "saving": each.saving,
        }
        for each in reasons.today
    ]  # fmt: skip
    later: list[dict[str, Any]] = [
        {
            **_named(program, each), "when": "can wait", "c_demo": each.c_demo, "serves_today": [],
            "uses_tomorrow": None, "share_taught_tomorrow": each.share, "saving": None,
        }
        for each in reasons.later
    ]  # fmt: skip
    return now + later


def _named(program: TwoStage, each: LessonToday | LessonLater) -> dict[str, Any]:
    shop = program.today
    return {"lesson": shop.lessons[each.lesson], "robot": shop.robots[each.robot]}


def _float(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return math.nan  # which the check refuses
    return float(value)
