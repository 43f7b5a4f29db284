"""The volume algorithm with prices on limits: multipliers v and prices λ move together.

As `volume`; a limit Σ_j w_kj y_j <= B_k is one more relaxed constraint, whose residual is what the averaged subproblem
solutions take too much. Residuals of limits are counted in a unit of their own, since a step has to mean as much for a
price, which every facility pays, as for a multiplier.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from p2l.records import Array
from p2l.team.facility.alarm import Flag
from p2l.team.facility.kernel import kernel
from p2l.team.facility.pairs import Pairs
from p2l.team.facility.volume import Bound, State, _evaluate, _is_open

_FIRST_STEP = 0.1
_UNIT = 0.15  # exponent of the number of facilities, tried on 1,000 tasks: prices move fast, and settle
_CHECK = 100  # iterations between two looks at the progress


class Priced(NamedTuple):
    """A bound with its prices λ [K]; `value` is L(v, λ), and `bound` that of the instance with λ w in its openings."""

    bound: Bound
    prices: Array
    value: float


def raise_priced_bound(
    pairs: Pairs,
    state: State,
    weights: Array,
    limits: Array,
    multipliers: Array,
    prices: Array,
    upper: float,
    iterations: int,
    flag: Flag,
) -> Priced:
    """Improve multipliers [D] and prices [K] by volume iterations.

    Args:
        pairs: the instance, without prices.
        state: [F] FREE, OPEN or CLOSED.
        weights: [K, F] what each facility takes of each limit.
        limits: [K] what the open facilities may take together.
        multipliers: [D] where to begin.
        prices: [K] where to begin.
        upper: cost of a known plan; a bound that reaches it ends the search.
        iterations: at most this many.
        flag: stops them when it is raised.
    """
    size = np.sqrt((weights**2).mean(axis=1))
    unit = np.where(size > 0.0, size, 1.0) * pairs.facilities**_UNIT
    work = pairs._replace(opening=pairs.opening.copy())
    v, price, value, reduced_cost, share = _ascend(
        work, pairs.opening, state, weights, limits, unit, multipliers, prices, upper, iterations, flag
    )
    paid = float(price @ limits)
    return Priced(Bound(v, value + paid, reduced_cost, share), price, value)


@kernel
def _price(opening, base, weights, price):
    for j in range(opening.size):
        opening[j] = base[j]
        for k in range(price.size):
            opening[j] += price[k] * weights[k, j]


@kernel
def _taken(state, reduced_cost, weights, limits, unit, excess):
    """[K] what the subproblem's solution takes beyond each limit, over the unit."""
    for k in range(limits.size):
        excess[k] = -limits[k]
    for j in range(reduced_cost.size):
        if _is_open(state, reduced_cost, j):
            for k in range(limits.size):
                excess[k] += weights[k, j]
    for k in range(limits.size):
        excess[k] /= unit[k]


@kernel
def _ascend(work, base, state, weights, limits, unit, v, prices, upper, iterations, flag):
    demands, facilities, count = v.size, base.size, limits.size
    centre, trial = v.copy(), np.empty(demands)
    price, trial_price = prices.copy(), np.empty(count)
    best_reduced_cost, reduced_cost = np.empty(facilities), np.empty(facilities)
    mean, residual = np.empty(demands), np.empty(demands)
    mean_excess, excess = np.empty(count), np.empty(count)
    _price(work.opening, base, weights, price)
    value = _evaluate(work, state, centre, best_reduced_cost, mean)
    for k in range(count):
        value -= price[k] * limits[k]
    _taken(state, best_reduced_cost, weights, limits, unit, mean_excess)
    share = np.zeros(facilities)
    for j in range(facilities):
        share[j] = 1.0 if _is_open(state, best_reduced_cost, j) else 0.0
    step, weight, idle, last_check = _FIRST_STEP, 0.1, 0, value
    aim = upper + max(0.05 * (upper - value), 1e-8 * abs(upper))
    for t in range(iterations):
        if flag[0] != 0 or value >= upper:
            break
        norm = 0.0
        for i in range(demands):
            if mean[i] < 0.0 or centre[i] < work.outside[i]:
                norm += mean[i] * mean[i]
        for k in range(count):
            if mean_excess[k] > 0.0 or price[k] > 0.0:
                norm += mean_excess[k] * mean_excess[k]
        if norm < 1e-12:
            break
        length = step * (aim - value) / norm
        for i in range(demands):
            trial[i] = min(work.outside[i], centre[i] + length * mean[i])
        for k in range(count):
            trial_price[k] = max(0.0, price[k] + length * mean_excess[k] / unit[k])
        _price(work.opening, base, weights, trial_price)
        trial_value = _evaluate(work, state, trial, reduced_cost, residual)
        for k in range(count):
            trial_value -= trial_price[k] * limits[k]
        _taken(state, reduced_cost, weights, limits, unit, excess)
        along, cross, own = 0.0, 0.0, 0.0
        for i in range(demands):
            along += residual[i] * mean[i]
            difference = residual[i] - mean[i]
            cross -= difference * mean[i]
            own += difference * difference
        for k in range(count):
            along += excess[k] * mean_excess[k]
            difference = excess[k] - mean_excess[k]
            cross -= difference * mean_excess[k]
            own += difference * difference
        mix = weight if own == 0.0 else min(weight, max(0.1 * weight, cross / own))
        for i in range(demands):
            mean[i] += mix * (residual[i] - mean[i])
        for k in range(count):
            mean_excess[k] += mix * (excess[k] - mean_excess[k])
        for j in range(facilities):
            share[j] += mix * ((1.0 if _is_open(state, reduced_cost, j) else 0.0) - share[j])
        if trial_value > value:
            value, idle = trial_value, 0
            centre[:] = trial
            price[:] = trial_price
            best_reduced_cost[:] = reduced_cost
            if along >= 0.0:
                step = min(2.0, step * 1.1)
        else:
            idle += 1
            if idle == 20:
                step, idle = step * 0.66, 0
        if t % _CHECK == _CHECK - 1:
            if value - last_check < 1e-4 * (upper - value):
                break
            if value - last_check < 0.01 * abs(value):
                weight = max(0.01, weight * 0.7)
            last_check = value
    return centre, price, value, best_reduced_cost, share
