"""Sentences follow the data: the same claim is confirmed, half confirmed or denied by different results."""

import pandas as pd
import pytest

from p2l.evaluation.team import readings, tables
from p2l.evaluation.thesis import load_thesis
from tests.evaluation.team.team_results import FOLDER, METHODS, results, study, summary

HIGH = "high_teaching"
THESIS = load_thesis(FOLDER, 3)


def levels(*excess, base=(800.0, 900.0, 1000.0)):
    """ADL at `base` on three sets; every baseline `excess` above at level 0, 1, …"""
    frames = []
    for level, more in enumerate(excess):
        costs = {method: [cost + more for cost in base] for method in METHODS}
        frames.append(results({**costs, "adl": list(base)}, HIGH, level))
    return summary(pd.concat(frames))


def test_strict_equal_and_clear_levels_are_counted_apart():
    found = readings.cheapest(levels(100.0, 0.0, -5.0), HIGH)
    assert found == readings.Cheapest(strict=1, ties=1, clear=1, levels=3)


def test_a_lead_that_changes_sign_between_sets_is_not_clear():
    frame = results({"adl": [800.0, 900.0], **{m: [700.0, 1200.0] for m in METHODS if m != "adl"}})
    found = readings.cheapest(summary(frame), HIGH)
    assert (found.strict, found.clear) == (1, 0)


@pytest.mark.parametrize(
    ("excess", "agrees", "words"),
    [
        ((100.0, 50.0), "yes", "cheapest method at 2 of 2 levels by executed"),
        ((100.0, 0.0), "partly", "cheapest method at 1 of 2 levels and equal to the cheapest at 1 by executed"),
        ((-1.0, -1.0), "no", "cheapest method at 0 of 2 levels by executed"),
    ],
)
def test_whether_adl_is_cheapest(excess, agrees, words):
    reading = readings.read_cheapest("claim", levels(*excess), HIGH)
    assert reading.agrees == agrees
    assert words in reading.ours


@pytest.mark.parametrize(("excess", "agrees"), [((300.0, 10.0), "yes"), ((10.0, 300.0), "no")])
def test_whether_the_lead_drops(excess, agrees):
    reading = readings.read_gap("claim", levels(*excess), HIGH)
    assert reading.agrees == agrees
    assert f"from {excess[0]:.0f} at 0 skills to {excess[1]:.0f} at 1" in reading.ours


@pytest.mark.parametrize(
    ("autonomy", "ad", "agrees"), [(10.0, 800.0, "yes"), (5.0, 800.0, "partly"), (5.0, 2000.0, "no")]
)
def test_whether_planners_converge_to_autonomy(autonomy, ad, agrees):
    frame = results({"adl": [800.0, 800.0], "ad": [ad, ad]}, HIGH, level=8).assign(attempts=autonomy)
    reading = readings.read_convergence("claim", summary(frame), HIGH, 10.0)
    assert reading.agrees == agrees
    assert f"attempts {autonomy / 10:.0%} of the tasks" in reading.ours


def test_where_cba_crosses_ad():
    cheap, dear = {"adl": [1.0], "ad": [900.0], "cba": [800.0]}, {"adl": [1.0], "ad": [700.0], "cba": [750.0]}
    frame = pd.concat([results(cheap, HIGH, 0), results(dear, HIGH, 4)])
    assert readings.read_crossing("claim", summary(frame), HIGH).agrees == "yes"
    frame = pd.concat([results(dear, HIGH, 0), results(dear, HIGH, 4)])
    assert readings.read_crossing("claim", summary(frame), HIGH).agrees == "no"


@pytest.mark.parametrize(("theta", "agrees"), [(0.2, "yes"), (0.25, "partly"), (0.6, "no")])
def test_the_threshold_beside_the_thesis(theta, agrees):
    table = tables.figure_3_7(summary(study()), {HIGH: theta}, THESIS)
    assert readings.read_theta("claim", table).agrees == agrees


def board(delegated):
    numbers = {0: (1, 0), 1: (1, 2), 2: (1, 3), 3: (1, 4), 4: (2, 2)}
    frame = results({"adl": [1.0] * 5, "adl_true": [1.0] * 5}, regime="board")
    frame["demos"] = [float(numbers[index][0]) for index in frame["set"]]
    frame["delegated"] = [float(numbers[index][1]) for index in frame["set"]]
    frame.loc[(frame["method"] == "adl") & (frame["set"] == 4), "delegated"] = delegated
    return tables.table_3_1(frame, THESIS)


def test_orders_that_are_reproduced():
    reading = readings.read_orders("claim", board(2.0))
    assert (reading.agrees, reading.ours) == ("yes", "5 of 5 rows are reproduced from the learnt predictor.")


def test_an_order_that_differs_is_named_with_what_the_true_matrix_gives():
    reading = readings.read_orders("claim", board(3.0))
    assert reading.agrees == "partly"
    assert "4 of 5 rows" in reading.ours
    assert "order=5: delegated 3 (thesis 2; with the true transfer matrix 2)" in reading.ours
    assert readings.orders_that_differ(board(3.0)) == ["order=5"]


def test_percentages_agree_when_our_interval_holds_the_thesis():
    wide = results({"adl": [800.0, 912.0], "ad": [1000.0] * 2, "cba": [1000.0, 1612.0], "alm": [1100.0] * 2})
    assert readings.read_percent("claim", tables.table_3_2(wide, THESIS)).agrees == "yes"
    narrow = results({"adl": [500.0, 500.1], "ad": [1000.0] * 2, "cba": [1000.0] * 2, "alm": [1100.0] * 2})
    assert readings.read_percent("claim", tables.table_3_2(narrow, THESIS)).agrees == "no"


@pytest.mark.parametrize(("excess", "agrees"), [((20.0,), "yes"), ((130.0,), "partly"), ((400.0,), "no")])
def test_whether_others_do_as_well_with_cheap_teaching(excess, agrees):
    assert readings.read_low("claim", levels(*excess), HIGH).agrees == agrees


@pytest.mark.parametrize(("excess", "agrees"), [((100.0, 80.0), "yes"), ((100.0, 0.0), "partly"), ((-9.0, 0.0), "no")])
def test_whether_adl_leads_with_costly_teaching(excess, agrees):
    assert readings.read_high("claim", levels(*excess), HIGH).agrees == agrees


@pytest.mark.parametrize(("without", "agrees"), [((0.0, 0.0, 0.1), "yes"), ((0.9, 0.8, 0.95), "no")])
def test_whether_walls_are_used(without, agrees):
    rates = {"own_task_success": (1.0, 0.9, 1.0), "own_task_success_without_walls": without}
    given = {key: dict(zip(("mean", "low", "high"), rate, strict=True)) | {"trials": 30} for key, rate in rates.items()}
    assert readings.read_walls("claim", tables.walls(given, "board", THESIS)).agrees == agrees


def test_savings_tell_how_many_are_clear_and_which_is_largest():
    table = tables.order_any(study(), "lego", THESIS)
    reading = readings.read_saving(table, "executed_saving", "It saves")
    assert reading.ours.startswith("It saves in 0 of 4 settings with a 95 % interval above zero (0 below zero)")
    assert "the largest is 63 [-17, 143] for lego, " in reading.ours
    price = readings.read_saving(tables.prediction_price(study(), "lego", THESIS), "executed_price", "It costs more")
    assert price.ours.startswith("It costs more in 4 of 4 settings with a 95 % interval above zero (0 below zero)")


def scores(**brier):
    rows = [
        {"method": method, "pairs": "new_test", "metric": metric, "mean": value, "low": 0.0, "high": 1.0, "n": 9}
        for method, value in brier.items()
        for metric in ("brier", "auc")
    ]
    return tables.transfer_scores(rows, "lego", THESIS)


def test_the_best_predictor_is_named_whoever_it_is():
    good = readings.read_scores(scores(model=0.1, nearest_neighbour=0.2, constant=0.3), "new_test", "lego")
    poor = readings.read_scores(scores(model=0.4, nearest_neighbour=0.2, constant=0.3), "new_test", "lego")
    assert good.ours.endswith("by Brier score is the model.")
    assert poor.ours.endswith("by Brier score is the nearest neighbour.")
    assert "too few tasks" in readings.read_scores(scores(model=0.1), "both_new", "lego").ours
