"""A person's own tasks, as the stages `plan` and `check_plan` read them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np

from p2l.errors import ArtifactError, ConfigError, InputError, P2LError, SolverError
from p2l.records import Array
from p2l.schema import AskConfig, CheckPlanConfig, PlanConfig
from p2l.team.certificate import Verdict
from p2l.team.columns import likeness
from p2l.team.planners import plan
from p2l.team.routes import PLANNERS
from p2l.team.sheets import check_standard_input
from p2l.team.shop import Shop, ShopPlan, check_shop_plan, plan_shop
from p2l.team.shop.cautions import shop_cautions
from p2l.team.shop.difference import difference_of
from p2l.team.shop.explain import break_even_rows, explain_shop, reason_rows
from p2l.team.shop.files import check_shop_place, of_plan, read_shop_plan, settings_of, write_shop_plan
from p2l.team.shop.reading import Filling, ShopReading, read_shop
from p2l.team.shop.reasons import reasons_of
from p2l.team.shop.reasons_check import check_reasons
from p2l.team.shop.saved import load_shop, save_shop
from p2l.tracking import Tracker

Order = Literal["fixed", "any"]
_MODELS, _FOLDS, _FEWEST_PAIRS, _LEVEL = ("logistic", "gp", "trees", "net"), 5, 15, 0.9  # of predict_transfer


def read_own_tasks(
    cfg: PlanConfig | CheckPlanConfig | AskConfig, order: Order, max_lessons: float | None, max_teaching: float | None
) -> ShopReading:
    """The shop in the files that a configuration names, missing pairs filled as it says."""
    assert cfg.tasks is not None
    assert cfg.transfer is not None
    check_standard_input(cfg.tasks, cfg.transfer, *cfg.files)
    return read_shop(
        cfg.tasks,
        cfg.transfer,
        before=cfg.before,
        robots=cfg.robots,
        order=order,
        max_lessons=math.inf if max_lessons is None else max_lessons,
        max_teaching=math.inf if max_teaching is None else max_teaching,
        fill=cfg.fill,
        filling=filling_of(cfg),
    )


def filling_of(cfg: PlanConfig | CheckPlanConfig | AskConfig) -> Filling | None:
    """The model of missing pairs that a configuration asks for."""
    return None if cfg.features is None else _predictor(cfg.features, cfg.trials, cfg.seed)


def plan_own_tasks(cfg: PlanConfig, out: Path, track: Tracker) -> None:
    """Write the plan of a person's own tasks, its figure and its page, and print the reasons."""
    from p2l.evaluation.team.page import PageContent, write_page
    from p2l.evaluation.team.shop_figure import save_shop_figure

    PLANNERS.check(cfg.planner)
    inputs = [path for path in (cfg.tasks, cfg.transfer, *cfg.files) if path is not None]
    check_shop_place(out, inputs)
    reading = read_own_tasks(cfg, cfg.order or "fixed", cfg.max_lessons, cfg.max_teaching)
    shop = reading.shop
    day = _plan(cfg, shop)
    reasons = reasons_of(shop, day, time_limit_s=cfg.reasons_s)
    save_shop_figure(out / "plan.png", shop, day)  # whatever can fail comes before the first table
    picture = (out / "plan.png").read_bytes()
    why, near = reason_rows(shop, reasons), break_even_rows(shop, reasons)
    alone = None if math.isnan(reasons.alone) else reasons.alone
    remarks = (*reading.remarks, *shop_cautions(shop))
    content = PageContent(shop, day, cfg.subject, why, near, alone, remarks, picture)
    write_page(out / "plan.html", content)
    save_shop(out, reading.saved)
    write_shop_plan(out, shop, day, reasons, extra=reading.extra, remarks=remarks)
    track.metrics({"objective": day.objective, "lower_bound": day.lower_bound, "seconds": day.seconds})
    for name in ("plan.png", "plan.html"):
        track.artifact(out / name)
    for remark in remarks:
        print(f"Note: {remark}")
    print(explain_shop(shop, day, reasons))


def check_today(cfg: CheckPlanConfig) -> tuple[Verdict, str, list[str]]:
    """What was recomputed, of what, and what else was found to be so."""
    reading = read_own_tasks(cfg, *settings_of(cfg.plan))
    try:
        return _checked(cfg, reading)
    except P2LError as error:
        raise _told_better(cfg.plan, reading, error) from error


def _checked(cfg: CheckPlanConfig, reading: ShopReading) -> tuple[Verdict, str, list[str]]:
    from p2l.evaluation.team.page import check_page

    shop = reading.shop
    day = read_shop_plan(cfg.plan, shop, reading.extra)
    verdict = check_shop_plan(shop, day)
    notes = ["plan.html shows this cost and this day."] if check_page(cfg.plan / "plan.html", shop, day) else []
    reasons = check_reasons(cfg.plan, shop, day, time_limit_s=cfg.reasons_s)
    if reasons is not None:
        rest = f"; {reasons.unknown} were not, for want of time (reasons_s=…)" if reasons.unknown else ""
        notes.append(f"reasons.csv: {reasons.compared} numbers solved for again, all are the same{rest}.")
    return verdict, f"{int(shop.count.sum())} tasks, order {shop.order}", notes


def _told_better(folder: Path, reading: ShopReading, error: P2LError) -> P2LError:
    """The error, or, where the plan was made for other tables, that it was."""
    way = "give the tables that it was made from, or plan again"
    try:
        what = difference_of(load_shop(folder), reading.saved)
    except ArtifactError:  # `ask` writes none
        return SolverError(f"{error}; if the tables are others: {way}") if isinstance(error, SolverError) else error
    return error if what is None else InputError(f"plan={folder}: was made from other tables: {what}; {way}")


def _plan(cfg: PlanConfig, shop: Shop) -> ShopPlan:
    """By any planner where a shop is a problem of the thesis; what is more than that has one route."""
    problem = shop.problem()
    if problem is not None:
        options = {"theta": cfg.theta} if cfg.planner == "cba" else {}
        return of_plan(plan(problem, cfg.planner, time_limit_s=cfg.time_limit_s, gap=cfg.gap, **options))
    if cfg.planner != "auto":
        raise ConfigError(
            f"planner={cfg.planner}: plans tasks that come once, one robot, a lesson on every task and a fixed or free "
            "order; use planner=auto for copies, several robots, decisions, limits, a catalogue or a partial order"
        )
    return plan_shop(shop, time_limit_s=cfg.time_limit_s, gap=cfg.gap)


def _predictor(features: Path, trials: Path | None, seed: int) -> Filling:
    """Fills pairs with what `predict_transfer` says of them, at its own settings."""
    from p2l.seeding import generator
    from p2l.team.trial_files import read_features, read_trials
    from p2l.transfer.few_trials import Prior, Trials
    from p2l.transfer.pair_models import FitSetting
    from p2l.transfer.prediction import predict

    tasks = read_features(features)
    tried = read_trials(trials, tasks.names, features) if trials else Trials.none()

    def fill(taught: tuple[str, ...], tested: tuple[str, ...]) -> Array:
        unknown = [name for name in (*taught, *tested) if name not in tasks.names]
        if unknown:
            others = set(tasks.names) - {*taught, *tested}
            problem = f"has no row for '{unknown[0]}', whose pairs are to be predicted{likeness(unknown[0], others)}"
            raise InputError.at(features, None, "task", problem)
        rng = generator(seed, "predict_transfer")
        prediction = predict(FitSetting(tasks, Prior()), tried, _MODELS, _FOLDS, _FEWEST_PAIRS, _LEVEL, rng=rng)
        place = {name: index for index, name in enumerate(tasks.names)}
        rows, columns = ([place[name] for name in names] for names in (taught, tested))
        return np.asarray(prediction.p[np.ix_(rows, columns)])

    return fill
