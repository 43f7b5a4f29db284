"""Stage `check_plan`: is a plan what it says (thesis, section 3.3; the bound is that of `p2l.team.certificate`)?"""

from __future__ import annotations

from pathlib import Path

from p2l.schema import CheckPlanConfig
from p2l.team.shop import check_shop_plan
from p2l.team.shop.files import read_shop_plan, settings_of
from p2l.team.shop.reasons_check import check_reasons
from p2l.tracking import Tracker
from stages._shop import read_own_tasks
from stages._stage import stage


@stage("check_plan", CheckPlanConfig)
def run(cfg: CheckPlanConfig, out: Path, track: Tracker) -> None:  # noqa: ARG001
    """Print what was recomputed."""
    from p2l.evaluation.team.page import check_page

    reading = read_own_tasks(cfg, *settings_of(cfg.plan))
    shop = reading.shop
    plan = read_shop_plan(cfg.plan, shop, reading.extra)
    verdict = check_shop_plan(shop, plan)
    has_page = check_page(cfg.plan / "plan.html", shop, plan)
    reasons = check_reasons(cfg.plan, shop, plan, time_limit_s=cfg.reasons_s)
    proof = "optimal" if verdict.optimal else f"at most {verdict.gap:.2%} of its cost above the optimum"
    track.metrics({"objective": verdict.cost, "lower_bound": verdict.bound, "gap": verdict.gap})
    tasks = f"{int(shop.count.sum())} tasks, order {shop.order}"
    print(f"{cfg.plan}: {tasks}; costs {verdict.cost:,.6g}; no plan costs less than {verdict.bound:,.6g}: {proof}.")
    if has_page:
        print("plan.html shows this cost and this day.")
    if reasons is not None:
        rest = f"; {reasons.unknown} were not, for want of time (reasons_s=…)" if reasons.unknown else ""
        print(f"reasons.csv: {reasons.compared} numbers solved for again, all are the same{rest}.")


if __name__ == "__main__":
    run()
