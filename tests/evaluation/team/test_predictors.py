"""Predictors side by side: means, paired differences, and rows that join an existing table."""

import numpy as np
import pandas as pd
import pytest

from p2l.evaluation.rows import COLUMNS
from p2l.evaluation.team.metrics import summarise
from p2l.evaluation.team.predictors import PredictorVariant, comparison, further_rows, predictor_figure
from p2l.evaluation.transfer.planned import planned_predictions
from p2l.team.execute import Truth
from tests.evaluation.team.team_results import results

SCORE = {"method": "model", "pairs": "planned", "metric": "auc", "mean": 0.9, "low": 0.8, "high": None, "n": 7}
LEVELS = (0, 2)


def variant(encoding, skills, costs):
    """ADL with these costs of three sets at level 0, ten less at level 2; the truth costs 700, 800, 850."""
    frames = [
        results({"adl": [cost - 5.0 * level for cost in costs], "adl_true": [700.0, 800.0, 850.0]}, level=level)
        for level in LEVELS
    ]
    frame = pd.concat(frames, ignore_index=True)
    return PredictorVariant(encoding, skills, frame, summarise(frame), [SCORE])


@pytest.fixture
def two():
    return [
        variant("difference", "predicted", [900.0, 1000.0, 1100.0]),
        variant("walls", "measured", [800.0, 910.0, 980.0]),
    ]


def value(table, setting, metric, method="adl"):
    [row] = table[(table["setting"] == setting) & (table["metric"] == metric) & (table["method"] == method)].to_dict(
        "records"
    )
    return row


def test_costs_and_paired_differences_by_hand(two):
    table = comparison("insertion", two)
    assert list(table.columns) == list(COLUMNS)
    walls = "domain=insertion;predictor=walls;skills=measured;regime=high_teaching;pretrained=0"
    assert value(table, walls, "executed_cost")["mean"] == pytest.approx(2690 / 3)
    saving = value(table, walls, "executed_saving")
    assert saving["mean"] == pytest.approx((100 + 90 + 120) / 3)
    half = 4.302653 * np.std([100, 90, 120], ddof=1) / np.sqrt(3)
    assert (saving["low"], saving["high"]) == pytest.approx((310 / 3 - half, 310 / 3 + half), rel=1e-6)
    assert value(table, walls, "executed_price")["mean"] == pytest.approx((100 + 110 + 130) / 3)
    late = walls.replace("pretrained=0", "pretrained=2")
    assert value(table, late, "executed_cost")["mean"] == pytest.approx(2690 / 3 - 10)
    true = "domain=insertion;regime=high_teaching;pretrained=0"
    assert value(table, true, "executed_cost", "adl_true")["mean"] == pytest.approx(2350 / 3)
    assert "executed_saving" not in set(table.loc[table["setting"].str.contains("difference"), "metric"])


def test_scores_stand_beside_costs_and_a_limit_that_is_not_defined_is_empty(two):
    row = value(
        comparison("insertion", two), "domain=insertion;predictor=walls;skills=measured;pairs=planned", "auc", "model"
    )
    assert (row["mean"], row["low"], row["n"]) == (0.9, 0.8, 7)
    assert np.isnan(row["high"])


def test_further_rows_are_those_of_the_figures_with_the_predictor_named(two):
    rows = further_rows(two[1], "high_teaching")
    assert set(rows["setting"]) == {f"pretrained={level};predictor=walls;skills=measured" for level in LEVELS}
    assert set(rows["method"]) == {"adl"}
    both = further_rows(two[1])
    assert set(both["setting"]) == {f"regime=high_teaching;{setting}" for setting in rows["setting"]}
    assert list(rows.columns) == list(COLUMNS)


def test_a_line_for_each_predictor_and_one_for_the_truth(two):
    figure = predictor_figure(
        {"on the lattice": two, "off it": two}, "high_teaching", {one.setting: one.encoding for one in two}
    )
    assert [len(axes.lines) for axes in figure.axes] == [3, 3]
    np.testing.assert_allclose(figure.axes[0].lines[1].get_ydata(), [2690 / 3, 2690 / 3 - 10])


def test_another_predictor_is_judged_on_the_pairs_of_these_plans():
    plans = pd.DataFrame(
        {
            "method": "adl",
            "decision": ["act", "act", "learn"],
            "skill": [1, 2, 0],
            "task": [0, 1, 0],
            "block": 0,
            "p_success": [0.9, 0.8, 1.0],
        }
    )
    executing = np.array([[1.0, 0.0], [0.5, 0.0], [0.0, 0.25]])
    truths = {0: Truth(executing, executing)}
    other = np.arange(6.0).reshape(3, 2) / 10
    own = planned_predictions(plans, truths, 4)
    judged = planned_predictions(plans, truths, 4, tables={0: other})
    np.testing.assert_allclose(own.p, [0.9, 0.8])
    np.testing.assert_allclose(judged.p, [other[1, 0], other[2, 1]])
    np.testing.assert_array_equal(judged.successes, [2, 1])
    np.testing.assert_array_equal(judged.test_task, own.test_task)
