"""A shop's plan as files: `plan.csv` to read, `plan.json` with all of it, `certificate.npz`, `reasons.csv`."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from p2l.artifacts import finite, save_arrays, write_text
from p2l.errors import ArtifactError, InputError, ShapeError
from p2l.team.plan_files import read_plan
from p2l.team.problem import Decision, Plan, Status
from p2l.team.shop.explain import tasks_of
from p2l.team.shop.proof_file import PROOF, proof_arrays, read_proof
from p2l.team.shop.reasons import Reasons
from p2l.team.shop.record import SHOP_ORDERS, Shop, ShopCertificate, ShopPlan
from p2l.team.shop.rows import plan_rows
from p2l.team.shop.saved import SHOP
from p2l.text import guarded_cell

TABLE, SUMMARY, REASONS = "plan.csv", "plan.json", "reasons.csv"
FILES = (TABLE, SUMMARY, PROOF, REASONS, SHOP, "plan.png", "plan.html")
WITHOUT, UNKNOWN = "without_lessons", "unknown_reasons"  # keys of plan.json
_FIRST, _LAST = ["order", "task"], ["skill", "p_success", "expected_cost"]
_GROUPS = {"taught": np.int64, "sequence": np.int64, "decision": np.int64, "robot": np.int64, "lesson": np.int64,
           "p_success": np.float64, "expected_cost": np.float64}  # fmt: skip


def check_shop_place(folder: Path | str, inputs: Sequence[Path] = (), files: Sequence[str] = FILES) -> None:
    """Refuse a folder in which a plan would take the place of what it is made from, such as an earlier plan.

    Raises:
        ArtifactError: `folder` is a file, or an input would be overwritten.
    """
    place = Path(folder)
    if place.is_file():
        raise ArtifactError(f"{place}: is a file; give a folder to write the plan into")
    for path in (place / name for name in files if (place / name).exists()):
        if any(each.exists() and each.samefile(path) for each in inputs):
            raise ArtifactError(f"{path}: is an input, and the plan would overwrite it; name another folder")


def of_plan(plan: Plan) -> ShopPlan:
    """The plan of a thesis's problem as one of `Shop.of_problem`."""
    lessons = np.array([task for task in plan.sequence.tolist() if plan.decision[task] == Decision.LEARN], np.int64)
    proof = None
    if plan.certificate is not None:
        root = np.full(1, -1)
        proof = ShopCertificate(root, root, root, (plan.certificate,))
    return ShopPlan(
        planner=plan.planner, status=plan.status, taught=np.stack([lessons, np.zeros_like(lessons)], axis=1),
        sequence=plan.sequence, decision=plan.decision, robot=np.where(plan.decision == Decision.DELEGATE, -1, 0),
        lesson=plan.skill, p_success=plan.p_success, expected_cost=plan.expected_cost, objective=plan.objective,
        lower_bound=plan.lower_bound, gap=plan.gap, seconds=plan.seconds, certificate=proof,
    )  # fmt: skip


def named_rows(shop: Shop, plan: ShopPlan) -> list[dict[str, Any]]:
    """A row for every step of the day (`rows.plan_rows`) with names.

    Keys: order, task, count, decision, robot, skill (the lesson's name, '' for pre-trained skills or the person),
    p_success, expected_cost.
    """
    return [
        {
            "order": place,
            "task": shop.tasks[row.task] if row.task >= 0 else shop.lessons[row.lesson],
            "count": max(1, row.copies),
            "decision": row.decision.name.lower(),
            "robot": " + ".join(shop.robots[robot] for robot in row.robots),
            "skill": shop.lessons[row.lesson] if row.lesson >= 0 else "",
            "p_success": row.p_success,
            "expected_cost": row.expected_cost,
        }
        for place, row in enumerate(plan_rows(shop, plan), start=1)
    ]


def columns_of(shop: Shop) -> list[str]:
    """Columns of `plan.csv`; `count` and `robot` only where they say something."""
    count = ["count"] if bool((shop.count > 1).any()) else []
    robot = ["robot"] if len(shop.robots) > 1 else []
    return [*_FIRST, *count, "decision", *robot, *_LAST]


def table_text(shop: Shop, plan: ShopPlan, extra: Mapping[str, tuple[str, ...]] | None = None) -> str:
    """`plan.csv`: `named_rows`, then a person's own columns [n cells by name]; one that is named as ours says so."""
    columns, more = columns_of(shop), dict(extra or {})
    place = {name: index for index, name in enumerate(shop.tasks)}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    taken = {*_FIRST, "count", "decision", "robot", *_LAST}
    writer.writerow([*columns, *(f"{name} (given)" if name in taken else guarded_cell(name) for name in more)])
    for row in named_rows(shop, plan):
        cells = [f"{row[name]:.12g}" if name in _LAST[1:] else guarded_cell(str(row[name])) for name in columns]
        at = place.get(row["task"])
        writer.writerow([*cells, *("" if at is None else guarded_cell(values[at]) for values in more.values())])
    return text.getvalue()


def write_shop_plan(
    folder: Path | str,
    shop: Shop,
    plan: ShopPlan,
    reasons: Reasons,
    *,
    extra: Mapping[str, tuple[str, ...]] | None = None,
    remarks: tuple[str, ...] = (),
) -> None:
    """Write `plan.csv`, `plan.json`, `certificate.npz` and `reasons.csv`; the caller has checked the place."""
    summary = {
        "planner": plan.planner,
        "status": plan.status,
        "objective": finite(plan.objective),
        "lower_bound": finite(plan.lower_bound),
        "gap": finite(plan.gap),
        "seconds": finite(plan.seconds),
        WITHOUT: finite(reasons.alone),
        UNKNOWN: reasons.unknown + math.isnan(reasons.alone),
        "remarks": list(remarks),
        **_summed_up(shop, plan),
        "groups": {name: getattr(plan, name).tolist() for name in _GROUPS},
    }
    texts = {REASONS: reasons_text(shop, reasons), TABLE: table_text(shop, plan, extra)}
    write_files(Path(folder), summary, plan.certificate, texts)


def write_files(out: Path, summary: Mapping[str, Any], proof: ShopCertificate | None, texts: Mapping[str, str]) -> None:
    """Write `certificate.npz`, tables by their names, and `plan.json`; nothing is written before all of it is text."""
    facts = json.dumps(summary, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    if proof is not None:
        save_arrays(out / PROOF, proof_arrays(proof), schema="shop_certificate", version=1)
    for name, text in (*texts.items(), (SUMMARY, facts)):
        write_text(out / name, text)


def reasons_text(shop: Shop, reasons: Reasons) -> str:
    """`reasons.csv`: lessons that are given, then what others would have to cost."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = ["lesson", "robot", "given", "c_demo", "serves", "saving", "saving_others_fixed", "given_below"]
    writer.writerow(names)
    for each in reasons.lessons:
        users = "; ".join(tasks_of(shop, each))
        numbers = (each.saving, each.saving_others_fixed, each.stays_up_to)
        head = [guarded_cell(shop.lessons[each.lesson]), guarded_cell(shop.robots[each.robot]), "yes"]
        writer.writerow([*head, _number(each.c_demo), guarded_cell(users), *map(_number, numbers)])
    for other in reasons.not_given:
        head = [guarded_cell(shop.lessons[other.lesson]), guarded_cell(shop.robots[other.robot]), "no"]
        writer.writerow([*head, _number(other.c_demo), "", "", "", _number(other.below)])
    return text.getvalue()


def read_shop_plan(folder: Path | str, shop: Shop, extra: Mapping[str, tuple[str, ...]] | None = None) -> ShopPlan:
    """Read what `write_shop_plan` has written; `check_shop_plan` says whether it is true.

    Raises:
        ArtifactError: a file is missing, damaged, or not what `write_shop_plan` writes.
        InputError: the plan is not of this shop, or `plan.csv` is not the table of `plan.json`.
    """
    out = Path(folder)
    summary = read_summary(out)
    if "groups" not in summary and (problem := shop.problem()) is not None:
        return of_plan(read_plan(out, problem))  # what `p2l.write_plan` writes
    try:
        groups: dict[str, Any] = {name: np.array(summary["groups"][name], dtype=kind) for name, kind in _GROUPS.items()}
        plan = ShopPlan(
            planner=str(summary["planner"]), status=cast(Status, summary["status"]),
            objective=_float(summary, "objective"), lower_bound=_float(summary, "lower_bound"),
            gap=_float(summary, "gap"), seconds=_float(summary, "seconds"), certificate=read_proof(out / PROOF),
            **groups,
        )  # fmt: skip
        if len(plan.sequence) != len(shop.groups[0]):
            raise ValueError("its tasks are others")
        for name, truth in _summed_up(shop, plan).items():
            if summary[name] != truth:
                raise ValueError(f"its '{name}' is not what these tasks and its decisions give")
    except IndexError as error:
        what = "it names tasks, robots or lessons by numbers that there are not"
        raise InputError.at(out / SUMMARY, None, None, f"is no plan of these tasks ({what}); plan again") from error
    except (KeyError, ValueError, TypeError, AttributeError, ShapeError, OverflowError) as error:
        raise InputError.at(out / SUMMARY, None, None, f"is no plan of these tasks ({error}); plan again") from error
    check_table(out, table_text(shop, plan, extra))
    return plan


def check_table(out: Path, expected: str) -> None:
    """Refuse a `plan.csv` that is not the table of `plan.json`.

    Raises:
        ArtifactError: it cannot be read.
        InputError: it is another; the message has the first row that differs.
    """
    try:
        text = (out / TABLE).read_bytes().decode()  # line breaks in a person's cells stay as they are
    except (OSError, UnicodeDecodeError) as error:
        raise ArtifactError(f"{out / TABLE}: cannot be read as a plan ({error}); plan again") from error
    if text != expected:
        lines = zip(text.splitlines(), expected.splitlines(), strict=False)
        line = next((at for at, (one, other) in enumerate(lines, start=1) if one != other), None)
        raise InputError.at(out / TABLE, line, None, f"is not what {SUMMARY} says; plan again")


def read_summary(folder: Path) -> dict[str, Any]:
    """`plan.json`.

    Raises:
        ArtifactError: missing, or no summary of a plan.
    """
    path = folder / SUMMARY
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ArtifactError(f"{path}: cannot be read as a plan's summary ({error}); plan again") from error
    if not isinstance(summary, dict) or not {"planner", "status", "objective", "order"} <= set(summary):
        raise ArtifactError(f"{path}: is no summary of a plan; plan again")
    return summary


def settings_of(folder: Path | str) -> tuple[Literal["fixed", "any"], float | None, float | None]:
    """Order, `max_lessons` and `max_teaching` that a written plan was made for; a partial order is in its own file.

    Raises:
        ArtifactError: as `read_summary`, or settings that there are not.
    """
    summary = read_summary(Path(folder))
    limits = [summary.get(name) for name in ("max_lessons", "max_teaching")]
    largest = sys.float_info.max  # an integer of a file may be more
    numbers = [each is None or (isinstance(each, (int, float)) and 0.0 <= each <= largest) for each in limits]
    if summary["order"] not in SHOP_ORDERS or not all(numbers):
        raise ArtifactError(f"{Path(folder) / SUMMARY}: its order or its limits are unknown; plan again")
    lessons, teaching = (None if each is None else float(each) for each in limits)
    return "any" if summary["order"] == "any" else "fixed", lessons, teaching


def _summed_up(shop: Shop, plan: ShopPlan) -> dict[str, Any]:
    """What of `plan.json` follows from the shop and the decisions."""
    return {
        "order": shop.order,
        "n_tasks": int(shop.count.sum()),
        **{f"n_{kind.name.lower()}": _copies(shop, plan, kind) for kind in Decision},
        "max_lessons": finite(shop.max_lessons),
        "max_teaching": finite(shop.max_teaching),
        "lessons": [
            {"lesson": shop.lessons[each], "robot": shop.robots[r], "c_demo": float(shop.c_demo[r, each])}
            for each, r in plan.taught.tolist()
        ],
        "plan": named_rows(shop, plan),
    }


def _copies(shop: Shop, plan: ShopPlan, kind: Decision) -> int:
    _, size = shop.groups
    return int(size[plan.decision == kind].sum())


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.12g}"


def _float(summary: Mapping[str, Any], name: str) -> float:
    value = summary.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return math.nan  # which the check refuses
    return float(value)
