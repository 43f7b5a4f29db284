"""An uncertain tomorrow: which lessons to take today, and which can wait until tomorrow's orders are known.

Read `record`, then `outcome` (what a plan costs), then `planner`; `forecast` makes scenarios of expected numbers,
`sampling` says how far a plan for a sample can be from the best one, `baselines` is what it is held against.
"""

from p2l.team.tomorrow.certificate import check_two_stage_plan, two_stage_bound
from p2l.team.tomorrow.outcome import TwoStageOutcome, two_stage_outcome
from p2l.team.tomorrow.planner import plan_two_stage, recourse
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan

__all__ = [
    "TwoStage",
    "TwoStageOutcome",
    "TwoStagePlan",
    "check_two_stage_plan",
    "plan_two_stage",
    "recourse",
    "two_stage_bound",
    "two_stage_outcome",
]
