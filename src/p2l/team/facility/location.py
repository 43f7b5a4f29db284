"""Facility location for its own sake: the public `solve_facility_location` (thesis, equation 3.3).

A small instance is given to HiGHS first, for no longer than it takes to load the compiled kernels of `facility`; what
HiGHS does not prove in that time, and everything larger, goes the large-scale route.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, freeze
from p2l.team.facility.pairs import Answer, Pairs, of_table, open_for_outside
from p2l.team.problem import Certificate, FacilitySolution, Status

_FEW_PAIRS = 6_000  # HiGHS answers such an instance sooner than the kernels load
_LOADING_S = 0.4  # what loading them takes at least
_LARGEST = 1e100  # sums of larger costs overflow
_TRUSTED = 1e-6  # relative gap up to which HiGHS is believed: its feasibility tolerance


def solve_facility_location(
    opening_cost: Array, service_cost: Array, *, time_limit_s: float = 60.0, gap: float = 0.0
) -> FacilitySolution:
    """Open facilities and assign demands at least total cost (thesis, equation 3.3).

    Args:
        opening_cost: [F] at least 0 and at most 1e100.
        service_cost: [D, F] at least 0 and at most 1e100, cost of serving a demand (row) from a facility (column).
        time_limit_s: wall seconds; at the limit the best solution so far is returned with its true bound.
        gap: relative gap at which the search may stop; 0 proves optimality (to 1e-9 relative).

    Raises:
        ShapeError: no facility or no demand, a wrong shape, a cost that is complex, NaN, infinite, negative or
            above 1e100.
        ConfigError: a time limit of zero or less, or a gap outside [0, 1).
    """
    if not time_limit_s > 0.0:
        raise ConfigError(f"time_limit_s: {time_limit_s} given; it must be above 0")
    if not 0.0 <= gap < 1.0:
        raise ConfigError(f"gap: {gap} given; it is relative and must lie in [0, 1)")
    began = time.perf_counter()
    sizes: dict[str, int] = {}
    opening = np.array(freeze("opening_cost", opening_cost, ("F",), sizes, low=0.0, high=_LARGEST))
    service = np.array(freeze("service_cost", service_cost, ("D", "F"), sizes, low=0.0, high=_LARGEST))
    if not service.size:
        raise ShapeError(f"service_cost: has shape {service.shape}; give at least one demand and one facility")
    pairs = of_table(opening, service)
    answer = _at_once(pairs, time_limit_s, gap)
    if answer is None:
        from p2l.team.facility.solve import load_kernels, solve_pairs

        load_kernels()
        began = time.perf_counter()
        answer = solve_pairs(pairs, deadline=began + time_limit_s, gap=gap)
    opened = open_for_outside(opening, service, answer.open)
    assignment = np.flatnonzero(opened)[service[:, opened].argmin(axis=1)]
    cost = float(opening[opened].sum() + service[np.arange(len(service)), assignment].sum())
    bound = _bound(pairs, answer.multipliers)
    return FacilitySolution(
        open=opened,
        assignment=assignment,
        cost=cost,
        lower_bound=min(cost, answer.lower_bound),
        status=answer.status,
        seconds=time.perf_counter() - began,
        certificate=Certificate(np.minimum(answer.multipliers, pairs.outside), min(bound, cost), cost),
    )


def _at_once(pairs: Pairs, time_limit_s: float, gap: float) -> Answer | None:
    """A small instance by HiGHS, if that takes less time than loading the kernels; None if it does not."""
    if len(pairs.cost) > _FEW_PAIRS or "p2l.team.facility.solve" in sys.modules:
        return None
    from p2l.team.facility.core import solve_core

    found = solve_core(pairs, time_limit_s=min(time_limit_s, _LOADING_S), gap=gap)
    if found.open is None or not found.finished or found.multipliers is None:
        return None
    best = np.full(pairs.demands, np.inf)
    served = np.flatnonzero(found.open[pairs.facility])
    np.minimum.at(best, pairs.rows()[served], pairs.cost[served])
    cost = float(pairs.opening[found.open].sum() + np.minimum(best, pairs.outside).sum())
    multipliers = np.minimum(found.multipliers, pairs.outside)
    lower = min(cost, max(found.lower_bound, _bound(pairs, multipliers)))
    status: Status = "optimal" if lower >= cost * (1.0 - _TRUSTED) else "feasible"
    return Answer(found.open, cost, lower, status, multipliers)


def _bound(pairs: Pairs, multipliers: Array) -> float:
    """L(v), from scratch."""
    saved = np.zeros(pairs.facilities)
    np.add.at(saved, pairs.facility, np.maximum(multipliers[pairs.rows()] - pairs.cost, 0.0))
    return float(multipliers.sum() + np.minimum(0.0, pairs.opening - saved).sum())
