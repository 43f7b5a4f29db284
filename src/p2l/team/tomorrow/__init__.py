"""An uncertain tomorrow: which lessons to take today, and which can wait until tomorrow's orders are known.

Read `record`, then `outcome` (what a plan costs), then `planner`; `forecast` makes scenarios of expected numbers,
`sampling` says how far a plan for a sample can be from the best one, `baselines` is what it is held against.
"""

from p2l.team.tomorrow.baselines import hindsight, mean_tomorrow, plan_for_mean, plan_myopically, realised
from p2l.team.tomorrow.certificate import check_two_stage_plan, two_stage_bound
from p2l.team.tomorrow.forecast import Forecast, sample_counts, with_counts
from p2l.team.tomorrow.outcome import TwoStageOutcome, two_stage_outcome
from p2l.team.tomorrow.planner import plan_two_stage, recourse
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan
from p2l.team.tomorrow.sampling import GapInterval, Replications, gap_interval, replicate

__all__ = [
    "Forecast",
    "GapInterval",
    "Replications",
    "TwoStage",
    "TwoStageOutcome",
    "TwoStagePlan",
    "check_two_stage_plan",
    "gap_interval",
    "hindsight",
    "mean_tomorrow",
    "plan_for_mean",
    "plan_myopically",
    "plan_two_stage",
    "realised",
    "recourse",
    "replicate",
    "sample_counts",
    "two_stage_bound",
    "two_stage_outcome",
    "with_counts",
]
