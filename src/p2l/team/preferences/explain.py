"""What a person is told: what each question is worth, and which one comes next."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

import numpy as np

from p2l.team.preferences.record import Preferences
from p2l.team.preferences.values import QuestionValue
from p2l.team.shop import Shop
from p2l.text import guarded_cell, printable

_COLUMNS = ("family", "tasks", "answered", "mean", "sd", "value", "ahead", "net")


def explain_questions(
    shop: Shop, preferences: Preferences, values: Sequence[QuestionValue], asked: Sequence[int], c_ask: float
) -> str:
    """A table of the families, the question that is worth most first, and the next question or why there is none."""
    rows = [("family", "tasks", "c_hum believed", "a question is worth")]
    for each in values:
        belief = preferences.prior[each.family]
        spread = f" ± {math.sqrt(belief.variance):,.1f}" if not belief.is_certain else ""
        worth = "answered" if each.family in asked and not spread else f"{each.value + each.ahead:,.1f}"
        name = printable(preferences.families[each.family], lines=False)
        rows.append((name, str(_copies(shop, preferences, each.family)), f"{belief.mean:,.1f}{spread}", worth))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    ]
    return "\n".join(
        [lines[0], "  ".join("-" * width for width in widths), *lines[1:], "", _next(preferences, values, c_ask)]
    )


def questions_text(
    shop: Shop, preferences: Preferences, values: Sequence[QuestionValue], asked: Sequence[int], c_ask: float
) -> str:
    """`questions.csv`: a row per family, the question that is worth most first; `net` is after c_ask."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for each in values:
        belief, copies = preferences.prior[each.family], _copies(shop, preferences, each.family)
        numbers = (belief.mean, math.sqrt(belief.variance), each.value, each.ahead, each.net(c_ask))
        head = [guarded_cell(preferences.families[each.family]), copies, "yes" if each.family in asked else "no"]
        writer.writerow([*head, *(f"{number:.9g}" for number in numbers)])
    return text.getvalue()


def _next(preferences: Preferences, values: Sequence[QuestionValue], c_ask: float) -> str:
    best = values[0]
    name = printable(preferences.families[best.family], lines=False)
    worth = f"{best.value + best.ahead:,.1f}"
    if best.net(c_ask) <= 0.0:
        return f"No question is worth its cost of {c_ask:,.1f}; the best, '{name}', is worth {worth}. The plan stands."
    return (
        f"Next question: what does it cost you to do one task of '{name}'? The answer is worth {worth} and costs "
        f"{c_ask:,.1f}; add it to the answers as a row {name},<cost>, and say this again."
    )


def _copies(shop: Shop, preferences: Preferences, family: int) -> int:
    return int(shop.count[(preferences.member == family) & np.isfinite(shop.c_hum)].sum())
