"""Chapter 5: recoveries together with the nominal skills, their learning curves, and their transfer."""

from __future__ import annotations

import math
from collections.abc import Callable

import pandas as pd

from p2l.evaluation.chaining import readings
from p2l.evaluation.chaining.figures import MAIN, learning_curves, option_counts
from p2l.evaluation.chaining.views import CHAPTER, METHODS, absent_section, commands, joint_table, sheet
from p2l.evaluation.page.page import PageTable, Part, Picture, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import plain_setting, setting_label
from p2l.evaluation.sheets import aggregates
from p2l.evaluation.statistics import TRAININGS
from p2l.evaluation.style import png

PROTOCOL_5_1 = (
    "Every learner meets the same start states, none of which learning or choosing a policy has seen. Where a detector "
    "fires, the recovery takes over; RL acts alone, from the start of the task. "
    f"{TRAININGS}"
)
PROTOCOL_5_2 = (
    "Policies of RC, unchanged, from failures that a misplaced shelf induces, or, in robosuite, those of its own "
    "environment with its own controller, its gains matched to the skills' impedance, and its own test of success. The "
    "thesis's rows are 5 attempts each on a real robot."
)
TRAINED = {"revisited": "– episodes from earlier successes", "spared": "– budget not simulated"}  # in training
STEP_METRICS = ("control_steps", "ratio", "reached")


def table_5_1(sources: Sources) -> Section:
    """Overall success of every learner in every world, beside the nominal skills."""
    title = "Table 5.1: overall success with learnt recoveries"
    if not sources.chain_worlds:
        return absent_section(title)
    full, claims = joint_table(sources, "table_5_1"), sources.chapter(CHAPTER).claims
    table = aggregates(full)
    cells = {(row["setting"], row["method"], row["metric"]): row for row in table.to_dict("records")}
    parts: list[Part] = [PROTOCOL_5_1, *readings.of_worlds(claims, cells), *readings.of_order(claims, cells)]
    parts += [*readings.of_laziness(cells), _success("table_5_1", full, cells)]
    numbers = {
        f"table_5_1/{setting.removeprefix('world=')}/{method}/{metric}": float(row["mean"])
        for (setting, method, metric), row in cells.items()
        if not math.isnan(row["mean"])
    }
    return Section(title, parts, commands(sources), numbers)


def figure_5_5(sources: Sources) -> Section:
    """Success during training, and control steps until the thesis's success."""
    title = "Figure 5.5: learning curves"
    if not sources.chain_worlds:
        return absent_section(title)
    full, steps = joint_table(sources, "figure_5_5"), joint_table(sources, "steps_to_thesis")
    table = aggregates(full)
    seeds = int(table["n"].max())
    caption = (
        "Share of evaluation episodes that succeed during training, from failures that training never starts from (RL: "
        f"from the task's start). Mean of {_seeds(seeds)}; bands are 95 % t intervals, none with one seed."
    )
    parts: list[Part] = [
        *readings.of_progress(sources.chapter(CHAPTER).claims, table),
        Picture("figure_5_5", png(learning_curves(table)), caption),
        sheet(
            "figure_5_5", _ends(table), full, "Success at each learner's last evaluation; the curves are in the file."
        ),
    ]
    if len(steps):
        rows = steps[steps["metric"].isin(STEP_METRICS)]
        caption = (
            "Control steps until an evaluation first stands for the thesis's overall success, their ratio to the "
            "thesis's 500,000, and the share of runs that get there; a run that does not counts with all its steps."
        )
        parts.append(sheet("steps_to_thesis", rows, steps, caption))
    return Section(title, parts, commands(sources))


def figure_5_8(sources: Sources) -> Section:
    """Counts of the nominal options while RC learns."""
    title = "Figure 5.8: which nominal options are tried"
    if not sources.chain_worlds:
        return absent_section(title)
    full, claim = joint_table(sources, "figure_5_8"), sources.chapter(CHAPTER).claims["figure_5_8", "commits"]
    full = full[full["method"] == MAIN]
    table = aggregates(full)
    parts: list[Part] = []
    last = []
    for place, world in enumerate(sources.chain_worlds):
        rows = table[table["setting"].str.startswith(f"world={world};")]
        if rows.empty:
            parts.append(f"{world}: RC was not trained.")
            continue
        reading, ends = readings.of_commitment(claim, world, rows)
        last.append(ends)
        caption = f"{world}: how often each nominal option is chosen in a round of PPO; mean over seeds."
        picture = png(option_counts(table, world, MAIN))
        parts += [reading, Picture("figure_5_8" if place == 0 else f"figure_5_8_{world}", picture, caption)]
    if last:
        ends = pd.concat(last, ignore_index=True)
        parts.append(sheet("figure_5_8", ends, full, "Times chosen in a round, mean of the last tenth."))
    return Section(title, parts, commands(sources))


def table_5_2(sources: Sources) -> Section:
    """Transfer of policies to other worlds."""
    title = "Table 5.2: policies where they were not learnt"
    if not sources.chain_worlds:
        return absent_section(title)
    full = joint_table(sources, "table_5_2")
    if not len(full):
        return Section(title, ["Left out: the preset induces no failures elsewhere (experiment.chain.transfer)."])
    claim = sources.chapter(CHAPTER).claims["table_5_2", "transfer"]
    table = aggregates(full)
    rows = table[table["metric"] == "recovery"]
    caption = f"Recovery rate. {TRAININGS} Each training is in the file."
    parts: list[Part] = [PROTOCOL_5_2, readings.of_transfer(claim, rows), sheet("table_5_2", rows, full, caption)]
    numbers = {
        f"table_5_2/{plain_setting(str(row['setting']))}/{row['method']}": float(row["mean"])
        for row in rows.to_dict("records")
        if not math.isnan(row["mean"])
    }
    return Section(title, parts, commands(sources), numbers)


SECTIONS: tuple[Callable[[Sources], Section], ...] = (table_5_1, figure_5_5, figure_5_8, table_5_2)


def _success(name: str, table: pd.DataFrame, cells: readings.Cells) -> PageTable:
    """A row per world, a column per method; the thesis's numbers below ours."""
    names = [str(method) for method in table["method"].unique()]
    methods = sorted(names, key=lambda method: [*METHODS, method].index(method))  # those of one's own come last
    rows = []
    for setting in dict.fromkeys(aggregates(table)["setting"]):
        ours, thesis = [setting_label(setting)], ["– thesis"]
        for method in methods:
            row = cells.get((setting, method, "success"))
            ours.append("–" if row is None else f"{readings.percent(row)}")
            value = math.nan if row is None else float(row["thesis"])
            thesis.append("–" if math.isnan(value) else f"{100.0 * value:.3g} %")
        rows += [ours, thesis]
        for metric, label in TRAINED.items():
            of_method = [cells.get((setting, method, metric)) for method in methods]
            if any(of_method):
                rows.append(
                    [label, *("–" if one is None else f"{100.0 * float(one['mean']):.0f} %" for one in of_method)]
                )
    caption = f"Overall success. {TRAININGS} Recoveries and single trainings are in the file."
    return PageTable(
        name, table, ["", *(METHODS.get(method, f"Nominal + {method}") for method in methods)], rows, caption
    )


def _ends(curves: pd.DataFrame) -> pd.DataFrame:
    """The last point of every curve."""
    place = curves["setting"].str.extract(r"(?P<world>.*);control_steps=(?P<steps>\d+)")
    points = curves.assign(world=place["world"], steps=place["steps"].astype(float))
    last = points.loc[points.groupby(["world", "method"], sort=False)["steps"].idxmax()]
    return last.drop(columns=["world", "steps"])


def _seeds(number: int) -> str:
    return "one seed" if number == 1 else f"{number} seeds"
