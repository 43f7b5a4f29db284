"""Which limit it is that no plan keeps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from p2l.team.shop.record import Ruling, Shop


def fault_of(shop: Shop, can_be_kept: Callable[[Shop], bool]) -> str:
    """What to say of a shop that has no plan.

    Args:
        shop: a day.
        can_be_kept: whether a day with fewer limits has a plan; True where there is no time to find out.
    """
    own = shop.completes
    needed = np.flatnonzero((own >= 0) & (shop.choice[own] == Ruling.LEARN))
    if len(needed) > shop.max_lessons:
        return f"{len(needed)} tasks are to be taught (decision learn), and max_lessons is {shop.max_lessons:g}"
    least = math.fsum(shop.c_demo[:, needed].min(axis=0).tolist())
    if math.isfinite(least) and least > shop.max_teaching * (1.0 + 1e-12):
        what = "lesson that is to be given (decision learn) takes" if len(needed) == 1 else "lessons to be given take"
        return f"the {what} {least:g} at least, and max_teaching is {shop.max_teaching:g}"
    limits = {"max_lessons": shop.max_lessons, "max_teaching": shop.max_teaching}
    limits = {name: value for name, value in limits.items() if math.isfinite(value)}
    if not limits:
        return "some task has no way, given the decisions and the order of work"
    alone = dict(limits)
    if len(limits) == 2:
        days = {
            "max_lessons": replace(shop, max_teaching=math.inf),
            "max_teaching": replace(shop, max_lessons=math.inf),
        }
        alone = {name: value for name, value in limits.items() if not can_be_kept(days[name])}
    both = "" if alone else "both "  # each of them alone can be kept
    named = " and ".join(f"{name}={value:g}" for name, value in (alone or limits).items())
    return f"what has no way but a lesson cannot be done within {both}{named}"
