"""Shared parts of the sections of chapter 5."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pandas as pd

from p2l.evaluation.chaining.figures import LEARNERS
from p2l.evaluation.page.page import PageTable, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.page.views import estimate, setting_label, stage_commands

CHAPTER, STAGE = 5, "evaluate_chains"
METHODS = {
    "nominal": "Nominal",
    **{name: f"Nominal + {style.label}" for name, style in LEARNERS.items()},
    "rl": "RL",
    "constant_macro": "Nominal + best macro, always",
    "any_macro": "Nominal + any macro (ceiling)",
}


def sheet(name: str, rows: pd.DataFrame, table: pd.DataFrame, caption: str) -> PageTable:
    """Some rows on the page, all of them in the file."""
    cells = [
        [
            METHODS.get(str(row["method"]), str(row["method"])),
            setting_label(str(row["setting"])),
            str(row["metric"]).replace("_", " "),
            _estimate(row),
            "–" if math.isnan(row["thesis"]) else f"{row['thesis']:.3g}",
            str(row["n"]),
        ]
        for row in rows.to_dict("records")
    ]
    return PageTable(name, table, ["", "", "", "ours", "thesis", "n"], cells, caption)


def _estimate(row: dict[Any, Any]) -> str:
    digits = 0 if row["metric"] == "control_steps" else 2
    return estimate(float(row["mean"]), float(row["low"]), float(row["high"]), digits=digits)


def joint_table(sources: Sources, name: str) -> pd.DataFrame:
    """The worlds' tables, one below the other."""
    tables = [sources.sheet(STAGE, world, f"{name}.csv") for world in sources.chain_worlds]
    full = [table for table in tables if len(table)]
    return pd.concat(full, ignore_index=True) if full else tables[0]


def commands(sources: Sources) -> Sequence[str]:
    """Commands that make chapter 5's data."""
    return stage_commands(STAGE, sources.chain_worlds)


def absent_section(title: str) -> Section:
    """The section of a pipeline without worlds of chapter 5."""
    return Section(title, ["Left out: conf/pipeline.yaml names no chain_worlds. Add them there."])
