"""A person's own day as a `Shop`: tables of orders, transfer, robots and a partial order, with whatever they leave out.

Reading stops at the first thing that is wrong, with one message that names the file, the row and the column. What had
to be assumed is said in `ShopReading.remarks`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.team.sheets import Sheet, check_standard_input, read_sheet
from p2l.team.shop.lessons import TransferTable, misspelt, open_table
from p2l.team.shop.measurements import Measured, read_probabilities
from p2l.team.shop.orders import Orders, listed, read_orders
from p2l.team.shop.possible import lessons_to_give, refuse_impossible
from p2l.team.shop.record import SHOP_ORDERS, Ruling, Shop, ShopOrder
from p2l.team.shop.reduction import too_late
from p2l.team.shop.robots import Robots, read_before, read_robots
from p2l.team.shop.saved import SavedShop

Filling = Callable[[tuple[str, ...], tuple[str, ...]], Array]


@dataclass(frozen=True)
class ShopReading:
    """What a person's tables say.

    Attributes:
        shop: the day.
        remarks: what was assumed, a sentence each.
        extra: columns of the orders that are not ours: n cells of each, by its name as written.
        family: [n] family of each task, '' where it has none; None if the orders have no such column.
        trials: [R, L, n] attempts behind each transfer probability, 0 where nobody has counted any.
    """

    shop: Shop
    remarks: tuple[str, ...]
    extra: Mapping[str, tuple[str, ...]]
    family: tuple[str, ...] | None
    trials: Array

    @property
    def saved(self) -> SavedShop:
        """What a day needs of it."""
        return SavedShop(self.shop, self.trials, self.extra)


def read_shop(
    orders: Path | str,
    transfer: Path | str | None,
    *,
    before: Path | str | None = None,
    robots: Path | str | None = None,
    order: ShopOrder = "fixed",
    max_lessons: float = math.inf,
    max_teaching: float = math.inf,
    fill: float | None = None,
    filling: Filling | None = None,
) -> ShopReading:
    r"""Read a day.

    Args:
        orders: a table that `orders.read_orders` describes.
        transfer: a table that `lessons.open_table` describes, with gaps or without; None if there is none.
        before: a table that `robots.read_before` describes. Work is then in any order that keeps it, whatever `order`.
        robots: a table that `robots.read_robots` describes; None for one robot, named "robot".
        order: "fixed", "any" or "partial".
        max_lessons: as in `Shop`.
        max_teaching: as in `Shop`.
        fill: probability of the pairs that the transfer table does not have.
        filling: model of these pairs, which `fill` is not asked for then: names of K lessons and of M tasks to [K, M]
            probabilities.

    Raises:
        InputError: a table that cannot be read, holds what it should not, or lacks what a plan needs; a task that
            nobody can do or teach.
        ConfigError: an unknown order, a limit below 0, a fill that is no probability.
        ShapeError: `filling` does not give what it should.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from p2l.team.shop import read_shop
        >>> with TemporaryDirectory() as folder:
        ...     orders, transfer = Path(folder) / "orders.csv", Path(folder) / "transfer.csv"
        ...     _ = orders.write_text("task,c_rob,c_hum,c_fail,c_demo,count\npeg,1,9,9,12,3\nlid,1,9,9,12,1\n")
        ...     _ = transfer.write_text("taught,tested,p\npeg,peg,0.9\npeg,lid,0.5\n")
        ...     day = read_shop(orders, transfer, order="any", fill=0)
        >>> day.shop.transfer[0].tolist(), day.remarks
        ([[0.9, 0.5], [0.0, 1.0]], ('1 of 3 pairs has no value in transfer.csv; taken as 0 (fill=0)',))
    """
    _check_settings(order, max_lessons, max_teaching, fill)
    check_standard_input(orders, transfer, before, robots)
    today = read_orders(read_sheet(orders))
    table, team = (None if each is None else read_sheet(each) for each in (transfer, robots))
    arcs = None if before is None else read_before(read_sheet(before), today.tasks)
    limits = (max_lessons, max_teaching)
    reading = shop_of_orders(today, table, team, order, arcs, limits, fill=fill, filling=filling)
    refuse_impossible(reading.shop, today)
    return reading


def shop_of_orders(
    today: Orders,
    transfer: Sheet | None,
    robots: Sheet | None,
    order: ShopOrder = "fixed",
    arcs: IntArray | None = None,
    limits: tuple[float, float] = (math.inf, math.inf),
    *,
    fill: float | None = None,
    filling: Filling | None = None,
) -> ShopReading:
    """As `read_shop`, of orders and tables that are read already; whether every task can be done is not asked.

    Args:
        today: n orders.
        transfer: as in `read_shop`.
        robots: as in `read_shop`.
        order: without arcs.
        arcs: [P, 2] of a partial order, None for none.
        limits: `max_lessons` and `max_teaching`.
        fill: as in `read_shop`.
        filling: as in `read_shop`.

    Raises:
        InputError: as `read_shop`.
        ShapeError: as `read_shop`.
    """
    table = open_table(transfer, today)
    known = set(today.tasks)
    others = {name: cost for name, cost in table.c_demo.items() if name not in known}
    team = read_robots(robots, today, others)
    lessons, c_demo, remarks = _lessons(today, table, tuple(others), team)
    measured = read_probabilities(table, lessons, today.tasks, team.names)
    try:
        shop = Shop(
            tasks=today.tasks,
            robots=team.names,
            lessons=lessons,
            completes=np.append(np.arange(len(today.tasks)), np.full(len(lessons) - len(today.tasks), -1)),
            count=today.count,
            c_hum=today.c_hum,
            c_rob=team.c_rob,
            c_fail=team.c_fail,
            pretrained=team.pretrained,
            c_demo=c_demo,
            transfer=np.zeros((len(team.names), len(lessons), len(today.tasks))),
            choice=today.choice,
            order=order if arcs is None else "partial",
            before=arcs,
            max_lessons=limits[0],
            max_teaching=limits[1],
        )
    except ShapeError as error:
        raise InputError.at(today.name, None, None, str(error)) from error
    values, gaps = _complete(shop, table, measured, fill, filling)
    shop = replace(shop, transfer=_scaled(shop, values, measured, team, today))
    if measured.own and (team.skill < 1.0).any():
        remarks += ("skill lowers what is measured with no robot in particular; rows of a robot are taken as they are",)
    hints = (f"in {table.name}, {hint}" for hint in misspelt(table, today.tasks))
    return ShopReading(
        shop=shop,
        remarks=(*today.remarks, *team.remarks, *remarks, *measured.remarks, *gaps, *hints),
        extra=today.extra,
        family=today.family,
        trials=_trials(shop, measured),
    )


def _check_settings(order: str, max_lessons: float, max_teaching: float, fill: float | None) -> None:
    if order not in SHOP_ORDERS:
        raise ConfigError(f"order: '{order}' is unknown; use one of {list(SHOP_ORDERS)}")
    for name, value in (("max_lessons", max_lessons), ("max_teaching", max_teaching)):
        if not value >= 0.0:
            raise ConfigError(f"{name}: {value} given; expected a number of at least 0")
    if math.isfinite(max_lessons) and max_lessons != math.floor(max_lessons):
        raise ConfigError(f"max_lessons: {max_lessons} given; expected a whole number")
    if fill is not None and not 0.0 <= fill <= 1.0:
        raise ConfigError(f"fill: {fill} given; expected a probability in [0, 1]")


def _lessons(
    orders: Orders, table: TransferTable, others: tuple[str, ...], team: Robots
) -> tuple[tuple[str, ...], Array, tuple[str, ...]]:
    """Names of the L lessons, [R, L] what they cost, and what is to be said of those that are on none of the tasks."""
    n = len(orders.tasks)
    demos = np.concatenate([orders.demos, np.ones(len(others))])
    c_demo = np.where(team.teachable & ~np.isnan(team.c_demo), team.c_demo, np.inf) * demos
    kept = [each for each in range(n, n + len(others)) if np.isfinite(c_demo[:, each]).any()]
    unknown = [others[each - n] for each in range(n, n + len(others)) if np.isnan(team.c_demo[:, each]).all()]
    names = [others[each - n] for each in kept]
    remarks = []
    if names:
        what = "lesson is" if len(names) == 1 else "lessons are"
        remarks.append(f"{len(names)} {what} in {table.name} and not among the tasks; taught first ({listed(names)})")
    if unknown:
        what = "lesson is" if len(unknown) == 1 else "lessons are"
        text = f"{len(unknown)} {what} in {table.name} and not among the tasks, without c_demo; left out"
        remarks.append(f"{text} ({listed(unknown)})")
    return (*orders.tasks, *names), c_demo[:, [*range(n), *kept]], tuple(remarks)


def _complete(
    shop: Shop, table: TransferTable, measured: Measured, fill: float | None, filling: Filling | None
) -> tuple[Array, tuple[str, ...]]:
    """[R, L, n] values for all pairs, and what was assumed."""
    values = np.repeat(measured.general[None], len(shop.robots), 0)
    for robot, own in measured.own.items():
        values[robot] = np.where(np.isnan(own), values[robot], own)
    missing = np.isnan(values)
    if not missing.any():
        return values, ()
    needed = _useful(shop)
    gap = (missing & needed).any(axis=0)
    default: Array = np.full(gap.shape, 0.0 if fill is None else fill)
    remarks: tuple[str, ...] = ()
    if gap.any():
        default, remarks = _default(shop, table, gap, int(needed.any(axis=0).sum()), fill, filling)
    values = np.where(missing, default[None], values)
    same = np.arange(shop.n)
    unused = missing[:, same, same] & ~needed[:, same, same]
    values[:, same, same] = np.where(unused, 1.0, values[:, same, same])
    return values, remarks


def _default(
    shop: Shop, table: TransferTable, gap: BoolArray, pairs: int, fill: float | None, filling: Filling | None
) -> tuple[Array, tuple[str, ...]]:
    """[L, n] values where there is a gap, and where they are from."""
    many = f"{gap.sum()} of {pairs} pairs"
    if fill is None and filling is None:
        k, i = np.argwhere(gap)[0].tolist()
        lesson, task = shop.lessons[k], shop.tasks[i]
        first = "that of" if gap.sum() == 1 else "the first of which is"
        hint = "".join(f"; {each}" for each in misspelt(table, shop.tasks)[:1])
        ways = "give it, or fill=0 (such a lesson does not help), or features=<table of the tasks> to predict it"
        problem = f"has no value for {many}, {first} '{lesson}' taught and '{task}' tested{hint}; {ways}"
        raise InputError.at(table.name if table.sheet is None else table.sheet.name, None, None, problem)
    default = np.full(gap.shape, 0.0 if fill is None else fill)
    source = f"taken as {fill:g} (fill={fill:g})" if filling is None else "predicted"
    if filling is not None:
        rows, columns = np.flatnonzero(gap.any(axis=1)), np.flatnonzero(gap.any(axis=0))
        lessons, tasks = tuple(shop.lessons[k] for k in rows), tuple(shop.tasks[i] for i in columns)
        sizes = {"K": len(rows), "M": len(columns)}
        predicted = freeze("filling", filling(lessons, tasks), ("K", "M"), sizes, low=0.0, high=1.0)
        default[np.ix_(rows, columns)] = predicted
    has = "has" if gap.sum() == 1 else "have"
    remarks = [f"{many} {has} no value in {table.name}; {source}"]
    own = np.arange(shop.n)
    if (copies := gap[own, own]).any():
        names = listed([shop.tasks[each] for each in np.flatnonzero(copies)])
        remarks.append(f"among them how probably a lesson does the other copies of its own task ({names})")
    return default, tuple(remarks)


def _useful(shop: Shop) -> BoolArray:
    """[R, L, n] pairs that a plan may use: the lesson can be given and comes in time, the task can be attempted."""
    can_act = np.isfinite(shop.c_rob) & (shop.choice != Ruling.DELEGATE)
    can_act &= (shop.choice != Ruling.LEARN) | (shop.count > 1)
    useful: BoolArray = lessons_to_give(shop)[:, :, None] & can_act[:, None, :]
    useful[:, : shop.n] &= ~too_late(shop)
    own = np.arange(shop.n)
    useful[:, own, own] &= shop.count > 1
    return useful


def _trials(shop: Shop, measured: Measured) -> Array:
    """[R, L, n] attempts behind each probability."""
    trials = np.repeat(measured.trials[None], len(shop.robots), 0)
    for robot, own in measured.own.items():
        trials[robot] = np.where(np.isnan(own), trials[robot], measured.own_trials[robot])
    return trials


def _scaled(shop: Shop, values: Array, measured: Measured, team: Robots, orders: Orders) -> Array:
    """[R, L, n] probabilities of these robots, after as many demonstrations as are given."""
    skill = np.repeat(team.skill[:, None, :], len(shop.lessons), 1) if measured.own else team.skill[:, None, :]
    for robot, own in measured.own.items():
        skill[robot][~np.isnan(own)] = 1.0
    learnt = np.append(orders.learnt, np.ones(len(shop.lessons) - shop.n))
    scaled: Array = values * skill * learnt[:, None]
    return scaled
