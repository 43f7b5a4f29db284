"""The strong facility location form as arrays, handed to HiGHS without a modelling layer.

Columns: one variable per facility, then one per pair. The outside option is folded into the objective: a pair earns
c_ij - b_i on top of the constant Σ b_i, and its demand's row is Σ_j x_ij <= 1. The linear relaxation is solved first:
it is often integral, and its duals are the multipliers of the certificate.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import highspy
import numpy as np

from p2l.errors import SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.facility.pairs import Pairs

_TOLERANCE = 1e-7
_COMPLETE = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kModelEmpty)
_AT_LIMIT = (highspy.HighsModelStatus.kTimeLimit, highspy.HighsModelStatus.kIterationLimit)


@dataclass(frozen=True)
class ProgramSolution:
    """What HiGHS found.

    Attributes:
        open: [F] best open set, None if there is none yet.
        lower_bound: proven, -infinity if there is none yet.
        complete: whether the solve ended inside the gap.
        multipliers: [D] duals of the linear relaxation, None if the time did not suffice for it.
    """

    open: BoolArray | None
    lower_bound: float
    complete: bool
    multipliers: Array | None


def solve_program(pairs: Pairs, *, time_limit_s: float, gap: float = 0.0) -> ProgramSolution:
    """Solve a `Pairs` instance with HiGHS.

    Args:
        pairs: the instance.
        time_limit_s: wall seconds.
        gap: relative gap at which HiGHS may stop.

    Raises:
        SolverError: a cost that is NaN or infinite (HiGHS would silently call NaN optimal), a time limit of zero or
            less, or an end that is neither a solution nor the time limit.
    """
    deadline = time.perf_counter() + time_limit_s
    if not time_limit_s > 0.0:
        raise SolverError(f"time limit: {time_limit_s} s given; it must be above 0")
    if not all(np.isfinite(part).all() for part in (pairs.opening, pairs.outside, pairs.cost)):
        raise SolverError("facility location: a cost is NaN or infinite; check the costs before solving")
    if not len(pairs.cost):
        return ProgramSolution(np.zeros(pairs.facilities, dtype=bool), float(pairs.outside.sum()), True, pairs.outside)
    lp, scale = relaxation(pairs)
    highs = highspy.Highs()
    options = {"output_flag": False, "threads": 1, "mip_rel_gap": gap, "mip_abs_gap": 0.0, "time_limit": time_limit_s}
    for name, value in options.items():
        highs.setOptionValue(name, value)
    if highs.passModel(lp) == highspy.HighsStatus.kError:
        raise SolverError("facility location: HiGHS refused the program; its costs may be out of range")
    if not _run(highs):
        return ProgramSolution(None, -math.inf, False, None)
    bound = highs.getInfo().objective_function_value / scale
    multipliers = pairs.outside + np.asarray(highs.getSolution().row_dual[: pairs.demands]) / scale
    share = np.asarray(highs.getSolution().col_value[: pairs.facilities])
    if (np.abs(share - np.round(share)) <= _TOLERANCE).all():
        return ProgramSolution(share > 0.5, bound, True, multipliers)
    return _integer(highs, pairs, scale, bound, multipliers, deadline)


def _integer(
    highs: highspy.Highs, pairs: Pairs, scale: float, root_bound: float, multipliers: Array, deadline: float
) -> ProgramSolution:
    binary = np.full(pairs.facilities, highspy.HighsVarType.kInteger)
    highs.changeColsIntegrality(pairs.facilities, np.arange(pairs.facilities, dtype=np.int32), binary)
    # HiGHS counts its time limit over all runs of one model
    highs.setOptionValue("time_limit", highs.getRunTime() + max(1e-3, deadline - time.perf_counter()))
    complete = _run(highs)
    info = highs.getInfo()
    open_set = np.asarray(highs.getSolution().col_value[: pairs.facilities]) > 0.5
    has_solution = info.primal_solution_status == 2
    bound = info.mip_dual_bound / scale
    return ProgramSolution(
        open_set if has_solution else None,
        max(root_bound, bound) if math.isfinite(bound) else root_bound,
        complete,
        multipliers,
    )


def _run(highs: highspy.Highs) -> bool:
    """Run HiGHS; True when it ends by itself, False at the time limit."""
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
