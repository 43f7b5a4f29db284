"""An independent check of a shop's plan and of its lower bound: no solver, no pairs, only the shop's own numbers.

As `p2l.team.certificate`, whose tree of cases it uses for every leaf; what is new is in the instance (copies, robots,
lessons, decisions that a person has made, limits) and in the cases of a partial order, which have to be those of a
circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, get_args

import numpy as np

from p2l.errors import SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.cases import Instance, tree_bound
from p2l.team.certificate import PROVEN, Verdict
from p2l.team.problem import Status, relative_gap
from p2l.team.shop.outcome import attempt_cost, shop_outcome
from p2l.team.shop.record import Ruling, Shop, ShopCertificate, ShopPlan, precedence

_TABLE = 4_000_000  # entries of a table of service costs that is kept from case to case


def check_shop_plan(shop: Shop, plan: ShopPlan) -> Verdict:
    """Recompute a plan from its lessons and its sequence, and the bound from its certificate.

    Raises:
        SolverError: the plan has no certificate, or a number or the status in it is not what the shop gives.
        ShapeError: the plan breaks the order, a limit, or a decision that is made.

    Example:
        >>> import numpy as np
        >>> from p2l import Problem, Shop, check_shop_plan, plan_shop
        >>> one = np.ones(1)
        >>> day = Shop.of_problem(Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1)))
        >>> check_shop_plan(day, plan_shop(day)).optimal
        True
    """
    if plan.certificate is None:
        raise SolverError("certificate: none given; plan with planner=auto")
    outcome = shop_outcome(shop, plan.taught, plan.sequence)
    for name in ("decision", "robot", "lesson", "p_success", "expected_cost"):
        claim, truth = getattr(plan, name), getattr(outcome, name)
        if len(claim) != len(truth) or not bool((np.abs(claim - truth) <= PROVEN * np.abs(truth)).all()):
            raise SolverError(f"certificate: {name} of a task is not what the shop gives")
    if not abs(plan.objective - outcome.total) <= PROVEN * abs(outcome.total):
        raise SolverError(f"certificate: objective is {plan.objective}, but the shop gives {outcome.total}")
    bound = shop_bound(shop, plan.certificate)
    if not bound <= outcome.total * (1.0 + PROVEN):
        raise SolverError(f"certificate: proves that nothing costs less than {bound}; this costs {outcome.total}")
    if not plan.lower_bound <= bound + PROVEN * abs(outcome.total):
        raise SolverError(f"certificate: lower_bound is {plan.lower_bound}, but {bound} is proven")
    gap = relative_gap(outcome.total, plan.lower_bound)
    if not abs(plan.gap - gap) <= PROVEN or plan.status not in get_args(Status):
        raise SolverError(f"certificate: gap is {plan.gap} and status '{plan.status}'; cost and bound give {gap}")
    if (plan.status == "optimal") != (plan.gap <= PROVEN):
        raise SolverError(f"certificate: status is '{plan.status}', but a gap of {gap:.2g} is proven")
    return Verdict(outcome.total, bound, relative_gap(outcome.total, bound))


def shop_bound(shop: Shop, proof: ShopCertificate) -> float:
    """What no plan of the shop costs less than.

    Raises:
        SolverError: cases that leave something out, a leaf without a certificate, or one of another shop.
    """
    services = services_of(shop)
    return cases_bound(shop, proof, len(shop.groups[0]), lambda dropped: instance_of(shop, services, dropped))


def cases_bound(shop: Shop, proof: ShopCertificate, demands: int, instance: Callable[[BoolArray], Instance]) -> float:
    """The lowest bound of the cases of a day's order of work.

    Args:
        shop: the day, whose groups of copies are the first demands.
        proof: the cases.
        demands: how many demands the instances have.
        instance: that of a case, from the pairs [L, G] that are left out of it.

    Raises:
        SolverError: as `shop_bound`.
    """
    below = _below(proof)
    lowest, waiting = math.inf, [(0, np.zeros((len(shop.lessons), len(shop.groups[0])), dtype=bool))]
    while waiting:
        case, dropped = waiting.pop()
        if below[case]:
            pairs = [(int(proof.lesson[each]), int(proof.group[each])) for each in below[case]]
            _check_circle(shop, pairs)
            for each, (lesson, group) in zip(below[case], pairs, strict=True):
                less = dropped.copy()
                less[lesson, group] = True
                waiting.append((each, less))
            continue
        leaf = proof.leaf[case]
        if leaf is None or leaf.multipliers.shape[1] != demands:
            raise SolverError(f"certificate: case {case} has no proof of this shop")
        lowest = min(lowest, tree_bound(instance(dropped), leaf))
    return lowest


def _below(proof: ShopCertificate) -> list[list[int]]:
    if not len(proof.parent) or proof.parent[0] != -1:
        raise SolverError("certificate: it has no root")
    below: list[list[int]] = [[] for _ in proof.leaf]
    for case, parent in enumerate(proof.parent[1:].tolist(), start=1):
        if not 0 <= parent < case:
            raise SolverError(f"certificate: case {case} does not come after its parent")
        below[parent].append(case)
    return below


def _check_circle(shop: Shop, pairs: list[tuple[int, int]]) -> None:
    """Refuse cases that are not those of a circle: pair after pair, its task comes before the next one's lesson."""
    task, _ = shop.groups
    comes_before = precedence(shop)
    for (lesson, group), (following, _) in zip(pairs, [*pairs[1:], pairs[0]], strict=True):
        if not (0 <= lesson < len(shop.lessons) and 0 <= group < len(task)):
            raise SolverError("certificate: a case leaves out a pair that does not exist")
        first, own = int(task[group]), int(shop.completes[following])
        if shop.completes[lesson] < 0 or own < 0 or not comes_before[first, own]:
            raise SolverError("certificate: the pairs that its cases leave out are no circle")


class Services(NamedTuple):
    """Facilities of a shop: lesson [F], robot [F], and service costs [high - low, F] of some groups."""

    lesson: IntArray
    robot: IntArray
    block: Callable[[int, int], Array]


def services_of(shop: Shop) -> Services:
    """What every lesson of a day, given to any robot, is worth to its groups of copies."""
    task, size = shop.groups
    facilities = [(each, r) for each in range(len(shop.lessons)) for r in range(len(shop.robots))]
    lesson = np.array([each for each, _ in facilities], dtype=np.int64)
    robot = np.array([r for _, r in facilities], dtype=np.int64)
    own = shop.completes[lesson]
    forbidden = None if shop.order == "any" else precedence(shop)

    def block(low: int, high: int) -> Array:
        cost = np.full((high - low, len(facilities)), np.inf)
        for g in range(low, high):
            i = int(task[g])
            if shop.choice[i] != Ruling.DELEGATE and not (shop.choice[i] == Ruling.LEARN and g < shop.n):
                attempts = attempt_cost(shop, robot, np.full(len(robot), i), shop.transfer[robot, lesson, i])
                cost[g - low] = float(size[g]) * attempts
                if forbidden is not None:
                    cost[g - low][(own >= 0) & forbidden[i, np.maximum(own, 0)]] = np.inf
            if g < shop.n:
                cost[g - low][own == i] = 0.0
        return cost

    if len(task) * len(facilities) > _TABLE:
        return Services(lesson, robot, block)
    table = block(0, len(task))
    return Services(lesson, robot, lambda low, high: table[low:high])


def instance_of(shop: Shop, services: Services, dropped: BoolArray) -> Instance:
    """A day as facility location, without the pairs [L, G] that a case leaves out."""
    task, size = shop.groups
    lesson, block = services.lesson, services.block
    may_be = np.array([_may_be_taught(shop, each) for each in lesson.tolist()], dtype=bool)
    opening = np.where(may_be, shop.c_demo[services.robot, lesson], np.inf)
    names = tuple(f"task '{shop.tasks[i]}'" for i in task.tolist())
    rest = block
    if dropped.any():

        def rest(low: int, high: int) -> Array:
            return np.where(dropped[lesson, low:high].T, np.inf, block(low, high))

    groups = zip(task.tolist(), size.tolist(), strict=True)
    outside = np.array([_without_lessons(shop, g, i, float(m)) for g, (i, m) in enumerate(groups)])
    limits = np.array([shop.max_lessons, shop.max_teaching])
    used = np.isfinite(limits)
    weights = np.stack([np.ones(len(lesson)), np.where(np.isinf(opening), 0.0, opening)])
    if not used.any():
        return Instance(opening, outside, names, rest)
    return Instance(opening, outside, names, rest, weights[used], limits[used])


def _may_be_taught(shop: Shop, lesson: int) -> bool:
    i = int(shop.completes[lesson])
    return i < 0 or shop.choice[i] in (Ruling.FREE, Ruling.LEARN)


def _without_lessons(shop: Shop, group: int, task: int, size: float) -> float:
    if shop.choice[task] == Ruling.LEARN and group < shop.n:
        return math.inf
    person = math.inf if shop.choice[task] == Ruling.ACT else float(shop.c_hum[task])
    if shop.choice[task] == Ruling.DELEGATE:
        return person * size
    robots = np.arange(len(shop.robots))
    attempts = attempt_cost(shop, robots, np.full(len(robots), task), shop.pretrained[:, task])
    return size * min(person, float(attempts.min()))
