"""Stage `check_plan`: is a plan what it says (thesis, section 3.3; the bound is that of `p2l.team.certificate`)?"""

from __future__ import annotations

from pathlib import Path

from p2l.schema import CheckPlanConfig
from p2l.team.certificate import check_certificate
from p2l.team.files import read_problem
from p2l.team.plan_files import planned_order, read_plan
from p2l.tracking import Tracker
from stages._stage import stage


@stage("check_plan", CheckPlanConfig)
def run(cfg: CheckPlanConfig, out: Path, track: Tracker) -> None:  # noqa: ARG001
    """Print what was recomputed."""
    problem = read_problem(cfg.tasks, cfg.transfer, planned_order(cfg.plan))
    verdict = check_certificate(problem, read_plan(cfg.plan, problem))
    proof = "optimal" if verdict.optimal else f"at most {verdict.gap:.2%} of its cost above the optimum"
    track.metrics({"objective": verdict.cost, "lower_bound": verdict.bound, "gap": verdict.gap})
    tasks = f"{problem.n} tasks, order {problem.order}"
    print(f"{cfg.plan}: {tasks}; costs {verdict.cost:,.6g}; no plan costs less than {verdict.bound:,.6g}: {proof}.")


if __name__ == "__main__":
    run()
