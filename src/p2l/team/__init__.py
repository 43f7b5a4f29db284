"""Act, Delegate or Learn: which tasks the robot does, which the person does, which are worth a demonstration.

Read `problem` (the records), `outcome` (what decisions cost), `mip.model` (the thesis's programs), then `facility` (the
large-scale route). Importing this package loads no solver.
"""

from p2l.team.facility import solve_facility_location
from p2l.team.outcome import Outcome, objective
from p2l.team.planners import plan
from p2l.team.problem import Certificate, Decision, FacilitySolution, Plan, Problem
from p2l.team.routes import PLANNERS

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
