"""What no good solution can use, taken out before any solver sees it, and one scale for what is left.

Serving every demand in the way that is cheapest for it alone costs U, at most D times the optimum. A facility or a pair
that costs more than U is in no optimal solution, and an outside option above U is as good as none. So whatever a person
writes for "never", a million, 1e15 or infinity, the solvers meet numbers between 0 and 2 U, and their absolute
tolerances mean something. Scaling by a power of two changes no digit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from p2l.records import Array, BoolArray
from p2l.team.facility.pairs import Pairs

_ROUNDING = 1e-12  # relative, on the safe side of every comparison
_LARGEST_EXPONENT = 1000


class Presolved(NamedTuple):
    """An instance with the same demands, facilities and optimal solutions.

    Attributes:
        pairs: scaled, so that U lies between 1 and 2 (unless nothing costs anything).
        scale: what its costs were multiplied with.
        open: [F] the solution of cost U.
    """

    pairs: Pairs
    scale: float
    open: BoolArray


def presolve(pairs: Pairs) -> Presolved:
    """Take out what costs more than a solution that is known, and scale."""
    open_set = _alone(pairs)
    small, scale = presolve_below(pairs, solution_cost(pairs, open_set), np.ones(pairs.facilities, dtype=bool))
    return Presolved(small, scale, open_set)


def presolve_below(pairs: Pairs, upper: float, usable: BoolArray) -> tuple[Pairs, float]:
    """The instance of `usable` facilities [F] and of what costs no more than `upper`, and what it was scaled with."""
    scale = 2.0 ** min(_LARGEST_EXPONENT, max(-_LARGEST_EXPONENT, 1 - math.frexp(upper)[1])) if upper > 0.0 else 1.0
    limit = upper * (1.0 + _ROUNDING)
    dear = 2.0 * upper if upper > 0.0 else 1.0  # more than any good solution costs
    usable = usable & (pairs.opening <= limit)
    useful = usable[pairs.facility] & (pairs.cost <= limit)
    left = Pairs(
        opening=np.where(usable, pairs.opening, dear) * scale,
        outside=np.minimum(pairs.outside, dear) * scale,
        start=np.concatenate([[0], np.cumsum(useful)])[pairs.start],
        facility=pairs.facility[useful],
        cost=pairs.cost[useful] * scale,
    )
    return left, scale


def solution_cost(pairs: Pairs, open_set: BoolArray) -> float:
    """Opening plus each demand's cheapest open or outside service, rounded once."""
    service, is_served = pairs.outside.copy(), open_set[pairs.facility]
    np.minimum.at(service, pairs.rows()[is_served], pairs.cost[is_served])
    return math.fsum([*pairs.opening[open_set].tolist(), *service.tolist()])


def lagrangian(pairs: Pairs, multipliers: Array) -> float:
    """L(v) as a solver sees it, multipliers [D]; what is reported is `p2l.team.certificate`'s."""
    return float(multipliers.sum() + np.minimum(0.0, reduced_costs(pairs, multipliers)).sum())


def reduced_costs(pairs: Pairs, multipliers: Array) -> Array:
    """[F] f_j - Σ_i (v_i - c_ij)⁺ at multipliers [D]."""
    saving = np.zeros(pairs.facilities)
    np.add.at(saving, pairs.facility, np.maximum(multipliers[pairs.rows()] - pairs.cost, 0.0))
    return np.asarray(pairs.opening - saving)


def _alone(pairs: Pairs) -> BoolArray:
    """[F] the facilities that some demand would open for itself alone."""
    total: Array = pairs.opening[pairs.facility] + pairs.cost
    open_set = np.zeros(pairs.facilities, dtype=bool)
    some = np.flatnonzero(np.diff(pairs.start))
    if not some.size:
        return open_set
    best = np.minimum.reduceat(total, pairs.start[some])
    rows = np.repeat(best, np.diff(pairs.start)[some])
    place = np.flatnonzero(total == rows)
    demand = pairs.rows()[place]
    first = place[np.unique(demand, return_index=True)[1]]
    wanted = best < pairs.outside[some]
    open_set[pairs.facility[first[wanted]]] = True
    return open_set
