"""Predictions that plans rely on, by hand: each pair once, of the plans of one method, with the truth of its block."""

import numpy as np
import pandas as pd
from numpy.testing import assert_array_equal

from p2l.evaluation.transfer.planned import planned_predictions
from p2l.evaluation.transfer.scores import score_table
from p2l.team.execute import Truth

COLUMNS = ["block", "method", "decision", "skill", "task", "p_success"]


def test_each_pair_on_which_a_plan_acts_is_scored_once():
    rows = [
        (0, "adl", "act", 2, 0, 0.9),
        (0, "adl", "act", 2, 0, 0.9),  # another set plans with the same pair
        (0, "adl", "act", 1, 1, 0.2),
        (0, "adl", "learn", 1, 0, 1.0),
        (0, "adl", "delegate", -1, 1, 0.0),
        (0, "cba", "act", 0, 1, 0.7),  # another method's
        (1, "adl", "act", 2, 0, 0.6),
    ]
    truths = {
        0: Truth(np.zeros((3, 2)), np.array([[0, 0], [0, 0.25], [1, 0]])),
        1: Truth(np.zeros((3, 2)), np.full((3, 2), 0.5)),
    }
    found = planned_predictions(pd.DataFrame(rows, columns=COLUMNS), truths, draws=4)
    assert_array_equal(found.p, [0.2, 0.9, 0.6])
    assert_array_equal(found.successes, [1, 4, 2])
    assert len(np.unique(found.test_task)) == 3  # task 0 of block 1 is another one than that of block 0
    assert len(np.unique(found.train_task)) == 3
    table = score_table([found], np.random.default_rng(0)).set_index("metric")
    assert (table["n"] == 3).all()
    brier = np.mean([0.04 - 0.4 * 0.25 + 0.25, 0.81 - 1.8 + 1.0, 0.36 - 1.2 * 0.5 + 0.5])
    assert np.isclose(table.loc["brier", "mean"], brier)
    # Of 7 successes and 5 failures: the first pair's success loses to 2 of 2 others' failures, and so on.
    assert np.isclose(table.loc["auc", "mean"], (1 * 1.5 + 4 * 5 + 2 * (3 + 1)) / (7 * 5))
    assert table.loc["auc", "low"] <= table.loc["auc", "mean"] <= table.loc["auc", "high"]
