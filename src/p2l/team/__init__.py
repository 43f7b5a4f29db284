"""Act, Delegate or Learn: which tasks the robot does, which the person does, which are worth a demonstration.

Read `problem` (the records), `outcome` (what decisions cost), `model` (the thesis's programs), then `facility` (the
large-scale route). Importing this package loads no solver.
"""

from p2l.team.outcome import Outcome, objective
from p2l.team.planners import PLANNERS, plan
from p2l.team.problem import Certificate, Decision, FacilitySolution, Plan, Problem

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
]
