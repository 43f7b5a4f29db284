"""What a plan for today and tomorrow costs, recomputed from the input alone; it knows nothing of facilities or solvers.

Tomorrow nothing has to be put in order: every lesson comes first, and every copy is done in the cheapest way that the
lessons leave.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.team.shop.outcome import ShopOutcome, shop_outcome
from p2l.team.tomorrow.record import TwoStage


@dataclass(frozen=True)
class TwoStageOutcome:
    """Today's part, the expected cost [S] of each scenario tomorrow, and the expected cost of both."""

    today: ShopOutcome
    tomorrow: Array
    total: float


@dataclass(frozen=True)
class Tomorrow:
    """What tomorrow comes to with given lessons.

    Attributes:
        cost: [S] expected cost of each scenario, its lessons included.
        uses: [T] expected number of tomorrow's copies that each of today's lessons is used for.
    """

    cost: Array
    uses: Array


def two_stage_outcome(program: TwoStage, taught: IntArray, sequence: IntArray, later: IntArray) -> TwoStageOutcome:
    """The best that can be done with given lessons today and tomorrow.

    Args:
        program: today and tomorrow.
        taught: [T, 2] lessons that are given today and robots, as for `shop_outcome`.
        sequence: [G] today's order of work, as for `shop_outcome`.
        later: [K, 3] scenario, lesson and robot of what is taught tomorrow.

    Raises:
        ShapeError: as `shop_outcome`; a lesson tomorrow that cannot be given, or twice.
    """
    today = shop_outcome(program.today, taught, sequence)
    tomorrow = tomorrow_outcome(program, taught, later)
    expected = [p * cost for p, cost in zip(program.probability.tolist(), tomorrow.cost.tolist(), strict=True)]
    return TwoStageOutcome(today, tomorrow.cost, math.fsum([today.total, *expected]))


def tomorrow_outcome(program: TwoStage, taught: IntArray, later: IntArray, priced: TwoStage | None = None) -> Tomorrow:
    """Tomorrow's cost in each scenario.

    Args:
        program: today and tomorrow.
        taught: as for `two_stage_outcome`.
        later: as for `two_stage_outcome`.
        priced: the same with other success probabilities, at which what is decided by those of `program` is priced.

    Raises:
        ShapeError: as for `two_stage_outcome`.
    """
    pairs = np.reshape(np.asarray(taught, dtype=np.int64), (-1, 2))
    waiting = _later(program, later)
    truth = program if priced is None else priced
    kinds = np.arange(len(program.types))
    ways, prices = (
        np.concatenate([each.c_hum[None], attempt_costs(each, None), attempt_costs(each, pairs)])
        for each in (program, truth)
    )
    place = ways.argmin(axis=0)
    base, price = ways[place, kinds], prices[place, kinds]
    left = program.counts.copy()  # copies that today's way is for
    cost = np.zeros(program.scenarios)
    waited, waited_prices = (attempt_costs(each, waiting[:, 1:]) for each in (program, truth))
    ends = np.searchsorted(waiting[:, 0], np.arange(program.scenarios + 1))
    for scenario in np.unique(waiting[:, 0]).tolist():
        given = slice(int(ends[scenario]), int(ends[scenario + 1]))
        lesson, robot = waiting[given, 1], waiting[given, 2]
        best = waited[given].argmin(axis=0)
        own = (program.lesson >= 0) & np.isin(program.lesson, lesson)
        copies = program.counts[scenario] - np.where(own, np.minimum(program.counts[scenario], 1.0), 0.0)
        better = waited[given][best, kinds] < base
        left[scenario] = np.where(better, 0.0, copies)
        served = _product(np.where(better, copies, 0.0), waited_prices[given][best, kinds])
        cost[scenario] = program.c_demo[robot, lesson].sum() + served.sum()
    cost = cost + _product(left, price[None, :]).sum(axis=1)
    way = place - 1 - len(program.today.robots)  # of today's lessons; below 0 is without any
    expected = program.probability @ left
    uses = np.bincount(way[way >= 0], expected[way >= 0], minlength=len(pairs)).astype(np.float64)
    return Tomorrow(cost, uses)


def _product(copies: Array, cost: Array) -> Array:
    """Copies times cost; none of what is not possible costs nothing."""
    product: Array = np.where(copies > 0.0, copies * np.where((copies > 0.0), cost, 0.0), 0.0)
    return product


def attempt_costs(program: TwoStage, pairs: IntArray | None) -> Array:
    """[K, J] expected cost of one attempt after each of K lessons to robots; None: [R, J] without any."""
    if pairs is None:
        robot, skill = np.arange(len(program.today.robots)), program.pretrained
    else:
        robot, skill = pairs[:, 1], program.transfer[pairs[:, 1], pairs[:, 0]]
    risk, c_fail = 1.0 - skill, program.c_fail[robot]
    is_risky: BoolArray = risk > 0.0
    return np.asarray(program.c_rob[robot] + np.where(is_risky, risk * np.where(is_risky, c_fail, 0.0), 0.0))


def _later(program: TwoStage, later: IntArray) -> IntArray:
    """[K, 3] by scenario."""
    rows = np.asarray(later)
    rows = freeze("later", rows.reshape(-1, 3) if rows.size else np.zeros((0, 3)), ("K", 3), {}, np.int64, low=0)
    if len(rows) and program.commit == "all":
        raise ShapeError("plan: it teaches tomorrow, though all lessons are to be given today (commit=all)")
    if (rows >= (program.scenarios, len(program.today.lessons), len(program.today.robots))).any():
        raise ShapeError("plan: it has a scenario, lesson or robot tomorrow that there is not")
    if len(np.unique(rows, axis=0)) < len(rows):
        raise ShapeError("plan: a lesson is given to a robot twice in a scenario")
    if np.isinf(program.c_demo[rows[:, 2], rows[:, 1]]).any():
        raise ShapeError("plan: it teaches tomorrow what cannot be taught then")
    ordered: IntArray = rows[np.argsort(rows[:, 0], kind="stable")]
    return ordered
