"""Tables 4.1 and 4.2 and the data of figures 4.6 and 4.7, on data made by hand."""

import numpy as np
import pandas as pd
import pytest

from p2l.errors import ArtifactError
from p2l.evaluation.metareskill.curves import draw_4_6, draw_4_7, figure_4_6, figure_4_7
from p2l.evaluation.metareskill.evaluation import read_curves
from p2l.evaluation.metareskill.tables import paired_gain, table_4_1, table_4_2
from p2l.evaluation.metareskill.within import SKILLS, WAY, draw_within, success_within
from p2l.evaluation.rows import COLUMNS
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.thesis import load_thesis
from p2l.manifest import write_manifest


@pytest.fixture(scope="module")
def thesis():
    return load_thesis("data/thesis", 4)


def episodes(method, seed, successes, count=10, setting="", broken=()):
    rows = {
        "episode": np.arange(count),
        "success": np.arange(count) < successes,
        "diverged": np.isin(np.arange(count), broken),
        "path_m": 0.5 + 0.1 * np.arange(count),
        "options": 3,
        "recoveries": (np.arange(count) >= successes).astype(int),
    }
    return pd.DataFrame(rows).assign(place="door", setting=setting, method=method, seed=seed)


def cell(table, method, metric, setting=""):
    rows = table[(table["method"] == method) & (table["metric"] == metric) & (table["setting"] == setting)]
    [row] = rows.to_dict("records")
    return row


def test_table_4_1_keeps_seeds_pools_them_and_pairs_strategies_by_start_row(thesis):
    parts = [episodes("recoveries", 0, 9), episodes("recoveries", 1, 10)]
    parts += [episodes("open_loop", 0, 6), episodes("open_loop", 1, 8, broken=(9,))]
    table = table_4_1(pd.concat(parts, ignore_index=True), thesis, np.random.default_rng(0))
    assert tuple(table.columns) == COLUMNS
    assert cell(table, "recoveries", "success", "seed=0")["mean"] == 0.9
    over = cell(table, "recoveries", "success")
    assert (over["mean"], over["n"], over["thesis"]) == (pytest.approx(0.95), 2, 0.924)
    assert (over["low"], over["high"]) == (pytest.approx(0.95 - 12.7062047 * 0.05), 1.0)  # t of 90 and 100 %
    base = cell(table, "open_loop", "success")  # no training changes it
    assert (base["n"], base["low"]) == (19, float(wilson_interval(14, 19)[0]))  # one broke down
    assert [cell(table, name, "path_m")["n"] for name in ("recoveries", "open_loop")] == [2, 19]
    assert cell(table, "open_loop", "diverged")["mean"] == 0.05
    gain = cell(table, "recoveries", "gain", "over=open_loop")
    assert (gain["mean"], gain["n"]) == (pytest.approx(4 / 19), 19)  # 3 of 10 rows, and 1 of 9
    assert gain["low"] <= gain["mean"] <= gain["high"]
    assert gain["thesis"] == pytest.approx(0.214)
    assert cell(table, "recoveries", "path_m", "seed=1")["mean"] == pytest.approx(0.95)
    assert cell(table, "recoveries", "path_m_success", "seed=0")["mean"] == pytest.approx(0.9)
    assert cell(table, "recoveries", "recovered", "seed=0")["mean"] == pytest.approx(0.1)


def test_table_4_2_has_a_gain_for_each_door_and_one_for_all_unseen_ones(thesis):
    doors = {"handle=1": (8, 9), "handle=2": (5, 9), "handle=3": (7, 9), "simulator=robosuite": (6, 7)}
    parts = [
        episodes(method, 0, count, setting=setting).assign(place=setting)
        for setting, counts in doors.items()
        for method, count in zip(("open_loop", "recoveries"), counts, strict=True)
    ]
    unseen = ["handle=2", "handle=3"]
    table = table_4_2(pd.concat(parts, ignore_index=True), unseen, thesis, np.random.default_rng(0))
    assert cell(table, "recoveries", "gain", "over=open_loop;handle=2")["mean"] == pytest.approx(0.4)
    assert cell(table, "recoveries", "gain", "over=open_loop;handle=2")["thesis"] == pytest.approx(0.3)
    both = cell(table, "recoveries", "gain", "over=open_loop;handle=unseen")
    assert (both["mean"], both["n"], both["thesis"]) == (pytest.approx(0.3), 20, 0.175)
    assert cell(table, "recoveries", "success", "simulator=robosuite")["mean"] == 0.7
    assert not len(table_4_2(pd.concat(parts).iloc[:0], unseen, thesis, np.random.default_rng(0)))


def test_success_within_counts_what_has_succeeded_by_then(thesis):
    one, other = episodes("recoveries", 0, 6, broken=(9,)), episodes("recoveries", 1, 6, broken=(9,))
    parts = [part.assign(options=[3, 3, 4, 4, 4, 6, 6, 6, 6, 6]) for part in (one, other, episodes("retry", 0, 0))]
    table = success_within(pd.concat(parts, ignore_index=True), thesis)
    assert tuple(table.columns) == COLUMNS
    rates = {count: cell(table, "recoveries", SKILLS, f"skills={count}")["mean"] for count in range(1, 7)}
    assert rates == pytest.approx({1: 0.0, 2: 0.0, 3: 2 / 9, 4: 5 / 9, 5: 5 / 9, 6: 6 / 9})
    assert cell(table, "recoveries", WAY, "way_m=0.7")["mean"] == pytest.approx(3 / 9)  # 0.5, 0.6 and 0.7 m
    assert cell(table, "recoveries", WAY, "way_m=1.0")["mean"] == pytest.approx(6 / 9)
    assert cell(table, "recoveries", SKILLS, "skills=4")["n"] == 2  # trainings
    assert cell(table, "retry", SKILLS, "skills=6")["high"] == pytest.approx(wilson_interval(0, 10)[1])
    assert not len(success_within(parts[0].iloc[:0], thesis))
    assert len(draw_within(table, "door").axes) == 2


def test_the_bootstrap_of_a_gain_draws_seeds_and_rows():
    rng = np.random.default_rng(0)
    alike = pd.DataFrame({"seed": np.repeat([0, 1], 50), "ours": 1.0, "theirs": 0.0})
    found = paired_gain(alike, rng)
    assert (found.mean, found.low, found.high, found.n) == (1.0, 1.0, 1.0, 100)
    apart = alike.assign(theirs=np.repeat([0.0, 1.0], 50))  # all of the spread is between seeds
    found = paired_gain(apart, rng)
    assert (found.low, found.mean, found.high) == (0.0, 0.5, 1.0)


@pytest.fixture(scope="module")
def values():
    curves = {
        ("metareskill", 0): [-9.0, -5.0, -4.0, -4.0],
        ("metareskill", 1): [-9.0, -6.0, -4.0, -2.0],
        ("round_robin", 0): [-9.0, -8.0, -6.0, -5.0],
        ("round_robin", 1): [-9.0, -8.0, -4.0, -4.0],
    }
    rows = [(seed, name, k, value) for (name, seed), curve in curves.items() for k, value in enumerate(curve)]
    return pd.DataFrame(rows, columns=["seed", "chooser", "queries", "value"])


def test_figure_4_7_compares_choosers_by_seed(values, thesis):
    table = figure_4_7(values, "metareskill", thesis)
    assert cell(table, "metareskill", "value", "queries=3")["mean"] == -3.0
    assert cell(table, "round_robin", "value", "seed=1;queries=1")["mean"] == -8.0
    assert cell(table, "metareskill", "final_gain", "over=round_robin")["mean"] == pytest.approx(1.5)
    shares = [cell(table, "metareskill", "budget_share", f"seed={seed};over=round_robin")["mean"] for seed in (0, 1)]
    assert shares == pytest.approx([1 / 3, 2 / 3])  # seed 0 is as good after one query of three, seed 1 after two
    better = cell(table, "metareskill", "better", "over=round_robin")
    assert (better["mean"], better["n"], better["thesis"]) == (1.0, 2, 1.0)
    assert cell(table, "metareskill", "within_70_percent", "over=round_robin")["mean"] == 1.0


def test_figures_are_drawn_from_their_tables_alone(values, thesis, tmp_path):
    rows = [
        (s, c, m, t, s + m, 0.5) for s in (0, 1) for c in ("metareskill", "round_robin") for m in (0, 1) for t in "ab"
    ]
    allocation = pd.DataFrame(rows, columns=["seed", "chooser", "mode", "target", "trained", "q"])
    made = {"4_6": figure_4_6(values, allocation, ["metareskill", "round_robin"], thesis)}
    made["4_7"] = figure_4_7(values, "metareskill", thesis)
    assert cell(made["4_6"], "metareskill", "trained", "mode=1;target=a")["mean"] == 1.5
    for name, table in made.items():
        table.to_csv(tmp_path / f"{name}.csv", index=False, float_format="%.6g")
    left, right = draw_4_6(pd.read_csv(tmp_path / "4_6.csv"), "door").axes
    assert len(left.lines) == 1  # round-robin alone saturates
    assert sorted(bar.get_height() for bar in right.patches) == [0.5] * 4 + [1.5] * 4
    [axes] = draw_4_7(pd.read_csv(tmp_path / "4_7.csv"), "door").axes
    assert [list(line.get_ydata()) for line in axes.lines[:2]] == [[-9.0, -5.5, -4.0, -3.0], [-9.0, -8.0, -5.0, -4.5]]
    assert axes.get_xlabel() == "REPS queries"


def test_curves_without_a_column_or_a_seed_are_refused(tmp_path):
    with pytest.raises(ArtifactError, match=r"stages\.learn_recoveries"):
        read_curves(tmp_path, [0])
    path = tmp_path / "figure_4_7.csv"
    values = pd.DataFrame([[0, "ucb1", 0, -9.0]], columns=["seed", "chooser", "queries", "value"])
    names = ["seed", "chooser", "mode", "target", "trained", "q"]
    pd.DataFrame([[0, "ucb1", 0, "a", 0, 0.5]], columns=names).to_csv(tmp_path / "figure_4_6.csv", index=False)
    values.drop(columns="value").to_csv(path, index=False)
    with pytest.raises(ArtifactError, match=r"no manifest\.json"):
        read_curves(tmp_path, [0])
    write_manifest(tmp_path)
    with pytest.raises(ArtifactError, match="lacks columns value"):
        read_curves(tmp_path, [0])
    values.to_csv(path, index=False)
    with pytest.raises(ArtifactError, match="not as its stage wrote it"):
        read_curves(tmp_path, [0])
    write_manifest(tmp_path)
    assert [len(table) for table in read_curves(tmp_path, [0])] == [1, 1]
    with pytest.raises(ArtifactError, match=r"nothing of seeds \[1\]"):
        read_curves(tmp_path, [0, 1])
