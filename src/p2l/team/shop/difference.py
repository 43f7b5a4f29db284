"""In what one day is another than that which a plan was made for: `difference_of`."""

from __future__ import annotations

import numpy as np

from p2l.records import Array
from p2l.team.shop.orders import listed
from p2l.team.shop.record import Shop
from p2l.team.shop.saved import SavedShop

_OF_TASKS = ("count", "choice", "c_hum")
_OF_ROBOTS = ("c_rob", "c_fail", "pretrained")


def difference_of(planned: SavedShop, here: SavedShop) -> str | None:
    """The first thing that is different, as a clause; None if nothing is, or only how often pairs were tried."""
    before, now = planned.shop, here.shop
    for kind in ("tasks", "robots", "lessons"):
        if (names := _names(kind, getattr(before, kind), getattr(now, kind))) is not None:
            return names
    if before.order != now.order:
        return f"the order of work is {now.order}, and was {before.order}"
    if set(map(tuple, before.arcs.tolist())) != set(map(tuple, now.arcs.tolist())):
        return "the partial order (before=…) has other rows"
    for limit in ("max_lessons", "max_teaching"):
        if getattr(before, limit) != getattr(now, limit):
            return f"{limit} is {getattr(now, limit):g}, and was {getattr(before, limit):g}"
    return _costs(before, now) or _columns(planned, here)


def _names(kind: str, before: tuple[str, ...], now: tuple[str, ...]) -> str | None:
    if before == now:
        return None
    gone, new = ([each for each in one if each not in other] for one, other in ((before, now), (now, before)))
    parts = [f"{listed(names)} {what}" for names, what in ((gone, "missing"), (new, "new")) if names]
    return f"{kind}: {', '.join(parts)}" if parts else f"the {kind} are in another order"


def _costs(before: Shop, now: Shop) -> str | None:
    """The first number that is different, of shops with the same names."""
    for name in (*_OF_TASKS, *_OF_ROBOTS, "c_demo", "completes", "transfer"):
        old, new = getattr(before, name), getattr(now, name)
        if (other := old != new).any():
            at = tuple(np.argwhere(other)[0].tolist())
            return f"{name} of {_place(now, name, at)} is {_number(new, at)}, and was {_number(old, at)}"
    return None


def _place(shop: Shop, name: str, at: tuple[int, ...]) -> str:
    if name in _OF_TASKS:
        return f"'{shop.tasks[at[0]]}'"
    robot = f" ({shop.robots[at[0]]})" if len(shop.robots) > 1 else ""
    if name in _OF_ROBOTS:
        return f"'{shop.tasks[at[1]]}'{robot}"
    if name == "transfer":
        return f"a lesson on '{shop.lessons[at[1]]}' to '{shop.tasks[at[2]]}'{robot}"
    return f"'{shop.lessons[at[-1]]}'{robot if name == 'c_demo' else ''}"


def _number(values: Array, at: tuple[int, ...]) -> str:
    return f"{values[at]:.12g}"


def _columns(planned: SavedShop, here: SavedShop) -> str | None:
    if dict(planned.extra) == dict(here.extra):
        return None
    names = [name for name in {**planned.extra, **here.extra} if planned.extra.get(name) != here.extra.get(name)]
    return f"other cells in {listed(names)}" if names else "columns of your own are in another order"
