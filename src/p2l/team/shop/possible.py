"""Tasks that no plan can do: found out before anything is planned, and told by their row."""

from __future__ import annotations

import numpy as np

from p2l.errors import InputError
from p2l.records import BoolArray
from p2l.team.shop.orders import Orders
from p2l.team.shop.outcome import attempt_cost
from p2l.team.shop.record import Ruling, Shop
from p2l.team.shop.reduction import outside_costs, too_late

_NO_WAY = {
    Ruling.FREE: "cannot be done: nobody can do or teach it, and no lesson that comes in time makes an attempt "
    "possible; give it a finite cost",
    Ruling.ACT: "is to be attempted, and no attempt is possible, not by a lesson that comes in time either; give it a "
    "finite c_rob and c_fail",
    Ruling.DELEGATE: "is to be delegated, and the person cannot do it; give it a finite c_hum",
    Ruling.LEARN: "is to be taught, and cannot be; give it a finite c_demo, and do not say teachable=no",
}


def lessons_to_give(shop: Shop) -> BoolArray:
    """[R, L] lessons that can be given to a robot, and that no decision rules out."""
    can_teach: BoolArray = np.isfinite(shop.c_demo)
    can_teach[:, : shop.n] &= (shop.choice == Ruling.FREE) | (shop.choice == Ruling.LEARN)
    return can_teach


def refuse_impossible(shop: Shop, orders: Orders) -> None:
    """A plan that gives every lesson does all tasks, unless one of them has no way at all.

    Raises:
        InputError: there is such a task; the message names its row.
    """
    task, _ = shop.groups
    lost = np.flatnonzero(np.isinf(outside_costs(shop))).tolist()
    can_teach = lessons_to_give(shop)
    late = too_late(shop) if lost else np.zeros((shop.n, shop.n), dtype=bool)
    robots = np.arange(len(shop.robots))
    for group in lost:
        each, is_first = int(task[group]), group < shop.n
        choice = Ruling(int(shop.choice[each]))
        in_time = can_teach.copy()
        in_time[:, : shop.n] &= ~late[:, each]
        best = np.where(in_time, shop.transfer[:, :, each], -1.0).max(axis=1)
        attempts = attempt_cost(shop, robots, np.full(len(robots), each), np.maximum(best, 0.0))
        is_attempted = choice != Ruling.DELEGATE and not (is_first and choice == Ruling.LEARN)
        by_attempt = is_attempted and bool((np.isfinite(attempts) & (best >= 0.0)).any())
        if by_attempt or (is_first and can_teach[:, each].any()):
            continue
        what = f"task '{shop.tasks[each]}'" + ("" if is_first else ", after its first copy,")
        has_decision = choice in (Ruling.ACT, Ruling.DELEGATE, Ruling.LEARN) and (is_first or choice != Ruling.LEARN)
        problem = f"{what} {_NO_WAY[choice if has_decision else Ruling.FREE]}"
        raise InputError.at(orders.name, orders.lines[each], orders.decision if has_decision else None, problem)
