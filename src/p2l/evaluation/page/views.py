"""Numbers, settings and commands as they stand on the page."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pandas as pd

from p2l.evaluation.page.page import Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.style import METHODS

FLOW = ("collect", "fit_transfer", "plan", "evaluate_team")
WORLD_FLOW = ("discover", "cluster", "fit_preconditions", "learn_recoveries", "evaluate_recoveries")
CHAIN_FLOW = ("discover", "chain_recoveries", "evaluate_chains")


def estimate(mean: float, low: float = math.nan, high: float = math.nan, digits: int = 0) -> str:
    """`mean [low, high]`; the mean alone without limits, a dash without a mean."""
    if math.isnan(mean):
        return "–"
    if math.isnan(low) or math.isnan(high):
        return f"{mean:g}"
    return f"{mean:z.{digits}f} [{low:z.{digits}f}, {high:z.{digits}f}]"  # z: no minus before zero


def averages(table: pd.DataFrame, method: str, metrics: Sequence[str]) -> list[list[str]]:
    """Rows of a method in a table with `_sd` metrics: ours with intervals, and the thesis's below it if it has any."""
    rows = table[table["method"] == method].set_index("metric")[["mean", "low", "high", "thesis"]].to_dict("index")
    ours, thesis = [METHODS[method].label], ["– thesis"]
    for metric in metrics:
        row, spread = rows[metric], rows[f"{metric}_sd"]
        digits = 0 if metric.endswith("cost") else 1
        limits = "" if math.isnan(row["low"]) else f" [{row['low']:.{digits}f}, {row['high']:.{digits}f}]"
        ours.append(f"{row['mean']:.{digits}f} ± {spread['mean']:.{digits}f}{limits}")
        thesis.append(f"{row['thesis']:g} ± {spread['thesis']:g}")
    return [ours, thesis] if not math.isnan(rows[metrics[0]]["thesis"]) else [ours]


def pivot(table: pd.DataFrame, metric: str, methods: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Head and rows: one row per setting, one column per method."""
    rows = table[table["metric"] == metric]
    cell = {
        (row["setting"], row["method"]): estimate(row["mean"], row["low"], row["high"])
        for row in rows.to_dict("records")
    }
    settings = list(dict.fromkeys(rows["setting"]))
    body = [[setting_label(setting), *(cell.get((setting, method), "–") for method in methods)] for setting in settings]
    return ["", *(METHODS[method].label for method in methods)], body


def setting_label(setting: str) -> str:
    """A setting's values as they stand in a table of the page."""
    labels = [_value_label(*part.split("=", 1)) for part in setting.split(";") if part]
    return ", ".join(dict.fromkeys(labels))


def _value_label(name: str, value: str) -> str:
    labels = {
        "pretrained": f"{value} pre-trained",
        "walls": f"walls {value}",
        "mode": f"mode {value}",
        "regime": value.replace("_", " cost of "),
    }
    return labels.get(name, value.replace("_", " "))


def plain_setting(setting: str) -> str:
    """A setting's values as a path for the tracker, which refuses `=` and `;` in names."""
    return "/".join(part.rpartition("=")[2] for part in setting.split(";"))


def missing(title: str, domains: Sequence[str], sources: Sources) -> Section:
    """The section of domains that the pipeline leaves out."""
    needs, runs = " and ".join(domains), ", ".join(sources.domains) or "none"
    return Section(
        title, [f"Left out: it needs {needs}, and conf/pipeline.yaml runs {runs}. Add what is missing there."]
    )


def stage_commands(last: str, items: Sequence[str]) -> list[str]:
    """The commands of the stages up to `last` for each item, a domain or a world."""
    flow = next(one for one in (FLOW, WORLD_FLOW, CHAIN_FLOW) if last in one)
    return [
        f"python -m stages.{stage} -cp data/config/{item} -cn {stage} hydra.run.dir=data/{stage}/{item}"
        for item in items
        for stage in flow[: flow.index(last) + 1]
    ]
