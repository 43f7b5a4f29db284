"""Stage `day`: the day as it happens; after each outcome the rest is planned anew (thesis, section 6.2.1)."""

from __future__ import annotations

from pathlib import Path

from p2l.errors import ConfigError
from p2l.schema import DayConfig
from p2l.team.day import SkillPrior, begin
from p2l.team.day.files import DAY, key_of, read_day, read_outcomes
from p2l.team.shop.files import read_shop_plan
from p2l.team.shop.saved import load_shop
from p2l.team.tomorrow.files import is_two_stage
from p2l.tracking import Tracker
from stages._day import Walk
from stages._stage import stage


@stage("day", DayConfig, record=DAY)
def run(cfg: DayConfig, out: Path, track: Tracker) -> None:
    """Go on from `day.csv`, enter what happened, and write the plan for the rest."""
    if is_two_stage(cfg.plan):
        advice = "plan the same tables without forecast, scenarios and tomorrow, and walk through that"
        raise ConfigError(f"plan={cfg.plan}: is for today and tomorrow, and a day is of today alone; {advice}")
    saved = load_shop(cfg.plan)
    plan = read_shop_plan(cfg.plan, saved.shop, saved.extra)
    setting = SkillPrior(cfg.prior_n, cfg.spread)
    morning = begin(saved.shop, plan, trials=saved.trials, setting=setting, time_limit_s=cfg.time_limit_s)
    key = key_of(morning)
    file = read_day(out / DAY, key)
    outcomes = None if cfg.outcomes is None else read_outcomes(cfg.outcomes, key)
    walk = Walk(out / DAY, key, track, saved.extra)
    walk.go_on(morning, file)
    try:
        if outcomes is None:
            walk.ask()
        else:
            walk.enter(outcomes, str(cfg.outcomes))
    finally:
        walk.write_rest()
    print(walk.summary())


if __name__ == "__main__":
    run()
