"""A plan as files: `plan.csv`, `plan.json`, `certificate.npz`, and a table of reasons to print."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from p2l.artifacts import finite, load_arrays, save_arrays, write_text
from p2l.errors import ArtifactError, InputError, ShapeError
from p2l.team.outcome import decide, objective
from p2l.team.problem import ORDERS, Certificate, Decision, Order, Plan, Problem, Status
from p2l.team.proof_arrays import from_arrays, to_arrays
from p2l.text import guarded_cell, printable

TABLE, SUMMARY, PROOF = "plan.csv", "plan.json", "certificate.npz"
_NUMBERS = ("p_success", "expected_cost")
_COLUMNS = ["order", "task", "decision", "skill", *_NUMBERS]
_NAMES = 4  # tasks that a row of the table of reasons names; the rest are counted


def check_place(folder: Path | str, inputs: Sequence[Path] = ()) -> None:
    """Refuse a folder in which a plan would take the place of a file that is no plan of ours.

    Args:
        folder: to write into.
        inputs: files that the plan is made from.

    Raises:
        ArtifactError: `folder` is a file, an input would be overwritten, or there is a `plan.csv` that is no plan.
    """
    place = Path(folder)
    if place.is_file():
        raise ArtifactError(f"{place}: is a file; give a folder to write the plan into")
    for path in (place / name for name in (TABLE, SUMMARY, PROOF) if (place / name).exists()):
        if any(each.exists() and each.samefile(path) for each in inputs):
            raise ArtifactError(f"{path}: is an input, and the plan would overwrite it; name another folder")
    table = place / TABLE
    try:
        with table.open(encoding="utf-8", errors="replace") as stream:
            ours = stream.readline().strip() in ("", ",".join(_COLUMNS))
    except OSError:  # there is none, or it will be told when it is written
        return
    if not ours:
        raise ArtifactError(f"{table}: is there already, and no plan of ours; name another folder")


def write_plan(folder: Path | str, problem: Problem, plan: Plan) -> None:
    """Write `plan.csv` (a row per task, in order of work), `plan.json` (the summary) and `certificate.npz` (the proof).

    In `plan.csv`, `skill` names the lesson that an attempt uses (a taught task names itself); it is empty for the
    pre-trained skills and for the person. A name that a spreadsheet would run gets an apostrophe before it.

    Raises:
        ArtifactError: see `check_place`.
        ShapeError: the plan is of another number of tasks.

    Example:
        >>> import numpy as np
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from p2l import Problem, plan, write_plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> with TemporaryDirectory() as folder:
        ...     write_plan(folder, problem, plan(problem))
        ...     print((Path(folder) / "plan.csv").read_text(), end="")
        order,task,decision,skill,p_success,expected_cost
        1,gear,act,,0.95,15
    """
    _same_size(problem, plan)
    check_place(folder)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for place, task in enumerate(plan.sequence.tolist(), start=1):
        skill = int(plan.skill[task])
        decision = Decision(int(plan.decision[task])).name.lower()
        numbers = [f"{value:.12g}" for value in (plan.p_success[task], plan.expected_cost[task])]
        lesson = guarded_cell(problem.tasks[skill]) if skill >= 0 else ""
        writer.writerow([place, guarded_cell(problem.tasks[task]), decision, lesson, *numbers])
    summary = {
        "planner": plan.planner,
        "order": problem.order,
        "status": plan.status,
        "objective": finite(plan.objective),
        "lower_bound": finite(plan.lower_bound),
        "gap": finite(plan.gap),
        "seconds": finite(plan.seconds),
        "n_tasks": problem.n,
        "n_act": plan.count(Decision.ACT),
        "n_delegate": plan.count(Decision.DELEGATE),
        "n_learn": plan.count(Decision.LEARN),
    }
    facts = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    if plan.certificate is not None:
        save_arrays(Path(folder) / PROOF, to_arrays(plan.certificate), schema="certificate", version=1)
    write_text(Path(folder) / TABLE, text.getvalue())
    write_text(Path(folder) / SUMMARY, facts)


def read_plan(folder: Path | str, problem: Problem) -> Plan:
    """Read what `write_plan` has written; `check_certificate` says whether it is true.

    Raises:
        ArtifactError: a file is missing, damaged, or not what `write_plan` writes.
        InputError: the plan is not of the tasks of this problem.

    Example:
        >>> import numpy as np
        >>> from tempfile import TemporaryDirectory
        >>> from p2l import Problem, check_certificate, plan, read_plan, write_plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> with TemporaryDirectory() as folder:
        ...     write_plan(folder, problem, plan(problem))
        ...     check_certificate(problem, read_plan(folder, problem)).optimal
        True
    """
    table, summary = Path(folder) / TABLE, _summary(Path(folder) / SUMMARY)
    index = {guarded_cell(name): place for place, name in enumerate(problem.tasks)} | {"": -1}
    try:
        with table.open(encoding="utf-8", newline="") as stream:
            header, *lines = list(csv.reader(stream, strict=True)) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ArtifactError(f"{table}: cannot be read as a plan ({error}); plan again") from error
    if header != _COLUMNS:
        raise InputError.at(table, 1, None, f"is not {','.join(_COLUMNS)}")
    columns: dict[str, list[float]] = {name: [0.0] * problem.n for name in ("decision", "skill", *_NUMBERS)}
    sequence = []
    for line, cells in enumerate(lines, start=2):
        try:
            row = dict(zip(_COLUMNS, cells, strict=True))
            if row["order"] != str(line - 1):
                raise ValueError(f"its order is '{row['order']}'")
            task = index[row["task"]]
            columns["decision"][task] = Decision[row["decision"].upper()]
            columns["skill"][task] = index[row["skill"]]
            for name in _NUMBERS:
                columns[name][task] = float(row[name])
        except (KeyError, ValueError, AttributeError, TypeError) as error:
            raise InputError.at(table, line, None, f"is no row of a plan of these tasks ({error})") from error
        sequence.append(task)
    if sorted(sequence) != list(range(problem.n)):
        raise InputError.at(table, None, None, f"does not name each of the {problem.n} tasks once")
    counts = {f"n_{kind.name.lower()}": columns["decision"].count(kind) for kind in Decision} | {"n_tasks": problem.n}
    if wrong := [name for name, count in counts.items() if summary.get(name) != count]:
        raise ArtifactError(
            f"{Path(folder) / SUMMARY}: {wrong[0]} is {summary.get(wrong[0])!r}, but {TABLE} has {counts[wrong[0]]}"
        )
    return Plan(
        planner=str(summary["planner"]),
        status=cast(Status, summary["status"]),
        sequence=np.array(sequence),
        decision=np.array(columns["decision"], dtype=np.int64),
        skill=np.array(columns["skill"], dtype=np.int64),
        p_success=np.array(columns["p_success"]),
        expected_cost=np.array(columns["expected_cost"]),
        objective=_float(summary, "objective"),
        lower_bound=_float(summary, "lower_bound"),
        gap=_float(summary, "gap"),
        seconds=_float(summary, "seconds"),
        certificate=_certificate(Path(folder) / PROOF),
    )


def planned_order(folder: Path | str) -> Order:
    """The order of work that a written plan was made for.

    Raises:
        ArtifactError: as `read_plan`.
    """
    order = str(_summary(Path(folder) / SUMMARY).get("order"))
    if order not in ORDERS:
        raise ArtifactError(f"{Path(folder) / SUMMARY}: order '{order}' is unknown; plan again")
    return cast(Order, order)


def _summary(path: Path) -> Mapping[str, Any]:
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ArtifactError(f"{path}: cannot be read as a plan's summary ({error}); plan again") from error
    if not isinstance(summary, dict) or not {"planner", "status", "objective", "lower_bound", "gap"} <= set(summary):
        raise ArtifactError(f"{path}: is no summary of a plan; plan again")
    return summary


def _float(summary: Mapping[str, Any], name: str) -> float:
    value = summary.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return math.nan  # which the check refuses
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _certificate(path: Path) -> Certificate | None:
    if not path.is_file():
        return None
    arrays = load_arrays(path, schema="certificate", version=1)
    try:
        return from_arrays(arrays)
    except (KeyError, TypeError, ValueError, ShapeError) as error:
        raise ArtifactError(f"{path}: is no certificate ({error}); plan again") from error


def _same_size(problem: Problem, plan: Plan) -> None:
    if not isinstance(cast(object, problem), Problem) or not isinstance(cast(object, plan), Plan):
        raise ShapeError(f"given a {type(problem).__name__} and a {type(plan).__name__}; expected a Problem and a Plan")
    if len(plan.decision) != problem.n:
        raise ShapeError(f"plan: is of {len(plan.decision)} tasks; the problem has {problem.n}")


def explain(problem: Problem, plan: Plan) -> str:
    """A table saying why each lesson pays: its cost, the tasks it pays for, their cost without it, and the saving.

    "Without it" keeps the other lessons and does every other task at its best; the taught task is counted in.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, explain, plan
        >>> one = np.ones(1)
        >>> problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1))
        >>> print(explain(problem, plan(problem)))  # doctest: +ELLIPSIS
        Expected cost 15.0 (proven optimal)...
    """
    _same_size(problem, plan)
    lessons = plan.decision == Decision.LEARN
    alone = objective(problem, decide(problem, np.zeros(problem.n, dtype=bool), plan.sequence), plan.sequence).total
    rows: list[tuple[str, ...]] = [("lesson", "costs", "pays for", "cost without it", "cost with it", "saving")]
    for lesson in plan.sequence[lessons[plan.sequence]].tolist():
        others = lessons.copy()
        others[lesson] = False
        without = objective(problem, decide(problem, others, plan.sequence), plan.sequence).expected_cost
        users = [task for task in plan.sequence.tolist() if plan.skill[task] == lesson and task != lesson]
        group = [lesson, *users]
        before, now = float(without[group].sum()), float(plan.expected_cost[group].sum())
        names = [printable(problem.tasks[task], lines=False) for task in users]
        listing = ", ".join(names[:_NAMES]) + (f" and {len(names) - _NAMES} more" if len(names) > _NAMES else "")
        numbers = [f"{value:,.1f}" for value in (before, now, before - now)]
        name = printable(problem.tasks[lesson], lines=False)
        rows.append((name, f"{problem.c_demo[lesson]:,.1f}", listing or "itself only", *numbers))
    counts = ", ".join(f"{plan.count(kind)} {kind.name.lower()}" for kind in Decision)
    proof = proof_text(plan.status, plan.objective, plan.lower_bound)
    total = f"Expected cost {plan.objective:,.1f} ({proof}); without any lesson {alone:,.1f}. {counts}."
    return total + "\n" + (_columns(rows) if len(rows) > 1 else "No lesson pays for itself.")


def proof_text(status: Status, objective: float, lower_bound: float) -> str:
    """How far a plan can be from the best one; its `gap` is relative to the plan, so it would say too little."""
    if status == "optimal":
        return "proven optimal"
    if lower_bound > 0.0:
        return f"{status}, at most {(objective - lower_bound) / lower_bound:.2%} above the optimum"
    return f"{status}, the optimum is at least {max(0.0, lower_bound):,.1f}"  # no cost is negative


def _columns(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    names = (0, 2)  # read from the left; numbers are compared from the right
    lines = [
        "  ".join(
            cell.ljust(w) if column in names else cell.rjust(w)
            for column, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])
