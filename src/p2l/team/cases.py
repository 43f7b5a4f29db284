"""The bound that a certificate proves: L(v) of a tree of cases, recomputed from the input with nothing believed.

What no solution below the target can contain is left out of a case: a facility, or a pair, whose use alone would raise
L(v) to the target, or that costs as much by itself; and a facility that could not save its cost if it were the only
one. What rounding may have done is taken off every bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from p2l.errors import SolverError
from p2l.records import Array, IntArray
from p2l.team.problem import Certificate

_BEYOND = 1e-9  # relative: by how much rounding may put a multiplier above its outside option
_EPS = float(np.finfo(np.float64).eps)
_ROUNDING = 8.0 * _EPS  # of a cost computed from the input, relative
USELESS = 1e-9  # relative: how much more than it can save a useless facility costs
_SLACK = 1e-12  # relative: by how much rounding may put what is taken above its limit
_BLOCK = 4_000_000  # entries of the cost table that are looked at together
_FREE, _OPEN, _CLOSED = 0, 1, -1


class Instance(NamedTuple):
    """What a certificate speaks of, read from the input block by block.

    Attributes:
        opening: [F] f_j, infinite where a facility cannot be opened.
        outside: [D] b_i, infinite where there is none.
        names: of the demands, for messages.
        block: service costs [high - low, F] of demands `low` to before `high`, infinite where there is no service.
        weights: [K, F] what each facility takes of the K limits, if there are any.
        limits: [K] what the open facilities may take together.
        pairs: where most services are infinite: demand, facility and cost [Z] of the finite ones of demands `low` to
            before `high`, in place of their block.
    """

    opening: Array
    outside: Array
    names: tuple[str, ...]
    block: Callable[[int, int], Array]
    weights: Array | None = None
    limits: Array | None = None
    pairs: Callable[[int, int], tuple[IntArray, IntArray, Array]] | None = None


class _Count(NamedTuple):
    """How many facilities are open in a case, and demands outside: at least, at most; and the price μ of each."""

    least: float = 0.0
    most: float = math.inf
    price: float = 0.0

    def paid(self) -> float:
        """μ, as often as the case says at least or at most."""
        return self.price * (self.least if self.price > 0.0 else self.most)


class _Case(NamedTuple):
    """A node's part of the instance: what is decided, which pairs are left, and a bound that is known already."""

    node: int
    state: npt.NDArray[np.int8]
    demand: IntArray
    facility: IntArray
    cost: Array
    low: float
    opened: _Count = _Count()


def tree_bound(instance: Instance, certificate: Certificate) -> float:
    """The lowest bound of a tree's leaves; its target where a case was left out that is no lower."""
    children = _children(certificate, len(instance.opening))
    multipliers = _cut(instance, certificate)[certificate.row]
    prices, count_prices = _prices(instance, certificate)[certificate.row], _count_prices(certificate)[certificate.row]
    target = certificate.target
    low, gain = _first(instance, multipliers[0], prices[0])
    if low >= target:
        return low
    lowest, waiting = math.inf, [_start(instance, multipliers[0], gain, low, target)]
    while waiting:
        fits = _within_limits(instance, waiting.pop())
        if fits is None:  # the open facilities alone take more than a limit
            continue
        case, v = fits, multipliers[fits.node]
        if (price := float(count_prices[case.node])) != case.opened.price:
            case = case._replace(opened=case.opened._replace(price=price))
        low, gain = _evaluate(instance, case, v, prices[case.node])
        if not low <= case.low:  # NaN, of an infinite cost, too
            case = case._replace(low=low)
        if case.low < target:
            fits = _within_limits(instance, _without(case, v, gain, low, target))
            if fits is None:
                continue
            case = fits
            if children[case.node]:
                waiting += _cases(certificate, children[case.node], case)
                continue
            if (case.state != _FREE).all():
                case = case._replace(low=max(case.low, _cost(instance, case)))
        lowest = min(lowest, case.low)
    return min(lowest, target)


def _children(certificate: Certificate, facilities: int) -> list[list[int]]:
    """Children of every node.

    Raises:
        SolverError: a node before its parent, a facility that does not exist, or cases that leave something out.
    """
    nodes = len(certificate.parent)
    children: list[list[int]] = [[] for _ in range(nodes)]
    if not nodes or certificate.parent[0] != -1 or bool((certificate.facility >= 2 * facilities).any()):
        raise SolverError("certificate: it has no root, or a case of a facility that does not exist")
    for node, parent in enumerate(certificate.parent[1:].tolist(), start=1):
        if not 0 <= parent < node:
            raise SolverError(f"certificate: node {node} does not come after its parent")
        children[parent].append(node)
    for node, below in enumerate(children):
        decided, sides = certificate.facility[below], certificate.is_open[below]
        whole = len(below) == 0 or (len(below) == 1 and decided[0] == -1)
        if not whole and not (len(below) == 2 and decided[0] == decided[1] != -1 and sides[0] != sides[1]):
            raise SolverError(f"certificate: the cases below node {node} leave something out")
    return children


def _cut(instance: Instance, certificate: Certificate) -> Array:
    """The multipliers, cut at the outside options that they exceed by rounding; a fine for them lets them rise."""
    outside = instance.outside + np.maximum(0.0, -_count_prices(certificate))[:, None]
    above = certificate.multipliers - outside
    if bool((above > _BEYOND * np.where(np.isfinite(outside), outside, 0.0)).any()):
        name = instance.names[int(above.max(axis=0).argmax())]
        raise SolverError(f"certificate: multiplier of {name} is above its outside option")
    cut: Array = np.minimum(certificate.multipliers, outside)
    return cut


def _prices(instance: Instance, certificate: Certificate) -> Array:
    """[R, K] prices of the instance's limits; zeros of a certificate that has none."""
    count, given = 0 if instance.limits is None else len(instance.limits), certificate.prices
    if given.shape[1] not in (0, count):
        raise SolverError(f"certificate: has prices of {given.shape[1]} limits; there are {count}")
    return given if given.shape[1] else np.zeros((len(given), count))


def _count_prices(certificate: Certificate) -> Array:
    """[R] μ of each v."""
    assert certificate.count_prices is not None
    return certificate.count_prices


def _first(instance: Instance, v: Array, price: Array) -> tuple[float, Array]:
    """L(v) of the whole instance, and what deciding against it adds for each facility, block by block."""
    saving = np.zeros(len(instance.opening))
    step = max(1, _BLOCK // max(1, len(saving)))
    for start in range(0, len(v), step):
        end = min(len(v), start + step)
        if instance.pairs is not None:
            demand, facility, cost = instance.pairs(start, end)
            saving += np.bincount(facility, np.maximum(v[demand] - cost, 0.0), len(saving))
            continue
        saving += np.maximum(v[start:end, None] - instance.block(start, end), 0.0).sum(axis=0)
    return _lagrangian(instance, price, _Count(), np.zeros(len(saving), dtype=np.int8), v, saving)


def _evaluate(instance: Instance, case: _Case, v: Array, price: Array) -> tuple[float, Array]:
    """As `_first`, on what is left of a case."""
    margin = v[case.demand] - case.cost
    used = margin > 0.0
    saving = np.bincount(case.facility[used], margin[used], len(case.state)).astype(np.float64)
    return _lagrangian(instance, price, case.opened, case.state, v, saving)


def _lagrangian(
    instance: Instance, price: Array, count: _Count, state: npt.NDArray[np.int8], v: Array, saving: Array
) -> tuple[float, Array]:
    """L(v) and, by facility, its reduced cost; what rounding may have changed is taken off the size of both."""
    opening, paid = instance.opening, np.zeros(0)
    if instance.weights is not None and instance.limits is not None and price.any():
        opening, paid = opening + price @ instance.weights, -price * instance.limits * (1.0 + _SLACK)
    each = count.price if math.isfinite(count.paid()) else 0.0  # a fine is paid back nowhere without an upper count
    opening, paid, fuzz = _with_count(instance, count, each, opening, paid, v)
    opening = np.where(closed := state == _CLOSED, 0.0, opening)
    reduced_cost = opening - saving
    used = (state == _OPEN) | (~closed & (reduced_cost < 0.0))
    eps, prices = _EPS, float(np.abs(v).sum())
    lost = eps * (len(v) + 8) * (np.abs(opening) + saving) + _ROUNDING * prices
    lost += _ROUNDING * abs(each)
    value = math.fsum([*v.tolist(), *reduced_cost[used].tolist(), *paid.tolist()])
    low = value - float(lost[used].sum()) - eps * (abs(value) + float(np.abs(paid).sum())) - fuzz
    lost[np.isinf(reduced_cost)] = 0.0  # an infinite opening cost is above all that rounding may do
    gain = np.maximum(np.abs(reduced_cost) - lost, 0.0)
    return low, np.sign(reduced_cost) * gain


def _with_count(
    instance: Instance, count: _Count, each: float, opening: Array, paid: Array, v: Array
) -> tuple[Array, Array, float]:
    """Opening costs and constants at `each` less for all that is counted, and what rounding may do to the constants.

    Without a price, no multiplier is above its outside option, unless the case has no use for its fine.
    """
    if count.price == 0.0:
        return opening, paid, 0.0
    left_outside = np.minimum(0.0, instance.outside - each - v)
    size = np.abs(v) + abs(each) + np.where(left_outside < 0.0, np.abs(instance.outside), 0.0)
    back = 0.0 if each == 0.0 else count.paid()
    return opening - each, np.concatenate([paid, left_outside, [back]]), _ROUNDING * (float(size.sum()) + abs(back))


def _start(instance: Instance, v: Array, gain: Array, low: float, target: float) -> _Case:
    """What the root leaves: every pair and facility that a solution below the target can contain."""
    none = np.zeros(0, dtype=np.int64)
    state = np.where(instance.opening >= target, np.int8(_CLOSED), np.int8(_FREE))
    decided = _without(_Case(0, state, none, none, np.zeros(0), low), v, gain, low, target)
    parts: list[tuple[IntArray, IntArray, Array]] = []
    saving = np.zeros(len(state))
    step = max(1, _BLOCK // max(1, len(state)))
    for start in range(0, len(v), step):
        end = min(len(v), start + step)
        demand, facility, cost = _services(instance, start, end)
        better = cost < instance.outside[demand]
        saving += np.bincount(facility[better], (instance.outside[demand] - cost)[better], len(state))
        left = better & ~(cost >= target * (1.0 + _ROUNDING))
        pairs = decided._replace(demand=demand[left], facility=facility[left], cost=cost[left])
        rest = _without(pairs, v, gain, low, target)
        parts.append((rest.demand, rest.facility, rest.cost))
    demand, facility, cost = (np.concatenate(part) for part in zip(*parts, strict=True))
    useless = (decided.state == _FREE) & (saving * (1.0 + USELESS) <= instance.opening)  # without it costs no more
    state = np.where(useless, np.int8(_CLOSED), decided.state)
    return decided._replace(state=state, demand=demand, facility=facility, cost=cost)


def _services(instance: Instance, start: int, end: int) -> tuple[IntArray, IntArray, Array]:
    """Demand, facility and cost of services below the outside options, or of more than these."""
    if instance.pairs is not None:
        return instance.pairs(start, end)
    cost = instance.block(start, end)
    row, column = np.nonzero(cost < instance.outside[start:end, None])
    return row + start, column, cost[row, column]


def _without(case: _Case, v: Array, gain: Array, low: float, target: float) -> _Case:
    """A case without the facilities and pairs whose use, or absence, alone costs as much as the target.

    `low` is L(v) of the very v that `gain` belongs to; a bound that an earlier node has proven may not stand in for it.
    """
    state = case.state.copy()
    free = state == _FREE
    state[free & (low + gain >= target)] = _CLOSED
    state[free & (low - gain >= target)] = _OPEN
    detour = np.where(state == _FREE, np.maximum(gain, 0.0), 0.0)[case.facility]
    detour += np.maximum(case.cost * (1.0 - _ROUNDING) - v[case.demand], 0.0)
    left = ~(low + detour >= target) & (state[case.facility] != _CLOSED)  # what is not proven to be out stays
    return case._replace(state=state, demand=case.demand[left], facility=case.facility[left], cost=case.cost[left])


def _cases(certificate: Certificate, below: list[int], case: _Case) -> list[_Case]:
    """The cases below a node, without the one that its bound rules out."""
    cases = []
    for node in below:
        facility, side = int(certificate.facility[node]), _OPEN if certificate.is_open[node] else _CLOSED
        if facility < 0:
            cases.append(case._replace(node=node))
        elif (number := facility - len(case.state)) >= 0:
            count = case.opened
            more, fewer = max(count.least, number + 1.0), min(count.most, float(number))
            count = count._replace(least=more) if side == _OPEN else count._replace(most=fewer)
            cases.append(case._replace(node=node, opened=count))
        elif case.state[facility] in (_FREE, side):
            state = case.state.copy()
            state[facility] = side
            cases.append(case._replace(node=node, state=state))
    return cases


def _within_limits(instance: Instance, case: _Case) -> _Case | None:
    """The case in which free facilities are closed that no longer fit; None if the open ones break a limit alone."""
    if instance.weights is None or instance.limits is None:
        return case
    state = case.state
    taken, most = instance.weights[:, state == _OPEN].sum(axis=1), instance.limits * (1.0 + _SLACK)
    if (taken > most).any():
        return None
    too_much = (taken[:, None] + instance.weights > most[:, None]).any(axis=0)
    return case._replace(state=np.where((state == _FREE) & too_much, np.int8(_CLOSED), state))


def _cost(instance: Instance, case: _Case) -> float:
    """What the only open set of a decided case costs at least."""
    service, is_open = np.array(instance.outside), case.state == _OPEN
    open_pairs = is_open[case.facility]
    np.minimum.at(service, case.demand[open_pairs], case.cost[open_pairs])
    return math.fsum([*instance.opening[is_open].tolist(), *service.tolist()]) * (1.0 - _ROUNDING)
