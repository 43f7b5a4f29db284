"""Tables 4.1 and 4.2, as long tables beside the thesis's numbers.

Columns are those of `evaluation.rows`.

Intervals of learnt recoveries are over trainings (`statistics.rate_interval`, `mean_interval`); those of the other
strategies, which no training changes, are over episodes.

- `success`: rate.
- `gain`: success minus that of the method `over`, on the same start rows; the bootstrap resamples seeds and within
  them episodes.
- `path_m`: path length of the end effector, m; `path_m_success` of the successful episodes
  alone, and `path_m_success_sd` its standard deviation. The thesis's "cost (m)" is read as the latter two: without
  recovery a third of its episodes ends early, and yet their cost is that of open loop, ± 0.02 m.
- `options`: skills executed in an episode; `recovered`: share of episodes with a skill that is none of the nominal.
- `diverged`: share of episodes whose simulation broke down. They are left out of everything else, and of a gain if
  either of the two did.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from p2l.evaluation.rows import Row, interval_row, rate_row, setting_of, single_row, table_of, trained_row
from p2l.evaluation.statistics import Interval, mean_interval, resample_weights
from p2l.evaluation.thesis import Thesis
from p2l.metareskill.strategy_names import LEARNT, OPEN_LOOP, RECOVERIES

TABLE_4_1, TABLE_4_2 = "table_4_1", "table_4_2"
UNSEEN = "unseen"
RESAMPLES = 2000


def table_4_1(episodes: pd.DataFrame, thesis: Thesis, rng: np.random.Generator) -> pd.DataFrame:
    """Strategies under an estimator that improves, and the gain of learnt recoveries over each of the others.

    Args:
        episodes: of `p2l.metareskill.episodes`, of one place.
        thesis: chapter 4.
        rng: of the bootstrap.
    """
    rows: list[Row] = []
    for method, part in episodes.groupby("method", sort=False):
        rows += _rows(str(method), "", part)
    for other in dict.fromkeys(episodes["method"]):
        if other != RECOVERIES and RECOVERIES in set(episodes["method"]):
            rows += _gains(episodes, str(other), "", rng)
    table = thesis.beside(table_of(rows), TABLE_4_1)
    return _with_gains(table, thesis, TABLE_4_1)


def table_4_2(episodes: pd.DataFrame, unseen: Sequence[str], thesis: Thesis, rng: np.random.Generator) -> pd.DataFrame:
    """Open loop and learnt recoveries on every door with their gain, and the mean gain over doors not trained on.

    Args:
        episodes: of `p2l.metareskill.episodes`; a door each setting.
        unseen: settings behind the row `handle=unseen`.
        thesis: chapter 4.
        rng: of the bootstrap.
    """
    rows: list[Row] = []
    for setting, part in episodes.groupby("setting", sort=False):
        for method, own in part.groupby("method", sort=False):
            rows += _rows(str(method), str(setting), own)
        rows += _gains(part, OPEN_LOOP, str(setting), rng)
    selection = episodes[episodes["setting"].isin(unseen)]
    if len(selection):
        rows += _gains(selection, OPEN_LOOP, f"handle={UNSEEN}", rng)
    return _with_gains(thesis.beside(table_of(rows), TABLE_4_2), thesis, TABLE_4_2)


def paired_gain(success: pd.DataFrame, rng: np.random.Generator, resamples: int = RESAMPLES) -> Interval:
    """Mean of `ours − theirs` over rows, with limits of a bootstrap of seeds and, within each, of its rows.

    Args:
        success: columns `seed, ours, theirs`, one row per pair.
        rng: of the bootstrap.
        resamples: how many.
    """
    away = success["ours"].to_numpy(dtype=float) - success["theirs"].to_numpy(dtype=float)
    seeds = success["seed"].to_numpy()
    groups = [away[seeds == seed] for seed in np.unique(seeds)]
    sizes = np.array([len(group) for group in groups], dtype=float)
    sums = np.stack([resample_weights(len(group), resamples, rng) @ group for group in groups], axis=1)
    weights = resample_weights(len(groups), resamples, rng)
    means = (weights * sums).sum(axis=1) / (weights * sizes).sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(np.asarray(away.mean()), np.asarray(low), np.asarray(high), len(away))


def _rows(method: str, setting: str, part: pd.DataFrame) -> list[Row]:
    """Each seed's rows, then those over all seeds."""
    rows: list[Row] = []
    for seed, own in part.groupby("seed", sort=True):
        rows += _measures(method, setting_of(f"seed={seed}", setting), own)
    return rows + _measures(method, setting, part)


def _measures(method: str, setting: str, part: pd.DataFrame) -> list[Row]:
    sound = part[~part["diverged"]]
    good = sound[sound["success"].astype(bool)]
    rows = [rate_of(method, setting, "success", sound, sound["success"])]
    for name, column, among in (("path_m", "path_m", sound), ("path_m_success", "path_m", good)):
        if len(among):
            rows.append(_mean(method, setting, name, among, column))
    if len(good) > 1:
        rows.append(single_row(method, setting, "path_m_success_sd", float(good["path_m"].std(ddof=1)), len(good)))
    if len(sound):
        rows.append(_mean(method, setting, "options", sound, "options"))
    rows.append(rate_of(method, setting, "recovered", sound, sound["recoveries"] > 0))
    rows.append(rate_of(method, setting, "diverged", part, part["diverged"]))
    return rows


def _gains(episodes: pd.DataFrame, other: str, setting: str, rng: np.random.Generator) -> list[Row]:
    """The gain of `RECOVERIES` over `other`: by seed, then over all seeds."""
    keys = ["seed", "place", "episode"]
    sound = episodes[~episodes["diverged"]].set_index(keys)
    ours, theirs = (sound[sound["method"] == name]["success"] for name in (RECOVERIES, other))
    pairs = pd.concat({"ours": ours, "theirs": theirs}, axis=1, join="inner").reset_index()
    over = setting_of(f"over={other}", setting)
    if not len(pairs):
        return []
    rows = [
        interval_row(RECOVERIES, setting_of(f"seed={seed}", over), "gain", paired_gain(own, rng))
        for seed, own in pairs.groupby("seed", sort=True)
    ]
    return [*rows, interval_row(RECOVERIES, over, "gain", paired_gain(pairs, rng))]


def _with_gains(table: pd.DataFrame, thesis: Thesis, item: str) -> pd.DataFrame:
    """The thesis's gains, where it gives both success rates."""
    references = table["thesis"].to_list()
    for place, row in enumerate(table.to_dict("records")):
        parts = str(row["setting"]).split(";")
        if row["metric"] != "gain" or not parts[0].startswith("over="):
            continue
        rates = [
            thesis.value(item, method, ";".join(parts[1:]), "success")
            for method in (RECOVERIES, parts[0].partition("=")[2])
        ]
        if rates[0] is not None and rates[1] is not None:
            references[place] = rates[0] - rates[1]
    return table.assign(thesis=np.array(references, dtype=float))


def rate_of(method: str, setting: str, metric: str, episodes: pd.DataFrame, hits: pd.Series[bool]) -> Row:
    """A rate with the interval that is due to it: over trainings of learnt recoveries, over episodes of the others."""
    if method in LEARNT:
        return trained_row(method, setting, metric, hits, episodes["seed"])
    return rate_row(method, setting, metric, int(hits.sum()), len(hits))


def _mean(method: str, setting: str, metric: str, episodes: pd.DataFrame, column: str) -> Row:
    values = episodes[column].astype(float)
    groups = [own for _, own in values.groupby(episodes["seed"])] if method in LEARNT else [values]
    return interval_row(method, setting, metric, mean_interval(groups))
