"""The strong facility location form as arrays, handed to HiGHS without a modelling layer.

Columns: one variable per facility, then one per pair. The outside option is folded into the objective: a pair earns
c_ij - b_i on top of the constant Σ b_i, and its demand's row is Σ_j x_ij <= 1. The linear relaxation is solved first:
it is often integral, and its duals are the multipliers of the certificate. Where it is not, a few cases often suffice
(`solve_in_cases`), each with its own duals: the certificate is their tree.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass

import highspy
import numpy as np
import numpy.typing as npt

from p2l.errors import SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.certificate import PROVEN
from p2l.team.facility.pairs import Pairs, PairsSolution
from p2l.team.facility.presolve import presolve, reduced_costs, solution_cost
from p2l.team.facility.tree import Tree

_INTEGRAL = 1e-7  # how far from a whole number a facility's opening may be
_TOLERANCE = 1e-10  # HiGHS's smallest; costs are scaled to what the solution costs
_TOLERANCES = ("primal_feasibility_tolerance", "dual_feasibility_tolerance", "mip_feasibility_tolerance")
_COMPLETE = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kModelEmpty)
_AT_LIMIT = (highspy.HighsModelStatus.kTimeLimit, highspy.HighsModelStatus.kIterationLimit)


@dataclass(frozen=True)
class ProgramSolution:
    """What HiGHS says; nothing of it is believed before the certificate's check.

    Attributes:
        open: [F] best open set, None if there is none yet.
        complete: whether the solve ended inside the gap.
        multipliers: [D] duals of the linear relaxation, None if the time did not suffice for it.
    """

    open: BoolArray | None
    complete: bool
    multipliers: Array | None


def solve_program(
    pairs: Pairs, *, time_limit_s: float, gap: float = 0.0, only_relaxation: bool = False
) -> ProgramSolution:
    """Solve a `Pairs` instance with HiGHS.

    Args:
        pairs: the instance.
        time_limit_s: wall seconds.
        gap: relative gap at which HiGHS may stop.
        only_relaxation: no branching; `complete` says whether the relaxation was integral.

    Raises:
        SolverError: a cost that is NaN (HiGHS would silently call it optimal), a time limit of zero or less, or an end
            that is neither a solution nor the time limit.
    """
    deadline = time.perf_counter() + time_limit_s
    if not time_limit_s > 0.0:
        raise SolverError(f"time limit: {time_limit_s} s given; it must be above 0")
    if any(np.isnan(part).any() for part in (pairs.opening, pairs.outside, pairs.cost)):
        raise SolverError("facility location: a cost is NaN; check the costs before solving")
    small, scale, known = presolve(pairs)
    if not len(small.cost):
        return ProgramSolution(known, True, small.outside / scale)
    lp, factor = relaxation(small)
    highs = _solver(lp, time_limit_s, gap)
    if not _run(highs):
        return ProgramSolution(None, False, None)
    multipliers = (small.outside + np.asarray(highs.getSolution().row_dual[: pairs.demands]) / factor) / scale
    share = np.asarray(highs.getSolution().col_value[: pairs.facilities])
    integral = bool((np.abs(share - np.round(share)) <= _INTEGRAL).all())
    if integral or only_relaxation:
        return ProgramSolution(share > 0.5, integral, multipliers)
    return _integer(lp, pairs, multipliers, deadline, gap)


def solve_in_cases(pairs: Pairs, *, deadline: float, gap: float, most: int) -> PairsSolution | None:
    """Branch on the relaxation, the case with the lowest bound first; for instances so small that it takes no time.

    Args:
        pairs: the instance.
        deadline: of `time.perf_counter`.
        gap: relative gap that is good enough.
        most: relaxations that may be solved; the same instance then ends the same way on every machine.

    Returns:
        An optimal solution with its proof, or None where `most` or the time does not suffice.

    Raises:
        SolverError: HiGHS ends in a way that is neither a solution nor the time limit.
    """
    small, scale, best = presolve(pairs)
    lp, factor = relaxation(small)
    highs = _solver(lp, max(1e-3, deadline - time.perf_counter()), 0.0)
    upper, tree = solution_cost(small, best), Tree(np.zeros(pairs.demands), pairs.facilities)
    waiting = [(-math.inf, 0, np.zeros(pairs.facilities, dtype=np.int8))]
    share_of_best = 1.0 - max(gap, 0.5 * PROVEN)
    while waiting and waiting[0][0] < upper * share_of_best:
        low, node, state = heapq.heappop(waiting)
        most -= 1
        if most < 0 or time.perf_counter() > deadline or not _run(highs, _decided(state)):
            return None
        share = np.asarray(highs.getSolution().col_value[: pairs.facilities])
        duals = np.asarray(highs.getSolution().row_dual[: pairs.demands])
        v = np.minimum(small.outside + duals / factor, small.outside)
        tree.price(node, v)
        reduced_cost = reduced_costs(small, v)
        used = (state > 0) | ((state == 0) & (reduced_cost < 0.0))
        low = max(low, float(v.sum() + reduced_cost[used].sum()))
        if (cost := solution_cost(small, share > 0.5)) < upper:
            best, upper = share > 0.5, cost
        free = np.flatnonzero(state == 0)
        if low < upper * share_of_best and free.size:
            facility = int(free[np.abs(share[free] - 0.5).argmin()])
            for side in (1, -1):
                case = state.copy()
                case[facility] = side
                heapq.heappush(waiting, (low, tree.child(node, facility, is_open=side > 0), case))
    proof = tree.certificate(upper * share_of_best, scale)
    return PairsSolution(best, solution_cost(pairs, best), True, proof)


def _decided(state: npt.NDArray[np.int8]) -> tuple[Array, Array]:
    """[F] least and most of each facility's opening: 1 is open, -1 closed, 0 either."""
    return (state > 0).astype(np.float64), (state >= 0).astype(np.float64)


def _integer(lp: highspy.HighsLp, pairs: Pairs, multipliers: Array, deadline: float, gap: float) -> ProgramSolution:
    """Branch, in a new solver: one that has solved the relaxation already overruns its time limit by seconds."""
    services, kinds = lp.num_col_ - pairs.facilities, highspy.HighsVarType
    lp.integrality_ = [kinds.kInteger] * pairs.facilities + [kinds.kContinuous] * services
    highs = _solver(lp, max(1e-3, deadline - time.perf_counter()), gap)
    complete = _run(highs)
    open_set = np.asarray(highs.getSolution().col_value[: pairs.facilities]) > 0.5
    has_solution = highs.getInfo().primal_solution_status == 2
    return ProgramSolution(open_set if has_solution else None, complete, multipliers)


def _solver(lp: highspy.HighsLp, time_limit_s: float, gap: float) -> highspy.Highs:
    highs = highspy.Highs()
    options = {"output_flag": False, "threads": 1, "mip_rel_gap": gap, "mip_abs_gap": 0.0, "time_limit": time_limit_s}
    for name, value in {**options, **dict.fromkeys(_TOLERANCES, _TOLERANCE)}.items():
        highs.setOptionValue(name, value)
    if highs.passModel(lp) == highspy.HighsStatus.kError:
        raise SolverError("facility location: HiGHS refused the program; its costs may be out of range")
    return highs


def _run(highs: highspy.Highs, bounds: tuple[Array, Array] | None = None) -> bool:
    """Run HiGHS, its first columns within `bounds`; True when it ends by itself, False at the time limit."""
    if bounds is not None:
        columns = np.arange(len(bounds[0]), dtype=np.int32)
        highs.changeColsBounds(len(columns), columns, *bounds)
    highs.run()
    status = highs.getModelStatus()
    if status not in _COMPLETE + _AT_LIMIT:
        raise SolverError(
            f"facility location: HiGHS ended with '{highs.modelStatusToString(status)}'; try planner=facility"
        )
    return status in _COMPLETE


def relaxation(pairs: Pairs) -> tuple[highspy.HighsLp, float]:
    """The linear relaxation as HiGHS wants it, its facilities first, and the factor that its costs were scaled by."""
    facilities, count, demands = pairs.facilities, len(pairs.cost), pairs.demands
    cost = np.concatenate([pairs.opening, pairs.cost - pairs.outside[pairs.rows()]])
    largest = float(np.abs(cost).max())
    scale = 2.0 ** min(1000, 10 - math.frexp(largest)[1]) if largest > 0.0 else 1.0  # HiGHS's tolerances are absolute
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = facilities + count, demands + count
    lp.col_cost_ = cost * scale
    lp.offset_ = float(pairs.outside.sum()) * scale
    lp.col_lower_, lp.col_upper_ = np.zeros(lp.num_col_), np.ones(lp.num_col_)
    lp.row_lower_ = np.full(lp.num_row_, -highspy.kHighsInf)
    lp.row_upper_ = np.concatenate([np.ones(demands), np.zeros(count)])
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = _matrix(pairs)
    return lp, scale


def _matrix(pairs: Pairs) -> tuple[IntArray, IntArray, Array]:
    """Row-wise: the demand rows over their pairs, then a linking row x_z - y_j <= 0 per pair."""
    count = len(pairs.cost)
    column = pairs.facilities + np.arange(count)
    start = np.concatenate([pairs.start, pairs.start[-1] + 2 * np.arange(1, count + 1)])
    link = np.stack([column, pairs.facility.astype(np.int64)], axis=1).ravel()
    value = np.concatenate([np.ones(count), np.tile([1.0, -1.0], count)])
    return start, np.concatenate([column, link]), value
