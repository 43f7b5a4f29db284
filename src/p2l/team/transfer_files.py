"""Transfer tables and next trials as files, and what a person is told of them on the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from p2l.errors import ArtifactError
from p2l.team.information import MOST, Outlook, TrialValue
from p2l.text import guarded_cell, printable
from p2l.transfer.prediction import Prediction

LONG = ("taught", "tested", "p", "low", "high", "trials", "successes", "supported_by")


def transfer_text(prediction: Prediction, form: str) -> str:
    """A transfer table as CSV: `long`, a row per ordered pair, or `square`, as stage `plan` reads it."""
    names = [guarded_cell(name) for name in prediction.names]
    p, m = prediction.p, len(names)
    rows: list[Sequence[str]] = [["task", *names]]
    if form == "square":
        rows += [[name, *(f"{value:.6f}" for value in p[at])] for at, name in enumerate(names)]
        return _csv(rows)
    tried = prediction.tried
    told = [
        f"{names[i]}>{names[j]}:{s}/{n}"
        for i, j, s, n in zip(tried.taught, tried.tested, tried.successes, tried.attempts, strict=True)
    ]
    rows = [LONG]
    for pair in range(m * m):
        i, j = divmod(pair, m)
        numbers = [f"{value:.6f}" for value in (p[i, j], prediction.low[i, j], prediction.high[i, j])]
        support = "; ".join(told[row] for row in prediction.support[pair])
        counts = [str(prediction.trials[i, j]), str(prediction.successes[i, j])]
        rows.append([names[i], names[j], *numbers, *counts, support])
    return _csv(rows)


def next_trials_text(values: Sequence[TrialValue], names: Sequence[str], attempts: int) -> str:
    """The pairs worth trying as CSV, best first."""
    header = ["taught", "tested", "p", "attempts", "value", "best_attempts", "best_value"]
    rows: list[Sequence[str]] = [header]
    for each in values:
        pair = [guarded_cell(names[each.taught]), guarded_cell(names[each.tested])]
        worth = [str(attempts), f"{each.value(attempts):.6g}", str(each.best), f"{each.value(each.best):.6g}"]
        rows.append([*pair, f"{each.p:.4f}", *worth])
    return _csv(rows)


def check_output(path: Path, inputs: Sequence[Path | None]) -> None:
    """Refuse to write a transfer table where it cannot go, or over what is none of ours.

    Raises:
        ArtifactError: an input, a folder, a file of another kind, or no folder to write into.
    """
    if any(each is not None and each.exists() and path.exists() and each.samefile(path) for each in inputs):
        raise ArtifactError(f"{path}: is an input, and the table would overwrite it; name another file")
    if not path.parent.is_dir():
        raise ArtifactError(f"{path}: there is no folder {path.parent}; make it, or name another file")
    if path.is_dir():
        raise ArtifactError(f"{path}: is a folder; name a file")
    if path.exists():
        with path.open(encoding="utf-8", errors="replace") as stream:
            first = stream.readline().strip()
        if first and first != ",".join(LONG) and not first.startswith("task,"):
            raise ArtifactError(f"{path}: is there already, and no transfer table; name another file")


def report(prediction: Prediction, outlook: Outlook | None, attempts: int) -> str:
    """What a person is told: models compared, trials worth running, and one closing line."""
    choice, names = prediction.choice, [printable(name, lines=False) for name in prediction.names]
    parts = []
    if choice.scores:
        rows = [("model", "log loss per trial", "90 % interval", "better than rates by", "90 % interval")]
        for score in choice.scores:
            gain = (f"{score.gain:+.3f}", f"{score.gain_low:+.3f} to {score.gain_high:+.3f}")
            rows.append((score.model, f"{score.loss:.3f}", f"{score.low:.3f} to {score.high:.3f}", *gain))
        parts.append(_aligned(rows, left=1))
    if outlook is not None:
        parts.append(_next_trials(outlook, names, attempts))
    parts.append(_closing(prediction, outlook, names))
    return "\n\n".join(parts)


def _next_trials(outlook: Outlook, names: Sequence[str], attempts: int) -> str:
    cost = f"Today's plan costs {outlook.plan.objective:,.1f} ({outlook.plan.status})."
    if not outlook.values:
        return f"{cost} No trial of up to {MOST} attempts could change it."
    rows = [("skill of", "tried on", "p today", f"worth of {attempts}", "best number", "worth of it")]
    for each in outlook.values:
        worth = (f"{each.value(attempts):,.2f}", str(each.best), f"{each.value(each.best):,.2f}")
        rows.append((names[each.taught], names[each.tested], f"{each.p:.2f}", *worth))
    day = "for one robot, without a partial order and limits on lessons"
    return (
        f"{cost} What attempts would save of it ({day}), in its units, before their own cost:\n{_aligned(rows, left=2)}"
    )


def _closing(prediction: Prediction, outlook: Outlook | None, names: Sequence[str]) -> str:
    choice, total = prediction.choice, int(prediction.trials.sum())
    counts = f"{total} trials of {len(prediction.tried)} pairs"
    line = f"Model {choice.model} ({choice.reason}); {prediction.p.size:,} pairs predicted from {counts}"
    if outlook is not None and outlook.values:
        best = outlook.values[0]
        line += (
            f"; best next trial: {names[best.taught]} on {names[best.tested]}, {best.best}x, "
            f"worth {best.value(best.best):,.2f}"
        )
    elif outlook is not None:
        line += "; no trial could change the plan"
    return f"{line}."


def _aligned(rows: Sequence[Sequence[str]], left: int) -> str:
    """Columns, the first `left` of them read from the left."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(w) if at < left else cell.rjust(w) for at, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
    return "\n".join(line.rstrip() for line in lines)


def _csv(rows: Sequence[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
