"""Stage `check_plan`: is a plan what it says (thesis, section 3.3; the bound is that of `p2l.team.certificate`)?"""

from __future__ import annotations

from pathlib import Path

from p2l.errors import ConfigError
from p2l.schema import CheckPlanConfig
from p2l.team.tomorrow.files import is_two_stage
from p2l.tracking import Tracker
from stages._shop import check_today
from stages._stage import stage
from stages._tomorrow import check_both_days


@stage("check_plan", CheckPlanConfig)
def run(cfg: CheckPlanConfig, out: Path, track: Tracker) -> None:  # noqa: ARG001
    """Print what was recomputed."""
    if is_two_stage(cfg.plan):
        verdict, what, notes = check_both_days(cfg)
    elif cfg.has_future:
        raise ConfigError(f"plan={cfg.plan}: is for today alone; leave out scenarios, forecast and tomorrow")
    else:
        verdict, what, notes = check_today(cfg)
    proof = "optimal" if verdict.optimal else f"at most {verdict.gap:.2%} of its cost above the optimum"
    track.metrics({"objective": verdict.cost, "lower_bound": verdict.bound, "gap": verdict.gap})
    print(f"{cfg.plan}: {what}; costs {verdict.cost:,.6g}; no plan costs less than {verdict.bound:,.6g}: {proof}.")
    for note in notes:
        print(note)


if __name__ == "__main__":
    run()
