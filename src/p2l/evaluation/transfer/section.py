"""Sections on the domains of the team flow: learnt skills and their use of walls, and the transfer predictors."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import pandas as pd

from p2l.evaluation.page.page import PageTable, Part, Picture, Reading, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, plain_setting, setting_label, stage_commands
from p2l.evaluation.style import png
from p2l.evaluation.team import readings, tables
from p2l.evaluation.team.layouts import environments
from p2l.evaluation.transfer.maps import block_ticks, task_order, transfer_maps

CHAPTER = 3
METRICS = ("auc", "brier", "log_loss", "ece")
PROTOCOL = (
    "The planner takes the predicted probability of success at its word, so it is judged as a probability, on tasks "
    "held out from fitting. new_test: a fitted task's skill on a new task; both_new: skill and task both new; planned: "
    "the pairs on which ADL's plans let the robot act, all of tasks that fitting never saw."
)
ENVIRONMENTS = (
    "The four insertion environments from above, 20 × 20 cm: walls, and the centres of the slots that tasks can have "
    "(thesis, section 3.5.1)."
)
STRATEGY = (
    "some learnt skills on their own tasks, seen from above: paths of the part's tip under different errors of the "
    "estimate (compare figure 3.6), or taps and what each firms up."
)


def learnt_skills(sources: Sources) -> Section:
    """The insertion environments, what learnt skills do, and whether they use walls."""
    thesis = sources.chapter(CHAPTER)
    parts: list[Part] = []
    if "insertion" in sources.domains:
        params = {"layout_seed": 0, "farthest_wall_cm": 2.0}
        params |= sources.config("collect", "insertion")["domain"]["params"]
        figure = environments(int(params["layout_seed"]), float(params["farthest_wall_cm"]))
        parts.append(Picture("environments", png(figure), ENVIRONMENTS))
    parts += [
        Picture(f"strategy_{domain}", sources.image("collect", domain, "strategy.png"), f"{domain}: {STRATEGY}")
        for domain in sources.domains
    ]
    by_domain = {domain: tables.walls(sources.collection(domain), domain, thesis) for domain in sources.domains}
    table = pd.concat(by_domain.values(), ignore_index=True)
    rows = [
        [setting_label(row["setting"]), f"{row['mean']:.3f} [{row['low']:.3f}, {row['high']:.3f}]", str(row["n"])]
        for row in table.to_dict("records")
    ]
    parts.append(
        PageTable("walls", table, ["", "success on the own task", "executions"], rows, "95 % Wilson intervals.")
    )
    numbers: dict[str, float] = {}
    for domain, own in by_domain.items():
        numbers |= {f"walls/{plain_setting(row['setting'])}": row["mean"] for row in own.to_dict("records")}
        if len(own) == 2:
            reading = readings.read_walls(thesis.claims["insertion", "walls"], own)
            parts.append(Reading(reading.thesis, f"{domain}: {reading.ours}", reading.agrees))
    return Section(
        "What skills do, and whether they use walls", parts, stage_commands("collect", sources.domains), numbers
    )


def predictors(sources: Sources) -> Section:
    """Scores, reliability and heat maps of each domain's transfer model."""
    thesis = sources.chapter(CHAPTER)
    by_domain = {domain: tables.transfer_scores(sources.scores(domain), domain, thesis) for domain in sources.domains}
    table = pd.concat(by_domain.values(), ignore_index=True)
    cell = {(row["method"], row["setting"], row["metric"]): row for row in table.to_dict("records")}
    keys = list(dict.fromkeys(zip(table["setting"], table["method"], strict=True)))
    rows = [
        [setting_label(setting), method.replace("_", " "), *(_score(cell.get((method, setting, m))) for m in METRICS)]
        for setting, method in keys
    ]
    parts: list[Part] = [
        PROTOCOL,
        *(readings.read_scores(own, "new_test", domain) for domain, own in by_domain.items()),
        PageTable(
            "transfer_model",
            table,
            ["", "predictor", "AUC", "Brier", "log loss", "calibration error"],
            rows,
            "95 % intervals resample held-out tasks; lower is better except for AUC.",
        ),
    ]
    for domain in sources.domains:
        parts += [_reliability(sources, domain), _maps(sources, domain)]
    numbers = {
        f"transfer_model/{domain}/{name}{metric}": cell["model", f"domain={domain};pairs={pairs}", metric]["mean"]
        for domain in sources.domains
        for metric in ("auc", "brier")
        for pairs, name in (("new_test", ""), ("planned", "planned/"))
        if ("model", f"domain={domain};pairs={pairs}", metric) in cell
    }
    return Section("How well transfer is predicted", parts, stage_commands("fit_transfer", sources.domains), numbers)


def _score(row: dict[Hashable, Any] | None) -> str:
    return "–" if row is None else estimate(row["mean"], row["low"], row["high"], digits=3)


def _reliability(sources: Sources, domain: str) -> Picture:
    caption = f"{domain}: how often pairs succeed whose predicted probability is p, on held-out tasks."
    return Picture(f"calibration_{domain}", sources.image("fit_transfer", domain, "calibration.png"), caption)


def _maps(sources: Sources, domain: str) -> Picture:
    data, model = sources.transfer(domain), sources.model(domain)
    order, kinds = task_order(data)
    place = {int(task): rank for rank, task in enumerate(order)}
    skills = sorted(range(len(data.train_task)), key=lambda skill: place[int(data.train_task[skill])])
    tasks = data.train_task[skills]
    panels = {
        "simulated success rate": data.rate[skills][:, order],
        "predicted probability": model.predict(data.features[tasks], data.features[order]),
    }
    rows = block_ticks([kinds[place[int(task)]] for task in tasks])
    figure = transfer_maps(panels, "taught task", "tested task", rows, block_ticks(kinds))
    caption = f"{domain}: every skill of the collected data on every task; most of these tasks were fitted."
    return Picture(f"transfer_{domain}", png(figure), caption)
