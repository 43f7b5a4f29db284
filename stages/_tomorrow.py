"""Today and an uncertain tomorrow, as the stages `plan` and `check_plan` read, plan and check them."""

from __future__ import annotations

import math
from pathlib import Path

from p2l.errors import ConfigError
from p2l.schema import CheckPlanConfig, PlanConfig
from p2l.seeding import generator
from p2l.team.certificate import Verdict
from p2l.team.shop.files import check_shop_place, settings_of
from p2l.team.tomorrow import check_two_stage_plan, plan_two_stage, replicate
from p2l.team.tomorrow.files import (
    FILES,
    LESSONS,
    TwoStageSetting,
    read_two_stage_plan,
    setting_of,
    write_two_stage_plan,
)
from p2l.team.tomorrow.lessons_check import check_lessons
from p2l.team.tomorrow.reading import Future, TwoStageReading, read_two_stage
from p2l.team.tomorrow.reasons import explain_two_stage, lesson_times
from p2l.team.tomorrow.record import TwoStagePlan
from p2l.team.tomorrow.sampling import Estimate, estimate, fresh_samples, subsamples
from p2l.tracking import Tracker
from stages._shop import Order, filling_of

_SAMPLE_GAP = 1e-5  # to which the best plan of a sample is known


def read_both_days(
    cfg: PlanConfig | CheckPlanConfig, setting: TwoStageSetting, order: Order, limits: tuple[float | None, float | None]
) -> TwoStageReading:
    """Today and tomorrow in the files that a configuration names; scenarios of a forecast are those of the seed."""
    assert cfg.tasks is not None
    assert cfg.transfer is not None
    most, longest = (math.inf if each is None else each for each in limits)
    return read_two_stage(
        cfg.tasks,
        cfg.transfer,
        Future(cfg.scenarios, cfg.forecast, cfg.tomorrow, setting.commit, setting.samples),
        generator(setting.seed, "plan", "tomorrow", "scenarios"),
        before=cfg.before,
        robots=cfg.robots,
        order=order,
        max_lessons=most,
        max_teaching=longest,
        fill=cfg.fill,
        filling=filling_of(cfg),
    )


def plan_both_days(cfg: PlanConfig, out: Path, track: Tracker) -> None:
    """Write the plan of today and tomorrow and its page, and print which lessons are taken now and which can wait."""
    from p2l.evaluation.team.tomorrow_page import write_tomorrow_page

    check_shop_place(out, [path for path in (cfg.tasks, cfg.transfer, *cfg.files, *cfg.future_files) if path], FILES)
    setting = TwoStageSetting(cfg.commit, cfg.samples, cfg.seed)
    reading = read_both_days(cfg, setting, cfg.order or "fixed", (cfg.max_lessons, cfg.max_teaching))
    plan = plan_two_stage(reading.program, time_limit_s=cfg.time_limit_s, gap=cfg.gap)
    reasons = lesson_times(reading.program, plan, time_limit_s=cfg.reasons_s)
    found = _estimate(cfg, reading, plan)
    text = explain_two_stage(reading.program, plan, reasons, found, cfg.repeats)
    write_tomorrow_page(out / "plan.html", reading.program, plan, reasons, found, reading.day.remarks, cfg.subject)
    write_two_stage_plan(out, reading, plan, reasons, setting, found)
    track.metrics({"objective": plan.objective, "lower_bound": plan.lower_bound, "seconds": plan.seconds})
    track.metrics({"cost_today": plan.today.objective, "cost_tomorrow": plan.objective - plan.today.objective})
    if found is not None and math.isfinite(found.gap.upper):
        track.metrics({"gap_upper": found.gap.upper})
    track.artifact(out / "plan.html")
    for remark in reading.day.remarks:
        print(f"Note: {remark}")
    print(text)


def check_both_days(cfg: CheckPlanConfig) -> tuple[Verdict, str, list[str]]:
    """What was recomputed, of what, and what else was found to be so."""
    from p2l.evaluation.team.tomorrow_page import check_tomorrow_page

    if not cfg.has_future:
        raise ConfigError(f"plan={cfg.plan}: is for today and tomorrow; give its scenarios=… or forecast=…, too")
    order, *limits = settings_of(cfg.plan)
    reading = read_both_days(cfg, setting_of(cfg.plan), order, (limits[0], limits[1]))
    program, plan = reading.program, read_two_stage_plan(cfg.plan, reading)
    verdict = check_two_stage_plan(program, plan)
    shown = check_tomorrow_page(cfg.plan / "plan.html", program, plan)
    notes = ["plan.html shows these costs and this day."] if shown else []
    lessons = check_lessons(cfg.plan, program, plan, time_limit_s=cfg.reasons_s)
    rest = (
        f"; savings of {lessons.unknown} were not compared, for want of time (reasons_s=…)" if lessons.unknown else ""
    )
    count = f"{lessons.lessons} lesson{'' if lessons.lessons == 1 else 's'}"
    notes.append(f"{LESSONS}: {count} recomputed, what they save solved for again, all are the same{rest}.")
    tasks = f"{int(program.today.count.sum())} tasks, order {program.today.order}"
    return verdict, f"{tasks}; {program.scenarios} scenarios of tomorrow", notes


def _estimate(cfg: PlanConfig, reading: TwoStageReading, plan: TwoStagePlan) -> Estimate | None:
    program, repeats, forecast = reading.program, cfg.repeats, reading.forecast
    if not repeats:
        return None
    streams = [generator(cfg.seed, "plan", "tomorrow", "replication", each) for each in range(repeats)]
    if forecast is None:
        samples = subsamples(program, repeats, streams[0])
    else:
        samples = fresh_samples(program, forecast, cfg.samples, streams)
    found = replicate(plan, samples, time_limit_s=cfg.time_limit_s, gap=_SAMPLE_GAP)
    return estimate(found, fresh=forecast is not None)
