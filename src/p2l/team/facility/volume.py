"""The volume algorithm: a Lagrangian bound close to the linear relaxation, and a fractional opening to round.

Relaxing "every demand is served once" with prices v leaves L(v) = Σ_i v_i + Σ_j min(0, f_j - Σ_i (v_i - c_ij)⁺),
v_i <= b_i. Rows are sorted by cost, so an evaluation reads only the pairs with c_ij < v_i. The averaged subproblem
solutions estimate the relaxation's primal; only their residual per demand and their opening per facility are kept.

Source: Barahona and Chudak, "Near-optimal solutions to large-scale facility location problems" (2005).
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from p2l.records import Array
from p2l.team.facility.alarm import Flag, silent
from p2l.team.facility.kernel import kernel
from p2l.team.facility.pairs import Pairs

State = npt.NDArray[np.int8]
FREE, OPEN, CLOSED = 0, 1, -1
_CHECK = 100  # iterations after which the averages may become slower


class Bound(NamedTuple):
    """A Lagrangian bound.

    Attributes:
        multipliers: [D] v.
        value: L(v).
        reduced_cost: [F] f_j - Σ_i (v_i - c_ij)⁺.
        share: [F] estimate of each facility's opening in the linear relaxation.
    """

    multipliers: Array
    value: float
    reduced_cost: Array
    share: Array


class Pace(NamedTuple):
    """How volume iterations go on.

    Attributes:
        step: the first one, as a share of the way to what a known plan costs.
        look: iterations between two looks at the progress.
        progress: they end when a look finds that less than this share of the gap was closed since the last.
    """

    step: float = 0.1
    look: int = _CHECK
    progress: float = 1e-4


_PACE = Pace()


def raise_bound(
    pairs: Pairs,
    state: State,
    multipliers: Array,
    upper: float,
    iterations: int,
    flag: Flag | None = None,
    pace: Pace = _PACE,
) -> Bound:
    """Improve multipliers [D] by volume iterations.

    Args:
        pairs: the instance.
        state: [F] FREE, OPEN or CLOSED.
        multipliers: [D] where to begin, each at most the outside cost.
        upper: cost of a known plan; a bound that reaches it ends the search.
        iterations: at most this many.
        flag: stops them when it is raised.
        pace: how they go on, and when they end.
    """
    flag = silent() if flag is None else flag
    return Bound(*_ascend(pairs, state, multipliers, upper, *pace, iterations, flag))


def bound_of(pairs: Pairs, state: State, multipliers: Array) -> float:
    """L(v) of the instance at the given multipliers [D]."""
    scratch = np.empty(pairs.facilities), np.empty(pairs.demands)
    return float(_evaluate(pairs, state, np.minimum(multipliers, pairs.outside), *scratch))


@kernel
def _is_open(state, reduced_cost, j):
    return state[j] == OPEN or (state[j] == FREE and reduced_cost[j] < 0.0)


@kernel
def _evaluate(pairs, state, v, reduced_cost, residual):
    """L(v); fills the reduced costs [F] and the subgradient [D]: 1 - how often each demand is served."""
    start, facility, cost = pairs.start, pairs.facility, pairs.cost
    end, is_used = np.empty(v.size, dtype=np.int64), np.zeros(reduced_cost.size, dtype=np.int64)
    reduced_cost[:] = pairs.opening
    total = 0.0
    for i in range(v.size):
        price, z, last = v[i], start[i], start[i + 1]
        total += price
        while z < last and cost[z] < price:
            reduced_cost[np.uint32(facility[z])] -= price - cost[z]  # unsigned: no look at whether it is negative
            z += 1
        end[i] = z
    for j in range(reduced_cost.size):
        if _is_open(state, reduced_cost, j):
            total += reduced_cost[j]
            is_used[j] = 1
    for i in range(v.size):
        served = 0
        for z in range(start[i], end[i]):
            served += is_used[np.uint32(facility[z])]
        residual[i] = 1.0 - served
    return total


@kernel
def _move(outside, centre, mean, step, distance, trial):
    """Step from the centre along the averaged residual, cut at the outside costs; False when there is no direction."""
    norm = 0.0
    for i in range(centre.size):
        if mean[i] < 0.0 or centre[i] < outside[i]:
            norm += mean[i] * mean[i]
    if norm < 1e-12:
        return False
    length = step * distance / norm
    for i in range(centre.size):
        trial[i] = min(outside[i], centre[i] + length * mean[i])
    return True


@kernel
def _average(state, reduced_cost, residual, mean, share, weight):
    """Mix the newest subproblem solution into the averages; returns its alignment with the old direction."""
    along, cross, own = 0.0, 0.0, 0.0
    for i in range(mean.size):
        along += residual[i] * mean[i]
        difference = residual[i] - mean[i]
        cross -= difference * mean[i]
        own += difference * difference
    mix = weight if own == 0.0 else min(weight, max(0.1 * weight, cross / own))
    for i in range(mean.size):
        mean[i] += mix * (residual[i] - mean[i])
    for j in range(share.size):
        share[j] += mix * ((1.0 if _is_open(state, reduced_cost, j) else 0.0) - share[j])
    return along


@kernel
def _ascend(pairs, state, v, upper, step, look, progress, iterations, flag):
    demands, facilities = v.size, pairs.opening.size
    centre, trial = v.copy(), np.empty(demands)
    best_reduced_cost, reduced_cost = np.empty(facilities), np.empty(facilities)
    mean, residual = np.empty(demands), np.empty(demands)
    value = _evaluate(pairs, state, centre, best_reduced_cost, mean)
    share = np.zeros(facilities)
    for j in range(facilities):
        share[j] = 1.0 if _is_open(state, best_reduced_cost, j) else 0.0
    weight, idle, last_look, last_check = 0.1, 0, value, value
    aim = upper + max(0.05 * (upper - value), 1e-8 * abs(upper))  # steps that aim at a value never pass it
    for t in range(iterations):
        if flag[0] != 0 or value >= upper or not _move(pairs.outside, centre, mean, step, aim - value, trial):
            break
        trial_value = _evaluate(pairs, state, trial, reduced_cost, residual)
        along = _average(state, reduced_cost, residual, mean, share, weight)
        if trial_value > value:
            value, idle = trial_value, 0
            centre[:] = trial
            best_reduced_cost[:] = reduced_cost
            if along >= 0.0:
                step = min(2.0, step * 1.1)
        else:
            idle += 1
            if idle == 20:
                step, idle = step * 0.66, 0
        if t % look == look - 1:
            if value - last_look < progress * (upper - value):
                break
            last_look = value
        if t % _CHECK == _CHECK - 1:
            if value - last_check < 0.01 * abs(value):
                weight = max(0.01, weight * 0.7)
            last_check = value
    return centre, value, best_reduced_cost, share
