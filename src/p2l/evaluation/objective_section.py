"""The section that sets the three decision makers side by side (thesis, eq. 1.2)."""

from __future__ import annotations

import math

import pandas as pd

from p2l.evaluation import objective
from p2l.evaluation.objective import Prices
from p2l.evaluation.page.page import PageTable, Part, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, plain_setting, setting_label
from p2l.evaluation.rows import Row, table_of
from p2l.evaluation.team.tables import HIGH

PRICES = Prices(failure=100.0, query=1.0, control_step=1e-4, tasks=1000.0)
_MAKERS = {
    objective.TEAM: "team plan (chapter 3)",
    objective.SKILLS: "recovery skills (chapter 4)",
    objective.POLICY: "recovery policy (chapter 5)",
}
_AMOUNTS = {"demonstrations": "demonstrations", "queries": "queries", "control_steps": "control steps"}
_LEAD = (
    "Every decision maker chooses what to learn so that what is gained in its tasks exceeds what learning costs "
    "(equation 1.2). All in units of effort, for as many tasks as learning serves; not learning means that the team "
    "acts and delegates only, that a robot carries on, uses the best heuristic, or has its nominal skills alone. "
)
_CAPTION = (
    "gain = without - with; net = gain - cost of learning. 95 % intervals, paired by set or training. Prices: a "
    f"demonstration costs the study's c_demo, a failed task {PRICES.failure:g}, a query of REPS {PRICES.query:g}, a "
    f"simulated control step {PRICES.control_step:g}; the last three are ours, so see from how many tasks on it pays."
)


def one_objective(sources: Sources) -> Section:
    """What learning gained, what it cost, and the net, for each decision maker."""
    table = objective_table(sources)
    groups = table.groupby(["method", "setting"], sort=False)
    cases = [(str(maker), str(setting), case.set_index("metric")) for (maker, setting), case in groups]
    head = ["", "", "tasks", "cost without", "with", "gain", "learning", "its cost", "net", "pays after (tasks)"]
    rows = [[_MAKERS[maker], setting_label(setting), *_cells(case)] for maker, setting, case in cases]
    numbers = {
        f"objective/{maker}/{plain_setting(setting)}": float(case["mean"]["net"]) for maker, setting, case in cases
    }
    parts: list[Part] = [_LEAD, PageTable("objective", table, head, rows, _CAPTION)]
    return Section("One objective (equation 1.2)", parts, metrics=numbers)


def _cells(case: pd.DataFrame) -> list[str]:
    value = {str(metric): row for metric, row in case[["mean", "low", "high"]].iterrows()}
    [amount] = [name for name in _AMOUNTS if name in value]
    tasks = float(value["pays_after"]["mean"])
    return [
        f"{value['served']['mean']:g}",
        *(estimate(*value[name]) for name in ("without", "with", "gain")),
        f"{value[amount]['mean']:.6g} {_AMOUNTS[amount]}",
        estimate(*value["learning_cost"]),
        estimate(*value["net"]),
        "never" if math.isinf(tasks) else f"{math.ceil(tasks)}",
    ]


def objective_table(sources: Sources) -> pd.DataFrame:
    """The rows of every decision maker that the pipeline runs, in the columns of `evaluation.rows`."""
    rows: list[Row] = []
    for domain in sources.domains:
        team = sources.team(domain)
        if team is None or HIGH not in team.study["regimes"]:
            continue
        case = team.results[(team.results["regime"] == HIGH) & (team.results["level"] == 0)]
        if case["set"].nunique() > 1:
            rows += objective.of_team(case, f"domain={domain};instead=ad", team.costs(HIGH)["c_demo"])
    for world in sources.recovery_worlds:
        table = sources.sheet("evaluate_recoveries", world, "table_4_1.csv").fillna({"setting": ""})
        rounds = sources.sheet("learn_recoveries", world, "rounds.csv")
        kept = rounds[rounds["chooser"] == rounds["chooser"].iloc[0]]  # the first one's skills are evaluated
        rows += objective.of_skills(table, world, kept.groupby("seed").size().tolist(), PRICES)
    for world in sources.chain_worlds:
        success = _by_seed(sources, world, "table_5_1", "success").unstack("method")
        if {"rc", "nominal"} <= set(success):
            rows += objective.of_policies(success, world, _steps(sources, world), PRICES)
    return table_of(rows).assign(thesis=math.nan)


def _by_seed(sources: Sources, world: str, name: str, metric: str) -> pd.Series:
    """A metric of every method and seed of a table of `evaluate_chains`."""
    table = sources.sheet("evaluate_chains", world, f"{name}.csv")
    rows = table[table["metric"] == metric]
    seed = rows["setting"].str.extract(r";seed=(\d+)")[0]
    return rows.assign(seed=seed).dropna(subset="seed").set_index(["seed", "method"])["mean"]


def _steps(sources: Sources, world: str) -> list[float]:
    """Control steps that each training of RC simulated: where its learning curve ends."""
    curve = sources.sheet("evaluate_chains", world, "figure_5_5.csv")
    place = curve[curve["method"] == "rc"]["setting"].str.extract(r";seed=(\d+);control_steps=(\d+)").dropna()
    return [float(last) for last in place[1].astype(float).groupby(place[0]).max()]
