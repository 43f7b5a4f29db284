"""Today and tomorrow from a person's tables: those of a shop, and what may come."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.records import Array, IntArray
from p2l.team.sheets import Sheet, check_standard_input, read_sheet
from p2l.team.shop.cautions import cheap_failures, failure_remarks
from p2l.team.shop.orders import Orders, read_orders
from p2l.team.shop.possible import refuse_impossible
from p2l.team.shop.reading import Filling, ShopReading, shop_of_orders
from p2l.team.shop.record import Ruling, Shop, ShopOrder
from p2l.team.shop.robots import read_before
from p2l.team.tomorrow.forecast import Forecast, sample_counts, with_counts
from p2l.team.tomorrow.outcome import attempt_costs
from p2l.team.tomorrow.record import COMMITS, Commit, TwoStage
from p2l.team.tomorrow.tables import read_forecast, read_scenarios

_MOST = 100_000  # scenarios


@dataclass(frozen=True)
class Future:
    """The tables of tomorrow, and what can be decided then.

    Attributes:
        scenarios: a table that `tables.read_scenarios` describes; None if there is a forecast.
        forecast: a table that `tables.read_forecast` describes; None if there are scenarios.
        types: a table of tasks that may come, as of orders; None for today's orders.
        commit: as in `TwoStage`.
        samples: scenarios that are drawn of a forecast.
    """

    scenarios: Path | str | None = None
    forecast: Path | str | None = None
    types: Path | str | None = None
    commit: Commit = "today"
    samples: int = 200

    def __post_init__(self) -> None:
        if (self.scenarios is None) == (self.forecast is None):
            raise ConfigError("scenarios, forecast: give one of them: a table of futures, or expected numbers")
        if self.commit not in COMMITS:
            raise ConfigError(f"commit: '{self.commit}' is unknown; use one of {list(get_args(Commit))}")
        if not 1 <= self.samples <= _MOST:
            raise ConfigError(f"samples: {self.samples} given; expected 1 to {_MOST}")


@dataclass(frozen=True)
class TwoStageReading:
    """What a person's tables say of today and tomorrow.

    Attributes:
        program: both.
        day: today's reading; its remarks are those of both.
        names: S names of the scenarios; empty if they are drawn.
        forecast: that they are drawn of; None for a table of scenarios.
    """

    program: TwoStage
    day: ShopReading
    names: tuple[str, ...]
    forecast: Forecast | None


def read_two_stage(
    orders: Path | str,
    transfer: Path | str,
    future: Future,
    rng: np.random.Generator,
    *,
    before: Path | str | None = None,
    robots: Path | str | None = None,
    order: ShopOrder = "fixed",
    max_lessons: float = math.inf,
    max_teaching: float = math.inf,
    fill: float | None = None,
    filling: Filling | None = None,
) -> TwoStageReading:
    """Read today and tomorrow.

    Args:
        orders: of today, as for `read_shop`.
        transfer: as for `read_shop`; tomorrow's tasks have columns in it, and rows if lessons on them can be given.
        future: tomorrow's tables.
        rng: for scenarios that are drawn of a forecast.
        before: as for `read_shop`.
        robots: as for `read_shop`, with rows for tomorrow's tasks if they differ.
        order: as for `read_shop`.
        max_lessons: as for `read_shop`, today.
        max_teaching: as for `read_shop`, today.
        fill: as for `read_shop`.
        filling: as for `read_shop`.

    Raises:
        InputError: as `read_shop`, `read_scenarios` and `read_forecast`; a decision for tomorrow; a task of tomorrow
            that nobody can do.
        ConfigError: an unknown order, a limit below 0, a fill that is no probability.
    """
    check_standard_input(orders, transfer, before, robots, future.scenarios, future.forecast, future.types)
    today = read_orders(read_sheet(orders))
    types = today if future.types is None else _types(read_sheet(future.types))
    table, team = read_sheet(transfer), None if robots is None else read_sheet(robots)
    arcs = None if before is None else read_before(read_sheet(before), today.tasks)
    late = _late(today, types, order, arcs)
    how: ShopOrder = "any" if late is None else "partial"
    both = shop_of_orders(_joined(today, types, types), table, team, how, late, fill=fill, filling=filling)
    shop = _today(both.shop, today, order, arcs, (max_lessons, max_teaching))
    refuse_impossible(shop, today)
    then = both.shop if types is today else _tomorrow(today, types, table, team)
    counts = np.zeros((1, len(types.tasks)))
    program = _program(both.shop, shop, then, types, counts, future.commit)
    remarks, forecast = both.remarks, None
    names: tuple[str, ...] = ()
    if future.scenarios is not None:
        scenarios = read_scenarios(read_sheet(future.scenarios), types.tasks)
        program = replace(program, counts=scenarios.counts, probability=scenarios.probability)
        remarks, names = (*remarks, *scenarios.remarks), scenarios.names
    elif future.forecast is not None:
        forecast = read_forecast(read_sheet(future.forecast), types.tasks)
        program = with_counts(program, sample_counts(forecast, future.samples, rng))
        remarks = (*remarks, f"{future.samples} scenarios are drawn of {Path(str(future.forecast)).name}")
    _refuse_impossible(program, types)
    if types is not today and bool((types.count != 1).any()):
        remarks = (*remarks, f"count is not read in {types.name}; scenarios or forecast say how many come")
    cheap = cheap_failures(shop.tasks, shop.c_hum, shop.c_rob, shop.c_fail)
    cheap += cheap_failures(program.types, program.c_hum, program.c_rob, program.c_fail)
    remarks = (*remarks, *failure_remarks(cheap))
    return TwoStageReading(program, replace(both, shop=shop, extra=today.extra, remarks=remarks), names, forecast)


def _types(sheet: Sheet) -> Orders:
    types = read_orders(sheet)
    decided = types.choice != Ruling.FREE
    if decided.any():
        row = int(decided.argmax())
        problem = f"task '{types.tasks[row]}' is decided, but only today's orders can be; leave it empty"
        raise InputError.at(types.name, types.lines[row], types.decision, problem)
    return types


def _joined(first: Orders, second: Orders, types: Orders) -> Orders:
    """The rows of one table, and those of another on tasks that it does not have; nothing is decided.

    Of what may come there are copies, or how well a lesson does its own task would not be asked for.
    """
    known = set(first.tasks)
    rows = [row for row, name in enumerate(second.tasks) if name not in known]
    names = (*first.tasks, *(second.tasks[row] for row in rows))
    arrays = {
        name: np.concatenate([getattr(first, name), getattr(second, name)[rows]])
        for name in ("c_rob", "c_hum", "c_fail", "c_demo", "pretrained", "teachable", "demos", "learnt")
    }
    remarks = first.remarks if second is first else (*first.remarks, *second.remarks)
    return replace(
        first,
        tasks=names,
        lines=(*first.lines, *(second.lines[row] for row in rows)),
        choice=np.full(len(names), int(Ruling.FREE)),
        count=np.where(np.isin(names, types.tasks), 2, np.concatenate([first.count, second.count[rows]])),
        remarks=remarks,
        **arrays,
    )


def _late(today: Orders, types: Orders, order: ShopOrder, arcs: IntArray | None) -> IntArray | None:
    """Arcs of today's order by which a lesson comes too late for a task that will not come again; None if all may do.

    Pairs that no plan can use need not be in the transfer table.
    """
    kinds = set(types.tasks)
    leaves = np.array([name not in kinds for name in today.tasks], dtype=bool)
    if not leaves.any() or (order == "any" and arcs is None):
        return None
    if arcs is None:
        n = len(today.tasks)
        arcs = np.argwhere(np.triu(np.ones((n, n), dtype=bool), 1))
    late: IntArray = arcs[leaves[arcs[:, 0]]]
    return late


def _today(both: Shop, today: Orders, order: ShopOrder, arcs: IntArray | None, limits: tuple[float, float]) -> Shop:
    n = len(today.tasks)
    own = np.arange(len(both.lessons))
    try:
        return Shop(
            tasks=today.tasks,
            robots=both.robots,
            lessons=both.lessons,
            completes=np.where(own < n, own, -1),
            count=today.count,
            c_hum=both.c_hum[:n],
            c_rob=both.c_rob[:, :n],
            c_fail=both.c_fail[:, :n],
            pretrained=both.pretrained[:, :n],
            c_demo=both.c_demo,
            transfer=both.transfer[:, :, :n],
            choice=today.choice,
            order=order if arcs is None else "partial",
            before=arcs,
            max_lessons=limits[0],
            max_teaching=limits[1],
        )
    except ShapeError as error:
        raise InputError.at(today.name, None, None, str(error)) from error


def _tomorrow(today: Orders, types: Orders, table: Sheet, team: Sheet | None) -> Shop:
    """All tasks at tomorrow's costs; what lessons are worth is not looked at."""
    return shop_of_orders(_joined(types, today, types), table, team, "any", fill=0.0).shop


def _program(both: Shop, shop: Shop, then: Shop, types: Orders, counts: Array, commit: Commit) -> TwoStage:
    place = {name: index for index, name in enumerate(both.lessons)}
    later = {name: index for index, name in enumerate(then.lessons)}
    own = np.array([place[name] for name in types.tasks], dtype=np.int64)
    kind = np.array([later[name] for name in types.tasks], dtype=np.int64)
    lessons = np.array([later[name] for name in both.lessons], dtype=np.int64)
    return TwoStage(
        today=shop,
        types=types.tasks,
        lesson=own,
        c_hum=then.c_hum[kind],
        c_rob=then.c_rob[:, kind],
        c_fail=then.c_fail[:, kind],
        pretrained=then.pretrained[:, kind],
        c_demo=then.c_demo[:, lessons],
        transfer=both.transfer[:, :, own],
        counts=counts,
        probability=np.ones(1),
        commit=commit,
    )


def _refuse_impossible(program: TwoStage, types: Orders) -> None:
    """Refuse a type that comes in some scenario, and that nobody can do there even if every lesson is given."""
    today = [(lesson, robot) for robot, lesson in np.argwhere(np.isfinite(program.today.c_demo)).tolist()]
    offers = np.array(today + program.teachable().tolist(), dtype=np.int64).reshape(-1, 2)
    ways = np.concatenate([program.c_hum[None], attempt_costs(program, None), attempt_costs(program, offers)])
    can_teach = np.isin(program.lesson, program.teachable()[:, 0])
    most = program.counts.max(axis=0)
    lost = np.isinf(ways.min(axis=0)) & (most > np.where(can_teach, 1.0, 0.0))
    if lost.any():
        row = int(lost.argmax())
        problem = (
            f"task '{types.tasks[row]}' may come {most[row]:g} times, and cannot be done: nobody can do it, and no "
            "lesson makes an attempt possible; give it a finite cost"
        )
        raise InputError.at(types.name, types.lines[row], None, problem)
