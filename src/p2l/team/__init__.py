"""Act, Delegate or Learn: which tasks the robot does, which the person does, which are worth a demonstration.

Read `problem` (the records), `outcome` (what decisions cost), `model` (the thesis's programs), then `facility` (the
large-scale route). Importing this package loads no solver.
"""

from p2l.records import Array
from p2l.team.outcome import Outcome, objective
from p2l.team.planners import plan
from p2l.team.problem import Certificate, Decision, FacilitySolution, Plan, Problem
from p2l.team.routes import PLANNERS


def solve_facility_location(
    opening_cost: Array, service_cost: Array, *, time_limit_s: float = 60.0, gap: float = 0.0
) -> FacilitySolution:
    """See `p2l.team.facility.solve_facility_location`; the solver is loaded when it is called."""
    from p2l.team.facility import solve_facility_location as solve

    return solve(opening_cost, service_cost, time_limit_s=time_limit_s, gap=gap)


__all__ = [
    "PLANNERS",
    "Certificate",
    "Decision",
    "FacilitySolution",
    "Outcome",
    "Plan",
    "Problem",
    "objective",
    "plan",
    "solve_facility_location",
]
