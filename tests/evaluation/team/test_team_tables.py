"""Tables of hand-made results, number by number."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from p2l.evaluation.team import tables
from p2l.evaluation.thesis import load_thesis
from tests.evaluation.team.team_results import FOLDER, results, study, summary

THESIS = load_thesis(FOLDER, 3)


def cell(table, method, setting, metric):
    rows = table[(table["method"] == method) & (table["setting"] == setting) & (table["metric"] == metric)]
    assert len(rows) == 1
    return rows.iloc[0]


def all_tables():
    frame = study()
    means = summary(frame)
    scores = [{"method": "model", "pairs": "both_new", "metric": "auc", "mean": None, "low": 0.1, "high": 0.9, "n": 5}]
    return {
        "table_3_1": tables.table_3_1(frame[(frame["level"] == 0) & (frame["regime"] == "high_teaching")], THESIS),
        "table_3_2": tables.table_3_2(frame, THESIS),
        "figure_3_7": tables.figure_3_7(means, {"high_teaching": 0.3, "low_teaching": 0.1}, THESIS),
        "figure_3_10": tables.figure_3_10(means, THESIS),
        "order_any": tables.order_any(frame, "lego", THESIS),
        "prediction_price": tables.prediction_price(frame, "lego", THESIS),
        "transfer_model": tables.transfer_scores(scores, "lego", THESIS),
        "walls": tables.walls({"own_task_success": {"mean": 1.0, "low": 0.9, "high": 1.0, "trials": 30}}, "x", THESIS),
    }


@pytest.mark.parametrize("name", all_tables())
def test_every_table_has_the_promised_columns_and_one_row_per_cell(name):
    table = all_tables()[name]
    assert tuple(table.columns) == tables.COLUMNS
    assert len(table) > 0
    assert not table.duplicated(["method", "setting", "metric"]).any()
    known = table.dropna(subset=["mean", "low"])
    assert ((known["low"] <= known["mean"]) & (known["mean"] <= known["high"])).all()


def test_table_3_1_counts_orders_from_one_and_holds_the_thesis_beside_adl_only():
    frame = results({"adl": [400.0, 500.0], "adl_true": [390.0, 500.0], "ad": [1000.0, 1000.0]}, regime="board")
    frame.loc[(frame["method"] == "adl") & (frame["set"] == 1), "delegated"] = 3.0
    table = tables.table_3_1(frame, THESIS)
    mine = cell(table, "adl", "order=2", "delegated")
    assert (mine["mean"], mine["thesis"], mine["n"]) == (3.0, 2.0, 1)
    assert math.isnan(mine["low"])
    assert math.isnan(cell(table, "adl_true", "order=2", "delegated")["thesis"])
    assert cell(table, "adl_true", "order=1", "executed_cost")["mean"] == 390.0
    assert set(table["method"]) == {"adl", "adl_true"}


def test_table_3_2_by_hand():
    frame = results({"adl": [800.0, 1000.0], "ad": [1000.0, 1000.0]})
    elsewhere = results({"adl": [1.0, 1.0], "ad": [1.0, 1.0]}, level=2)
    table = tables.table_3_2(pd.concat([frame, elsewhere]), THESIS)
    cost = cell(table, "adl", "pretrained=0", "executed_cost")
    half = stats.t.ppf(0.975, 1) * 100.0  # standard error of 800 and 1000
    assert (cost["mean"], cost["thesis"], cost["n"]) == (900.0, 856.0, 2)
    assert cost["low"] == pytest.approx(900.0 - half)
    spread = cell(table, "adl", "pretrained=0", "executed_cost_sd")
    assert spread["mean"] == pytest.approx(math.sqrt(2) * 100.0)
    assert spread["thesis"] == 120.9
    percent = cell(table, "ad", "pretrained=0", "percent_over_adl")
    assert percent["mean"] == pytest.approx(100.0 / 9.0)
    assert percent["thesis"] == 16.8


def test_percent_over_is_exact_where_costs_are_proportional():
    base = np.array([100.0, 250.0, 400.0])
    found = tables.percent_over(1.2 * base, base)
    assert (found.mean, found.low, found.high) == pytest.approx((20.0, 20.0, 20.0))


def test_percent_over_has_the_delta_methods_width():
    cost, base = np.array([110.0, 130.0]), np.array([100.0, 100.0])
    found = tables.percent_over(cost, base)
    half = stats.t.ppf(0.975, 1) * 10.0  # a constant base leaves the cost's own interval, in percent
    assert (found.mean, found.low, found.high) == pytest.approx((20.0, 20.0 - half, 20.0 + half))


def test_figure_3_7_keeps_costly_teaching_only_and_the_threshold():
    table = all_tables()["figure_3_7"]
    assert set(table["setting"]) == {"pretrained=0", "pretrained=2", ""}
    theta = cell(table, "cba_best", "", "theta")
    assert (theta["mean"], theta["thesis"]) == (0.3, 0.2)
    assert cell(table, "ad", "pretrained=0", "excess_cost")["mean"] == 100.0


def test_figure_3_10_names_both_regimes():
    table = all_tables()["figure_3_10"]
    assert cell(table, "adl", "regime=low_teaching;pretrained=2", "executed_cost")["mean"] == 900.0
    assert len(set(table["setting"])) == 4


def test_savings_and_prices_are_paired_differences_from_adl():
    every = all_tables()
    saved = cell(every["order_any"], "adl_any", "domain=lego;regime=high_teaching;pretrained=0", "executed_saving")
    half = stats.t.ppf(0.975, 2) * np.std([100.0, 50.0, 40.0], ddof=1) / math.sqrt(3)
    assert saved["mean"] == pytest.approx(190.0 / 3)
    assert saved["high"] - saved["mean"] == pytest.approx(half)
    price = cell(
        every["prediction_price"], "adl_true", "domain=lego;regime=low_teaching;pretrained=2", "executed_price"
    )
    assert (price["mean"], price["low"], price["high"]) == pytest.approx((10.0, 10.0, 10.0))
    assert set(every["prediction_price"]["metric"]) == {"executed_price"}


def test_rows_of_the_results_may_come_in_any_order():
    frame = study()
    mixed = frame.sample(frac=1.0, random_state=3)
    for make in (tables.order_any, tables.prediction_price):
        assert make(mixed, "lego", THESIS).equals(make(frame, "lego", THESIS))
    assert tables.table_3_2(mixed, THESIS).equals(tables.table_3_2(frame, THESIS))


def test_one_set_gives_means_without_limits():
    frame = results({"adl": [800.0], "ad": [1000.0], "adl_true": [790.0], "adl_any": [700.0]})
    assert tables.table_3_2(frame, THESIS)["low"].isna().all()
    assert tables.order_any(frame, "lego", THESIS)["mean"].tolist() == [100.0, 100.0]


def test_a_score_that_the_data_do_not_define_stays_empty():
    row = all_tables()["transfer_model"].iloc[0]
    assert math.isnan(row["mean"])
    assert row["setting"] == "domain=lego;pairs=both_new"


def test_walls_of_a_world_without_walls_are_one_row():
    assert all_tables()["walls"]["setting"].tolist() == ["domain=x;walls=kept"]
