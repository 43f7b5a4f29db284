"""How plans look: colours, words and numbers that the figure and the page of a plan share; draws nothing."""

from __future__ import annotations

import math

from p2l.team.problem import Decision
from p2l.team.shop.record import Shop

COLOURS = {Decision.ACT: "#4477AA", Decision.DELEGATE: "#BBBBBB", Decision.LEARN: "#CC6677"}
MEANING = {Decision.ACT: "act (robot)", Decision.DELEGATE: "delegate (person)", Decision.LEARN: "learn (lesson)"}
ORDER = {
    "fixed": "in the given order",
    "any": "in an order that the plan chose",
    "partial": "in an order that keeps the given one",
}
UNIT = "unit of the given costs"


def amount(value: float) -> str:
    """A cost to read: one decimal, three digits below 1, and words for what is not possible.

    Example:
        >>> from p2l.evaluation.team.look import amount
        >>> amount(1234.56), amount(0.012345), amount(float("inf"))
        ('1,234.6', '0.0123', 'not possible')
    """
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else "not possible"
    size = abs(value)
    if size >= 1e12 or 0.0 < size < 1e-6:
        return f"{value:.3g}"
    digits = 1 if size >= 1.0 or size == 0.0 else 2 - math.floor(math.log10(size))
    return f"{value:,.{digits}f}"


def limits(shop: Shop) -> list[str]:
    """The limits on lessons in words; empty if there are none."""
    words = []
    if math.isfinite(shop.max_lessons):
        words.append(f"at most {shop.max_lessons:,.0f} lesson{'' if shop.max_lessons == 1 else 's'}")
    if math.isfinite(shop.max_teaching):
        words.append(f"at most {amount(shop.max_teaching)} of teaching")
    return words
