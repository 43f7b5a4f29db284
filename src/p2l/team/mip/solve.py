"""Solve a Pyomo model with HiGHS and say honestly how it ended."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import pyomo.environ as pyo
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.repn import generate_standard_repn

from p2l.errors import SolverError

_ENDED_BY_TIME = (TerminationCondition.maxTimeLimit, TerminationCondition.iterationLimit)
_IMPOSSIBLE = (TerminationCondition.provenInfeasible, TerminationCondition.infeasibleOrUnbounded)


@dataclass(frozen=True)
class Ending:
    """How a solve ended: `complete` (inside the requested gap), whether the model holds a solution, and the bound."""

    complete: bool
    has_solution: bool
    lower_bound: float


def solve_model(model: Any, *, deadline: float, gap: float = 0.0, threads: int = 1) -> Ending:
    """Minimise a Pyomo model with HiGHS and load the best solution found into it.

    Args:
        model: any linear `pyo.ConcreteModel` with one objective.
        deadline: of `time.perf_counter`; then the best solution so far is loaded.
        gap: relative gap at which HiGHS may stop.
        threads: HiGHS threads.

    Raises:
        SolverError: a coefficient that is not finite (HiGHS would silently call NaN optimal), or a model without any
            solution.
        TimeoutError: the deadline came while the model was handed over.
    """
    _refuse_nonfinite(model)
    _in_time(deadline)
    solver = SolverFactory("highs")
    solver.set_instance(model)
    _in_time(deadline)
    results: Results = solver.solve(
        model,
        time_limit=deadline - time.perf_counter(),
        rel_gap=gap,
        abs_gap=0.0,
        threads=threads,
        solver_options={"mip_feasibility_tolerance": 1e-9, "primal_feasibility_tolerance": 1e-9},
        load_solutions=False,
        raise_exception_on_nonoptimal_result=False,
    )
    condition = results.termination_condition
    if condition in _IMPOSSIBLE:
        raise SolverError(f"{model.name}: HiGHS proved that no solution exists; relax the added constraints")
    complete = condition == TerminationCondition.convergenceCriteriaSatisfied
    if not complete and condition not in _ENDED_BY_TIME:
        raise SolverError(f"{model.name}: HiGHS stopped with '{condition.name}'; try planner=facility")
    has_solution = results.solution_status in (SolutionStatus.optimal, SolutionStatus.feasible)
    if has_solution:
        results.solution_loader.load_vars()
    bound = results.objective_bound
    return Ending(complete, has_solution, float(bound) if bound is not None and math.isfinite(bound) else -math.inf)


def _in_time(deadline: float) -> None:
    if time.perf_counter() >= deadline:
        raise TimeoutError


def _refuse_nonfinite(model: Any) -> None:
    for part in model.component_data_objects((pyo.Objective, pyo.Constraint), active=True):
        repn = generate_standard_repn(part.body if part.ctype is pyo.Constraint else part.expr)
        if not all(math.isfinite(pyo.value(value)) for value in (repn.constant, *repn.linear_coefs)):
            raise SolverError(f"{model.name}: '{part.name}' holds NaN or infinity; check the costs before solving")
