"""The strong facility location form as arrays, handed to HiGHS without a modelling layer.

Columns: one binary per facility, then one continuous variable per pair. The outside option is folded into the
objective: a pair earns c_ij - b_i on top of the constant Σ b_i, so its row becomes Σ_j x_ij <= 1; a demand without an
outside option keeps Σ_j x_ij = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import highspy
import numpy as np

from p2l.errors import SolverError
from p2l.records import Array, BoolArray, IntArray
from p2l.team.pairs import Pairs


@dataclass(frozen=True)
class CoreAnswer:
    """Best open set found ([F], None if none), a proven lower bound, and whether the solve finished inside the gap."""

    open: BoolArray | None
    lower_bound: float
    finished: bool


def solve_core(pairs: Pairs, *, time_limit_s: float, gap: float = 0.0, start: BoolArray | None = None) -> CoreAnswer:
    """Solve a `Pairs` instance exactly.

    Args:
        pairs: the instance; every cost finite except an infinite `outside`.
        time_limit_s: wall seconds.
        gap: relative gap at which HiGHS may stop.
        start: [F] an open set to begin from.

    Raises:
        SolverError: a cost that is NaN or infinite, a time limit of zero or less, or no feasible assignment.
    """
    if not time_limit_s > 0.0:
        raise SolverError(f"time limit: {time_limit_s} s given; it must be above 0")
    if not (np.isfinite(pairs.opening).all() and np.isfinite(pairs.cost).all()) or np.isnan(pairs.outside).any():
        raise SolverError("facility location: a cost is NaN or infinite; check the costs before solving")
    lp, scale = _program(pairs)
    highs = highspy.Highs()
    options = {"output_flag": False, "threads": 1, "mip_rel_gap": gap, "mip_abs_gap": 0.0, "time_limit": time_limit_s}
    for name, value in options.items():
        highs.setOptionValue(name, value)
    if highs.passModel(lp) == highspy.HighsStatus.kError:
        raise SolverError("facility location: HiGHS refused the program; are its costs finite?")
    if start is not None:
        highs.setSolution(_solution(pairs, start))
    highs.run()
    return _answer(highs, pairs, scale)


def _program(pairs: Pairs) -> tuple[highspy.HighsLp, float]:
    facilities, pair_count, demands = pairs.facilities, len(pairs.cost), pairs.demands
    rows = pairs.rows()
    base = np.where(np.isfinite(pairs.outside), pairs.outside, 0.0)
    cost = np.concatenate([pairs.opening, pairs.cost - base[rows]])
    largest = float(np.abs(cost).max(initial=0.0))
    scale = 2.0 ** (10 - math.frexp(largest)[1]) if largest > 0.0 else 1.0  # HiGHS's tolerances are absolute
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = facilities + pair_count, demands + pair_count
    lp.col_cost_ = cost * scale
    lp.offset_ = float(base.sum()) * scale
    lp.col_lower_, lp.col_upper_ = np.zeros(lp.num_col_), np.ones(lp.num_col_)
    integer, continuous = highspy.HighsVarType.kInteger, highspy.HighsVarType.kContinuous
    lp.integrality_ = [integer] * facilities + [continuous] * pair_count
    must = np.where(np.isfinite(pairs.outside), -highspy.kHighsInf, 1.0)
    lp.row_lower_ = np.concatenate([must, np.full(pair_count, -highspy.kHighsInf)])
    lp.row_upper_ = np.concatenate([np.ones(demands), np.zeros(pair_count)])
    start, index, value = _matrix(pairs)
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = start, index, value
    return lp, scale


def _matrix(pairs: Pairs) -> tuple[IntArray, IntArray, Array]:
    """Row-wise: the demand rows over their pairs, then a linking row x_z - y_j <= 0 per pair."""
    count = len(pairs.cost)
    column = pairs.facilities + np.arange(count)
    start = np.concatenate([pairs.start, pairs.start[-1] + 2 * np.arange(1, count + 1)])
    link = np.stack([column, pairs.facility.astype(np.int64)], axis=1).ravel()
    value = np.concatenate([np.ones(count), np.tile([1.0, -1.0], count)])
    return start, np.concatenate([column, link]), value


def _solution(pairs: Pairs, opened: BoolArray) -> highspy.HighsSolution:
    served = opened[pairs.facility]
    row = pairs.rows()[served]
    first = np.unique(row, return_index=True)[1]  # rows are sorted by cost: the first open pair is the cheapest
    flow = np.zeros(len(pairs.cost))
    flow[np.flatnonzero(served)[first]] = 1.0
    solution = highspy.HighsSolution()
    solution.col_value = np.concatenate([opened.astype(np.float64), flow]).tolist()
    return solution


def _answer(highs: highspy.Highs, pairs: Pairs, scale: float) -> CoreAnswer:
    status = highs.getModelStatus()
    if status in (highspy.HighsModelStatus.kInfeasible, highspy.HighsModelStatus.kUnboundedOrInfeasible):
        raise SolverError("facility location: no feasible assignment exists; every demand needs a facility to serve it")
    info = highs.getInfo()
    finished = status in (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kModelEmpty)
    opened = None
    if info.primal_solution_status == 2 or status == highspy.HighsModelStatus.kModelEmpty:
        opened = np.asarray(highs.getSolution().col_value[: pairs.facilities]) > 0.5
    bound = info.mip_dual_bound if pairs.facilities else float(np.sum(pairs.outside)) * scale
    return CoreAnswer(opened, bound / scale if math.isfinite(bound) else -math.inf, finished)
