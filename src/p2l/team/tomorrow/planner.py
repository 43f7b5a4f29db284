"""Plan today for a tomorrow that is not known: exact over the scenarios, with a certificate (thesis, section 6.2.1)."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from p2l.errors import ConfigError, SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team import facility
from p2l.team.certificate import PROVEN
from p2l.team.contract import check_stopping
from p2l.team.facility import Pairs
from p2l.team.problem import Status
from p2l.team.shop.record import Shop, ShopCertificate, ShopPlan
from p2l.team.shop.reduction import Reduction, reduce_shop
from p2l.team.shop.search import OrderSearch
from p2l.team.tomorrow.certificate import two_stage_bound
from p2l.team.tomorrow.outcome import TwoStageOutcome, tomorrow_outcome, two_stage_outcome
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan, proven_gap
from p2l.team.tomorrow.reduction import reduce_two_stage, tomorrow_pairs

_FINISH = 0.15  # share of the time limit that is left for the check
_NONE = np.zeros((0, 3), dtype=np.int64)


def plan_two_stage(program: TwoStage, *, time_limit_s: float = 60.0, gap: float = 0.0) -> TwoStagePlan:
    """Decide what is done and taught today, and what would be taught tomorrow in each scenario.

    Args:
        program: today and tomorrow.
        time_limit_s: wall seconds; at the limit the best plan so far is returned with its true bound.
        gap: relative gap at which the search may stop; 0 proves optimality for these scenarios.

    Raises:
        ConfigError: a time limit of zero or less, a gap outside [0, 1); no plan keeps today's limits and decisions, or
            does every task of every scenario.
        SolverError: no plan was found in time.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, Shop
        >>> from p2l.team.tomorrow import TwoStage, plan_two_stage
        >>> one = np.ones(1)
        >>> shop = Shop.of_problem(
        ...     Problem(("gear",), 10 * one, 100 * one, 100 * one, 150 * one, 0 * one, 0.9 * np.eye(1))
        ... )
        >>> both = TwoStage(shop, ("gear",), [0], 100 * one, 10 * one[None], 100 * one[None], 0 * one[None],
        ...                 150 * one[None], shop.transfer, [[9], [0]], [0.4, 0.6])
        >>> day = plan_two_stage(both)  # 150 + 0.4 · 9 · 20; waiting costs 100 + 0.4 · (150 + 8 · 20)
        >>> day.status, len(day.taught), round(day.objective, 6)
        ('optimal', 1, 222.0)
    """
    limit_s, gap = check_stopping(time_limit_s, gap)
    start = time.perf_counter()
    deadline = start + limit_s * (1.0 - _FINISH)
    try:
        search = _TwoStageSearch(program, deadline, gap)
    except TimeoutError:
        raise SolverError("no plan was found in time; give more time, or fewer scenarios") from None
    complete = search.run()
    best = search.best
    if best is None:
        if complete:
            raise ConfigError(
                "no plan keeps today's limits and decisions and does all that may come tomorrow; loosen one of them"
            )
        raise SolverError("no plan was found in time; give more time, or fewer scenarios")
    proof = search.proof()
    bound, relative = proven_gap(best.total, two_stage_bound(program, proof))
    status: Status = "optimal" if relative <= PROVEN else "feasible" if complete else "time_limit"
    return TwoStagePlan(
        today=day_plan(program.today, best.taught, best.sequence, best.outcome),
        later=best.later, tomorrow=best.outcome.tomorrow, objective=best.total, lower_bound=bound, gap=relative,
        status=status, seconds=time.perf_counter() - start, certificate=proof,
    )  # fmt: skip


def day_plan(shop: Shop, taught: IntArray, sequence: IntArray, outcome: TwoStageOutcome) -> ShopPlan:
    """Today's part as a plan of its own, of which nothing is proven."""
    day = outcome.today
    return ShopPlan(
        planner="two_stage", status="heuristic", taught=taught, sequence=sequence, decision=day.decision,
        robot=day.robot, lesson=day.lesson, p_success=day.p_success, expected_cost=day.expected_cost,
        objective=day.total, lower_bound=0.0, gap=1.0 if day.total > 0.0 and len(shop.tasks) else 0.0, seconds=0.0,
    )  # fmt: skip


@dataclass(frozen=True)
class _FoundTwoStage:
    """A plan: lessons [T, 2] and sequence [G] of today, lessons [K, 3] of tomorrow, and what it comes to."""

    taught: IntArray
    sequence: IntArray
    later: IntArray
    outcome: TwoStageOutcome

    @property
    def total(self) -> float:
        return self.outcome.total


class _TwoStageSearch(OrderSearch[_FoundTwoStage]):
    def __init__(self, program: TwoStage, deadline: float, gap: float) -> None:
        super().__init__(program.today, deadline, gap)
        self.program = program
        self.pairs = tomorrow_pairs(program, deadline=deadline)

    def reduce(self, dropped: BoolArray | None, deadline: float) -> Reduction:
        return reduce_two_stage(reduce_shop(self.shop, dropped, deadline=deadline), self.pairs)

    def bound(self, proof: ShopCertificate) -> float:
        return two_stage_bound(self.program, proof)

    def found(self, reduction: Reduction, open_set: BoolArray, taught: IntArray, sequence: IntArray) -> _FoundTwoStage:
        later = _later(self.program, reduction.pairs, open_set)
        outcome = two_stage_outcome(self.program, taught, sequence, later)
        uses = tomorrow_outcome(self.program, taught, later).uses
        day = outcome.today
        used = np.array(
            [
                bool(((day.lesson == lesson) & (day.robot == robot)).any()) or uses[place] > 0.0
                for place, (lesson, robot) in enumerate(taught.tolist())
            ],
            dtype=bool,
        )
        if not used.all():
            taught = taught[used]
            outcome = two_stage_outcome(self.program, taught, sequence, later)
        return _FoundTwoStage(taught, sequence, later, outcome)


def recourse(
    program: TwoStage, taught: IntArray, *, deadline: float = math.inf, gap: float = 0.0
) -> tuple[IntArray, Array]:
    """The best that can be done tomorrow after given lessons today.

    Args:
        program: today and tomorrow; of today only its lessons are looked at.
        taught: [T, 2] lessons and robots.
        deadline: of `time.perf_counter`; scenarios that are not reached by then are taught nothing more.
        gap: relative gap of each scenario's cost that is good enough.

    Returns:
        [K, 3] scenario, lesson and robot of what is taught tomorrow, and the cost [S] of each scenario.
    """
    if program.commit == "all":
        return _NONE, tomorrow_outcome(program, taught, _NONE).cost
    pairs = tomorrow_pairs(program, np.reshape(taught, (-1, 2)))
    open_set = np.zeros(pairs.facilities, dtype=bool)
    width = len(program.today.lessons) * len(program.today.robots)
    ends = np.searchsorted(program.groups.scenario, np.arange(program.scenarios + 1))
    for scenario in range(program.scenarios):
        low, high = int(ends[scenario]), int(ends[scenario + 1])
        first, last = int(pairs.start[low]), int(pairs.start[high])
        if first == last or time.perf_counter() > deadline:
            continue
        place = width * (1 + scenario)
        own = Pairs(
            opening=pairs.opening[place : place + width],
            outside=pairs.outside[low:high],
            start=pairs.start[low : high + 1] - first,
            facility=pairs.facility[first:last] - np.int32(place),
            cost=pairs.cost[first:last],
        )
        open_set[place : place + width] = facility.solve_small_or_large(own, deadline, gap, few=-1).open
    later = _later(program, pairs, open_set)
    return later, tomorrow_outcome(program, taught, later).cost


def _later(program: TwoStage, pairs: Pairs, open_set: BoolArray) -> IntArray:
    """[K, 3] scenario, lesson and robot of open facilities that serve something."""
    robots, width = len(program.today.robots), len(program.today.lessons) * len(program.today.robots)
    if pairs.facilities <= width:
        return _NONE
    rows, is_open = pairs.rows(), open_set[pairs.facility]
    front = np.unique(rows[is_open], return_index=True)[1]  # rows are sorted by cost
    serves = np.zeros(pairs.facilities, dtype=bool)
    serves[pairs.facility[is_open][front]] = True
    place = np.flatnonzero(serves[width:])
    scenario, rest = np.divmod(place, width)
    return np.stack([scenario, *np.divmod(rest, robots)], axis=1)
