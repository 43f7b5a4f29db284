"""Success within so many skills, and within so long a way of the hand: who gets there soon, and not only at all.

The thesis reports success at ten skills and the mean cost of successes, which hide whether a strategy needs four skills
or nine. Columns of the table are those of `evaluation.rows`; metrics are `success_within_skills` (setting `skills=…`)
and `success_within_way` (setting `way_m=…`, metres that the hand has moved). Intervals are those of table 4.1.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from p2l.evaluation.metareskill.figures import name_label
from p2l.evaluation.metareskill.tables import rate_of
from p2l.evaluation.rows import Row, table_of
from p2l.evaluation.style import label_ends, plain
from p2l.evaluation.thesis import Thesis
from p2l.metareskill.strategy_names import RECOVERIES

TABLE = "success_within"
SKILLS, WAY = "success_within_skills", "success_within_way"
STEP_M = 0.1
COLOURS = {RECOVERIES: "#0072B2"}
OTHERS = ("#E69F00", "#009E73", "#CC79A7", "#D55E00", "0.45", "#56B4E9")


def success_within(episodes: pd.DataFrame, thesis: Thesis) -> pd.DataFrame:
    """Of every strategy, the share of episodes that succeeded within each number of skills, and within each way.

    Args:
        episodes: of `p2l.metareskill.episodes`, of one place.
        thesis: chapter 4.
    """
    sound = episodes[~episodes["diverged"]]
    good = sound["success"].astype(bool)
    rows: list[Row] = []
    if len(sound):
        most = int(sound["options"].max())
        farthest = int(np.ceil(sound["path_m"][good].max() / STEP_M)) if good.any() else 0
        for method, part in sound.groupby("method", sort=False):
            won = part["success"].astype(bool)
            for count in range(1, most + 1):
                hits = won & (part["options"] <= count)
                rows.append(rate_of(str(method), f"skills={count}", SKILLS, part, hits))
            for step in range(1, farthest + 1):
                hits = won & (part["path_m"] <= step * STEP_M)
                rows.append(rate_of(str(method), f"way_m={step * STEP_M:.1f}", WAY, part, hits))
    return thesis.beside(table_of(rows), TABLE)


def draw_within(table: pd.DataFrame, title: str) -> Figure:
    """The table as two panels, with bands of the 95 % intervals."""
    figure = Figure(figsize=(10.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    methods = list(dict.fromkeys(table["method"]))
    others = iter(OTHERS * (1 + len(methods) // len(OTHERS)))
    colours = {method: COLOURS.get(method) or next(others) for method in methods}
    kinds: list[tuple[str, Callable[[str], float]]] = [(SKILLS, float), (WAY, float)]
    for axes, (metric, number) in zip((left, right), kinds, strict=True):
        ends = []
        for method in methods:
            part = table[(table["method"] == method) & (table["metric"] == metric)]
            if not len(part):
                continue
            at = [number(setting.partition("=")[2]) for setting in part["setting"]]
            line = {"color": colours[method], "lw": 2.6 if method == RECOVERIES else 1.5}
            axes.plot(at, part["mean"], drawstyle="steps-post", **line)
            axes.fill_between(at, part["low"], part["high"], color=line["color"], alpha=0.15, lw=0, step="post")
            ends.append((at[-1], float(part["mean"].iloc[-1]), name_label(method), str(line["color"])))
        plain(axes)
        if axes is right:
            label_ends(axes, ends)
    left.set(xlabel="skills executed", ylabel="share of episodes that have succeeded", ylim=(0.0, 1.02))
    right.set(xlabel="way of the hand, m")
    figure.suptitle(title)
    return figure
