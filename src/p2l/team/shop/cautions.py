"""What a table of orders probably does not mean, though it can be planned for as it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p2l.records import Array
from p2l.team.shop.orders import listed
from p2l.team.shop.record import Shop


def cheap_failures(tasks: Sequence[str], c_hum: Array, c_rob: Array, c_fail: Array) -> tuple[str, ...]:
    """Tasks at which a failed attempt costs less than handing the task over at once.

    `c_fail` holds the person's work after the failure, the task's own included (thesis, section 3.2), so that this is
    possible only where an attempt that fails leaves less to do than there was.

    Args:
        tasks: n names.
        c_hum: [n] as in `Shop`.
        c_rob: [R, n] as in `Shop`.
        c_fail: [R, n] as in `Shop`.
    """
    cheap = np.isfinite(c_hum) & (c_rob + c_fail < c_hum).any(axis=0)
    return tuple(tasks[each] for each in np.flatnonzero(cheap))


def shop_cautions(shop: Shop) -> tuple[str, ...]:
    """What to say of a day, a sentence each."""
    return failure_remarks(cheap_failures(shop.tasks, shop.c_hum, shop.c_rob, shop.c_fail))


def failure_remarks(names: Sequence[str]) -> tuple[str, ...]:
    """A sentence on such tasks; none if there are none."""
    if not names:
        return ()
    text = "a failed attempt (c_rob + c_fail) costs less than handing over (c_hum) at"
    advice = "c_fail has to hold the person's work after a failure, the task's own included"
    return (f"{text} {listed(list(dict.fromkeys(names)))}; {advice}",)
