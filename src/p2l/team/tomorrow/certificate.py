"""An independent check of a plan for today and tomorrow, and of its lower bound: no solver, only the input's numbers.

As `p2l.team.shop.certificate`, whose instance of today and whose cases it uses. Tomorrow's copies are further demands:
each sees today's lessons, and the lessons of its own scenario.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

import numpy as np

from p2l.errors import SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.cases import Instance
from p2l.team.certificate import PROVEN, Verdict
from p2l.team.problem import Status, relative_gap
from p2l.team.shop.certificate import cases_bound, instance_of, services_of
from p2l.team.shop.record import ShopCertificate
from p2l.team.tomorrow.outcome import two_stage_outcome
from p2l.team.tomorrow.record import Groups, TwoStage, TwoStagePlan

_TODAY = ("decision", "robot", "lesson", "p_success", "expected_cost")
Services = Callable[[int, int], tuple[IntArray, IntArray, Array]]


def check_two_stage_plan(program: TwoStage, plan: TwoStagePlan) -> Verdict:
    """Recompute a plan from its lessons and its sequence, and the bound from its certificate.

    Raises:
        SolverError: the plan has no certificate, or a number or the status in it is not what the input gives.
        ShapeError: the plan breaks the order, a limit, or a decision that is made; a lesson that cannot be given.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, Shop
        >>> from p2l.team.tomorrow import TwoStage, check_two_stage_plan, plan_two_stage
        >>> one = np.ones(1)
        >>> shop = Shop.of_problem(
        ...     Problem(("gear",), 10 * one, 100 * one, 100 * one, 120 * one, 0 * one, 0.9 * np.eye(1))
        ... )
        >>> both = TwoStage(shop, ("gear",), [0], 100 * one, 10 * one[None], 100 * one[None], 0 * one[None],
        ...                 120 * one[None], shop.transfer, [[2], [0]], [0.5, 0.5])
        >>> verdict = check_two_stage_plan(both, plan_two_stage(both))
        >>> round(verdict.cost, 6), verdict.optimal  # taught today: 120, and twice 20 with probability one half
        (140.0, True)
    """
    if plan.certificate is None:
        raise SolverError("certificate: none given; plan again")
    outcome = two_stage_outcome(program, plan.taught, plan.today.sequence, plan.later)
    claims = [(f"today's {name}", getattr(plan.today, name), getattr(outcome.today, name)) for name in _TODAY]
    claims.append(("cost of a scenario", plan.tomorrow, outcome.tomorrow))
    claims.append(("today's cost", np.array([plan.today.objective]), np.array([outcome.today.total])))
    claims.append(("objective", np.array([plan.objective]), np.array([outcome.total])))
    for name, claim, truth in claims:
        if len(claim) != len(truth) or not bool((np.abs(claim - truth) <= PROVEN * np.abs(truth)).all()):
            raise SolverError(f"certificate: {name} is not what today's and tomorrow's orders give")
    cost, bound = outcome.total, two_stage_bound(program, plan.certificate)
    if not bound <= cost * (1.0 + PROVEN):
        raise SolverError(f"certificate: proves that nothing costs less than {bound}; this costs {cost}")
    if not plan.lower_bound <= bound + PROVEN * abs(cost):
        raise SolverError(f"certificate: lower_bound is {plan.lower_bound}, but {bound} is proven")
    gap = relative_gap(cost, plan.lower_bound)
    if not abs(plan.gap - gap) <= PROVEN or plan.status not in get_args(Status):
        raise SolverError(f"certificate: gap is {plan.gap} and status '{plan.status}'; cost and bound give {gap}")
    if (plan.status == "optimal") != (plan.gap <= PROVEN):
        raise SolverError(f"certificate: status is '{plan.status}', but a gap of {gap:.2g} is proven")
    return Verdict(cost, bound, relative_gap(cost, bound))


def two_stage_bound(program: TwoStage, proof: ShopCertificate) -> float:
    """What no plan for today and tomorrow costs less than in expectation.

    Raises:
        SolverError: cases that leave something out, a leaf without a certificate, or one of another day.
    """
    shop, groups = program.today, program.groups
    services = services_of(shop)
    outside, later = _without_lessons(program)[groups.kind] * groups.weight, _later_openings(program)
    first, demands = len(shop.groups[0]), len(shop.groups[0]) + len(outside)
    names = tuple(f"type '{program.types[kind]}'" for kind in groups.kind.tolist())
    tomorrow = _tomorrow(program, groups)

    def instance(dropped: BoolArray) -> Instance:
        today = instance_of(shop, services, dropped)

        def pairs(low: int, high: int) -> tuple[IntArray, IntArray, Array]:
            parts = []
            if low < first:
                cost = today.block(low, min(high, first))
                row, column = np.nonzero(np.isfinite(cost))
                parts.append((row + low, column, cost[row, column]))
            if high > first:
                row, column, cost = tomorrow(max(low, first) - first, high - first)
                parts.append((row + first, column, cost))
            demand, facility, value = (np.concatenate(part) for part in zip(*parts, strict=True))
            return demand, facility, value

        weights = None if today.weights is None else np.pad(today.weights, ((0, 0), (0, len(later))))
        return Instance(
            opening=np.concatenate([today.opening, later]),
            outside=np.concatenate([today.outside, outside]),
            names=(*today.names, *names),
            block=today.block,
            weights=weights,
            limits=today.limits,
            pairs=pairs,
        )

    return cases_bound(shop, proof, demands, instance)


def _without_lessons(program: TwoStage) -> Array:
    """[J] what one copy costs without any lesson."""
    costs = []
    for j in range(len(program.types)):
        skills = program.pretrained[:, j]
        ways = [_attempt(program, r, j, skill) for r, skill in enumerate(skills.tolist())]
        costs.append(min(float(program.c_hum[j]), *ways))
    return np.array(costs)


def _attempt(program: TwoStage, robot: int, kind: int, skill: float) -> float:
    risk, c_rob = 1.0 - skill, float(program.c_rob[robot, kind])
    return c_rob if risk == 0.0 else c_rob + risk * float(program.c_fail[robot, kind])


def _later_openings(program: TwoStage) -> Array:
    """Opening costs of tomorrow's lessons, scenario after scenario: every lesson, to every robot."""
    if program.commit == "all":
        return np.zeros(0)
    return np.concatenate([p * program.c_demo.T.reshape(-1) for p in program.probability.tolist()])


def _tomorrow(program: TwoStage, groups: Groups) -> Services:
    """Finite service costs of some of tomorrow's groups."""
    robots, width = len(program.today.robots), program.c_demo.size
    teachable = np.isfinite(program.c_demo.T.reshape(-1))
    offers = [(lesson, robot) for lesson in range(len(program.today.lessons)) for robot in range(robots)]
    table = np.array(
        [
            [_attempt(program, r, j, float(program.transfer[r, lesson, j])) for lesson, r in offers]
            for j in range(len(program.types))
        ]
    ).reshape(len(program.types), width)
    own = np.array([[lesson == each for lesson, _ in offers] for each in program.lesson.tolist()], dtype=bool)
    own = own.reshape(len(program.types), width)

    def services(low: int, high: int) -> tuple[IntArray, IntArray, Array]:
        kind = groups.kind[low:high]
        cost = table[kind] * groups.weight[low:high, None]
        row, column = np.nonzero(np.isfinite(cost))
        parts = [(row, column, cost[row, column])]
        if program.commit == "today":
            cost[groups.is_first[low:high, None] & own[kind]] = 0.0
            row, column = np.nonzero(np.isfinite(cost) & teachable)
            parts.append((row, width * (1 + groups.scenario[low:high][row]) + column, cost[row, column]))
        demand, facility, value = (np.concatenate(part) for part in zip(*parts, strict=True))
        return demand + low, facility, value

    return services
