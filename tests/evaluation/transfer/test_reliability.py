"""A figure is drawn from its table, whole or not at all."""

import numpy as np
import pytest
from matplotlib.image import imread

from p2l.evaluation.transfer.reliability import reliability_diagram
from p2l.evaluation.transfer.scores import Predictions, calibration_table


def _predictions(method, p):
    number = np.arange(len(p))
    return Predictions(method, "new_test", np.array(p), number % 3, 4, number, number)


def test_reliability_diagram_shows_each_method_and_tolerates_empty_bins(tmp_path):
    table = calibration_table([_predictions("model", [0.05, 0.07, 0.93]), _predictions("constant", [0.4, 0.4, 0.4])])
    both, one = tmp_path / "both.png", tmp_path / "one.png"
    reliability_diagram(table, ("model", "constant"), "plane", both)
    reliability_diagram(table, ("model",), "plane", one)
    first, second = imread(both), imread(one)
    assert first.shape == second.shape
    assert np.abs(first - second).max() > 0.1
    assert first.std() > 0.05


def test_a_failed_drawing_leaves_nothing_behind(tmp_path):
    table = calibration_table([_predictions("model", [0.5])]).drop(columns="rate")
    with pytest.raises(KeyError):
        reliability_diagram(table, ("model",), "plane", tmp_path / "figure.png")
    assert list(tmp_path.iterdir()) == []
