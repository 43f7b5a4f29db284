"""Facility location for its own sake: the public `solve_facility_location` (thesis, equation 3.3).

The number of useful pairs alone decides who solves an instance, so that it goes the same way in every process: HiGHS
takes the linear relaxation of the small ones, which is often integral and is there sooner than the compiled kernels are
loaded, and branches on it in the tiny ones; the large-scale route takes all others. What the solution costs and what is
proven is recomputed by `p2l.team.certificate`, and nothing else is reported.
"""

from __future__ import annotations

import math
import time
from types import ModuleType

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray
from p2l.team.certificate import EXACT, PROVEN, proven_location_bound
from p2l.team.contract import check_stopping
from p2l.team.costs import freeze_cost
from p2l.team.facility.pairs import Pairs, PairsSolution, of_table, open_for_outside
from p2l.team.facility.presolve import lagrangian, presolve, solution_cost
from p2l.team.loading import loaded
from p2l.team.problem import Certificate, FacilitySolution, relative_gap

FEW_PAIRS = 1_000  # up to so many HiGHS takes at most 0.35 s; the kernels load in 0.45 s, once per process
# Demands up to which HiGHS also branches, if nothing else is said: fewer than the studies' sets, whose answers stay as
# they are where several are equal. And the relaxations that this may take, of a millisecond each.
TINY, _CASES = 8, 60
_FINISH = 0.24  # share of the time limit, at most, that is left for the check of what was found


def solve_facility_location(
    opening_cost: Array, service_cost: Array, *, time_limit_s: float = 60.0, gap: float = 0.0
) -> FacilitySolution:
    """Open facilities and assign demands at least total cost (thesis, equation 3.3).

    Args:
        opening_cost: [F] at least 0 and at most 1e100; infinite where a facility cannot be opened.
        service_cost: [D, F] at least 0 and at most 1e100, cost of serving a demand (row) from a facility (column);
            infinite where it cannot be served from there.
        time_limit_s: wall seconds; at the limit the best solution so far is returned with its true bound.
        gap: relative gap at which the search may stop; 0 proves optimality, to 1e-9 relative.

    Raises:
        ShapeError: no facility or no demand, a wrong shape, a cost that is complex, NaN, negative or above 1e100, a
            demand that no facility can serve.
        ConfigError: a time limit of zero or less, or a gap outside [0, 1).

    Example:
        >>> import numpy as np
        >>> from p2l import solve_facility_location
        >>> opening, service = np.array([4.0, 3.0]), np.array([[1.0, 6.0], [2.0, 3.0], [6.0, 1.0]])
        >>> solution = solve_facility_location(opening, service)
        >>> solution.open.tolist(), solution.assignment.tolist(), solution.cost, solution.status
        ([True, True], [0, 0, 1], 11.0, 'optimal')
    """
    limit_s, gap = check_stopping(time_limit_s, gap)
    start = time.perf_counter()
    opening, service = _checked(opening_cost, service_cost)
    deadline = start + limit_s * (1.0 - _FINISH)
    pairs = of_table(opening, service)
    whole_numbers = float(pairs.outside.sum()) < EXACT and _whole_numbers(opening, service)
    solution = solve_small_or_large(pairs, deadline, gap, whole_numbers=whole_numbers, counting=True)
    open_set = open_for_outside(opening, service, solution.open)
    assignment = np.flatnonzero(open_set)[service[:, open_set].argmin(axis=1)]
    cost = math.fsum([*opening[open_set].tolist(), *service[np.arange(len(service)), assignment].tolist()])
    bound = min(cost, proven_location_bound(opening, service, solution.certificate, cost))
    optimal = relative_gap(cost, bound) <= PROVEN
    return FacilitySolution(
        open=open_set,
        assignment=assignment,
        cost=cost,
        lower_bound=bound,
        status="optimal" if optimal else "feasible" if solution.complete else "time_limit",
        seconds=time.perf_counter() - start,
        certificate=solution.certificate,
    )


def _checked(opening_cost: Array, service_cost: Array) -> tuple[Array, Array]:
    """Costs as arrays that may be written to."""
    sizes: dict[str, int] = {}
    opening = np.array(freeze_cost("opening_cost", opening_cost, ("F",), sizes))
    service = np.array(freeze_cost("service_cost", service_cost, ("D", "F"), sizes))
    if not service.size:
        raise ShapeError(f"service_cost: has shape {service.shape}; give at least one demand and one facility")
    if (nowhere := np.isinf(service + opening).all(axis=1)).any():
        raise ShapeError(f"service_cost: no facility can serve demand {int(nowhere.argmax())}; give it a finite cost")
    return opening, service


def solve_small_or_large(
    pairs: Pairs,
    deadline: float,
    gap: float,
    *,
    whole_numbers: bool = False,
    few: int | None = None,
    tiny: int = TINY,
    multipliers: Array | None = None,
    open_set: BoolArray | None = None,
    counting: bool = False,
) -> PairsSolution:
    """The relaxation by HiGHS where an instance is small; what it does not prove, the large-scale route does.

    Args:
        pairs: the instance.
        deadline: of `time.perf_counter`.
        gap: relative gap that is good enough.
        whole_numbers: all costs are.
        few: largest number of pairs for HiGHS; `FEW_PAIRS` if none.
        tiny: largest number of demands with which HiGHS branches.
        multipliers: [D] where the large-scale route begins, such as those of an instance much like this one.
        open_set: [F] a solution that is known already.
        counting: whether the proof may have cases of how many facilities are open.
    """
    if len(pairs.cost) <= (FEW_PAIRS if few is None else few):
        from p2l.team.facility.program import solve_in_cases, solve_program

        seconds_left = max(1e-3, deadline - time.perf_counter())
        program = solve_program(pairs, time_limit_s=seconds_left, gap=gap, only_relaxation=True)
        if program.open is not None and program.multipliers is not None:
            multipliers, open_set = np.minimum(program.multipliers, pairs.outside), program.open
            cost = solution_cost(pairs, open_set)
            if lagrangian(pairs, multipliers) >= cost * (1.0 - max(gap, 0.5 * PROVEN)):
                return PairsSolution(open_set, cost, True, Certificate.of(multipliers))
        if pairs.demands <= tiny and len(pairs.cost):
            solution = solve_in_cases(pairs, deadline=deadline, gap=gap, most=_CASES)
            if solution is not None:
                return solution
    try:
        solve_pairs = loaded(large_scale, deadline).solve_pairs
    except TimeoutError:
        return _without_search(pairs, multipliers, open_set)
    return solve_pairs(
        pairs,
        deadline=deadline,
        gap=gap,
        multipliers=multipliers,
        open_set=open_set,
        whole_numbers=whole_numbers,
        counting=counting,
    )


def large_scale() -> ModuleType:
    """The module of the large-scale route, with its kernels loaded."""
    from p2l.team.facility import solve

    solve.load_kernels()
    return solve


def within_limits() -> ModuleType:
    """The module of instances within limits, with its kernels loaded."""
    import p2l.team.facility.limited as limited
    from p2l.team.facility import solve

    solve.load_kernels()
    limited.load_kernels()
    return limited


def _without_search(pairs: Pairs, multipliers: Array | None, open_set: BoolArray | None) -> PairsSolution:
    """What is known without any search; where nothing is, every demand at its cheapest is a bound."""
    _, _, known = presolve(pairs)
    best = min((each for each in (open_set, known) if each is not None), key=lambda each: solution_cost(pairs, each))
    if multipliers is None:
        first = np.minimum(pairs.start[:-1], max(0, len(pairs.cost) - 1))
        has_pair = np.diff(pairs.start) > 0
        multipliers = np.where(has_pair, pairs.cost[first], pairs.outside) if len(pairs.cost) else pairs.outside
    return PairsSolution(best, solution_cost(pairs, best), False, Certificate.of(multipliers))


def _whole_numbers(*costs: Array) -> bool:
    """Whether all costs that mean something are whole numbers."""
    return all(bool((finite == np.floor(finite)).all()) for finite in (part[np.isfinite(part)] for part in costs))
