"""Facility location for its own sake: the public `solve_facility_location` (thesis, equation 3.3).

The number of useful pairs alone decides who solves an instance, so that it goes the same way in every process: HiGHS
takes the small ones, which it solves sooner than the compiled kernels load, the large-scale route all others.
"""

from __future__ import annotations

import time

import numpy as np

from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, BoolArray, freeze
from p2l.team.facility.pairs import Pairs, PairsSolution, of_table, open_for_outside
from p2l.team.problem import Certificate, FacilitySolution, Status

FEW_PAIRS = 1_000  # up to so many HiGHS takes at most 0.35 s; the kernels load in 0.45 s, once per process
_LARGEST = 1e100  # sums of larger costs overflow
_TOLERANCE = 1e-6  # relative gap up to which HiGHS is believed: its feasibility tolerance


def solve_facility_location(
    opening_cost: Array, service_cost: Array, *, time_limit_s: float = 60.0, gap: float = 0.0
) -> FacilitySolution:
    """Open facilities and assign demands at least total cost (thesis, equation 3.3).

    Args:
        opening_cost: [F] at least 0 and at most 1e100.
        service_cost: [D, F] at least 0 and at most 1e100, cost of serving a demand (row) from a facility (column).
        time_limit_s: wall seconds; at the limit the best solution so far is returned with its true bound.
        gap: relative gap at which the search may stop; 0 proves optimality, to 1e-9 relative, or to 1e-6 relative
            where the instance has at most 1,000 useful pairs.

    Raises:
        ShapeError: no facility or no demand, a wrong shape, a cost that is complex, NaN, infinite, negative or
            above 1e100.
        ConfigError: a time limit of zero or less, or a gap outside [0, 1).

    Example:
        >>> import numpy as np
        >>> from p2l import solve_facility_location
        >>> opening, service = np.array([4.0, 3.0]), np.array([[1.0, 6.0], [2.0, 3.0], [6.0, 1.0]])
        >>> solution = solve_facility_location(opening, service)
        >>> solution.open.tolist(), solution.assignment.tolist(), solution.cost, solution.status
        ([True, True], [0, 0, 1], 11.0, 'optimal')
    """
    if not time_limit_s > 0.0:
        raise ConfigError(f"time_limit_s: {time_limit_s} given; it must be above 0")
    if not 0.0 <= gap < 1.0:
        raise ConfigError(f"gap: {gap} given; it is relative and must lie in [0, 1)")
    start = time.perf_counter()
    sizes: dict[str, int] = {}
    opening = np.array(freeze("opening_cost", opening_cost, ("F",), sizes, low=0.0, high=_LARGEST))
    service = np.array(freeze("service_cost", service_cost, ("D", "F"), sizes, low=0.0, high=_LARGEST))
    if not service.size:
        raise ShapeError(f"service_cost: has shape {service.shape}; give at least one demand and one facility")
    pairs = of_table(opening, service)
    if len(pairs.cost) <= FEW_PAIRS:
        solution = _by_highs(pairs, time_limit_s, gap)
    else:
        from p2l.team.facility.solve import load_kernels, solve_pairs

        load_kernels()
        start = time.perf_counter()
        solution = solve_pairs(pairs, deadline=start + time_limit_s, gap=gap)
    open_set = open_for_outside(opening, service, solution.open)
    assignment = np.flatnonzero(open_set)[service[:, open_set].argmin(axis=1)]
    cost = float(opening[open_set].sum() + service[np.arange(len(service)), assignment].sum())
    bound = _bound(pairs, solution.multipliers)
    return FacilitySolution(
        open=open_set,
        assignment=assignment,
        cost=cost,
        lower_bound=min(cost, solution.lower_bound),
        status=solution.status,
        seconds=time.perf_counter() - start,
        certificate=Certificate(np.minimum(solution.multipliers, pairs.outside), min(bound, cost), cost),
    )


def _by_highs(pairs: Pairs, time_limit_s: float, gap: float) -> PairsSolution:
    """The solution of a small instance, with the multipliers of its linear relaxation."""
    from p2l.team.facility.program import solve_program

    program = solve_program(pairs, time_limit_s=time_limit_s, gap=gap)
    open_set = np.zeros(pairs.facilities, dtype=bool) if program.open is None else program.open
    multipliers = pairs.outside if program.multipliers is None else np.minimum(program.multipliers, pairs.outside)
    cost = _cost(pairs, open_set)
    lower = min(cost, max(program.lower_bound, _bound(pairs, multipliers)))
    status: Status = "optimal" if lower >= cost * (1.0 - _TOLERANCE) else "feasible"
    return PairsSolution(open_set, cost, lower, status if program.complete else "time_limit", multipliers)


def _cost(pairs: Pairs, open_set: BoolArray) -> float:
    """Opening plus cheapest open or outside service."""
    best = np.full(pairs.demands, np.inf)
    service = np.flatnonzero(open_set[pairs.facility])
    np.minimum.at(best, pairs.rows()[service], pairs.cost[service])
    return float(pairs.opening[open_set].sum() + np.minimum(best, pairs.outside).sum())


def _bound(pairs: Pairs, multipliers: Array) -> float:
    """L(v), from scratch."""
    saving = np.zeros(pairs.facilities)
    np.add.at(saving, pairs.facility, np.maximum(multipliers[pairs.rows()] - pairs.cost, 0.0))
    return float(multipliers.sum() + np.minimum(0.0, pairs.opening - saving).sum())
